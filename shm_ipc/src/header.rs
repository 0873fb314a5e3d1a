//! The header of a frame: a fixed layout in shared memory, the same for every language.

use std::fmt;
use std::mem::{offset_of, size_of};

use bitflags::bitflags;
use iceoryx2::prelude::ZeroCopySend;
use thiserror::Error;

use crate::pixel_format::{PixelFormat, UnknownPixelFormat};

/// "UVCM" in memory: the first four bytes of every header.
pub const MAGIC: u32 = u32::from_le_bytes(*b"UVCM");

/// Version of the contract, in the header and in the names of the services. A change of layout or meaning raises it.
pub const CONTRACT_VERSION: u16 = 2;

/// Largest width and height of a frame, in pixels: a bound against nonsense, above any camera.
pub(crate) const LARGEST_SIDE: u32 = 65_535;

/// What is to be known of a frame besides its pixels. The layout is part of the contract.
///
/// Three cache lines of 64 bytes, little-endian, each for one question; reserved bytes are zero and leave each room to grow:
///
/// | bytes | line | why together |
/// | --- | --- | --- |
/// | 0..64 | what the picture is | all that a consumer must check before it touches a pixel lies in the line that it loads first |
/// | 64..128 | which frame it is | order and loss; changes with every frame |
/// | 128..192 | when it was | stamps; `send_monotonic_ns` is written last |
///
/// The header sits directly before the pixels; its size is a multiple of 64, so pixels begin on a cache line.
///
/// Any bytes are a valid `FrameHeader` in memory; [`FrameHeader::validate`] tells whether they make sense.
///
/// # Loss
///
/// `produced` runs on across epochs and across drivers, also killed ones. What a consumer lost between two frames is the difference of
/// their `produced` minus one, whatever the reason: never whole, never published, or read too late. (How many frames were published in
/// between, within one epoch, is the difference of `sequence` minus one.) Where `counting` differs, the count began anew: the consumer
/// lost `produced - 1` frames of the new count, and nothing tells what the old one ended with. That happens only where the camera's page
/// in `/dev/shm` was removed while no driver ran.
///
/// Frames between two streams are produced for nobody and not counted: of a camera that is closed, and those taken for a mask in
/// generate-mode.
#[derive(Debug, Clone, Copy, PartialEq, Default, ZeroCopySend)]
#[repr(C)]
#[repr(align(64))]
#[type_name("uvcam::FrameHeader")]
#[non_exhaustive]
pub struct FrameHeader {
    /// [`MAGIC`].
    pub magic: u32,
    /// [`CONTRACT_VERSION`].
    pub contract_version: u16,
    /// Bytes of this header.
    pub header_size: u16,
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Bytes from the start of one row to the start of the next.
    pub stride: u32,
    /// PFNC code; [`FrameHeader::pixel_format`] reads it.
    pub pixel_format: u32,
    /// What was done to the frame and where it comes from.
    pub flags: Flags,
    /// Zero.
    pub(crate) reserved_picture: u32,
    /// Identity of the mask that was applied ([`Flags::MASKED`]) or travels beside the frame ([`Flags::MASK_ATTACHED`]); all zero where
    /// the camera flies without.
    pub mask_id: [u8; 16],
    /// Exposure time in us, as read back from the camera.
    pub exposure_us: f64,
    /// Gain in dB, as read back from the camera.
    pub gain_db: f64,

    /// Identity of an uninterrupted stream: new at every start of the driver and every reconnection of the camera. CLOCK_REALTIME
    /// in ns when the stream began; one more than the epoch before where that clock was set back, so that it rises.
    pub epoch: u64,
    /// Place among the published frames of this epoch, from 0.
    pub sequence: u64,
    /// The device's own count of this frame in this epoch, from 0, widened so that it does not wrap.
    pub device_frame_id: u64,
    /// Identity of the count `produced`: CLOCK_REALTIME in ns when it began. Written by
    /// [`Publisher::publish`](crate::Publisher::publish).
    pub counting: u64,
    /// Frames that the device is known to have produced up to and including this one, published or not: what a loss is told from. Written
    /// by [`Publisher::publish`](crate::Publisher::publish).
    pub produced: u64,
    /// Zero.
    pub(crate) reserved_order: [u64; 3],

    /// Time between frames in ns, as read back from the camera.
    pub frame_period_ns: u64,
    /// The device's own clock at this frame, in ns from an arbitrary start; 0 with [`Flags::NO_DEVICE_CLOCK`] where it has none.
    pub device_timestamp_ns: u64,
    /// CLOCK_MONOTONIC in ns when the driver had the whole frame.
    pub arrival_monotonic_ns: u64,
    /// CLOCK_MONOTONIC in ns when the frame was sent. Written by [`Publisher::publish`](crate::Publisher::publish).
    pub send_monotonic_ns: u64,
    /// CLOCK_MONOTONIC in ns at the middle of the exposure.
    pub mid_exposure_monotonic_ns: u64,
    /// CLOCK_REALTIME in ns at the middle of the exposure.
    pub mid_exposure_realtime_ns: u64,
    /// Half width in ns of the interval around either mid-exposure stamp that holds the true time.
    pub mid_exposure_uncertainty_ns: u64,
    /// Zero.
    pub(crate) reserved_time: u64,
}

macro_rules! assert_offsets {
    ($($field:ident: $offset:literal),+ $(,)?) => {
        $(const _: () = assert!(offset_of!(FrameHeader, $field) == $offset);)+
    };
}

assert_offsets! {
    magic: 0, contract_version: 4, header_size: 6, width: 8, height: 12, stride: 16, pixel_format: 20, flags: 24,
    reserved_picture: 28, mask_id: 32, exposure_us: 48, gain_db: 56,
    epoch: 64, sequence: 72, device_frame_id: 80, counting: 88, produced: 96, reserved_order: 104,
    frame_period_ns: 128, device_timestamp_ns: 136, arrival_monotonic_ns: 144, send_monotonic_ns: 152,
    mid_exposure_monotonic_ns: 160, mid_exposure_realtime_ns: 168, mid_exposure_uncertainty_ns: 176, reserved_time: 184,
}
const _: () = assert!(size_of::<FrameHeader>() == 192 && align_of::<FrameHeader>() == 64);

impl FrameHeader {
    /// A header for frames of one shape: magic, version, size and shape filled, all else zero.
    ///
    /// `width` in pixels, `height` in rows, `stride` in bytes from row to row.
    pub fn new(width: u32, height: u32, stride: u32, pixel_format: PixelFormat) -> Self {
        FrameHeader {
            magic: MAGIC,
            contract_version: CONTRACT_VERSION,
            header_size: size_of::<FrameHeader>() as u16,
            width,
            height,
            stride,
            pixel_format: pixel_format.code(),
            ..FrameHeader::default()
        }
    }

    /// Sets or clears `flag`.
    pub fn set_flag(&mut self, flag: Flags, on: bool) {
        self.flags.set(flag, on);
    }

    /// Records the mask that was applied, with [`Flags::MASKED`]; `None` where none was.
    pub fn set_mask(&mut self, mask_id: Option<[u8; 16]>) {
        self.mask_id = mask_id.unwrap_or_default();
        self.set_flag(Flags::MASKED, mask_id.is_some());
        self.set_flag(Flags::MASK_ATTACHED, false);
    }

    /// Records the mask that travels beside the frame and was not applied, with [`Flags::MASK_ATTACHED`].
    pub fn set_attached_mask(&mut self, mask_id: [u8; 16]) {
        self.mask_id = mask_id;
        self.set_flag(Flags::MASKED, false);
        self.set_flag(Flags::MASK_ATTACHED, true);
    }

    /// Whether there is a mask for the frame, be it applied or not.
    pub fn has_mask(&self) -> bool {
        self.flags.intersects(Flags::MASKED | Flags::MASK_ATTACHED)
    }

    /// The pixel format.
    ///
    /// # Errors
    /// [`HeaderError::PixelFormat`] where the code is not part of the contract.
    pub fn pixel_format(&self) -> Result<PixelFormat, HeaderError> {
        Ok(PixelFormat::try_from(self.pixel_format)?)
    }

    /// Checks that the header can be trusted for a payload of `payload_len` bytes, and returns how many of them are the image:
    /// `stride * (height - 1) + width * bytes_per_pixel`.
    ///
    /// To be called on a copy: who publishes may write to shared memory at any time.
    ///
    /// # Errors
    /// [`HeaderError`] names the first field that is wrong.
    pub fn validate(&self, payload_len: usize) -> Result<usize, HeaderError> {
        if self.magic != MAGIC {
            return Err(HeaderError::Magic(self.magic));
        }
        if self.contract_version != CONTRACT_VERSION {
            return Err(HeaderError::ContractVersion(self.contract_version));
        }
        if usize::from(self.header_size) != size_of::<FrameHeader>() {
            return Err(HeaderError::HeaderSize(self.header_size));
        }
        let bytes_per_pixel = self.pixel_format()?.bytes_per_pixel() as u64;
        let FrameHeader { width, height, stride, .. } = *self;
        let sane = 1..=LARGEST_SIDE;
        if !sane.contains(&width) || !sane.contains(&height) {
            return Err(HeaderError::Size { width, height });
        }
        let row_bytes = u64::from(width) * bytes_per_pixel;
        if row_bytes > u64::from(stride) {
            return Err(HeaderError::Stride { stride, row_bytes });
        }
        // Below 2^32 * 2^16 + 2^17: no overflow in 64 bits.
        let image_bytes = u64::from(stride) * u64::from(height - 1) + row_bytes;
        match usize::try_from(image_bytes) {
            Ok(bytes) if bytes <= payload_len => Ok(bytes),
            _ => Err(HeaderError::Payload { image_bytes, payload_len }),
        }
    }
}

/// Bits of [`FrameHeader::flags`].
#[derive(Clone, Copy, PartialEq, Eq, Default, ZeroCopySend)]
#[repr(C)]
pub struct Flags(u32);

bitflags! {
    impl Flags: u32 {
        /// A mask was applied, and what it masks is black: [`FrameHeader::mask_id`] tells which.
        const MASKED = 1;
        /// The frame was rendered, not taken.
        const SIMULATED = 1 << 1;
        /// The frame was read from a file.
        const REPLAYED = 1 << 2;
        /// Parts of the frame are missing.
        const INCOMPLETE = 1 << 3;
        /// The device has no clock: [`FrameHeader::device_timestamp_ns`] says nothing.
        const NO_DEVICE_CLOCK = 1 << 4;
        /// A mask was not applied and travels beside the frame: the own airframe is in sight, and [`FrameHeader::mask_id`] tells which
        /// mask shows where.
        const MASK_ATTACHED = 1 << 5;
        // Another process wrote them: any bit may be set.
        const _ = !0;
    }
}

impl Flags {
    /// No flag.
    pub const NONE: Flags = Flags::empty();
}

impl fmt::Debug for Flags {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{:#x} [", self.bits())?;
        bitflags::parser::to_writer(self, &mut *formatter)?;
        write!(formatter, "]")
    }
}

/// Why a header is not to be trusted.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum HeaderError {
    /// Not a header of this contract.
    #[error("magic {0:#010x} is not {MAGIC:#010x} (\"UVCM\"): not a frame of uvcam")]
    Magic(u32),
    /// Another version of the contract.
    #[error("contract version {0} is not {CONTRACT_VERSION}: use driver and consumer of one version")]
    ContractVersion(u16),
    /// A header of another size.
    #[error("a header of {0} bytes is not one of {size} bytes", size = size_of::<FrameHeader>())]
    HeaderSize(u16),
    /// A pixel format that is not part of the contract.
    #[error(transparent)]
    PixelFormat(#[from] UnknownPixelFormat),
    /// A side of zero, or of more pixels than any camera has.
    #[error("{width}x{height} is no size: 1 to {LARGEST_SIDE} pixels a side")]
    Size {
        /// Width in pixels.
        width: u32,
        /// Height in rows.
        height: u32,
    },
    /// Rows that overlap.
    #[error("stride {stride} is below the {row_bytes} bytes of a row")]
    Stride {
        /// Bytes from row to row.
        stride: u32,
        /// Bytes of the pixels of a row.
        row_bytes: u64,
    },
    /// An image that reaches beyond its payload.
    #[error("an image of {image_bytes} bytes does not fit in a payload of {payload_len} bytes")]
    Payload {
        /// Bytes from the first pixel to the last.
        image_bytes: u64,
        /// Bytes there are.
        payload_len: usize,
    },
}

#[cfg(test)]
mod tests;
