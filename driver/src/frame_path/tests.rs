use std::sync::Arc;
use std::sync::mpsc::channel;

use uvcam_shm_ipc::{PixelFormat, Settings, Subscriber, Wakeup};

use super::*;
use crate::camera::{Identity, Settings as CameraSettings};

const WIDTH: u32 = 752;
const HEIGHT: u32 = 480;
const SLOTS: usize = 6;
const FRAMES: u64 = 10_000;

mod laws;
mod loss;

/// Shared memory that no other test uses.
pub(crate) struct Place {
    pub(crate) settings: Settings,
    _folder: tempfile::TempDir,
}

impl Place {
    pub(crate) fn new() -> Self {
        let folder = tempfile::Builder::new().prefix("path").tempdir_in("/tmp").unwrap();
        let prefix = folder.path().file_name().unwrap().to_str().unwrap().replace('.', "");
        let settings = Settings::new(prefix, folder.path());
        Place { settings, _folder: folder }
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        // What a driver leaves to its successor.
        for file in std::fs::read_dir("/dev/shm").unwrap().flatten() {
            if file.file_name().to_string_lossy().starts_with(&self.settings.prefix) {
                let _ = std::fs::remove_file(file.path());
            }
        }
    }
}

pub(crate) fn identity() -> Identity {
    Identity {
        kind: "simulated",
        vendor: String::new(),
        model: String::new(),
        serial: String::new(),
        transport: String::new(),
        address: String::new(),
    }
}

fn applied(width: u32, height: u32) -> Applied {
    Applied::exactly(&CameraSettings::new(width, height, 60.0, 1000.0))
}

/// A camera whose next frame is always there, all of it white.
struct Instant {
    identity: Identity,
    queued: Vec<Slot>,
    exposed: u64,
    /// When it began, CLOCK_MONOTONIC in ns. Arrivals are a frame period apart from there on, however fast the test is.
    began_ns: u64,
    /// Frames that come with a part missing, by their number.
    is_incomplete: fn(u64) -> bool,
    /// Frames after which it is gone.
    frames: u64,
}

impl Instant {
    fn new() -> Self {
        Instant {
            identity: identity(),
            queued: Vec::with_capacity(SLOTS),
            exposed: 0,
            began_ns: monotonic_ns(),
            is_incomplete: |_| false,
            frames: u64::MAX,
        }
    }
}

impl Camera for Instant {
    fn identity(&self) -> &Identity {
        &self.identity
    }

    fn configure(&mut self, _: &CameraSettings) -> Result<Applied, CameraError> {
        unreachable!("the path gets what was applied")
    }

    fn queue(&mut self, slot: Slot) -> Result<(), CameraError> {
        self.queued.push(slot);
        Ok(())
    }

    fn start(&mut self) -> Result<(), CameraError> {
        Ok(())
    }

    fn next(&mut self, _: Duration) -> Result<Event, CameraError> {
        if self.exposed == self.frames {
            return Err(CameraError::Disconnected { serial: String::new(), doing: "streaming" });
        }
        let Some(mut slot) = self.queued.pop() else { return Ok(Event::Timeout) };
        slot.pixels_mut().fill(255);
        let frame_id = self.exposed;
        self.exposed += 1;
        if (self.is_incomplete)(frame_id) {
            return Ok(Event::Incomplete(slot));
        }
        Ok(Event::Complete(Capture {
            slot,
            frame_id,
            device_timestamp_ns: Some(self.exposed * 16_666_667),
            arrival_monotonic_ns: self.began_ns + self.exposed * 16_666_667 + self.exposed * 7919 % 300_000,
        }))
    }

    fn stop(&mut self) {
        self.queued.clear();
    }
}
