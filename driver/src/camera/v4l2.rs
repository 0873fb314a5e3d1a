//! Cameras of the kernel's video drivers (Video4Linux 2): USB cameras (UVC) and sensors on the board.
//!
//! Frames go straight into the slots (user pointers) where the driver takes their memory and the rows have no padding; otherwise
//! they are copied once, out of buffers of the kernel. The copy is not fused with the mask: blanking the masked runs afterwards
//! costs some per cent of the copy.
//!
//! A frame's device timestamp is the driver's stamp where that is CLOCK_MONOTONIC: at the start of the exposure or at the end of the
//! frame, as the driver likes (V4L2_BUF_FLAG_TSTAMP_SRC_*). uvcvideo stamps the start.

use std::io;
use std::time::Duration;

use rustix::io::Errno;
use uvcam_shm_ipc::Slot;

use super::source::{CameraSource, V4l2, V4l2Memory};
use super::{Applied, Camera, CameraError, Capture, Event, Identity, Settings};
use crate::clock::DeviceClock;
use crate::told::OPENING;
use controls::Failure;
use format::Layout;
use sequence::SequenceUnwrapper;
use stream::Stream;

mod configure;
mod controls;
mod device;
mod discovery;
mod format;
mod sequence;
mod stream;

const KIND: &str = "v4l2";

/// All connected cameras that the access rights let the driver open.
pub(super) fn list() -> Vec<Identity> {
    discovery::list()
}

/// An opened camera.
struct V4l2Camera {
    stream: Stream,
    identity: Identity,
    source: V4l2,
    layout: Layout,
    sequence: SequenceUnwrapper,
    /// As the last frame was stamped.
    clock: DeviceClock,
}

impl V4l2Camera {
    /// Opens the camera that the source names.
    ///
    /// # Errors
    /// [`CameraError::Absent`] with what was found instead; [`CameraError::Refused`] where several have the serial;
    /// [`CameraError::Device`] where it may not be opened.
    fn open(source: &V4l2) -> Result<Self, CameraError> {
        let (device, identity) = discovery::open(&source.device)?;
        Ok(V4l2Camera {
            stream: Stream::new(device),
            identity,
            source: source.clone(),
            layout: Layout::default(),
            sequence: SequenceUnwrapper::default(),
            clock: DeviceClock::HostAtFrameEnd,
        })
    }

    fn failed(&self, doing: &'static str, error: &io::Error) -> CameraError {
        let serial = self.identity.serial.clone();
        if is_gone(error) {
            return CameraError::Disconnected { serial, doing };
        }
        let held = match Errno::from_io_error(error) {
            Some(Errno::BUSY) => "; another program uses it",
            _ => "",
        };
        CameraError::Device { serial, doing, cause: format!("{error}{held}") }
    }
}

impl CameraSource for V4l2 {
    fn open(&mut self) -> Result<Box<dyn Camera>, CameraError> {
        Ok(Box::new(V4l2Camera::open(self)?))
    }
}

/// Whether the device is not there any more.
fn is_gone(error: &io::Error) -> bool {
    matches!(Errno::from_io_error(error), Some(Errno::NODEV | Errno::NXIO))
}

impl Camera for V4l2Camera {
    fn identity(&self) -> &Identity {
        &self.identity
    }

    fn device_clock(&self) -> DeviceClock {
        self.clock
    }

    fn configure(&mut self, settings: &Settings) -> Result<Applied, CameraError> {
        let configured = configure::configure(self.stream.device(), settings, &self.source);
        let (applied, layout) = configured.map_err(|failure| match failure {
            Failure::Refused(error) => error,
            Failure::Io(error) => self.failed("configuring", &error),
        })?;
        self.layout = layout;
        Ok(applied)
    }

    fn queue(&mut self, slot: Slot) -> Result<(), CameraError> {
        self.stream.queue(slot).map_err(|error| self.failed("queueing", &error))
    }

    fn start(&mut self) -> Result<(), CameraError> {
        let memories: &[V4l2Memory] = match self.source.memory {
            Some(V4l2Memory::UserPointer) => &[V4l2Memory::UserPointer],
            Some(V4l2Memory::Mapped) => &[V4l2Memory::Mapped],
            None if self.layout.is_slot() => &[V4l2Memory::UserPointer, V4l2Memory::Mapped],
            None => &[V4l2Memory::Mapped],
        };
        self.sequence = SequenceUnwrapper::default();
        let memory =
            self.stream.start(memories, &self.layout).map_err(|error| self.failed("starting", &error))?;
        match memory {
            V4l2Memory::UserPointer => {
                tracing::debug!("camera {}: frames are not copied", self.identity.serial)
            }
            V4l2Memory::Mapped => {
                tracing::info!(target: OPENING, "camera {}: frames are copied once", self.identity.serial);
            }
        }
        Ok(())
    }

    fn next(&mut self, timeout: Duration) -> Result<Event, CameraError> {
        let filled = match self.stream.next(&self.layout, timeout) {
            Ok(Some(filled)) => filled,
            Ok(None) => return Ok(Event::Timeout),
            Err(error) => return Err(self.failed("streaming", &error)),
        };
        Ok(match filled.frame {
            None if filled.is_untouched => {
                self.queue(filled.slot)?;
                Event::Timeout
            }
            None => Event::Incomplete(filled.slot),
            Some(frame) => {
                self.clock = match frame.is_of_exposure_start {
                    true => DeviceClock::HostAtExposureStart,
                    false => DeviceClock::HostAtFrameEnd,
                };
                Event::Complete(Capture {
                    slot: filled.slot,
                    frame_id: self.sequence.unwrap(frame.sequence),
                    device_timestamp_ns: frame.timestamp_ns,
                    arrival_monotonic_ns: filled.arrival_monotonic_ns,
                })
            }
        })
    }

    fn stop(&mut self) {
        self.stream.stop();
    }
}

impl Drop for V4l2Camera {
    fn drop(&mut self) {
        self.stop();
    }
}
