//! A frame in a program's hands, and its header.

use std::mem::{offset_of, size_of};

use uvcam_shm_ipc::{CONTRACT_VERSION, Flags, Frame, FrameHeader, PixelFormat};

use crate::argument;
use crate::error::{Failure, UVCAM_OK, call, uvcam_status};
use crate::handle::Table;

/// Version of the contract between driver and consumers that this library speaks.
pub const UVCAM_CONTRACT_VERSION: u16 = 2;
/// Flag of a frame: a mask was applied, and what it masks is black; `mask_id` tells which.
pub const UVCAM_FLAG_MASKED: u32 = 1;
/// Flag of a frame: it was rendered, not taken.
pub const UVCAM_FLAG_SIMULATED: u32 = 2;
/// Flag of a frame: it was read from a file.
pub const UVCAM_FLAG_REPLAYED: u32 = 4;
/// Flag of a frame: parts of it are missing.
pub const UVCAM_FLAG_INCOMPLETE: u32 = 8;
/// Flag of a frame: the device has no clock, and `device_timestamp_ns` says nothing.
pub const UVCAM_FLAG_NO_DEVICE_CLOCK: u32 = 16;
/// Flag of a frame: a mask was not applied and travels beside the frame; `mask_id` tells which.
pub const UVCAM_FLAG_MASK_ATTACHED: u32 = 32;
/// Pixel format, as PFNC numbers it: 8 bits in one byte.
pub const UVCAM_MONO8: u32 = 0x0108_0001;
/// Pixel format: 10 bits in two bytes, little-endian, value in the low bits.
pub const UVCAM_MONO10: u32 = 0x0110_0003;
/// Pixel format: 12 bits in two bytes, little-endian, value in the low bits.
pub const UVCAM_MONO12: u32 = 0x0110_0005;
/// Pixel format: 16 bits in two bytes, little-endian.
pub const UVCAM_MONO16: u32 = 0x0110_0007;

const _: () = assert!(UVCAM_CONTRACT_VERSION == CONTRACT_VERSION);
const _: () =
    assert!(UVCAM_FLAG_MASKED == Flags::MASKED.bits() && UVCAM_FLAG_SIMULATED == Flags::SIMULATED.bits());
const _: () = assert!(
    UVCAM_FLAG_REPLAYED == Flags::REPLAYED.bits() && UVCAM_FLAG_INCOMPLETE == Flags::INCOMPLETE.bits()
);
const _: () = assert!(UVCAM_FLAG_NO_DEVICE_CLOCK == Flags::NO_DEVICE_CLOCK.bits());
const _: () = assert!(UVCAM_FLAG_MASK_ATTACHED == Flags::MASK_ATTACHED.bits());
const _: () = assert!(UVCAM_MONO8 == PixelFormat::Mono8.code() && UVCAM_MONO10 == PixelFormat::Mono10.code());
const _: () =
    assert!(UVCAM_MONO12 == PixelFormat::Mono12.code() && UVCAM_MONO16 == PixelFormat::Mono16.code());

/// What is to be known of a frame besides its pixels. 192 bytes; the layout is part of the contract, and CONTRACT.md describes it byte by
/// byte.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
#[allow(non_camel_case_types, reason = "its name in C")]
pub struct uvcam_frame_header {
    /// "UVCM" in memory.
    pub magic: u32,
    /// UVCAM_CONTRACT_VERSION.
    pub contract_version: u16,
    /// Bytes of this header.
    pub header_size: u16,
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Bytes from the start of one row to the start of the next.
    pub stride: u32,
    /// UVCAM_MONO8, UVCAM_MONO10, UVCAM_MONO12 or UVCAM_MONO16.
    pub pixel_format: u32,
    /// UVCAM_FLAG_...; bits that have no name here may be set.
    pub flags: u32,
    /// Zero.
    pub reserved_picture: u32,
    /// Identity of the mask that was applied or travels beside the frame; all zero where the camera flies without.
    pub mask_id: [u8; 16],
    /// Exposure time in us, as read back from the camera.
    pub exposure_us: f64,
    /// Gain in dB, as read back from the camera.
    pub gain_db: f64,

    /// Identity of an uninterrupted stream: new, and higher, at every start of the driver and every reconnection of the camera.
    pub epoch: u64,
    /// Place among the published frames of this epoch, from 0.
    pub sequence: u64,
    /// The device's own count of this frame in this epoch, from 0.
    pub device_frame_id: u64,
    /// Identity of the count `produced`.
    pub counting: u64,
    /// Frames that the device is known to have produced up to and including this one, published or not.
    pub produced: u64,
    /// Zero.
    pub reserved_order: [u64; 3],

    /// Time between frames in ns, as read back from the camera.
    pub frame_period_ns: u64,
    /// The device's own clock at this frame, in ns from an arbitrary start.
    pub device_timestamp_ns: u64,
    /// CLOCK_MONOTONIC in ns when the driver had the whole frame.
    pub arrival_monotonic_ns: u64,
    /// CLOCK_MONOTONIC in ns when the frame was sent.
    pub send_monotonic_ns: u64,
    /// CLOCK_MONOTONIC in ns at the middle of the exposure.
    pub mid_exposure_monotonic_ns: u64,
    /// CLOCK_REALTIME in ns at the middle of the exposure.
    pub mid_exposure_realtime_ns: u64,
    /// Half width in ns of the interval around either mid-exposure stamp that holds the true time.
    pub mid_exposure_uncertainty_ns: u64,
    /// Zero.
    pub reserved_time: u64,
}

macro_rules! assert_same_place {
    ($($field:ident),+ $(,)?) => {
        $(const _: () = assert!(offset_of!(uvcam_frame_header, $field) == offset_of!(FrameHeader, $field));)+
    };
}

assert_same_place! {
    magic, contract_version, header_size, width, height, stride, pixel_format, flags, mask_id, exposure_us, gain_db,
    epoch, sequence, device_frame_id, counting, produced,
    frame_period_ns, device_timestamp_ns, arrival_monotonic_ns, send_monotonic_ns, mid_exposure_monotonic_ns,
    mid_exposure_realtime_ns, mid_exposure_uncertainty_ns,
}
const _: () = assert!(size_of::<uvcam_frame_header>() == size_of::<FrameHeader>());

/// A frame that this program holds: its memory stays as it is until uvcam_frame_release(). It may be used by any thread, and outlives its
/// subscriber.
#[allow(non_camel_case_types, reason = "its name in C")]
pub struct uvcam_frame(());

/// What there is to see of a frame. All of it is valid until the frame is released.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
#[allow(non_camel_case_types, reason = "its name in C")]
pub struct uvcam_frame_view {
    /// The header: a copy that was checked, so that `pixels` reaches as far as it says.
    pub header: *const uvcam_frame_header,
    /// The image, in the memory that the driver wrote: row by row from the top, `header->stride` bytes apart. Mapped for reading alone.
    pub pixels: *const u8,
    /// Bytes from the first pixel to the last: header->stride * (header->height - 1) + row_size.
    pub size: usize,
    /// Bytes of the pixels of a row; where they are fewer than `header->stride`, the rest is padding.
    pub row_size: usize,
    /// Frames that the device produced since the frame before and that did not reach this consumer, for whatever reason; exact, also
    /// across epochs and drivers. 0 for the first frame.
    pub lost_before: u64,
    /// Whether driver or camera started anew since the frame before.
    pub epoch_changed: bool,
}

pub(crate) static FRAMES: Table<Frame> = Table::new("a frame");

/// Shows a frame.
///
/// # Safety
/// Law 3 for `view`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn uvcam_frame_read(
    frame: *const uvcam_frame,
    view: *mut uvcam_frame_view,
) -> uvcam_status {
    call(|| {
        // SAFETY: law 3.
        let place = unsafe { argument::place(view, "a place for a view") }?;
        // What is shown is the table's until the frame is released.
        let frame = FRAMES.get(frame)?;
        let header = frame.header();
        let format = header.pixel_format().map_err(|error| Failure::fault(&error.to_string()))?;
        place.write(uvcam_frame_view {
            header: std::ptr::from_ref(header).cast(),
            pixels: frame.pixels().as_ptr(),
            size: frame.pixels().len(),
            row_size: header.width as usize * format.bytes_per_pixel(),
            lost_before: frame.lost_before(),
            epoch_changed: frame.epoch_changed(),
        });
        Ok(UVCAM_OK)
    })
}

/// Gives a frame's memory back to the driver. What was seen of it is not to be touched any more, by any thread.
#[unsafe(no_mangle)]
pub extern "C" fn uvcam_frame_release(frame: *mut uvcam_frame) -> uvcam_status {
    call(|| FRAMES.remove(frame).map(|_| UVCAM_OK))
}
