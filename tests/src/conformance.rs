//! What every camera must do, whatever it is made of: one suite, run on each of them, in `tests/conformance.rs` and in the lab.
//!
//! [`conformance!`](crate::conformance!) makes a test of each [`Case`], so that a failure names the camera and the case.
#![allow(clippy::unwrap_used)]

use std::time::{Duration, Instant};

use uvcam::camera::{Applied, Camera, CameraError, Capture, Event, Identity, Settings};
use uvcam_shm_ipc::Publisher;

use crate::SharedMemory;

const SLOTS: usize = 4;
const PATIENCE: Duration = Duration::from_secs(2);
const GAIN_TOLERANCE_DB: f64 = 0.1;

/// A kind of camera under test.
pub struct Kind<'a> {
    /// Opens it. It has at most one handle at a time.
    pub open: &'a dyn Fn() -> Box<dyn Camera>,
    /// Settings that it takes.
    pub settings: Settings,
    /// Gains that it takes beside that of its settings, dB ...
    pub takes_gains_db: &'a [f64],
    /// ... and gains that it cannot have.
    pub refuses_gains_db: &'a [f64],
}

/// One thing that every camera must do. `name` is the path of its test in the program.
pub struct Case {
    /// Where [`conformance!`](crate::conformance!) was called, and the name of the case.
    pub name: &'static str,
    /// Runs it; panics where the camera does otherwise.
    pub run: fn(&Kind),
}

/// Makes a test of each case, in the module where it is called. `$run` gets the [`Case`], and runs it on a camera.
#[macro_export]
macro_rules! conformance {
    ($run:path) => {
        $crate::conformance! { $run:
            identifies_itself
            is_the_same_device_when_it_is_opened_again
            reads_back_what_was_asked
            takes_the_gains_that_it_has_and_refuses_others
            fills_the_queued_slots_and_no_other_memory
            counts_frames_and_stamps_them
            waits_no_longer_than_asked
            loses_frames_visibly_when_it_has_no_slot
            gives_its_slots_back
            starts_again_after_a_stop
            refuses_an_exposure_that_does_not_fit
            refuses_a_slot_of_another_size
            does_not_start_without_being_configured
        }
    };
    ($run:path: $($case:ident)*) => { $(
        #[test]
        fn $case() {
            let path = concat!(module_path!(), "::", stringify!($case));
            // A test's path begins below its program's name.
            let (_, name) = path.split_once("::").unwrap();
            $run($crate::conformance::Case { name, run: $crate::conformance::$case });
        }
    )* };
}

/// Settings that a camera of this size takes: 50 Mono8 frames a second, 1 ms of exposure, no gain.
pub fn settings(width: u32, height: u32) -> Settings {
    Settings::new(width, height, 50.0, 1000.0)
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

/// Vendor, model and serial are texts that can be shown.
pub fn identifies_itself(kind: &Kind) {
    let camera = (kind.open)();
    assert!(!camera.identity().serial.is_empty());
    assert!(!camera.identity().model.is_empty());
    let Identity { vendor, model, serial, .. } = camera.identity();
    for text in [vendor, model, serial] {
        assert!(text.trim() == text && !text.contains(char::is_control), "{text:?}");
    }
}

/// Its identity lasts longer than its handle.
pub fn is_the_same_device_when_it_is_opened_again(kind: &Kind) {
    let first = (kind.open)().identity().clone();
    assert!((kind.open)().identity().is_same_device(&first), "{first:?}");
}

/// What it applies is what was asked for.
pub fn reads_back_what_was_asked(kind: &Kind) {
    let Kind { settings, .. } = kind;
    let applied = (kind.open)().configure(settings).unwrap();
    assert_eq!((applied.width, applied.height), (settings.width, settings.height));
    assert_eq!(applied.pixel_format, settings.pixel_format);
    assert!((applied.exposure_us - settings.exposure_us).abs() <= 1.0, "{applied:?}");
    assert!((applied.gain_db - settings.gain_db).abs() <= GAIN_TOLERANCE_DB, "{applied:?}");
    assert!((applied.fps - settings.fps).abs() <= 0.01 * settings.fps, "{applied:?}");
    assert_eq!(applied.payload_bytes, applied.stride as usize * applied.height as usize);
}

/// Gain is what was asked for, or an error that names it.
pub fn takes_the_gains_that_it_has_and_refuses_others(kind: &Kind) {
    let Kind { settings, takes_gains_db, refuses_gains_db, .. } = kind;
    assert!(takes_gains_db.len() + refuses_gains_db.len() > 0, "nothing to ask for");
    let with_gain = |gain_db| Settings { gain_db, ..settings.clone() };
    let mut camera = (kind.open)();
    // The last one is that of the settings: none stays from what was asked before.
    for asked_db in takes_gains_db.iter().chain([&settings.gain_db]) {
        let applied = camera.configure(&with_gain(*asked_db)).unwrap();
        assert!((applied.gain_db - asked_db).abs() <= GAIN_TOLERANCE_DB, "{asked_db} dB: {applied:?}");
    }
    for asked_db in *refuses_gains_db {
        let error = camera.configure(&with_gain(*asked_db)).unwrap_err();
        assert!(error.is_refusal() && error.to_string().contains("gain_db"), "{asked_db} dB: {error}");
    }
}

/// Frames come in the slots that were queued.
pub fn fills_the_queued_slots_and_no_other_memory(kind: &Kind) {
    let memory = SharedMemory::new();
    let mut camera = (kind.open)();
    let mut started = Started::new(camera.as_mut(), &kind.settings, &memory);
    for _ in 0..3 * SLOTS {
        let mut capture = started.next_whole();
        assert!(started.addresses.contains(&capture.slot.address()));
        assert!(capture.slot.pixels_mut().iter().any(|pixel| *pixel != 0));
        started.camera.queue(capture.slot).unwrap();
    }
}

/// Frame ids and arrivals grow.
pub fn counts_frames_and_stamps_them(kind: &Kind) {
    let memory = SharedMemory::new();
    let mut camera = (kind.open)();
    let mut started = Started::new(camera.as_mut(), &kind.settings, &memory);
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

/// A wait that is over before the next frame gives none.
pub fn waits_no_longer_than_asked(kind: &Kind) {
    let memory = SharedMemory::new();
    let slow = Settings { fps: 1.0, ..kind.settings.clone() };
    let mut camera = (kind.open)();
    let mut started = Started::new(camera.as_mut(), &slow, &memory);
    let first = started.next_whole();
    let event = started.camera.next(Duration::from_millis(1)).unwrap();
    assert!(matches!(event, Event::Timeout), "{event:?} after frame {}", first.frame_id);
}

/// What finds no slot is a gap in the ids.
pub fn loses_frames_visibly_when_it_has_no_slot(kind: &Kind) {
    let memory = SharedMemory::new();
    let mut camera = (kind.open)();
    let mut started = Started::new(camera.as_mut(), &kind.settings, &memory);
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

/// After a stop every slot is with its publisher.
pub fn gives_its_slots_back(kind: &Kind) {
    let memory = SharedMemory::new();
    let mut camera = (kind.open)();
    let started = Started::new(camera.as_mut(), &kind.settings, &memory);
    assert!(started.publisher.loan().is_err(), "the camera holds every slot");
    started.camera.stop();
    let loans: Vec<_> = (0..SLOTS).map(|_| started.publisher.loan().unwrap()).collect();
    assert!(loans.iter().all(|slot| slot.len() == started.applied.payload_bytes));
}

/// A stop is no end.
pub fn starts_again_after_a_stop(kind: &Kind) {
    let memory = SharedMemory::new();
    let mut camera = (kind.open)();
    Started::new(camera.as_mut(), &kind.settings, &memory).next_whole();
    camera.stop();
    Started::new(camera.as_mut(), &kind.settings, &memory).next_whole();
}

/// Two frame periods of exposure are no setting.
pub fn refuses_an_exposure_that_does_not_fit(kind: &Kind) {
    let slow = Settings { exposure_us: 2e6 / kind.settings.fps, ..kind.settings.clone() };
    let error = (kind.open)().configure(&slow).unwrap_err();
    assert!(error.is_refusal(), "{error}");
}

/// A slot is exactly as large as a frame.
pub fn refuses_a_slot_of_another_size(kind: &Kind) {
    let memory = SharedMemory::new();
    let mut camera = (kind.open)();
    let applied = camera.configure(&kind.settings).unwrap();
    let publisher = memory.publisher("wrong_size", applied.payload_bytes + 1, 1);
    let error = camera.queue(publisher.loan().unwrap()).unwrap_err();
    assert!(matches!(error, CameraError::Device { .. }), "{error}");
}

/// Nobody flies what was left behind.
pub fn does_not_start_without_being_configured(kind: &Kind) {
    assert!((kind.open)().start().is_err(), "started without being configured");
}
