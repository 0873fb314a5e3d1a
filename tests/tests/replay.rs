//! A recorded flight as a camera, however long it was.
#![allow(clippy::unwrap_used)]

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use image::{GrayImage, Luma};
use uvcam::camera::{CameraError, Event};
use uvcam_tests::conformance::{Started, settings};
use uvcam_tests::{SharedMemory, Stage, binary, open_replay, simulated, stderr};

/// 75 s at 60 fps, which are 1.6 GB of pixels.
const FRAMES: usize = 4500;
const SIZE: (u32, u32) = (752, 480);

fn write(folder: &Path, name: &str, level: u8) {
    GrayImage::from_pixel(8, 4, Luma([level])).save(folder.join(name)).unwrap();
}

#[test]
fn a_long_flight_takes_no_more_memory_than_a_short_one() {
    let replay = "[[camera]]\nname = \"right\"\nsource = { kind = \"replay\", path = \"frames\" }\n\
                  width = 752\nheight = 480\nfps = 60\nexposure_us = 1000\nmask = \"none\"\n";
    let stage = Stage::new(&(simulated("left", "none", "") + replay));
    let frames = stage.file("frames");
    std::fs::create_dir(&frames).unwrap();
    let first = frames.join("0.png");
    GrayImage::from_fn(SIZE.0, SIZE.1, |x, y| Luma([(x ^ y) as u8])).save(&first).unwrap();
    for index in 1..FRAMES {
        std::fs::hard_link(&first, frames.join(format!("{index}.png"))).unwrap();
    }
    // Less address space than the pixels of the flight: what asks for more is aborted.
    let output = Command::new("sh")
        .args(["-c", "ulimit -v 1400000 && exec \"$@\"", "sh"])
        .arg(binary())
        .args(["run", "--duration", "3", "--config"])
        .arg(stage.file("uvcam.toml"))
        .stdin(Stdio::null())
        .output()
        .unwrap();
    let said = stderr(&output);
    assert!(output.status.success(), "{:?}\n{said}", output.status);
    assert!(said.contains("right: streaming") && said.contains("left: streaming"), "{said}");
}

#[test]
fn pictures_come_in_the_order_in_which_a_person_counts_them() {
    let folder = tempfile::tempdir().unwrap();
    for (name, level) in [("frame_10.png", 30), ("frame_9.png", 20), ("frame_08.png", 10)] {
        write(folder.path(), name, level);
    }
    // What a Mac leaves beside the files of an exFAT stick.
    std::fs::write(folder.path().join("._frame_9.png"), "Mac OS X").unwrap();
    let memory = SharedMemory::new();
    let mut camera = open_replay(folder.path()).unwrap();
    let mut started = Started::new(camera.as_mut(), &settings(8, 4), &memory);
    for expected in [10, 20, 30, 10] {
        let mut capture = started.next_whole();
        assert!(capture.slot.pixels_mut().iter().all(|pixel| *pixel == expected));
        started.camera.queue(capture.slot).unwrap();
    }
    started.camera.stop();
    drop(started);
    // A new start begins with the first picture, whatever was read ahead before.
    let mut started = Started::new(camera.as_mut(), &settings(8, 4), &memory);
    let mut capture = started.next_whole();
    assert!(capture.slot.pixels_mut().iter().all(|pixel| *pixel == 10));
}

#[test]
fn a_broken_picture_is_an_incomplete_frame_and_the_next_ones_come() {
    let folder = tempfile::tempdir().unwrap();
    for index in 0..4 {
        write(folder.path(), &format!("{index}.png"), 10 * index + 10);
    }
    std::fs::write(folder.path().join("1.png"), "no picture").unwrap();
    GrayImage::new(4, 8).save(folder.path().join("2.png")).unwrap();
    let memory = SharedMemory::new();
    let mut camera = open_replay(folder.path()).unwrap();
    let started = Started::new(camera.as_mut(), &settings(8, 4), &memory);
    let mut incomplete = 0;
    let mut whole = Vec::new();
    while whole.len() < 4 {
        match started.camera.next(Duration::from_secs(2)).unwrap() {
            Event::Complete(mut capture) => {
                whole.push((capture.frame_id % 4, capture.slot.pixels_mut()[0]));
                started.camera.queue(capture.slot).unwrap();
            }
            Event::Incomplete(slot) => {
                incomplete += 1;
                started.camera.queue(slot).unwrap();
            }
            Event::Timeout => panic!("no frame"),
        }
    }
    assert!(incomplete >= 2, "{incomplete} incomplete among {whole:?}");
    assert!(whole.iter().all(|frame| [(0, 10), (3, 40)].contains(frame)), "{whole:?}");
}

#[test]
fn a_first_picture_that_cannot_be_read_fails_with_its_name() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("1.png"), "no picture").unwrap();
    let error = open_replay(folder.path()).unwrap().configure(&settings(8, 4)).unwrap_err();
    let message = error.to_string();
    assert!(matches!(error, CameraError::Device { .. }), "{message}");
    assert!(
        message.contains("failed while reading its pictures: `") && message.contains("1.png`"),
        "{message}"
    );
}
