//! No mask that can fly, no frames; and the driver says why.
#![allow(clippy::unwrap_used)]

use std::time::Duration;

use image::{GrayImage, Luma, RgbImage};
use uvcam_shm_ipc::Flags;
use uvcam_tests::{Stage, next_frame, simulated, stderr};

/// Runs a driver whose only camera has this mask file, made by `write`; it must end by itself and say `expected`.
fn refused(write: impl FnOnce(&std::path::Path), expected: &str) {
    let stage = Stage::new(&simulated("left", "left.png", ""));
    write(&stage.file("left.png"));
    let mut subscriber = stage.subscriber("left");
    let output = stage.output(&["run", "--duration", "20"]);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(3), "{said}");
    assert!(said.contains("left: publishes nothing") && said.contains(expected), "{said}");
    assert!(!subscriber.wait(Duration::from_millis(1)).unwrap() && subscriber.receive().unwrap().is_none());
}

#[test]
fn a_missing_mask_is_refused() {
    refused(|_| {}, "No such file");
}

#[test]
fn garbage_is_refused() {
    refused(|path| std::fs::write(path, b"\x89PNG\r\n\x1a\nnot really").unwrap(), "left.png");
}

#[test]
fn a_mask_of_the_wrong_size_is_refused() {
    refused(|path| GrayImage::from_pixel(480, 752, Luma([255])).save(path).unwrap(), "480x752");
}

#[test]
fn a_mask_with_grey_pixels_is_refused_with_their_number() {
    let mut mask = GrayImage::from_pixel(752, 480, Luma([255]));
    for x in 10..17 {
        mask.put_pixel(x, 3, Luma([128]));
    }
    refused(|path| mask.save(path).unwrap(), "grey pixels: 7");
}

#[test]
fn a_mask_that_hides_everything_is_refused() {
    refused(|path| GrayImage::new(752, 480).save(path).unwrap(), "all pixels are masked");
}

#[test]
fn an_all_white_mask_flies_with_a_warning() {
    let stage = Stage::new(&simulated("left", "left.png", ""));
    RgbImage::from_pixel(752, 480, image::Rgb([255; 3])).save(stage.file("left.png")).unwrap();
    let output = stage.output(&["run", "--duration", "1"]);
    assert!(output.status.success() && stderr(&output).contains("no pixel is masked"), "{}", stderr(&output));
}

#[test]
fn an_unmasked_camera_says_so_in_every_header() {
    let stage = Stage::new(&simulated("left", "none", ""));
    let mut subscriber = stage.subscriber("left");
    let driver = stage.driver();
    let frame = next_frame(&mut subscriber);
    assert!(!frame.header().flags.contains(Flags::MASKED));
    assert!(frame.header().flags.contains(Flags::SIMULATED));
    assert_eq!(frame.header().mask_id, [0; 16]);
    assert!(stderr(&driver.stop()).contains("WITHOUT a mask"));
}

#[test]
fn a_refused_camera_leaves_the_others_running() {
    let stage = Stage::new(&(simulated("left", "missing.png", "") + &simulated("right", "none", "")));
    let mut right = stage.subscriber("right");
    let driver = stage.driver();
    for _ in 0..30 {
        next_frame(&mut right);
    }
    assert_eq!(right.lost(), 0);
    let output = driver.stop();
    assert_eq!(output.status.code(), Some(3));
    assert!(stderr(&output).contains("left: publishes nothing"));
}

#[test]
fn an_exposure_that_does_not_fit_is_refused_with_the_largest_that_does() {
    let stage = Stage::new(&simulated("left", "none", ", readout_us = 16000"));
    let output = stage.output(&["run", "--duration", "20"]);
    assert_eq!(output.status.code(), Some(3));
    assert!(
        stderr(&output).contains("the largest exposure_us that fits at 60 fps is 666"),
        "{}",
        stderr(&output)
    );
}
