//! A folder of PNG files as a camera: in the order of their names, at the configured rate, again and again.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use uvcam_masker::file::{FrameError, read_frame};
use uvcam_shm_ipc::{Flags, PixelFormat, Slot, monotonic_ns};

use super::paced::{Due, Paced, deadline};
use super::source::CameraSource;
use super::{Applied, Camera, CameraError, Capture, Event, Identity, Settings};
use crate::causes::with_causes;
use crate::told::OPENING;

mod ahead;
mod folder;

use ahead::{Ahead, Taken};
use folder::Folder;

/// A folder, by its path.
pub(super) struct ReplayFolder(pub(super) PathBuf);

impl CameraSource for ReplayFolder {
    fn open(&mut self) -> Result<Box<dyn Camera>, CameraError> {
        Ok(Box::new(ReplayCamera::open(&self.0)?))
    }

    fn flag(&self) -> Flags {
        Flags::REPLAYED
    }
}

/// An opened folder.
#[derive(Debug)]
struct ReplayCamera {
    identity: Identity,
    folder: Arc<Folder>,
    /// Columns and rows.
    size: (u32, u32),
    /// The pictures, where it is started.
    ahead: Option<Ahead>,
    paced: Paced,
    fps: f64,
}

impl ReplayCamera {
    /// Lists the folder.
    ///
    /// # Errors
    /// [`CameraError::Absent`] where it cannot be read or holds no PNG file.
    fn open(folder: &Path) -> Result<Self, CameraError> {
        let listed = Folder::list(folder).map_err(|found| CameraError::Absent {
            kind: "replay",
            wanted: folder.display().to_string(),
            found,
        })?;
        Ok(ReplayCamera {
            identity: Identity {
                kind: "replay",
                vendor: "uvcam".into(),
                model: "replay".into(),
                serial: folder.file_name().unwrap_or_default().to_string_lossy().into_owned(),
                transport: "none".into(),
                address: listed.path().display().to_string(),
            },
            folder: Arc::new(listed),
            size: (0, 0),
            ahead: None,
            paced: Paced::default(),
            fps: 0.0,
        })
    }

    fn failed(&self, doing: &'static str, cause: String) -> CameraError {
        CameraError::Device { serial: self.identity.serial.clone(), doing, cause }
    }
}

impl Camera for ReplayCamera {
    fn identity(&self) -> &Identity {
        &self.identity
    }

    /// Reads the first picture. Exposure and gain are what the configuration says of them: a picture does not tell.
    fn configure(&mut self, settings: &Settings) -> Result<Applied, CameraError> {
        settings.check_not_binned()?;
        settings.check_exposure_fits(0.0)?;
        if settings.pixel_format != PixelFormat::Mono8 {
            return Err(CameraError::Refused {
                setting: "pixel_format",
                asked: settings.pixel_format.to_string(),
                applied: "Mono8".into(),
                remedy: "set pixel_format = \"Mono8\"".into(),
            });
        }
        let first = self.folder.picture(0);
        let picture =
            read_frame(&first).map_err(|error| self.failed("reading its pictures", with_causes(&error)))?;
        // A single dark picture is no proof of it.
        if let Some(used_bits) = picture.unscaled_bits().filter(|bits| *bits > 0) {
            tracing::warn!(target: OPENING, "`{}`: {}", first.display(), FrameError::Unscaled { used_bits });
        }
        let (width, height) = picture.gray.dimensions();
        if (width, height) != (settings.width, settings.height) {
            return Err(CameraError::Refused {
                setting: "width and height",
                asked: format!("{}x{}", settings.width, settings.height),
                applied: format!("{width}x{height} in {}", first.display()),
                remedy: "set width and height to the size of the pictures, the same for all".into(),
            });
        }
        self.size = (width, height);
        self.fps = settings.fps;
        Ok(Applied::exactly(settings))
    }

    fn queue(&mut self, slot: Slot) -> Result<(), CameraError> {
        self.paced.queue(slot);
        Ok(())
    }

    fn start(&mut self) -> Result<(), CameraError> {
        let ahead = Ahead::start(self.folder.clone(), self.size);
        self.ahead = Some(ahead.map_err(|error| self.failed("starting", error.to_string()))?);
        self.paced.start(self.fps);
        Ok(())
    }

    fn next(&mut self, timeout: Duration) -> Result<Event, CameraError> {
        let deadline_ns = deadline(timeout);
        let Some(due) = self.paced.next(deadline_ns) else { return Ok(Event::Timeout) };
        let taken = self.ahead.as_ref().map_or(Taken::Ended, |ahead| ahead.take(due.frame_id, deadline_ns));
        let mut slot = due.slot;
        match taken {
            Taken::Whole(picture) if picture.len() == slot.len() => {
                slot.pixels_mut().copy_from_slice(&picture);
                // Its memory goes back before the frame is complete: what follows is the frame path.
                drop(picture);
                Ok(Event::Complete(Capture {
                    slot,
                    frame_id: due.frame_id,
                    device_timestamp_ns: None,
                    arrival_monotonic_ns: monotonic_ns(),
                }))
            }
            Taken::Whole(_) | Taken::Broken => Ok(Event::Incomplete(slot)),
            // A disk that is too slow loses frames as a late consumer does: the rhythm goes on, and the frame ids jump.
            Taken::Late => {
                self.paced.withdraw(Due { slot, ..due });
                Ok(Event::Timeout)
            }
            Taken::Ended => {
                Err(self.failed("reading its pictures", "the thread that reads them ended".into()))
            }
        }
    }

    fn stop(&mut self) {
        self.ahead = None;
        self.paced.stop();
    }
}
