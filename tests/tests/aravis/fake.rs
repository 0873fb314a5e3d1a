//! The library's camera in this process. It produces a frame only where a slot waits, and reads its settings at every frame.

use std::collections::HashSet;
use std::thread;

use uvcam::camera::{CameraError, Settings};
use uvcam_shm_ipc::PixelFormat;
use uvcam_tests::open_aravis;

use crate::{SETTINGS, SLOTS, Slots, is_ramp, ready, whole};

const SERIAL: &str = "Fake_1";

/// Small and fast.
const FAST: Settings = Settings { width: 64, height: 48, fps: 500.0, exposure_us: 1000.0, ..SETTINGS };

fn refusal(settings: &Settings) -> String {
    let mut camera = open_aravis(SERIAL).unwrap();
    match camera.configure(settings) {
        Err(error @ CameraError::Refused { .. }) => error.to_string(),
        other => panic!("a refusal was expected, not {other:?}"),
    }
}

#[test]
fn tells_who_it_is() {
    let camera = open_aravis(SERIAL).unwrap();
    let identity = camera.identity();
    assert_eq!((identity.kind, &*identity.vendor, &*identity.model), ("aravis", "Aravis", "Fake"));
}

#[test]
fn is_not_listed() {
    assert!(uvcam::camera::kinds::list().iter().all(|identity| identity.transport != "Fake"));
}

#[test]
fn applied_is_what_the_camera_reads_back() {
    let mut camera = open_aravis(SERIAL).unwrap();
    // It counts the period in whole microseconds.
    let applied = camera.configure(&Settings { fps: 60.0, exposure_us: 1234.0, ..SETTINGS }).unwrap();
    assert_eq!(applied.fps, 1e6 / 16_666.0);
    assert_eq!(applied.exposure_us, 1234.0);
    assert_eq!((applied.width, applied.height, applied.stride), (640, 480, 640));
    assert_eq!(applied.payload_bytes, 640 * 480);
    let applied = camera.configure(&Settings { pixel_format: PixelFormat::Mono16, ..SETTINGS }).unwrap();
    assert_eq!((applied.stride, applied.payload_bytes), (1280, 1280 * 480));
}

#[test]
fn frames_appear_in_the_queued_slots() {
    let mut camera = open_aravis(SERIAL).unwrap();
    let applied = camera.configure(&Settings { exposure_us: 10_000.0, fps: 100.0, ..FAST }).unwrap();
    let slots = Slots::new(applied.payload_bytes);
    let mut addresses = HashSet::new();
    for _ in 0..SLOTS {
        let mut slot = slots.publisher.loan().unwrap();
        // The ramp stays below 255.
        slot.pixels_mut().fill(255);
        addresses.insert(slot.address());
        camera.queue(slot).unwrap();
    }
    camera.start().unwrap();
    let mut last = None;
    for _ in 0..500 {
        let mut capture = whole(camera.as_mut());
        assert!(addresses.contains(&capture.slot.address()));
        assert!(is_ramp(capture.slot.pixels_mut(), 64));
        assert_eq!(capture.frame_id, last.map_or(0, |last| last + 1));
        last = Some(capture.frame_id);
        capture.slot.pixels_mut().fill(255);
        camera.queue(capture.slot).unwrap();
    }
}

#[test]
fn an_exposure_below_the_range_is_refused() {
    let message = refusal(&Settings { exposure_us: 5.0, ..SETTINGS });
    assert!(message.contains("exposure_us = 5 refused") && message.contains("10 to 10000000"), "{message}");
}

#[test]
fn an_exposure_above_the_frame_period_is_refused() {
    let message = refusal(&Settings { exposure_us: 50_000.0, ..SETTINGS });
    assert!(message.contains("the largest exposure_us that fits at 25 fps is 40000"), "{message}");
}

#[test]
fn a_frame_rate_out_of_range_is_refused() {
    let message = refusal(&Settings { fps: 2000.0, exposure_us: 100.0, ..SETTINGS });
    assert!(message.contains("fps = 2000 refused") && message.contains("at most 1000.00 fps"), "{message}");
}

#[test]
fn a_pixel_format_that_the_camera_lacks_is_refused() {
    let message = refusal(&Settings { pixel_format: PixelFormat::Mono12, ..SETTINGS });
    assert!(message.contains("pixel_format = Mono12 refused") && message.contains("Mono8"), "{message}");
}

#[test]
fn a_region_beyond_the_sensor_is_refused() {
    let message = refusal(&Settings { width: 4096, ..SETTINGS });
    assert!(message.contains("width = 4096 refused") && message.contains("1 to 2048"), "{message}");
}

#[test]
fn gain_in_unknown_steps_is_refused_unless_zero() {
    let message = refusal(&Settings { gain_db: 3.0, ..SETTINGS });
    assert!(message.contains("gain_db = 3 refused") && message.contains("GainRaw"), "{message}");
    let mut camera = open_aravis(SERIAL).unwrap();
    assert_eq!(camera.configure(&SETTINGS).unwrap().gain_db, 0.0);
}

#[test]
fn a_slot_of_another_size_is_refused() {
    let mut camera = open_aravis(SERIAL).unwrap();
    let slots = Slots::new(100);
    let slot = slots.publisher.loan().unwrap();
    assert!(matches!(camera.queue(slot), Err(CameraError::Device { .. })));
    camera.configure(&SETTINGS).unwrap();
    let slot = slots.publisher.loan().unwrap();
    assert!(matches!(camera.queue(slot), Err(CameraError::Device { .. })));
}

#[test]
fn a_camera_that_refused_its_settings_does_not_start() {
    let mut camera = open_aravis(SERIAL).unwrap();
    camera.configure(&SETTINGS).unwrap();
    camera.configure(&Settings { fps: 2000.0, ..SETTINGS }).unwrap_err();
    assert!(matches!(camera.start(), Err(CameraError::Device { .. })));
}

#[test]
fn stopping_gives_the_slots_back() {
    let (mut camera, _, slots) = ready(SERIAL, &FAST);
    assert!(slots.publisher.loan().is_err());
    camera.start().unwrap();
    let capture = whole(camera.as_mut());
    camera.queue(capture.slot).unwrap();
    camera.stop();
    // All of them, for another run.
    slots.queue_all(camera.as_mut());
    camera.start().unwrap();
    assert_eq!(whole(camera.as_mut()).frame_id, 0);
    drop(camera);
    let loans: Vec<_> = std::iter::from_fn(|| slots.publisher.loan().ok()).collect();
    assert_eq!(loans.len(), SLOTS);
}

#[test]
fn another_frame_size_takes_other_slots() {
    let (mut camera, _, slots) = ready(SERIAL, &FAST);
    camera.start().unwrap();
    drop(whole(camera.as_mut()));
    let applied = camera.configure(&Settings { width: 128, ..FAST }).unwrap();
    drop(slots);
    let slots = Slots::new(applied.payload_bytes);
    slots.queue_all(camera.as_mut());
    camera.start().unwrap();
    assert_eq!(whole(camera.as_mut()).slot.len(), 128 * 48);
}

#[test]
fn a_slot_may_be_kept_while_the_camera_goes_on() {
    let (mut camera, _, _slots) = ready(SERIAL, &FAST);
    camera.start().unwrap();
    let mut kept = whole(camera.as_mut());
    let pixels = kept.slot.pixels_mut().to_vec();
    for _ in 0..20 {
        let capture = whole(camera.as_mut());
        camera.queue(capture.slot).unwrap();
    }
    assert_eq!(kept.slot.pixels_mut(), pixels);
}

#[test]
fn many_threads_open_at_once() {
    thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                let (mut camera, ..) = ready(SERIAL, &FAST);
                camera.start().unwrap();
                whole(camera.as_mut());
            });
        }
        scope.spawn(uvcam::camera::kinds::list);
    });
}
