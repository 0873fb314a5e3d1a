//! What every camera must do, whatever it is made of: one suite, run on each of them, in `tests/conformance.rs` and in the lab.
#![allow(clippy::unwrap_used)]

use std::time::{Duration, Instant};

use uvcam::camera::{Applied, Camera, CameraError, Capture, Event, Identity, Settings};
use uvcam_shm_ipc::{PixelFormat, Publisher};

use crate::SharedMemory;

const SLOTS: usize = 4;
const PATIENCE: Duration = Duration::from_secs(2);

/// Settings that a camera of this size takes: 50 Mono8 frames a second, 1 ms of exposure, no gain.
pub fn settings(width: u32, height: u32) -> Settings {
    Settings {
        width,
        height,
        offset_x: 0,
        offset_y: 0,
        binning_horizontal: 1,
        binning_vertical: 1,
        pixel_format: PixelFormat::Mono8,
        fps: 50.0,
        exposure_us: 1000.0,
        gain_db: 0.0,
    }
}

/// A camera with its queue filled, started.
pub struct Started<'a> {
    /// The camera.
    pub camera: &'a mut dyn Camera,
    publisher: Publisher,
    applied: Applied,
    addresses: Vec<usize>,
}

impl<'a> Started<'a> {
    /// Configures, fills and starts it.
    pub fn new(camera: &'a mut dyn Camera, settings: &Settings, memory: &SharedMemory) -> Self {
        let applied = camera.configure(settings).unwrap();
        let publisher = memory.publisher("conformance", applied.payload_bytes, SLOTS);
        let mut addresses = Vec::new();
        for _ in 0..SLOTS {
            let slot = publisher.loan().unwrap();
            addresses.push(slot.address());
            camera.queue(slot).unwrap();
        }
        camera.start().unwrap();
        Started { camera, publisher, applied, addresses }
    }

    /// The next frame that is whole; it must come.
    pub fn next_whole(&mut self) -> Capture {
        let start = Instant::now();
        loop {
            match self.camera.next(PATIENCE).unwrap() {
                Event::Complete(capture) => return capture,
                Event::Incomplete(slot) => self.camera.queue(slot).unwrap(),
                Event::Timeout => assert!(start.elapsed() < PATIENCE * 2, "no frame"),
            }
        }
    }
}

/// Runs the suite. `open` opens the camera, which has at most one handle at a time.
pub fn suite(open: &dyn Fn() -> Box<dyn Camera>, settings: &Settings) {
    let memory = SharedMemory::new();
    identifies_itself(open().as_ref());
    is_the_same_device_when_it_is_opened_again(open);
    reads_back_what_was_asked(open().as_mut(), settings);
    fills_the_queued_slots_and_no_other_memory(open().as_mut(), settings, &memory);
    counts_frames_and_stamps_them(open().as_mut(), settings, &memory);
    waits_no_longer_than_asked(open().as_mut(), settings, &memory);
    loses_frames_visibly_when_it_has_no_slot(open().as_mut(), settings, &memory);
    gives_its_slots_back(open().as_mut(), settings, &memory);
    starts_again_after_a_stop(open().as_mut(), settings, &memory);
    refuses_what_does_not_fit(open, settings, &memory);
}

fn identifies_itself(camera: &dyn Camera) {
    assert!(!camera.identity().serial.is_empty());
    assert!(!camera.identity().model.is_empty());
    let Identity { vendor, model, serial, .. } = camera.identity();
    for text in [vendor, model, serial] {
        assert!(text.trim() == text && !text.contains(char::is_control), "{text:?}");
    }
}

fn is_the_same_device_when_it_is_opened_again(open: &dyn Fn() -> Box<dyn Camera>) {
    let first = open().identity().clone();
    assert!(open().identity().is_same_device(&first), "{first:?}");
}

fn reads_back_what_was_asked(camera: &mut dyn Camera, settings: &Settings) {
    let applied = camera.configure(settings).unwrap();
    assert_eq!((applied.width, applied.height), (settings.width, settings.height));
    assert_eq!(applied.pixel_format, settings.pixel_format);
    assert!((applied.exposure_us - settings.exposure_us).abs() <= 1.0, "{applied:?}");
    assert!((applied.fps - settings.fps).abs() <= 0.01 * settings.fps, "{applied:?}");
    assert_eq!(applied.payload_bytes, applied.stride as usize * applied.height as usize);
}

fn fills_the_queued_slots_and_no_other_memory(
    camera: &mut dyn Camera,
    settings: &Settings,
    memory: &SharedMemory,
) {
    let mut started = Started::new(camera, settings, memory);
    for _ in 0..3 * SLOTS {
        let mut capture = started.next_whole();
        assert!(started.addresses.contains(&capture.slot.address()));
        assert!(capture.slot.pixels_mut().iter().any(|pixel| *pixel != 0));
        started.camera.queue(capture.slot).unwrap();
    }
}

fn counts_frames_and_stamps_them(camera: &mut dyn Camera, settings: &Settings, memory: &SharedMemory) {
    let mut started = Started::new(camera, settings, memory);
    let mut last: Option<(u64, u64)> = None;
    for _ in 0..20 {
        let Capture { slot, frame_id, arrival_monotonic_ns, .. } = started.next_whole();
        if let Some((last_id, last_arrival)) = last {
            assert!(frame_id > last_id && arrival_monotonic_ns > last_arrival);
        }
        last = Some((frame_id, arrival_monotonic_ns));
        started.camera.queue(slot).unwrap();
    }
}

fn waits_no_longer_than_asked(camera: &mut dyn Camera, settings: &Settings, memory: &SharedMemory) {
    let slow = Settings { fps: 1.0, ..settings.clone() };
    let mut started = Started::new(camera, &slow, memory);
    let first = started.next_whole();
    let event = started.camera.next(Duration::from_millis(1)).unwrap();
    assert!(matches!(event, Event::Timeout), "{event:?} after frame {}", first.frame_id);
}

fn loses_frames_visibly_when_it_has_no_slot(
    camera: &mut dyn Camera,
    settings: &Settings,
    memory: &SharedMemory,
) {
    let mut started = Started::new(camera, settings, memory);
    let held: Vec<Capture> = (0..SLOTS).map(|_| started.next_whole()).collect();
    let event = started.camera.next(Duration::from_millis(100)).unwrap();
    assert!(matches!(event, Event::Timeout), "{event:?} without a slot");
    let last = held.iter().map(|capture| capture.frame_id).max().unwrap();
    for capture in held {
        started.camera.queue(capture.slot).unwrap();
    }
    let gap = started.next_whole().frame_id - last;
    assert!(gap > 1, "100 ms without a slot, and a gap of {gap}");
}

fn gives_its_slots_back(camera: &mut dyn Camera, settings: &Settings, memory: &SharedMemory) {
    let started = Started::new(camera, settings, memory);
    assert!(started.publisher.loan().is_err(), "the camera holds every slot");
    started.camera.stop();
    let loans: Vec<_> = (0..SLOTS).map(|_| started.publisher.loan().unwrap()).collect();
    assert!(loans.iter().all(|slot| slot.len() == started.applied.payload_bytes));
}

fn starts_again_after_a_stop(camera: &mut dyn Camera, settings: &Settings, memory: &SharedMemory) {
    Started::new(camera, settings, memory).next_whole();
    camera.stop();
    Started::new(camera, settings, memory).next_whole();
}

fn refuses_what_does_not_fit(open: &dyn Fn() -> Box<dyn Camera>, settings: &Settings, memory: &SharedMemory) {
    let slow = Settings { exposure_us: 2e6 / settings.fps, ..settings.clone() };
    let error = open().configure(&slow).unwrap_err();
    assert!(error.is_refusal(), "{error}");

    let mut camera = open();
    let applied = camera.configure(settings).unwrap();
    let publisher = memory.publisher("wrong_size", applied.payload_bytes + 1, 1);
    let error = camera.queue(publisher.loan().unwrap()).unwrap_err();
    assert!(matches!(error, CameraError::Device { .. }), "{error}");
    // A device has one master at a time.
    drop(camera);
    assert!(open().start().is_err(), "started without being configured");
}
