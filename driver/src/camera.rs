//! A camera: anything that fills slots of shared memory with frames.
//!
//! The frame path owns the rhythm: it hands empty [`Slot`]s to a camera with [`Camera::queue`], waits for filled ones with
//! [`Camera::next`], masks and publishes them. A camera never touches a pixel after it has reported the frame complete.
//!
//! A [`source`] opens them. Each implementation lives in a file of its own: [`simulated`] and `replay` need no hardware, `aravis` speaks
//! USB3 Vision and GigE Vision, `v4l2` the kernel's video drivers. All of them stand behind one `guard`, which watches over the order of
//! calls, and pass one conformance suite.

use std::fmt;
use std::time::Duration;

use uvcam_shm_ipc::{PixelFormat, Slot};

use crate::clock::DeviceClock;

#[cfg(feature = "aravis")]
mod aravis;
mod error;
mod gige_vision;
mod grid;
mod guard;
mod identity;
mod paced;
mod replay;
pub mod simulated;
pub mod source;
#[cfg(feature = "v4l2")]
mod v4l2;

pub use error::CameraError;
pub(crate) use gige_vision::{GIGE_VISION, SOCKET_FRAMES};
pub use grid::Grid;
pub use identity::{Identity, listed, told};

/// A camera that has been opened. It belongs to one thread at a time; one that has failed may be dropped on another, as closing a
/// dead device can take seconds.
///
/// The order of calls is `configure`, then `queue` and `start`, then `next` and `queue` in turn, then `stop`, and anew from any of them
/// on. A [`source`] hands out cameras that refuse another order with [`CameraError::Device`]; what implements this trait need not check
/// it, but keep within its memory. Dropping a camera stops it and gives every queued slot back.
pub trait Camera: Send {
    /// Who the device says it is.
    fn identity(&self) -> &Identity;

    /// Which clock [`Capture::device_timestamp_ns`] is read from; known with the first frame after `start`.
    fn device_clock(&self) -> DeviceClock {
        DeviceClock::default()
    }

    /// Fixes exposure, gain, format, region and frame rate, with all automatics off, and reads every one of them back.
    ///
    /// # Errors
    /// [`CameraError::Refused`] where the device applied something else than was asked, beyond its own step, or where the
    /// exposure does not fit the frame period; [`CameraError::Disconnected`] or [`CameraError::Device`] where it does not answer.
    /// After an error the camera must not be started.
    fn configure(&mut self, settings: &Settings) -> Result<Applied, CameraError>;

    /// Hands over an empty slot of exactly [`Applied::payload_bytes`] to be filled, before or after `start`.
    ///
    /// # Errors
    /// [`CameraError::Device`] where the slot has another size.
    fn queue(&mut self, slot: Slot) -> Result<(), CameraError>;

    /// Starts acquisition. Frame ids start anew.
    ///
    /// # Errors
    /// [`CameraError::Disconnected`] or [`CameraError::Device`].
    fn start(&mut self) -> Result<(), CameraError>;

    /// Waits at most `timeout` for the next frame, in the order in which the device exposed them.
    ///
    /// # Errors
    /// [`CameraError::Disconnected`] where the device is gone, [`CameraError::Device`] where it failed. The camera is to be
    /// dropped and opened again.
    fn next(&mut self, timeout: Duration) -> Result<Event, CameraError>;

    /// Temperature of the device in degrees Celsius (SFNC `DeviceTemperature`), `None` where it tells none. Takes the time of a question
    /// to the device.
    fn temperature_c(&mut self) -> Option<f64> {
        None
    }

    /// Stops acquisition and gives the queued slots back to their publisher.
    fn stop(&mut self);
}

impl fmt::Debug for dyn Camera {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("Camera").field("identity", self.identity()).finish_non_exhaustive()
    }
}

/// What became of a queued slot.
#[derive(Debug)]
pub enum Event {
    /// The slot holds one whole frame.
    Complete(Capture),
    /// The device sent a frame of which a part is missing; its pixels must not be used. It counts as lost: one for each frame of the
    /// device, and none where the slot came back because a transfer ended. The slot can be queued again.
    Incomplete(Slot),
    /// No frame ended within the timeout.
    Timeout,
}

/// One whole frame, still in the slot that the camera wrote.
#[derive(Debug)]
pub struct Capture {
    /// The pixels.
    pub slot: Slot,
    /// The device's own count of frames since `start`, from 0, freed from wrap-around: as many as this are known to have been produced
    /// before, whole, incomplete or never delivered.
    pub frame_id: u64,
    /// The device's clock in nanoseconds, at an instant that keeps its distance to the exposure; `None` where it has no clock.
    pub device_timestamp_ns: Option<u64>,
    /// CLOCK_MONOTONIC in nanoseconds when the frame was complete in memory.
    pub arrival_monotonic_ns: u64,
}

/// What the configuration asks of a camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Columns of the image (SFNC `Width`).
    pub width: u32,
    /// Rows of the image (SFNC `Height`).
    pub height: u32,
    /// Left edge of the region on the sensor, px (SFNC `OffsetX`).
    pub offset_x: u32,
    /// Upper edge of the region on the sensor, px (SFNC `OffsetY`).
    pub offset_y: u32,
    /// Sensor columns that make one column of the image (SFNC `BinningHorizontal`); 1 does not bin.
    pub binning_horizontal: u32,
    /// Sensor rows that make one row of the image (SFNC `BinningVertical`); 1 does not bin.
    pub binning_vertical: u32,
    /// Pixel format by its PFNC name.
    pub pixel_format: PixelFormat,
    /// Frames a second (SFNC `AcquisitionFrameRate`).
    pub fps: f64,
    /// Exposure time in microseconds (SFNC `ExposureTime`).
    pub exposure_us: f64,
    /// Gain in decibels (SFNC `Gain`).
    pub gain_db: f64,
}

/// What a camera applied, as it read back.
#[derive(Debug, Clone, PartialEq)]
pub struct Applied {
    /// Columns of the image.
    pub width: u32,
    /// Rows of the image.
    pub height: u32,
    /// Bytes from one row to the next.
    pub stride: u32,
    /// Pixel format.
    pub pixel_format: PixelFormat,
    /// Frames a second.
    pub fps: f64,
    /// Exposure time in microseconds.
    pub exposure_us: f64,
    /// Gain in decibels.
    pub gain_db: f64,
    /// Bytes of one frame: the exact size of a slot.
    pub payload_bytes: usize,
}

impl Settings {
    /// Refuses an exposure that, with the sensor's readout, is longer than the frame period: the camera would silently run
    /// at a lower rate.
    ///
    /// # Errors
    /// [`CameraError::Refused`] with the largest exposure that fits.
    pub fn check_exposure_fits(&self, readout_us: f64) -> Result<(), CameraError> {
        let largest_us = 1e6 / self.fps - readout_us;
        if self.exposure_us <= largest_us {
            return Ok(());
        }
        let remedy = if largest_us > 0.0 {
            format!("the largest exposure_us that fits at {} fps is {}", self.fps, largest_us.floor())
        } else {
            format!("no exposure fits: the readout alone allows {:.1} fps", 1e6 / readout_us)
        };
        Err(CameraError::Refused {
            setting: "exposure_us",
            asked: self.exposure_us.to_string(),
            applied: format!(
                "{:.0} us with the readout of {readout_us:.0} us, in a frame period of {:.0} us",
                self.exposure_us + readout_us,
                1e6 / self.fps
            ),
            remedy,
        })
    }

    /// Refuses binning, for a camera that has no sensor.
    ///
    /// # Errors
    /// [`CameraError::Refused`].
    pub fn check_not_binned(&self) -> Result<(), CameraError> {
        verify("binning_horizontal", f64::from(self.binning_horizontal), 1.0, 0.0)?;
        verify("binning_vertical", f64::from(self.binning_vertical), 1.0, 0.0)
    }
}

/// The difference of exposure times that passes for rounding, microseconds: one of them, or 1 %.
pub fn exposure_tolerance_us(exposure_us: f64) -> f64 {
    (0.01 * exposure_us).max(1.0)
}

/// The difference of gains that passes for rounding, decibels.
pub const GAIN_TOLERANCE_DB: f64 = 0.1;

/// The difference of frame rates that passes for rounding, frames a second: 0.5 %. Devices round the period to whole sensor lines, or
/// have a few rates and name them in units of their own.
pub fn frame_rate_tolerance(fps: f64) -> f64 {
    0.005 * fps
}

/// Refuses a setting that reads back as another value than was asked, beyond what passes for rounding.
///
/// # Errors
/// [`CameraError::Refused`] with both values.
pub fn verify(setting: &'static str, asked: f64, applied: f64, tolerance: f64) -> Result<(), CameraError> {
    // The last digits of a float conversion come on top.
    if (asked - applied).abs() <= tolerance.abs() + asked.abs() * 1e-6 + 1e-9 {
        return Ok(());
    }
    Err(CameraError::Refused {
        setting,
        asked: asked.to_string(),
        applied: applied.to_string(),
        remedy: format!("set {setting} = {applied}, or another value that the device can apply"),
    })
}
