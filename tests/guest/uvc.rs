//! A camera of the USB video class behind the kernel's uvcvideo.

use std::fs;
use std::path::PathBuf;

use uvcam_tests::scene::picture;
use uvcam_tests::usb::Plugged;
use uvcam_tests::uvc::{Camera, SIZE};
use uvcam_tests::wait_until;
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
