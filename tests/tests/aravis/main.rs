//! The `aravis` source on the library's two emulated cameras: the one in this process, and a GigE Vision camera that is a program
//! of its own.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test ends where what it stands on is missing")]

mod fake;
mod gige;
mod supervision;

use std::time::Duration;

use uvcam::camera::{Applied, Camera, Capture, Event, Settings};
use uvcam_shm_ipc::Publisher;
use uvcam_tests::{SharedMemory, open_aravis};

/// What the emulated cameras can do. At 10 ms exposure and no gain their picture is exactly a ramp.
const SETTINGS: Settings = Settings::new(640, 480, 25.0, 10_000.0);

/// Longer than any frame takes.
const PATIENCE: Duration = Duration::from_secs(2);

/// Slots that a camera fills in turn.
const SLOTS: usize = 6;

/// The slots of one camera, in shared memory of one test alone.
struct Slots {
    publisher: Publisher,
    // Last: the publisher lives in it.
    _memory: SharedMemory,
}

impl Slots {
    fn new(payload_bytes: usize) -> Self {
        let memory = SharedMemory::new();
        Slots { publisher: memory.publisher("camera", payload_bytes, SLOTS), _memory: memory }
    }

    /// Queues as many slots as there are.
    fn queue_all(&self, camera: &mut dyn Camera) {
        for _ in 0..SLOTS {
            camera.queue(self.publisher.loan().unwrap()).unwrap();
        }
    }
}

/// Opens and configures a camera and queues all slots.
fn ready(serial: &str, settings: &Settings) -> (Box<dyn Camera>, Applied, Slots) {
    let mut camera = open_aravis(serial).unwrap();
    let applied = camera.configure(settings).unwrap();
    let slots = Slots::new(applied.payload_bytes);
    slots.queue_all(camera.as_mut());
    (camera, applied, slots)
}

/// The next whole frame. The first of a GigE Vision stream need not be: its socket gets its size with the first packet. A later
/// one that is lost shows in the ids.
fn whole(camera: &mut dyn Camera) -> Capture {
    loop {
        match camera.next(PATIENCE).unwrap() {
            Event::Complete(capture) => return capture,
            Event::Incomplete(slot) => camera.queue(slot).unwrap(),
            Event::Timeout => panic!("no frame within {PATIENCE:?}"),
        }
    }
}

/// Whether a picture of `width` columns is the emulated camera's: a diagonal ramp, modulo 255, from any start.
fn is_ramp(pixels: &[u8], width: usize) -> bool {
    let start = usize::from(pixels[0]);
    pixels
        .chunks_exact(width)
        .enumerate()
        .all(|(y, row)| row.iter().enumerate().all(|(x, &pixel)| usize::from(pixel) == (start + x + y) % 255))
}
