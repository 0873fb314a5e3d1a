//! A video device's handle, and the requests to the kernel that crate `v4l` does not offer or that it answers with a panic: it
//! cuts names of 32 bytes without regard to UTF-8, and knows neither every type of control nor every colour space.
//!
//! Laws, on which every `unsafe` here rests:
//! 1. A request is given the structure that <linux/videodev2.h> defines for it; its number carries the structure's size. The
//!    kernel writes into it during the call only.
//! 2. V4L2 structures are integers and unions of integers and addresses: all zeros is a value of each.
//! 3. The handle is open as long as its [`Device`] exists.
//! 4. Which member of a union is valid follows from the memory of the buffer, and from the type of the format.

use std::ffi::c_void;
use std::io;
use std::mem::zeroed;
use std::os::fd::BorrowedFd;
use std::path::Path;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, poll};
use rustix::io::Errno;
use rustix::time::Timespec;
use v4l::control::{Control, Value};
use v4l::fraction::Fraction;
use v4l::v4l_sys::*;
use v4l::v4l2::{ioctl, vidioc};
use v4l::video::Capture;
use v4l::video::capture::Parameters;

use super::controls::{Controls, Range};
use super::format::FourCc;
use crate::camera::source::V4l2Memory;
use crate::camera::told;

/// Formats that are looked at, should a driver's list never end.
const MOST_FORMATS: u32 = 256;
const CAPTURE: u32 = v4l2_buf_type_V4L2_BUF_TYPE_VIDEO_CAPTURE;

/// An open video device.
pub(super) struct Device(v4l::Device);

/// What a device says of itself (VIDIOC_QUERYCAP).
pub(super) struct Capability {
    pub(super) driver: String,
    pub(super) card: String,
    pub(super) bus_info: String,
    /// Whether it is a camera, by the single-planar API, whose frames can be streamed.
    pub(super) captures: bool,
}

/// The number of a memory in V4L2.
fn code(memory: V4l2Memory) -> u32 {
    match memory {
        V4l2Memory::UserPointer => v4l2_memory_V4L2_MEMORY_USERPTR,
        V4l2Memory::Mapped => v4l2_memory_V4L2_MEMORY_MMAP,
    }
}

/// A buffer that the device is done with (VIDIOC_DQBUF).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Dequeued {
    pub(super) index: usize,
    /// The device reports lost or damaged data (V4L2_BUF_FLAG_ERROR).
    pub(super) damaged: bool,
    pub(super) bytes_used: usize,
    pub(super) sequence: u32,
    /// The driver's stamp, where it is CLOCK_MONOTONIC.
    pub(super) timestamp_ns: Option<u64>,
    /// Whether it was taken at the start of the exposure; otherwise at the end of the frame.
    pub(super) is_of_exposure_start: bool,
}

/// What a wait ended with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Ready {
    Nothing,
    /// A buffer can be dequeued.
    Frame,
    /// The device is gone or has failed; the next request tells which.
    Failed,
}

/// Runs one request; `argument` is the structure that belongs to it.
macro_rules! request {
    ($device:expr, $request:ident, $argument:expr) => {{
        let argument: *mut _ = $argument;
        // SAFETY: laws 1 and 3.
        unsafe { ioctl($device.0.handle().fd(), vidioc::$request, argument.cast::<c_void>()) }
    }};
}

macro_rules! all_zeros {
    ($structure:ty) => {
        // SAFETY: law 2.
        unsafe { zeroed::<$structure>() }
    };
}

impl Device {
    pub(super) fn open(path: &Path) -> io::Result<Self> {
        v4l::Device::with_path(path).map(Device)
    }

    pub(super) fn capability(&self) -> io::Result<Capability> {
        let mut answer = all_zeros!(v4l2_capability);
        request!(self, VIDIOC_QUERYCAP, &mut answer)?;
        // What this node can do, where the driver tells; otherwise what the device can do on all of its nodes.
        let capabilities = match answer.capabilities & V4L2_CAP_DEVICE_CAPS {
            0 => answer.capabilities,
            _ => answer.device_caps,
        };
        let needed = V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_STREAMING;
        Ok(Capability {
            driver: text(&answer.driver),
            card: text(&answer.card),
            bus_info: text(&answer.bus_info),
            captures: capabilities & needed == needed,
        })
    }

    /// The pixel formats that the device offers.
    pub(super) fn formats(&self) -> Vec<FourCc> {
        let format = |index| {
            let mut answer = all_zeros!(v4l2_fmtdesc);
            answer.index = index;
            answer.type_ = CAPTURE;
            // The list ends with an error.
            request!(self, VIDIOC_ENUM_FMT, &mut answer).ok()?;
            Some(FourCc(answer.pixelformat.to_le_bytes()))
        };
        (0..MOST_FORMATS).map_while(format).collect()
    }

    /// Asks for progressive frames of this size and format without row padding, and returns what the device gives instead.
    pub(super) fn set_format(&self, fourcc: FourCc, width: u32, height: u32) -> io::Result<v4l2_pix_format> {
        let mut format = all_zeros!(v4l2_format);
        format.type_ = CAPTURE;
        let mut asked = all_zeros!(v4l2_pix_format);
        (asked.width, asked.height) = (width, height);
        asked.pixelformat = u32::from_le_bytes(fourcc.0);
        asked.field = v4l2_field_V4L2_FIELD_NONE;
        format.fmt.pix = asked;
        request!(self, VIDIOC_S_FMT, &mut format)?;
        // SAFETY: laws 2 and 4.
        Ok(unsafe { format.fmt.pix })
    }

    /// Asks for a time per frame, and returns the one that the device keeps; `None` where it has no control of it.
    pub(super) fn set_interval(&self, interval: Fraction) -> io::Result<Option<Fraction>> {
        let applied = match self.0.set_params(&Parameters::new(interval)) {
            Ok(applied) => applied,
            // A sensor whose driver does not know the request at all.
            Err(error) if Errno::from_io_error(&error) == Some(Errno::NOTTY) => return Ok(None),
            Err(error) => return Err(error),
        };
        Ok(applied
            .capabilities
            .contains(v4l::parameters::Capabilities::TIME_PER_FRAME)
            .then_some(applied.interval))
    }

    /// Sets the number of buffers, and returns the one that the driver gives. 0 frees them all.
    pub(super) fn request_buffers(&self, memory: V4l2Memory, count: usize) -> io::Result<usize> {
        let mut asked = all_zeros!(v4l2_requestbuffers);
        asked.count = count as u32;
        asked.type_ = CAPTURE;
        asked.memory = code(memory);
        request!(self, VIDIOC_REQBUFS, &mut asked)?;
        Ok(asked.count as usize)
    }

    /// Where a buffer of the kernel lies: its place for `mmap`, and its length.
    pub(super) fn query_buffer(&self, index: usize) -> io::Result<(u32, usize)> {
        let mut buffer = buffer(V4l2Memory::Mapped, index);
        request!(self, VIDIOC_QUERYBUF, &mut buffer)?;
        // SAFETY: laws 2 and 4.
        Ok((unsafe { buffer.m.offset }, buffer.length as usize))
    }

    /// Maps a buffer of the kernel for reading.
    pub(super) fn map(&self, offset: u32, length: usize) -> io::Result<*mut c_void> {
        use rustix::mm::{MapFlags, ProtFlags, mmap};
        let (handle, place) = (self.handle(), u64::from(offset));
        // SAFETY: law 3; a new mapping touches no other memory.
        let memory =
            unsafe { mmap(std::ptr::null_mut(), length, ProtFlags::READ, MapFlags::SHARED, handle, place) };
        Ok(memory?)
    }

    /// Hands a buffer of the kernel to the device.
    pub(super) fn queue_mapped(&self, index: usize) -> io::Result<()> {
        request!(self, VIDIOC_QBUF, &mut buffer(V4l2Memory::Mapped, index))
    }

    /// Hands the memory at `address` to the device.
    ///
    /// # Safety
    /// The memory must be valid for writes of `length` bytes, and not be touched, until the buffer is dequeued, the stream is
    /// switched off, or the device is closed.
    pub(super) unsafe fn queue_user_pointer(
        &self,
        index: usize,
        address: *mut u8,
        length: usize,
    ) -> io::Result<()> {
        let mut buffer = buffer(V4l2Memory::UserPointer, index);
        buffer.m.userptr = address.expose_provenance() as _;
        buffer.length = length as u32;
        request!(self, VIDIOC_QBUF, &mut buffer)
    }

    /// The next buffer that is done; `None` where there is none yet.
    pub(super) fn dequeue(&self, memory: V4l2Memory) -> io::Result<Option<Dequeued>> {
        let mut buffer = buffer(memory, 0);
        match request!(self, VIDIOC_DQBUF, &mut buffer) {
            Ok(()) => Ok(Some(Dequeued {
                index: buffer.index as usize,
                damaged: buffer.flags & V4L2_BUF_FLAG_ERROR != 0,
                bytes_used: buffer.bytesused as usize,
                sequence: buffer.sequence,
                timestamp_ns: monotonic_stamp_ns(&buffer),
                is_of_exposure_start: buffer.flags & V4L2_BUF_FLAG_TSTAMP_SRC_MASK
                    == V4L2_BUF_FLAG_TSTAMP_SRC_SOE,
            })),
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Starts the device.
    pub(super) fn stream_on(&self) -> io::Result<()> {
        request!(self, VIDIOC_STREAMON, &mut CAPTURE.clone())
    }

    /// Stops the device. It then writes into no buffer any more.
    pub(super) fn stream_off(&self) -> io::Result<()> {
        request!(self, VIDIOC_STREAMOFF, &mut CAPTURE.clone())
    }

    /// Waits at most `timeout` until a buffer is done or the device has failed.
    pub(super) fn wait(&self, timeout: Duration) -> io::Result<Ready> {
        let handle = self.handle();
        let mut handles = [PollFd::new(&handle, PollFlags::IN)];
        let timeout = Timespec {
            tv_sec: timeout.as_secs().try_into().unwrap_or(i64::MAX),
            tv_nsec: timeout.subsec_nanos().into(),
        };
        match poll(&mut handles, Some(&timeout)) {
            Ok(_) if handles[0].revents().intersects(PollFlags::ERR | PollFlags::HUP) => Ok(Ready::Failed),
            Ok(0) => Ok(Ready::Nothing),
            Ok(_) => Ok(Ready::Frame),
            // A signal cut the wait short.
            Err(Errno::INTR) => Ok(Ready::Nothing),
            Err(error) => Err(error.into()),
        }
    }

    fn handle(&self) -> BorrowedFd<'_> {
        // SAFETY: law 3; the borrow ends with that of the device.
        unsafe { BorrowedFd::borrow_raw(self.0.handle().fd()) }
    }
}

impl Controls for Device {
    fn range(&self, id: u32) -> io::Result<Option<Range>> {
        let mut answer = all_zeros!(v4l2_query_ext_ctrl);
        answer.id = id;
        match request!(self, VIDIOC_QUERY_EXT_CTRL, &mut answer) {
            Ok(()) if answer.flags & V4L2_CTRL_FLAG_DISABLED != 0 => Ok(None),
            Ok(()) => Ok(Some(Range {
                minimum: answer.minimum,
                maximum: answer.maximum,
                step: i64::try_from(answer.step).unwrap_or(i64::MAX).max(1),
            })),
            // EINVAL: no such control. ENOTTY: no controls at all.
            Err(error) if matches!(Errno::from_io_error(&error), Some(Errno::INVAL | Errno::NOTTY)) => {
                Ok(None)
            }
            Err(error) => Err(error),
        }
    }

    fn read(&self, id: u32) -> io::Result<i64> {
        match self.0.control(id)?.value {
            Value::Integer(value) => Ok(value),
            Value::Boolean(on) => Ok(on.into()),
            _ => Err(io::Error::from(io::ErrorKind::InvalidData)),
        }
    }

    fn write(&self, id: u32, value: i64) -> io::Result<()> {
        self.0.set_control(Control { id, value: Value::Integer(value) })
    }
}

fn buffer(memory: V4l2Memory, index: usize) -> v4l2_buffer {
    let mut buffer = all_zeros!(v4l2_buffer);
    buffer.index = index as u32;
    buffer.type_ = CAPTURE;
    buffer.memory = code(memory);
    buffer
}

fn monotonic_stamp_ns(buffer: &v4l2_buffer) -> Option<u64> {
    let monotonic = buffer.flags & V4L2_BUF_FLAG_TIMESTAMP_MASK == V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;
    let seconds = u64::try_from(buffer.timestamp.tv_sec).ok().filter(|_| monotonic)?;
    let microseconds = u64::try_from(buffer.timestamp.tv_usec).ok()?;
    seconds.checked_mul(1_000_000_000)?.checked_add(microseconds.checked_mul(1000)?)
}

/// A text of fixed size, which ends at its first zero.
fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    told(&String::from_utf8_lossy(&bytes[..end]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stamped(flags: u32, seconds: i64, microseconds: i64) -> Option<u64> {
        let mut buffer = buffer(V4l2Memory::Mapped, 0);
        buffer.flags = flags;
        buffer.timestamp = timeval { tv_sec: seconds, tv_usec: microseconds };
        monotonic_stamp_ns(&buffer)
    }

    #[test]
    fn only_a_monotonic_stamp_is_taken() {
        let end_of_frame = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;
        let start_of_exposure = end_of_frame | V4L2_BUF_FLAG_TSTAMP_SRC_SOE;
        assert_eq!(stamped(end_of_frame, 12, 345_678), Some(12_345_678_000));
        assert_eq!(stamped(start_of_exposure, 12, 345_678), Some(12_345_678_000));
        assert_eq!(stamped(0, 12, 345_678), None, "of an unknown clock");
        assert_eq!(stamped(V4L2_BUF_FLAG_TIMESTAMP_COPY, 12, 345_678), None);
        assert_eq!(stamped(end_of_frame, -1, 0), None);
        assert_eq!(stamped(end_of_frame, i64::MAX, 0), None);
    }

    #[test]
    fn a_name_cut_inside_a_character_is_still_a_text() {
        assert_eq!(text(b"Kamera f\xc3"), "Kamera f\u{fffd}");
        assert_eq!(text(b"camera\0rest"), "camera");
        assert_eq!(text(b"\0"), "");
    }

    #[test]
    fn what_is_no_video_device_answers_with_an_error() {
        let device = Device::open(Path::new("/dev/null")).unwrap();
        assert_eq!(
            device.capability().err().and_then(|error| Errno::from_io_error(&error)),
            Some(Errno::NOTTY)
        );
        assert!(device.formats().is_empty());
        assert!(device.range(V4L2_CID_GAIN).unwrap().is_none());
        assert!(device.set_format(FourCc(*b"GREY"), 64, 48).is_err());
        assert!(device.stream_off().is_err());
    }
}
