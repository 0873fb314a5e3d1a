//! The kernel's virtual video device, which draws test patterns and fails on command.

use std::io::{ErrorKind, Read};

use rustix::event::{PollFd, PollFlags, poll};
use uvcam::camera::source::{Source, V4l2, V4l2Device, V4l2Memory};
use uvcam_masker::{ImageView, Mask};
use uvcam_shm_ipc::{Flags, Frame};
use uvcam_tests::conformance::{Case, Kind, settings};
use uvcam_tests::{Stage, next_frame, open, stderr};
use v4l::control::{Control, Value};
use v4l::v4l_sys::{V4L2_CID_AUTOGAIN, V4L2_CID_GAIN};
use v4l::video::Capture;
use v4l::{Device, Format, FourCC};

mod faults;

/// The device under test, and its serial: the place where it is connected.
const NODE: &str = "/dev/video0";
const SERIAL: &str = "platform:vivid-000";
/// A size at which the device draws up to 60 frames a second.
const SIZE: (u32, u32) = (320, 180);
const FPS: u32 = 50;
/// Rows that the mask blanks.
const MASKED_ROWS: u32 = 60;

/// Controls of vivid, by their ids (drivers/media/test-drivers/vivid/vivid-ctrls.c).
const VIVID: u32 = 0x00f0_f000;
const TEST_PATTERN: u32 = VIVID;
const OSD_TEXT_MODE: u32 = VIVID + 1;
const SHOW_BORDER: u32 = VIVID + 4;
const SHOW_SQUARE: u32 = VIVID + 5;
const SEQUENCE_WRAP: u32 = VIVID + 38;
const PERCENTAGE_DROPPED: u32 = VIVID + 64;

/// 100 % colour squares: differs from row to row and from column to column.
const COLOUR_SQUARES: i64 = 4;
const NO_TEXT: i64 = 2;

fn set(id: u32, value: i64) {
    let value = Value::Integer(value);
    Device::with_path(NODE).unwrap().set_control(Control { id, value }).unwrap();
}

fn get(id: u32) -> Value {
    Device::with_path(NODE).unwrap().control(id).unwrap().value
}

/// The same picture for ever, and no faults; automatics on, as a camera comes out of its box.
fn reset() {
    for (id, value) in [
        (TEST_PATTERN, COLOUR_SQUARES),
        (OSD_TEXT_MODE, NO_TEXT),
        (SHOW_BORDER, 1),
        (SHOW_SQUARE, 1),
        (PERCENTAGE_DROPPED, 0),
        (SEQUENCE_WRAP, 0),
        (V4L2_CID_AUTOGAIN, 1),
    ] {
        set(id, value);
    }
}

/// What the device draws, got by `read(2)`: another way than the driver's.
fn drawn(fourcc: &[u8; 4], bytes_per_pixel: usize) -> Vec<u8> {
    let mut device = Device::with_path(NODE).unwrap();
    let format = device.set_format(&Format::new(SIZE.0, SIZE.1, FourCC::new(fourcc))).unwrap();
    assert_eq!((format.width, format.height, &format.fourcc.repr), (SIZE.0, SIZE.1, fourcc));
    let mut picture = vec![0; SIZE.0 as usize * SIZE.1 as usize * bytes_per_pixel];
    loop {
        match device.read(&mut picture) {
            Ok(bytes) => break assert_eq!(bytes, picture.len()),
            Err(error) => assert_eq!(error.kind(), ErrorKind::WouldBlock, "{error}"),
        }
        let handle = device.handle();
        // SAFETY: the handle is open as long as `device` is.
        let handle = unsafe { std::os::fd::BorrowedFd::borrow_raw(handle.fd()) };
        poll(&mut [PollFd::new(&handle, PollFlags::IN)], None).unwrap();
    }
    assert!(picture.iter().any(|byte| *byte != picture[0]), "a picture of one grey");
    picture
}

/// A driver's configuration; `source` are further keys of its source.
fn camera(source: &str, pixel_format: &str) -> String {
    format!(
        "[[camera]]\nname = \"left\"\nsource = {{ kind = \"v4l2\", fixed_exposure_us = 1000, {source} }}\n\
         width = {}\nheight = {}\npixel_format = \"{pixel_format}\"\nfps = {FPS}\nexposure_us = 1000\nmask = \"mask.png\"\n",
        SIZE.0, SIZE.1
    )
}

/// What every frame must be: masked, and otherwise what the device drew.
struct Expected {
    mask: Mask,
    picture: Vec<u8>,
    bytes_per_pixel: usize,
}

impl Expected {
    fn new(stage: &Stage, fourcc: &[u8; 4], bytes_per_pixel: usize) -> Self {
        let mask = stage.write_mask("mask.png", SIZE, MASKED_ROWS);
        Expected { mask, picture: drawn(fourcc, bytes_per_pixel), bytes_per_pixel }
    }

    fn check(&self, frame: &Frame) {
        let header = frame.header();
        assert!(header.flags.contains(Flags::MASKED) && header.mask_id == self.mask.id().0);
        let (width, height) = SIZE;
        let image =
            ImageView::new(frame.pixels(), width, height, header.stride as usize, self.bytes_per_pixel);
        assert_eq!(self.mask.masked_nonzero(&image.unwrap()).unwrap(), 0);
        let kept = (height - MASKED_ROWS) as usize * width as usize * self.bytes_per_pixel;
        assert_eq!(frame.pixels().len(), self.picture.len());
        assert!(frame.pixels()[..kept] == self.picture[..kept], "pixels of frame {}", header.device_frame_id);
    }
}

/// Flies for `frames` frames and expects all of them, whole.
fn fly(source: &str, (pixel_format, fourcc, bytes_per_pixel): (&str, &[u8; 4], usize), frames: u64) {
    reset();
    let stage = Stage::new(&camera(source, pixel_format));
    let expected = Expected::new(&stage, fourcc, bytes_per_pixel);
    let mut subscriber = stage.subscriber("left");
    let driver = stage.driver();
    // The camera may begin while the consumer still connects.
    let mut next_id = None;
    for _ in 0..frames {
        let frame = next_frame(&mut subscriber);
        let id = frame.header().device_frame_id;
        assert_eq!(id, *next_id.get_or_insert(id));
        next_id = Some(id + 1);
        expected.check(&frame);
    }
    assert_eq!((subscriber.frames(), subscriber.lost(), subscriber.epochs()), (frames, 0, 1));
    let output = driver.stop();
    assert!(output.status.success(), "{}", stderr(&output));
    println!("\n| vivid, {source}, {pixel_format} | {frames} frames | 0 | - |");
}

fn conforms(memory: V4l2Memory, case: Case) {
    reset();
    let source = Source::V4l2(V4l2 {
        device: V4l2Device::Path(NODE.into()),
        memory: Some(memory),
        gain_step_db: None,
        fixed_exposure_us: Some(1000.0),
    });
    (case.run)(&Kind {
        open: &|| open(&source).unwrap(),
        settings: settings(SIZE.0, SIZE.1),
        // Its gain has no unit.
        takes_gains_db: &[],
        refuses_gains_db: &[3.0],
    });
}

mod conforms_by_user_pointers {
    use super::*;

    fn run(case: Case) {
        conforms(V4l2Memory::UserPointer, case);
    }

    uvcam_tests::conformance!(run);
}

mod conforms_by_one_copy {
    use super::*;

    fn run(case: Case) {
        conforms(V4l2Memory::Mapped, case);
    }

    uvcam_tests::conformance!(run);
}

#[test]
fn three_hundred_frames_by_user_pointers() {
    fly("path = \"/dev/video0\", memory = \"userptr\"", ("Mono8", b"GREY", 1), 300);
}

#[test]
fn three_hundred_frames_by_one_copy() {
    fly("path = \"/dev/video0\", memory = \"mmap\"", ("Mono8", b"GREY", 1), 300);
}

#[test]
fn formats_of_two_bytes_a_pixel() {
    for format in [("Mono10", b"Y10 "), ("Mono12", b"Y12 "), ("Mono16", b"Y16 ")] {
        fly(&format!("serial = \"{SERIAL}\""), (format.0, format.1, 2), 30);
    }
}

#[test]
fn automatic_gain_is_off_and_gain_the_lowest() {
    reset();
    let stage = Stage::new(&camera("path = \"/dev/video0\"", "Mono8"));
    stage.write_mask("mask.png", SIZE, MASKED_ROWS);
    let mut subscriber = stage.subscriber("left");
    let _driver = stage.driver();
    let frame = next_frame(&mut subscriber);
    assert_eq!(frame.header().gain_db, 0.0);
    assert_eq!((get(V4L2_CID_AUTOGAIN), get(V4L2_CID_GAIN)), (Value::Boolean(false), Value::Integer(0)));
}

#[test]
fn without_user_pointers_frames_are_copied() {
    reset();
    let stage = Stage::new(&camera("path = \"/dev/video0\"", "Mono8"));
    let expected = Expected::new(&stage, b"GREY", 1);
    faults::press(faults::REQBUFS_ERROR);
    let mut subscriber = stage.subscriber("left");
    let driver = stage.driver();
    for _ in 0..20 {
        expected.check(&next_frame(&mut subscriber));
    }
    assert_eq!((subscriber.lost(), subscriber.epochs()), (0, 1));
    let output = driver.stop();
    assert!(stderr(&output).contains("frames are copied once"), "{}", stderr(&output));
}

#[test]
fn a_second_driver_is_refused_and_costs_the_first_nothing() {
    reset();
    let stages = [(); 2].map(|()| Stage::new(&camera("path = \"/dev/video0\"", "Mono8")));
    let expected = stages.each_ref().map(|stage| Expected::new(stage, b"GREY", 1));
    let mut subscriber = stages[0].subscriber("left");
    let _driver = stages[0].driver();
    expected[0].check(&next_frame(&mut subscriber));
    let second = std::thread::scope(|scope| {
        let second = scope.spawn(|| stages[1].driver().finish());
        while !second.is_finished() {
            expected[0].check(&next_frame(&mut subscriber));
        }
        second.join().unwrap()
    });
    assert_eq!(second.status.code(), Some(4), "{}", stderr(&second));
    assert!(stderr(&second).contains("another program uses it"), "{}", stderr(&second));
    for _ in 0..20 {
        expected[0].check(&next_frame(&mut subscriber));
    }
    assert_eq!((subscriber.lost(), subscriber.epochs()), (0, 1));
}

#[test]
fn what_the_device_cannot_do_is_refused() {
    reset();
    let good = camera("path = \"/dev/video0\"", "Mono8");
    for (line, instead, expected) in [
        ("fixed_exposure_us = 1000, ", "", "exposure_us = 1000 refused: the camera gives no control"),
        ("width = 320", "width = 322", "width and height = 322x180 refused: the camera gives 320x180"),
        ("fps = 50", "fps = 57", "fps = 57 refused: the camera gives 60"),
        (
            "mask =",
            "gain_db = 6\nmask =",
            "gain_db = 6 refused: the camera gives 0 to 255 in a unit that it does not tell",
        ),
        ("mask =", "offset_x = 8\nmask =", "offset_x = 8 refused"),
    ] {
        let text = good.replace(line, instead);
        let stage = Stage::new(&text);
        let width = if text.contains("322") { 322 } else { SIZE.0 };
        stage.write_mask("mask.png", (width, SIZE.1), MASKED_ROWS);
        let output = stage.driver().finish();
        assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
        assert!(stderr(&output).contains(expected), "{}\nexpected: {expected}", stderr(&output));
    }
}

#[test]
fn the_list_names_it() {
    let stage = Stage::new(&camera("path = \"/dev/video0\"", "Mono8"));
    let output = stage.output(&["list"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.lines().any(|line| line.starts_with("v4l2") && line.contains(SERIAL)), "{text}");
}
