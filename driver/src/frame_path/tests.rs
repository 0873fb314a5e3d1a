use std::sync::Arc;
use std::sync::mpsc::channel;

use uvcam_masker::Mask;
use uvcam_shm_ipc::{PixelFormat, Settings, Subscriber, Wakeup};

use super::*;
use crate::camera::{Identity, Settings as CameraSettings};

const WIDTH: u32 = 752;
const HEIGHT: u32 = 480;
const SLOTS: usize = 6;
const FRAMES: u64 = 10_000;

mod loss;

/// Shared memory that no other test uses.
struct Place {
    settings: Settings,
    _folder: tempfile::TempDir,
}

impl Place {
    fn new() -> Self {
        let folder = tempfile::Builder::new().prefix("path").tempdir_in("/tmp").unwrap();
        let prefix = folder.path().file_name().unwrap().to_str().unwrap().replace('.', "");
        let settings = Settings { prefix, root_path: folder.path().into(), ..Settings::default() };
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

fn identity() -> Identity {
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
    Applied {
        width,
        height,
        stride: width,
        pixel_format: PixelFormat::Mono8,
        fps: 60.0,
        exposure_us: 1000.0,
        gain_db: 0.0,
        payload_bytes: (width * height) as usize,
    }
}

/// A camera whose next frame is always there.
struct Instant {
    identity: Identity,
    queued: Vec<Slot>,
    exposed: u64,
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
        let Some(mut slot) = self.queued.pop() else { return Ok(Event::Timeout) };
        slot.pixels_mut().fill(255);
        self.exposed += 1;
        Ok(Event::Complete(Capture {
            slot,
            frame_id: self.exposed - 1,
            device_timestamp_ns: Some(self.exposed * 16_666_667),
            arrival_monotonic_ns: self.exposed * 16_666_667 + self.exposed * 7919 % 300_000,
        }))
    }

    fn stop(&mut self) {
        self.queued.clear();
    }
}

#[test]
fn from_complete_to_sent_nothing_is_allocated() {
    let place = Place::new();
    let settings = &place.settings;
    let frame_bytes = (WIDTH * HEIGHT) as usize;
    let mut publisher = Publisher::create(settings, "left", frame_bytes, SLOTS).unwrap();
    // One consumer reads, one listens to the event and never reads: its oldest frames give way.
    let mut reader = Subscriber::open(settings, "left").unwrap();
    let mut listener = Subscriber::open(settings, "left").unwrap();
    listener.set_wakeup(Wakeup::Event);
    assert!(!listener.wait(Duration::from_millis(1)).unwrap());

    let (_, commands) = channel();
    let mut camera = Instant { identity: identity(), queued: Vec::with_capacity(SLOTS), exposed: 0 };
    let applied = applied(WIDTH, HEIGHT);
    let mask = Mask::from_fn(WIDTH, HEIGHT, |x, y| (x / 8 + y / 8) % 7 == 0);
    let counters = Counters::default();
    let mut path = FramePath {
        camera: &mut camera,
        applied: &applied,
        publisher: &mut publisher,
        mask: &mut Some(Arc::new(mask)),
        commands: &commands,
        counters: &counters,
        header: FrameHeader::new(WIDTH, HEIGHT, WIDTH, PixelFormat::Mono8),
        first_frame_patience: PATIENCE,
        slots: SLOTS,
        position: Position::default(),
    };
    for frame in 0..=FRAMES {
        path.fill_queue().unwrap();
        let Event::Complete(capture) = path.camera.next(PATIENCE).unwrap() else { panic!("no frame") };
        path.position.queued -= 1;
        let mut sent = Ok(());
        let allocated = allocation_counter::measure(|| sent = path.publish(capture));
        sent.unwrap();
        // The first frame connects the consumers that came since the last one.
        assert!(frame == 0 || allocated.count_total == 0, "frame {frame}: {allocated:?}");
        assert_eq!(reader.next().unwrap().unwrap().header().sequence, frame);
    }
    assert_eq!((reader.lost(), counters.lost.into_inner()), (0, 0));
    assert_eq!(counters.published.into_inner(), FRAMES + 1);
}
