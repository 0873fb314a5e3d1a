//! Mask files as crews, editors and accidents leave them: what must not fly is refused before anything changes.
#![allow(clippy::unwrap_used)]

use std::path::Path;
use std::process::Output;

use image::{GrayImage, ImageBuffer, Luma, Rgba, RgbaImage};
use rustix::fs::{CWD, FileType, Mode, mknodat};
use rustix::process::Signal;
use uvcam_masker::{Mask, file};
use uvcam_tests::{Stage, health_where, next_frame, simulated, stderr, wait_until};

/// Writes a file.
type Write = fn(&Path);

/// The camera `left`, which flies `left.png`, and `right`, which flies without.
fn cameras() -> String {
    simulated("left", "left.png", "") + &simulated("right", "none", "")
}

/// A mask of which the airframe was erased to transparency.
fn erased(path: &Path) {
    let erased = |x, y| Rgba([255, 255, 255, if x < 100 && y < 70 { 0 } else { 255 }]);
    RgbaImage::from_fn(752, 480, erased).save(path).unwrap();
}

/// A PNG chunk of its type and data, with its length and check sum.
fn chunk(kind: &[u8; 4], data: &[u8]) -> Vec<u8> {
    let sum = |bytes: &[u8]| {
        // CRC-32 of ISO/IEC 15948, annex D.
        !bytes.iter().fold(u32::MAX, |sum, byte| {
            (0..8)
                .fold(sum ^ u32::from(*byte), |sum, _| (sum >> 1) ^ (0xedb8_8320 & (sum & 1).wrapping_neg()))
        })
    };
    let body = [kind, data].concat();
    [&(data.len() as u32).to_be_bytes()[..], &body, &sum(&body).to_be_bytes()].concat()
}

/// A picture with these header, palette and pixel chunks.
fn crafted(width: u32, height: u32, [depth, colour]: [u8; 2], palette: &[u8], pixels: &[u8]) -> Vec<u8> {
    let header = [&width.to_be_bytes()[..], &height.to_be_bytes(), &[depth, colour, 0, 0, 0]].concat();
    let palette = if palette.is_empty() { Vec::new() } else { chunk(b"PLTE", palette) };
    [
        b"\x89PNG\r\n\x1a\n".to_vec(),
        chunk(b"IHDR", &header),
        palette,
        chunk(b"IDAT", pixels),
        chunk(b"IEND", &[]),
    ]
    .concat()
}

/// A palette of seven bytes, in a picture of the camera's size.
fn broken_palette(path: &Path) {
    std::fs::write(path, crafted(752, 480, [8, 3], &[255; 7], &[0x78, 1])).unwrap();
}

/// The header of a picture of 64 million pixels.
fn swollen(path: &Path) {
    std::fs::write(path, crafted(8192, 8192, [1, 0], &[], &[0x78, 1])).unwrap();
}

fn pipe(path: &Path) {
    mknodat(CWD, path, FileType::Fifo, Mode::from_raw_mode(0o600), 0).unwrap();
}

fn assert_refused(output: &Output, expected: &str) {
    assert_eq!(output.status.code(), Some(3), "{}", stderr(output));
    assert!(stderr(output).contains(expected), "{}", stderr(output));
}

#[test]
fn a_transparent_mask_is_refused_by_everything_that_reads_masks() {
    const REFUSAL: &str = "7000 transparent pixels; flatten the picture: black is discarded, white kept";
    let stage = Stage::new(&cameras());
    erased(&stage.file("left.png"));
    stage.write_mask("picture.png", (752, 480), 10);
    let path = |name: &str| stage.file(name).to_string_lossy().into_owned();
    let (left, picture, out) = (path("left.png"), path("picture.png"), path("out.png"));
    for words in [
        &["mask", "check", &left][..],
        &["mask", "repair", &left, &out],
        &["mask", "repair", "--threshold", "128", &left, &out],
        &["mask", "apply", "--mask", &left, &picture, &out],
        &["mask", "metrics", &left],
        &["watch", "right", "--timeout", "1", "--mask", &left],
        &["run", "--duration", "1"],
    ] {
        assert_refused(&stage.output(words), REFUSAL);
        assert!(!stage.file("out.png").exists(), "{words:?}");
    }
    let generated = stage.output(&["generate", "--from", &left, "--out", &out]);
    assert_refused(&generated, "frame refused: ");
    assert_refused(&generated, "7000 transparent pixels");
    let missing = stage.output(&["generate", "--from", &picture, &path("missing.png"), "--out", &out]);
    assert_eq!(missing.status.code(), Some(2), "{}", stderr(&missing));
    assert!(!stage.file("out.png").exists());
}

#[test]
fn no_file_in_place_of_a_mask_costs_a_frame_and_a_good_one_flies_again() {
    let stage = Stage::new(&cameras());
    stage.write_mask("left.png", (752, 480), 10);
    let (mut left, mut right) = (stage.subscriber("left"), stage.subscriber("right"));
    let driver = stage.driver();
    next_frame(&mut left);
    next_frame(&mut right);
    let wrong: [(Write, &str); 5] = [
        (erased, "7000 transparent pixels"),
        (broken_palette, "chunk PLTE has a length that is no multiple of 3"),
        (swollen, "8192x8192"),
        (pipe, "it is a named pipe, not a file"),
        (|path| std::os::unix::fs::symlink("/dev/zero", path).unwrap(), "it is a device, not a file"),
    ];
    for (rows, (write, _)) in (20..).zip(wrong) {
        let flies = next_frame(&mut left).header().mask_id;
        std::fs::remove_file(stage.file("left.png")).unwrap();
        write(&stage.file("left.png"));
        driver.signal(Signal::HUP);
        for _ in 0..60 {
            assert_eq!(next_frame(&mut left).header().mask_id, flies, "what was in force stays");
            while right.receive().unwrap().is_some() {}
        }
        std::fs::remove_file(stage.file("left.png")).unwrap();
        let good = stage.write_mask("left.png", (752, 480), rows);
        driver.signal(Signal::HUP);
        wait_until("the good mask flies", || {
            while right.receive().unwrap().is_some() {}
            next_frame(&mut left).header().mask_id == good.id().0
        });
    }
    // What a busy machine keeps from this consumer is not lost by the driver.
    for camera in ["left", "right"] {
        let health = health_where("a record", &mut stage.health(camera), |_| true);
        assert_eq!((health.lost, health.no_free_slot, health.epochs), (0, 0, 1), "{camera}");
    }
    let output = driver.stop();
    assert!(output.status.success(), "{}", stderr(&output));
    for (_, expected) in wrong {
        assert!(stderr(&output).contains(expected), "{expected}: {}", stderr(&output));
    }
}

#[test]
fn a_camera_that_starts_with_a_broken_mask_flies_the_good_one_that_comes() {
    let stage = Stage::new(&cameras());
    broken_palette(&stage.file("left.png"));
    let (mut left, mut right) = (stage.subscriber("left"), stage.subscriber("right"));
    let driver = stage.driver();
    next_frame(&mut right);
    let good = stage.write_mask("left.png", (752, 480), 10);
    // The signal may come before the camera's thread has read the broken one.
    wait_until("the good mask flies", || {
        driver.signal(Signal::HUP);
        left.wait(std::time::Duration::from_millis(100)).unwrap()
    });
    assert_eq!(next_frame(&mut left).header().mask_id, good.id().0);
    assert!(driver.stop().status.success());
}

#[test]
fn what_is_accepted_or_restored_is_checked_before_anything_moves() {
    let stage = Stage::new(&cameras());
    let content = |name: &str| std::fs::read(stage.file(name)).unwrap();
    for rows in [10, 20] {
        stage.write_mask("left.candidate.png", (752, 480), rows);
        assert!(stage.output(&["mask", "accept", "left"]).status.success());
    }
    let in_force = content("left.png");
    let wrong: [(Write, &str); 4] = [
        (|path| GrayImage::from_pixel(752, 480, Luma([7])).save(path).unwrap(), "grey pixels: 360960"),
        (|path| GrayImage::new(752, 480).save(path).unwrap(), "all pixels are masked"),
        (
            |path| GrayImage::from_pixel(480, 752, Luma([255])).save(path).unwrap(),
            "the mask is 480x752 pixels",
        ),
        (erased, "7000 transparent pixels"),
    ];
    for (write, expected) in wrong {
        write(&stage.file("left.candidate.png"));
        stage.write_mask("left.candidate.input.png", (752, 480), 1);
        let candidate = content("left.candidate.png");
        assert_refused(&stage.output(&["mask", "accept", "left"]), expected);
        assert_eq!((content("left.png"), content("left.candidate.png")), (in_force.clone(), candidate));
        assert!(stage.file("left.candidate.input.png").exists());

        let bad = stage.file("left.history/000007_bad.png");
        write(&bad);
        let listed = stage.output(&["mask", "history", "left"]);
        let text = String::from_utf8_lossy(&listed.stdout).into_owned();
        let lines: Vec<&str> = text.lines().collect();
        assert!(listed.status.success() && lines.len() == 2, "{text}");
        assert!(lines[0].starts_with("1  must not fly: ") && lines[0].contains(expected), "{text}");
        assert!(lines[1].starts_with("2  ") && lines[1].contains("7520 px"), "{text}");
        assert_refused(&stage.output(&["mask", "restore", "left"]), expected);
        assert_eq!(content("left.png"), in_force);
        std::fs::remove_file(bad).unwrap();
    }
    assert!(stage.output(&["mask", "restore", "left"]).status.success());
    assert_eq!(Mask::load(&stage.file("left.png")).unwrap().masked_px(), 7520);
}

#[test]
fn parameters_beyond_their_ranges_are_refused_before_a_camera_is_troubled() {
    let stage = Stage::new(&cameras());
    stage.write_mask("left.png", (752, 480), 10);
    let mut left = stage.subscriber("left");
    let driver = stage.driver();
    next_frame(&mut left);
    for (option, value, expected) in [
        ("--kappa", "2000", "kappa is 2000; give 0 to 300 pixels"),
        ("--k", "1000", "k is 1000; give 1 to 100 points"),
        ("--eta", "5000", "eta is 5000; give 0 to 1000 pixels"),
        ("--tau", "inf", "tau is inf; give a distance in pixels above 0, at most 1000"),
        ("--leaf", "11", "leaf is 11; give one of [5, 10, 20, 40]"),
    ] {
        let output = stage.output(&["generate", "left", "--method", "paper", option, value]);
        assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
        assert!(stderr(&output).contains(expected), "{}", stderr(&output));
    }
    for _ in 0..60 {
        next_frame(&mut left);
    }
    assert_eq!(left.epochs(), 1);
    assert!(driver.stop().status.success());

    let stage = Stage::new(&(simulated("left", "left.png", "") + "[camera.generate]\nkappa = 301\n"));
    let output = stage.output(&["run"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("kappa: found 301; allowed: 0 to 300 pixels"), "{}", stderr(&output));
}

#[test]
fn a_mask_of_nearly_everything_is_no_mask() {
    let stage = Stage::new("");
    GrayImage::from_pixel(200, 150, Luma([200])).save(stage.file("frame.png")).unwrap();
    let [from, out] = ["frame.png", "mask.png"].map(|name| stage.file(name).to_string_lossy().into_owned());
    let output = stage.output(&["generate", "--from", &from, "--method", "paper", "--out", &out]);
    assert_refused(&output, "30000 of 30000 pixels are masked");
    assert!(!stage.file("mask.png").exists());
}

#[test]
fn frames_of_twelve_bits_in_sixteen_are_named() {
    let stage = Stage::new("");
    let names = ["dark.png", "lit.png"].map(|name| stage.file(name));
    for (name, largest) in names.iter().zip([0, 4080_u16]) {
        let frame = ImageBuffer::from_fn(200, 150, |x, y| {
            Luma([if (80..110).contains(&x) && y > 60 { largest } else { largest / 16 }])
        });
        frame.save(name).unwrap();
    }
    let [dark, lit] = names.map(|name| name.to_string_lossy().into_owned());
    let out = stage.file("mask.png").to_string_lossy().into_owned();
    let output = stage.output(&["generate", "--from", &dark, &lit, "--out", &out]);
    assert_refused(&output, "these pictures use 12 of 16 bits; scale them");
    assert!(!stage.file("mask.png").exists());
    assert_eq!(file::read_frame(Path::new(&lit)).unwrap().unscaled_bits(), Some(12));
}
