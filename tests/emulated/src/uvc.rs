//! A USB camera of the video class that is a program: GREY over a bulk endpoint, exposure, gain, and the automatics that a flight
//! wants off. The kernel's uvcvideo drives it.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use crate::scene::{self, picture};
use crate::usb::{Bytes, Descriptors, Device, Setup, Stall};

mod descriptors;

/// Columns and rows of its pictures.
pub const SIZE: (u16, u16) = (640, 480);
const VIDEO_BYTES: usize = SIZE.0 as usize * SIZE.1 as usize;
/// Frame intervals are told in units of 100 ns.
const FRAME_RATE_UNIT: u32 = 10_000_000;
/// 60, 30 and 15 frames a second.
const FRAME_INTERVALS: [u32; 3] = [166_666, 333_333, 666_666];
const DATA: u8 = 1;
/// Pictures that the camera keeps for a host that is late.
const MEMORY_FRAMES: usize = 4;
/// Of the probe and commit controls (USB Video Class 1.1, table 4-47).
const STREAMING_CONTROL_BYTES: usize = 34;
const HEADER_BYTES: usize = 2;

/// Requests to a control (USB Video Class 1.1, table A-8).
const SET_CUR: u8 = 0x01;
const GET_CUR: u8 = 0x81;
const GET_MIN: u8 = 0x82;
const GET_MAX: u8 = 0x83;
const GET_RES: u8 = 0x84;
const GET_LEN: u8 = 0x85;
const GET_INFO: u8 = 0x86;
const GET_DEF: u8 = 0x87;

/// One control: where it is, its bounds and what it has after power-up.
struct Kind {
    unit: u8,
    selector: u8,
    bytes: usize,
    min: u32,
    max: u32,
    default: u32,
}

const EXPOSURE_MODE: Kind = Kind {
    unit: descriptors::CAMERA,
    selector: 2,
    bytes: 1,
    min: 1,
    max: 9,
    default: MODE_APERTURE_PRIORITY,
};
const EXPOSURE_PRIORITY: Kind =
    Kind { unit: descriptors::CAMERA, selector: 3, bytes: 1, min: 0, max: 1, default: 1 };
const EXPOSURE_TIME: Kind =
    Kind { unit: descriptors::CAMERA, selector: 4, bytes: 4, min: 1, max: 10_000, default: 157 };
const GAIN: Kind =
    Kind { unit: descriptors::PROCESSING, selector: 4, bytes: 2, min: 0, max: 240, default: 64 };
const POWER_LINE_FREQUENCY: Kind =
    Kind { unit: descriptors::PROCESSING, selector: 5, bytes: 1, min: 0, max: 2, default: 1 };
/// As of many cheap cameras, it cannot be 0.
const BACKLIGHT_COMPENSATION: Kind =
    Kind { unit: descriptors::PROCESSING, selector: 1, bytes: 2, min: 1, max: 5, default: 3 };
const KINDS: [Kind; 6] =
    [EXPOSURE_MODE, EXPOSURE_PRIORITY, EXPOSURE_TIME, GAIN, POWER_LINE_FREQUENCY, BACKLIGHT_COMPENSATION];
/// Modes are bits: of these the camera has manual and aperture priority.
const MODE_MANUAL: u32 = 1;
const MODE_APERTURE_PRIORITY: u32 = 8;

/// What a camera does wrong, once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// A picture with half of its pixels.
    ShortPayload,
    /// A whole picture whose header says that it is not to be trusted.
    ErrorBit,
    /// No picture until the stream is started anew.
    Freeze,
}

/// The camera.
pub struct Camera {
    serial: String,
    values: [u32; KINDS.len()],
    streaming_control: Vec<u8>,
    /// When the next picture is due, while streaming.
    due: Option<Instant>,
    is_streaming: bool,
    next_id: u64,
    frames: VecDeque<Bytes>,
    faults: Vec<Fault>,
    locks_frame_rate: bool,
}

impl Camera {
    /// A camera that has just been powered up.
    pub fn new(serial: &str) -> Self {
        scene::prepare();
        Camera {
            serial: serial.into(),
            values: KINDS.map(|kind| kind.default),
            streaming_control: streaming_control(FRAME_INTERVALS[0]),
            due: None,
            is_streaming: false,
            next_id: 0,
            frames: VecDeque::new(),
            faults: Vec::new(),
            locks_frame_rate: false,
        }
    }

    /// The camera, but refusing to say how frame rate and exposure go together while the exposure is fixed.
    pub fn with_frame_rate_locked_while_manual(self) -> Self {
        Camera { locks_frame_rate: true, ..self }
    }

    /// Lets it do something wrong.
    pub fn fail(&mut self, fault: Fault) {
        self.faults.push(fault);
    }

    /// Whether every fault has come to pass.
    pub fn has_failed(&self) -> bool {
        self.faults.is_empty()
    }

    /// Exposure time in microseconds; `None` where the camera chooses.
    pub fn exposure_us(&self) -> Option<f64> {
        // In units of 100 us.
        (self.value(&EXPOSURE_MODE) == MODE_MANUAL).then(|| f64::from(self.value(&EXPOSURE_TIME)) * 100.0)
    }

    /// Gain in the camera's own steps.
    pub fn gain(&self) -> u32 {
        self.value(&GAIN)
    }

    /// Whether it may lower its frame rate for the sake of exposure.
    pub fn lowers_frame_rate(&self) -> bool {
        self.value(&EXPOSURE_PRIORITY) == 1
    }

    /// Its backlight compensation, from 1 to 5.
    pub fn backlight_compensation(&self) -> u32 {
        self.value(&BACKLIGHT_COMPENSATION)
    }

    /// The filter against lamps that flicker: 0 is off.
    pub fn power_line_frequency(&self) -> u32 {
        self.value(&POWER_LINE_FREQUENCY)
    }

    fn value(&self, kind: &Kind) -> u32 {
        self.place(kind.unit, kind.selector).map_or(0, |place| self.values[place])
    }

    fn place(&self, unit: u8, selector: u8) -> Option<usize> {
        KINDS.iter().position(|kind| (kind.unit, kind.selector) == (unit, selector))
    }

    fn take(&mut self, fault: Fault) -> bool {
        let place = self.faults.iter().position(|waiting| *waiting == fault);
        place.map(|place| self.faults.remove(place)).is_some()
    }

    fn unit_control(&mut self, setup: Setup, data: &[u8]) -> Result<Vec<u8>, Stall> {
        let (unit, selector) = ((setup.index >> 8) as u8, (setup.value >> 8) as u8);
        let place = self.place(unit, selector).ok_or(Stall)?;
        let kind = &KINDS[place];
        let number = |value: u32| Ok(value.to_le_bytes()[..kind.bytes].to_vec());
        match setup.request {
            SET_CUR => {
                let mut bytes = [0; 4];
                bytes[..kind.bytes].copy_from_slice(data.get(..kind.bytes).ok_or(Stall)?);
                let value = u32::from_le_bytes(bytes);
                let is_mode = place == 0;
                let fits = match is_mode {
                    true => value == MODE_MANUAL || value == MODE_APERTURE_PRIORITY,
                    false => (kind.min..=kind.max).contains(&value),
                };
                let is_manual = self.value(&EXPOSURE_MODE) == MODE_MANUAL;
                let is_locked = self.locks_frame_rate && is_manual && selector == EXPOSURE_PRIORITY.selector;
                if !fits || is_locked && unit == EXPOSURE_PRIORITY.unit {
                    return Err(Stall);
                }
                self.values[place] = value;
                Ok(Vec::new())
            }
            GET_CUR => number(self.values[place]),
            GET_MIN => number(kind.min),
            GET_MAX => number(kind.max),
            // Of modes, the bits that it has.
            GET_RES if place == 0 => number(MODE_MANUAL | MODE_APERTURE_PRIORITY),
            GET_RES => number(1),
            GET_DEF => number(kind.default),
            GET_LEN => Ok(vec![kind.bytes as u8, 0]),
            // It can be read and written.
            GET_INFO => Ok(vec![3]),
            _ => Err(Stall),
        }
    }

    fn streaming(&mut self, setup: Setup, data: &[u8]) -> Result<Vec<u8>, Stall> {
        const PROBE: u16 = 0x0100;
        const COMMIT: u16 = 0x0200;
        match (setup.request, setup.value) {
            (SET_CUR, PROBE | COMMIT) => {
                let interval = data.get(4..8).ok_or(Stall)?;
                let asked = u32::from_le_bytes(interval.try_into().map_err(|_| Stall)?);
                let nearest = FRAME_INTERVALS.into_iter().min_by_key(|offered| offered.abs_diff(asked));
                self.streaming_control = streaming_control(nearest.ok_or(Stall)?);
                if setup.value == COMMIT {
                    self.is_streaming = true;
                    self.frames.clear();
                    self.due = Some(Instant::now() + self.period());
                }
                Ok(Vec::new())
            }
            (GET_CUR, PROBE | COMMIT) => Ok(self.streaming_control.clone()),
            (GET_MIN | GET_DEF, PROBE) => Ok(streaming_control(FRAME_INTERVALS[0])),
            (GET_MAX, PROBE) => Ok(streaming_control(FRAME_INTERVALS[2])),
            (GET_LEN, PROBE | COMMIT) => Ok(vec![STREAMING_CONTROL_BYTES as u8, 0]),
            (GET_INFO, PROBE | COMMIT) => Ok(vec![3]),
            _ => Err(Stall),
        }
    }

    /// From one picture to the next: what was agreed on, or the exposure where that takes longer.
    fn period(&self) -> Duration {
        let mut interval = [0; 4];
        interval.copy_from_slice(&self.streaming_control[4..8]);
        let agreed = Duration::from_nanos(100 * u64::from(u32::from_le_bytes(interval)));
        let exposure = Duration::from_micros(100 * u64::from(self.value(&EXPOSURE_TIME)));
        agreed.max(exposure)
    }

    fn expose(&mut self) {
        let id = self.next_id;
        self.next_id += 1;
        if self.frames.len() >= MEMORY_FRAMES {
            return;
        }
        // End of the header, end of the frame, and a bit that changes with every frame (USB Video Class 1.1, 2.4.3.3).
        let mut flags = 0x82 | (id & 1) as u8;
        let mut pixels = picture(id, VIDEO_BYTES);
        if self.take(Fault::ShortPayload) {
            pixels.truncate(VIDEO_BYTES / 2);
        } else if self.take(Fault::ErrorBit) {
            flags |= 0x40;
        }
        let mut transfer = vec![HEADER_BYTES as u8, flags];
        transfer.extend_from_slice(&pixels);
        self.frames.push_back(transfer.into());
    }
}

/// What both sides agree on: the only format and size, an interval, one transfer a picture.
fn streaming_control(interval: u32) -> Vec<u8> {
    let mut bytes = vec![0; STREAMING_CONTROL_BYTES];
    bytes[2] = 1;
    bytes[3] = 1;
    bytes[4..8].copy_from_slice(&interval.to_le_bytes());
    bytes[18..22].copy_from_slice(&(VIDEO_BYTES as u32).to_le_bytes());
    bytes[22..26].copy_from_slice(&((VIDEO_BYTES + HEADER_BYTES) as u32).to_le_bytes());
    bytes
}

impl Device for Camera {
    fn descriptors(&self) -> Descriptors {
        descriptors::descriptors(&self.serial)
    }

    fn control(&mut self, setup: Setup, data: &[u8]) -> Result<Vec<u8>, Stall> {
        match setup.index.to_le_bytes() {
            [1, 0] => self.streaming(setup, data),
            [0, 0] => Err(Stall),
            _ => self.unit_control(setup, data),
        }
    }

    fn write(&mut self, _endpoint: u8, _data: &[u8]) -> Result<(), Stall> {
        Err(Stall)
    }

    fn read(&mut self, _endpoint: u8) -> Result<Option<Bytes>, Stall> {
        Ok(self.frames.pop_front())
    }

    fn reset(&mut self, _endpoint: u8) {
        // How a host ends a stream over a bulk endpoint.
        self.is_streaming = false;
        self.due = None;
        self.frames.clear();
    }

    fn elapse(&mut self, now: Instant) -> Option<Instant> {
        while let Some(due) = self.due {
            if due > now {
                break;
            }
            if self.take(Fault::Freeze) {
                self.due = None;
                break;
            }
            self.due = Some(due + self.period());
            self.expose();
        }
        self.due
    }
}
