//! A folder of PNG files as a camera: in the order of their names, at the configured rate, again and again.

use std::path::{Path, PathBuf};
use std::time::Duration;

use uvcam_masker::file::read_gray;
use uvcam_shm_ipc::{PixelFormat, Slot, monotonic_ns};

use super::paced::{Paced, deadline};
use super::{Applied, Camera, CameraError, Capture, Event, Identity, Settings};

/// An opened folder.
#[derive(Debug)]
pub struct ReplayCamera {
    identity: Identity,
    files: Vec<PathBuf>,
    frames: Vec<Vec<u8>>,
    paced: Paced,
    fps: f64,
}

impl ReplayCamera {
    /// Lists the folder.
    ///
    /// # Errors
    /// [`CameraError::Absent`] where it cannot be read or holds no PNG file.
    pub fn open(folder: &Path) -> Result<Self, CameraError> {
        let absent = |found: String| CameraError::Absent {
            kind: "replay",
            wanted: folder.display().to_string(),
            found,
        };
        let entries = std::fs::read_dir(folder).map_err(|error| absent(error.to_string()))?;
        let mut files: Vec<PathBuf> =
            entries.filter_map(|entry| entry.ok().map(|entry| entry.path())).collect();
        files.retain(|path| path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png")));
        files.sort();
        if files.is_empty() {
            return Err(absent("no file that ends in .png".into()));
        }
        Ok(ReplayCamera {
            identity: Identity {
                kind: "replay",
                vendor: "uvcam".into(),
                model: "replay".into(),
                serial: folder.file_name().unwrap_or_default().to_string_lossy().into_owned(),
                transport: "none".into(),
                address: folder.display().to_string(),
            },
            files,
            frames: Vec::new(),
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

    /// Reads the pictures. Exposure and gain are what the configuration says of them: a picture does not tell.
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
        self.frames.clear();
        for file in &self.files {
            let picture =
                read_gray(file).map_err(|error| self.failed("reading its pictures", error.to_string()))?;
            if picture.dimensions() != (settings.width, settings.height) {
                let (width, height) = picture.dimensions();
                return Err(CameraError::Refused {
                    setting: "width and height",
                    asked: format!("{}x{}", settings.width, settings.height),
                    applied: format!("{width}x{height} in {}", file.display()),
                    remedy: "set width and height to the size of the pictures, the same for all".into(),
                });
            }
            self.frames.push(picture.into_raw());
        }
        self.fps = settings.fps;
        Ok(Applied {
            width: settings.width,
            height: settings.height,
            stride: settings.width,
            pixel_format: PixelFormat::Mono8,
            fps: settings.fps,
            exposure_us: settings.exposure_us,
            gain_db: settings.gain_db,
            payload_bytes: settings.frame_bytes(),
        })
    }

    fn queue(&mut self, slot: Slot) -> Result<(), CameraError> {
        let needed = self.frames.first().map_or(0, Vec::len);
        if slot.len() != needed {
            return Err(self
                .failed("queueing a slot", format!("the slot has {} bytes, a frame {needed}", slot.len())));
        }
        self.paced.queue(slot);
        Ok(())
    }

    fn start(&mut self) -> Result<(), CameraError> {
        if self.frames.is_empty() {
            return Err(self.failed("starting", "it is not configured".into()));
        }
        self.paced.start(self.fps);
        Ok(())
    }

    fn next(&mut self, timeout: Duration) -> Result<Event, CameraError> {
        let Some(due) = self.paced.next(deadline(timeout)) else { return Ok(Event::Timeout) };
        let mut slot = due.slot;
        // `start` refuses an empty folder, so there is always a picture.
        if let Some(picture) = self.frames.get((due.frame_id % self.frames.len().max(1) as u64) as usize) {
            slot.pixels_mut().copy_from_slice(picture);
        }
        Ok(Event::Complete(Capture {
            slot,
            frame_id: due.frame_id,
            device_timestamp_ns: None,
            arrival_monotonic_ns: monotonic_ns(),
        }))
    }

    fn stop(&mut self) {
        self.paced.stop();
    }
}
