//! What the camera tells about itself (USB Video Class 1.1, chapter 3).

use super::{DATA, FRAME_INTERVALS, FRAME_RATE_UNIT, SIZE, VIDEO_BYTES};
use crate::usb::Speed;
use crate::usb::descriptors::{Descriptors, bulk_endpoint, interface};

const CONTROL_CLASS: [u8; 3] = [0x0e, 1, 0];
const STREAMING_CLASS: [u8; 3] = [0x0e, 2, 0];
/// Type of a descriptor of a class's own.
const CLASS_SPECIFIC: u8 = 0x24;
/// Units, by which controls are addressed.
pub(super) const CAMERA: u8 = 1;
pub(super) const PROCESSING: u8 = 2;
const OUTPUT: u8 = 3;
/// GREY: the code of its four letters in a GUID (Linux: UVC_GUID_FORMAT_Y800).
const GREY: [u8; 16] = *b"Y800\x00\x00\x10\x00\x80\x00\x00\xaa\x00\x38\x9b\x71";

/// All of them.
pub(super) fn descriptors(serial: &str) -> Descriptors {
    let speed = Speed::High;
    let control = control();
    let body = [
        // Both interfaces are one function.
        vec![8, 11, 0, 2, 0x0e, 3, 0, 0],
        interface(0, 0, CONTROL_CLASS),
        class_specific(1, &[&[0x10, 0x01], &length(control.len() + 13)[..], &[0; 4], &[1, 1]].concat()),
        control,
        interface(1, 1, STREAMING_CLASS),
        streaming(),
        bulk_endpoint(speed, DATA | 0x80),
    ];
    Descriptors {
        speed,
        class: [0xef, 0x02, 0x01],
        // pid.codes keeps this number for tests.
        id: (0x1209, 0x0002),
        strings: vec!["uvcam".into(), "Emulated UVC".into(), serial.into()],
        interfaces: 2,
        body: body.concat(),
    }
}

/// A sensor with control of its exposure, a processing unit with backlight compensation, gain and the filter against flickering light, the way out.
fn control() -> Vec<u8> {
    const EXPOSURE_MODE_PRIORITY_TIME: u8 = 0b1110;
    const BACKLIGHT_GAIN_AND_POWER_LINE: u8 = 0b111;
    let camera = [CAMERA, 0x01, 0x02, 0, 0, 0, 0, 0, 0, 0, 0, 3, EXPOSURE_MODE_PRIORITY_TIME, 0, 0];
    let processing = [PROCESSING, CAMERA, 0, 0, 2, 0, BACKLIGHT_GAIN_AND_POWER_LINE, 0, 0];
    let output = [OUTPUT, 0x01, 0x01, 0, PROCESSING, 0];
    [class_specific(2, &camera), class_specific(5, &processing), class_specific(3, &output)].concat()
}

/// One format, one size.
fn streaming() -> Vec<u8> {
    let format = [&[1, 1][..], &GREY, &[8, 1, 0, 0, 0, 0]].concat();
    let (width, height) = SIZE;
    let bit_rate = |interval: u32| VIDEO_BYTES as u32 * 8 * (FRAME_RATE_UNIT / interval);
    let mut frame = vec![1, 0];
    frame.extend([width, height].into_iter().flat_map(u16::to_le_bytes));
    let [fastest, .., slowest] = FRAME_INTERVALS;
    for word in [bit_rate(slowest), bit_rate(fastest), VIDEO_BYTES as u32, fastest] {
        frame.extend(word.to_le_bytes());
    }
    frame.push(FRAME_INTERVALS.len() as u8);
    frame.extend(FRAME_INTERVALS.into_iter().flat_map(u32::to_le_bytes));
    let body = [class_specific(4, &format), class_specific(5, &frame)].concat();
    let header = [&[1][..], &length(body.len() + 14), &[DATA | 0x80, 0, OUTPUT, 0, 0, 0, 1, 0]].concat();
    [class_specific(1, &header), body].concat()
}

fn class_specific(subtype: u8, body: &[u8]) -> Vec<u8> {
    [&[body.len() as u8 + 3, CLASS_SPECIFIC, subtype], body].concat()
}

fn length(bytes: usize) -> [u8; 2] {
    (bytes as u16).to_le_bytes()
}
