//! A camera of the USB video class behind the kernel's uvcvideo.

use std::fs;
use std::path::PathBuf;

use uvcam_emulated::scene::picture;
use uvcam_emulated::usb::Plugged;
use uvcam_emulated::uvc::{Camera, Fault, SIZE};
use uvcam_masker::{ImageView, Mask};
use uvcam_shm_ipc::{Frame, Subscriber, monotonic_ns};
use uvcam_tests::{Process, Stage, health_where, next_frame, stderr, wait_until};
use v4l::buffer::Type;
use v4l::control::{Control, Value};
use v4l::io::traits::CaptureStream;
use v4l::prelude::MmapStream;
use v4l::video::Capture;
use v4l::{Device, FourCC};

/// Control ids (Linux, videodev2.h and v4l2-controls.h).
const GAIN: u32 = 0x0098_0913;
const POWER_LINE_FREQUENCY: u32 = 0x0098_0918;
const EXPOSURE_AUTO: u32 = 0x009a_0901;
const EXPOSURE_MANUAL: i64 = 1;
const EXPOSURE_ABSOLUTE: u32 = 0x009a_0902;
const EXPOSURE_AUTO_PRIORITY: u32 = 0x009a_0903;

/// Rows that the mask blanks.
const MASKED_ROWS: u32 = 100;
/// The longest time from the return of the camera to its first good frame. The guest's clock counts instructions: it can be relied on.
const RECOVERY_NS: u64 = 1_000_000_000;

/// The node that the kernel makes of the camera; udev links it by the serial number.
fn node(serial: &str) -> PathBuf {
    let folder = PathBuf::from("/dev/v4l/by-id");
    let mut found = None;
    wait_until("udev has linked the camera", || {
        let entries = fs::read_dir(&folder).into_iter().flatten().flatten();
        found = entries.map(|entry| entry.path()).find(|path| {
            path.to_string_lossy().contains(serial) && path.to_string_lossy().ends_with("index0")
        });
        found.is_some()
    });
    found.unwrap()
}

#[test]
fn exposure_and_gain_arrive_as_asked_and_pictures_as_drawn() {
    let camera = Plugged::new(Camera::new("UVC1"));
    let device = Device::with_path(node("UVC1")).unwrap();
    let set = |id, value| device.set_control(Control { id, value: Value::Integer(value) }).unwrap();
    set(EXPOSURE_AUTO, EXPOSURE_MANUAL);
    set(EXPOSURE_AUTO_PRIORITY, 0);
    set(EXPOSURE_ABSOLUTE, 10);
    set(GAIN, 17);
    set(POWER_LINE_FREQUENCY, 0);
    {
        let camera = camera.device();
        assert_eq!((camera.exposure_us(), camera.gain()), (Some(1000.0), 17));
        assert!(!camera.lowers_frame_rate() && camera.power_line_frequency() == 0);
    }

    let format = device.format().unwrap();
    assert_eq!(format.fourcc, FourCC::new(b"GREY"));
    assert_eq!((format.width, format.height), (u32::from(SIZE.0), u32::from(SIZE.1)));
    let mut stream = MmapStream::with_buffers(&device, Type::VideoCapture, 4).unwrap();
    for sequence in 0..60 {
        let (pixels, metadata) = stream.next().unwrap();
        assert_eq!((metadata.sequence, metadata.bytesused as usize), (sequence, pixels.len()));
        assert!(pixels == &*picture(u64::from(pixels[0]) - 1, pixels.len()), "picture {sequence}");
    }
}

/// A driver on the camera, and a consumer that looks at every frame.
struct Flight {
    memory: &'static str,
    camera: Option<Plugged<Camera>>,
    mask: Mask,
    subscriber: Subscriber,
    driver: Process,
    // Last: the others live in it.
    _stage: Stage,
}

impl Flight {
    fn start(memory: &'static str) -> Self {
        let camera = Plugged::new(Camera::new("UVC1"));
        node("UVC1");
        let (width, height) = SIZE;
        let stage = Stage::new(&format!(
            "[[camera]]\nname = \"left\"\nwidth = {width}\nheight = {height}\nfps = 60\nexposure_us = 1000\n\
             gain_db = 1.7\nmask = \"mask.png\"\n[camera.source]\nkind = \"v4l2\"\nserial = \"UVC1\"\n\
             memory = \"{memory}\"\ngain_step_db = 0.1\n"
        ));
        let mask = stage.write_mask("mask.png", (width.into(), height.into()), MASKED_ROWS);
        let subscriber = stage.subscriber("left");
        let driver = stage.driver();
        Flight { memory, camera: Some(camera), mask, subscriber, driver, _stage: stage }
    }

    /// Takes a frame, which must be masked and otherwise one that the camera drew.
    fn frame(&mut self) -> Frame {
        let frame = next_frame(&mut self.subscriber);
        let (width, height) = (u32::from(SIZE.0), u32::from(SIZE.1));
        let image = ImageView::new(frame.pixels(), width, height, width as usize, 1).unwrap();
        assert_eq!(self.mask.masked_nonzero(&image).unwrap(), 0);
        let drawn = picture(u64::from(frame.pixels()[0]) - 1, frame.pixels().len());
        let kept = ((height - MASKED_ROWS) * width) as usize;
        assert!(frame.pixels()[..kept] == drawn[..kept], "frame {}", frame.header().device_frame_id);
        frame
    }

    fn report(self, what: &str, seen: &str, recovery: &str) {
        println!("\n| UVC, {}: {what} | {seen} | {} | {recovery} |", self.memory, self.subscriber.lost());
        let output = self.driver.stop();
        assert!(output.status.success(), "{}", stderr(&output));
    }
}

#[test]
fn the_driver_sets_the_camera_and_loses_no_frame() {
    for memory in ["userptr", "mmap"] {
        let mut flight = Flight::start(memory);
        for id in 0..300 {
            let header = *flight.frame().header();
            assert_eq!((header.device_frame_id, header.exposure_us), (id, 1000.0));
            assert!((header.gain_db - 1.7).abs() < 1e-9);
        }
        assert_eq!((flight.subscriber.lost(), flight.subscriber.epochs()), (0, 1));
        {
            let camera = flight.camera.as_ref().unwrap().device();
            assert_eq!((camera.exposure_us(), camera.gain()), (Some(1000.0), 17));
            assert!(!camera.lowers_frame_rate() && camera.power_line_frequency() == 0);
        }
        flight.report("300 frames", "nothing", "-");
    }
}

#[test]
fn an_unplugged_camera_is_found_again_by_its_serial() {
    for memory in ["userptr", "mmap"] {
        let mut flight = Flight::start(memory);
        for _ in 0..30 {
            flight.frame();
        }
        flight.camera = None;
        flight.camera = Some(Plugged::new(Camera::new("UVC1")));
        let plugged = monotonic_ns();
        let recovery_ns = loop {
            let frame = flight.frame();
            if frame.epoch_changed() {
                break frame.header().arrival_monotonic_ns - plugged;
            }
        };
        for _ in 0..30 {
            flight.frame();
        }
        assert_eq!((flight.subscriber.lost(), flight.subscriber.epochs()), (0, 2));
        assert!(recovery_ns < RECOVERY_NS, "{recovery_ns} ns");
        flight.report(
            "unplugged and plugged in",
            "a new epoch",
            &format!("{:.2}", recovery_ns as f64 * 1e-9),
        );
    }
}

#[test]
fn a_spoilt_picture_is_one_lost_frame() {
    for memory in ["userptr", "mmap"] {
        let mut flight = Flight::start(memory);
        for (lost, fault) in [(1, Fault::ShortPayload), (2, Fault::ErrorBit)] {
            flight.frame();
            flight.camera.as_ref().unwrap().device().fail(fault);
            while flight.subscriber.lost() < lost {
                flight.frame();
            }
            for _ in 0..30 {
                flight.frame();
            }
            assert_eq!((flight.subscriber.lost(), flight.subscriber.epochs()), (lost, 1), "{fault:?}");
        }
        flight.report("half a picture, a picture with the error bit", "gaps", "-");
    }
}

#[test]
fn a_camera_that_freezes_is_opened_again() {
    for memory in ["userptr", "mmap"] {
        let mut flight = Flight::start(memory);
        let mut last_ns = 0;
        for _ in 0..30 {
            last_ns = flight.frame().header().arrival_monotonic_ns;
        }
        flight.camera.as_ref().unwrap().device().fail(Fault::Freeze);
        let silence_ns = loop {
            let frame = flight.frame();
            let arrival_ns = frame.header().arrival_monotonic_ns;
            if frame.epoch_changed() {
                break arrival_ns - last_ns;
            }
            last_ns = arrival_ns;
        };
        for _ in 0..30 {
            flight.frame();
        }
        assert_eq!((flight.subscriber.lost(), flight.subscriber.epochs()), (0, 2));
        // A camera counts as silent after a second.
        assert!(silence_ns < 1_000_000_000 + RECOVERY_NS, "{silence_ns} ns");
        flight.report("silence", "a new epoch", &format!("{:.2}", silence_ns as f64 * 1e-9));
    }
}

/// The link that leads to the camera by the port that it is in: another camera there has the same.
fn by_path() -> PathBuf {
    let folder = PathBuf::from("/dev/v4l/by-path");
    let mut found = None;
    wait_until("udev has linked the port", || {
        let entries = fs::read_dir(&folder).into_iter().flatten().flatten();
        found = entries.map(|entry| entry.path()).find(|path| {
            let path = path.to_string_lossy();
            path.contains("vhci_hcd") && path.contains("usb-") && path.ends_with("index0")
        });
        found.is_some()
    });
    found.unwrap()
}

#[test]
fn another_camera_in_its_port_is_not_flown_and_itself_is() {
    let camera = Plugged::new(Camera::new("UVC1"));
    let port = by_path();
    let stage = Stage::new(&format!(
        "[[camera]]\nname = \"left\"\nwidth = {}\nheight = {}\nfps = 60\nexposure_us = 1000\nmask = \"none\"\n\
         source = {{ kind = \"v4l2\", path = {port:?} }}\n",
        SIZE.0, SIZE.1
    ));
    let mut subscriber = stage.subscriber("left");
    let driver = stage.driver();
    next_frame(&mut subscriber);
    let mut health = stage.health("left");
    drop(camera);
    let other = Plugged::new(Camera::new("UVC2"));
    let refused = health_where("the refusal", &mut health, |health| health.last_error().contains("UVC2"));
    assert!(refused.last_error().contains("\"UVC1\" was opened first"), "{}", refused.last_error());
    drop(other);
    let _camera = Plugged::new(Camera::new("UVC1"));
    while !next_frame(&mut subscriber).epoch_changed() {}
    assert_eq!(subscriber.epochs(), 2);
    let output = driver.stop();
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(stderr(&output).contains("left: streaming, Emulated UVC \"UVC1\""), "{}", stderr(&output));
}

#[test]
fn the_frame_rate_is_settled_before_the_exposure_and_a_constant_need_not_be_zero() {
    let camera = Plugged::new(Camera::new("UVC1").with_frame_rate_locked_while_manual());
    node("UVC1");
    let stage = Stage::new(&format!(
        "[[camera]]\nname = \"left\"\nwidth = {}\nheight = {}\nfps = 60\nexposure_us = 1000\nmask = \"none\"\n\
         source = {{ kind = \"v4l2\", serial = \"UVC1\" }}\n",
        SIZE.0, SIZE.1
    ));
    let mut subscriber = stage.subscriber("left");
    let driver = stage.driver();
    next_frame(&mut subscriber);
    {
        let camera = camera.device();
        assert!(!camera.lowers_frame_rate());
        assert_eq!((camera.exposure_us(), camera.backlight_compensation()), (Some(1000.0), 1));
    }
    driver.stop();

    // Left behind by another program: fixed exposure, and a frame rate that it may lower and that is locked by now.
    drop(camera);
    let camera = Plugged::new(Camera::new("UVC1").with_frame_rate_locked_while_manual());
    let device = Device::with_path(node("UVC1")).unwrap();
    device.set_control(Control { id: EXPOSURE_AUTO, value: Value::Integer(EXPOSURE_MANUAL) }).unwrap();
    drop(device);
    let mut subscriber = stage.subscriber("left");
    let driver = stage.driver();
    next_frame(&mut subscriber);
    assert!(camera.device().lowers_frame_rate());
    let output = driver.stop();
    assert!(stderr(&output).contains("exposure_dynamic_framerate = 0 refused"), "{}", stderr(&output));
}
