//! A camera: anything that fills slots of shared memory with frames.
//!
//! The frame path owns the rhythm: it hands empty [`Slot`]s to a camera with [`Camera::queue`], waits for filled ones with
//! [`Camera::next`], masks and publishes them. A camera never touches a pixel after it has reported the frame complete.
//!
//! A [`source`] opens them, and [`kinds`] knows which there are. Each implementation lives in a file of its own: [`simulated`] and
//! `replay` need no hardware, `aravis` speaks USB3 Vision and GigE Vision, `v4l2` the kernel's video drivers. All of them stand behind
//! one `guard`, which watches over the order of calls, and pass one conformance suite.

use std::fmt;
use std::time::Duration;

use uvcam_shm_ipc::Slot;

use crate::clock::DeviceClock;

#[cfg(feature = "aravis")]
mod aravis;
mod error;
mod gige_vision;
mod grid;
mod guard;
mod identity;
pub mod kinds;
mod paced;
mod replay;
mod settings;
pub mod simulated;
pub mod source;
#[cfg(feature = "v4l2")]
mod v4l2;

pub use error::CameraError;
pub(crate) use gige_vision::{GIGE_VISION, SOCKET_FRAMES};
pub use grid::Grid;
pub use identity::{Identity, listed, told};
pub use settings::{
    Applied, GAIN_TOLERANCE_DB, Settings, exposure_tolerance_us, frame_rate_tolerance, verify,
};

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
