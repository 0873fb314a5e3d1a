//! A USB3 Vision camera that is a program, down to its USB descriptors. See the README of this package.

use std::time::{Duration, Instant};

use crate::scene;
use crate::usb::descriptors::{Descriptors, bulk_endpoint, interface};
use crate::usb::{Bytes, Device, Setup, Speed, Stall};
use control::{Command, Request};
use memory::{Memory, Refusal};
use stream::{Defect, Frame, Stream};

mod control;
mod description;
mod features;
mod memory;
mod stream;

const CONTROL: u8 = 1;
const DATA: u8 = 2;
/// Class of an interface: miscellaneous, USB3 Vision; the last number tells control from data.
const CONTROL_CLASS: [u8; 3] = [0xef, 0x05, 0];
const DATA_CLASS: [u8; 3] = [0xef, 0x05, 2];
/// Index of the string that names the device for all times.
const GUID: u8 = 4;

/// Who a camera says it is.
#[derive(Debug, Clone)]
pub struct Identity {
    /// `DeviceVendorName`, and the USB manufacturer string.
    pub vendor: String,
    /// `DeviceModelName`, and the USB product string.
    pub model: String,
    /// `DeviceVersion`.
    pub version: String,
    /// `DeviceSerialNumber`, and the USB serial string.
    pub serial: String,
    /// `DeviceUserID`.
    pub user_id: String,
}

impl Identity {
    /// An emulated camera with this serial number.
    pub fn with_serial(serial: &str) -> Self {
        Identity {
            vendor: "uvcam".into(),
            model: "Emulated".into(),
            version: "1.0".into(),
            serial: serial.into(),
            user_id: String::new(),
        }
    }
}

/// What a camera does wrong, once, from the next opportunity on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// A frame with half of its pixels, but a trailer.
    ShortPayload,
    /// A frame without a trailer.
    NoTrailer,
    /// The streaming endpoint halts until the host resets it.
    StalledEndpoint,
    /// The camera answers, but exposes no frame until its acquisition is started anew.
    Freeze,
    /// So many frames are exposed and never sent: the ids jump.
    FrameIdJump(u64),
    /// From the next start of the acquisition on, ids have 16 bits, as on older devices, and are about to wrap: the first is 65500,
    /// and 1 follows 65535.
    SixteenBitIds,
    /// The next write of this feature is refused.
    RefusedWrite(&'static str),
    /// The next write of this feature is confirmed, and does nothing.
    IgnoredWrite(&'static str),
}

impl Fault {
    fn is_of_a_frame(self) -> bool {
        matches!(self, Fault::ShortPayload | Fault::NoTrailer | Fault::Freeze | Fault::FrameIdJump(_))
    }
}

/// The camera.
pub struct Camera {
    identity: Identity,
    memory: Memory,
    answers: std::collections::VecDeque<Vec<u8>>,
    stream: Stream,
    faults: Vec<Fault>,
    powered_up: Instant,
    acquisition: Option<Acquisition>,
}

/// What lasts from `AcquisitionStart` to `AcquisitionStop`.
struct Acquisition {
    /// When the next frame is exposed; never, for a frozen camera.
    due: Option<Instant>,
    next_id: u64,
    sixteen_bits: bool,
}

impl Acquisition {
    fn take_id(&mut self) -> u64 {
        let id = self.next_id;
        self.next_id = if self.sixteen_bits && id == 65535 { 1 } else { id + 1 };
        id
    }
}

impl Camera {
    /// A camera that has just been powered up.
    pub fn new(identity: Identity) -> Self {
        Camera::from_parts(identity, None)
    }

    /// A camera that tells steps of its exposure time, yet confirms any value.
    pub fn with_exposure_steps(identity: Identity, step_us: f64) -> Self {
        Camera::from_parts(identity, Some(step_us))
    }

    fn from_parts(identity: Identity, exposure_step_us: Option<f64>) -> Self {
        scene::prepare();
        let memory = Memory::new(&identity, exposure_step_us);
        Camera {
            identity,
            memory,
            answers: Default::default(),
            stream: Stream::default(),
            faults: Vec::new(),
            powered_up: Instant::now(),
            acquisition: None,
        }
    }

    /// Lets it do something wrong.
    pub fn fail(&mut self, fault: Fault) {
        self.faults.push(fault);
    }

    /// Whether every fault has come to pass.
    pub fn has_failed(&self) -> bool {
        self.faults.is_empty()
    }

    /// The present value of a feature that is a whole number, an enumeration or a boolean.
    pub fn integer(&self, feature: &str) -> i64 {
        self.memory.integer(feature)
    }

    /// The present value of a feature that is a real number.
    pub fn float(&self, feature: &str) -> f64 {
        self.memory.float(feature)
    }

    /// Whether it exposes frames.
    pub fn is_acquiring(&self) -> bool {
        self.acquisition.is_some()
    }

    fn take(&mut self, fault: Fault) -> bool {
        let place = self.faults.iter().position(|waiting| *waiting == fault);
        place.map(|place| self.faults.remove(place)).is_some()
    }

    fn write_memory(&mut self, address: u64, data: &[u8]) -> Result<(), Refusal> {
        for fault in self.faults.clone() {
            match fault {
                Fault::RefusedWrite(name) if memory::address_of(name) == address => {
                    self.take(fault);
                    return Err(Refusal::AccessDenied);
                }
                Fault::IgnoredWrite(name) if memory::address_of(name) == address => {
                    self.take(fault);
                    return Ok(());
                }
                _ => {}
            }
        }
        match self.memory.write(address, data, self.acquisition.is_some())? {
            Some("AcquisitionStart") => {
                let due = Some(Instant::now() + self.period());
                let sixteen_bits = self.take(Fault::SixteenBitIds);
                let next_id = if sixteen_bits { 65500 } else { 0 };
                self.acquisition.get_or_insert(Acquisition { due, next_id, sixteen_bits });
            }
            Some("AcquisitionStop") => self.acquisition = None,
            Some("UserSetLoad") => self.memory.load_defaults(),
            Some("TimestampLatch") => {
                let now = self.powered_up.elapsed().as_nanos() as i64;
                self.memory.set_integer("TimestampLatchValue", now);
            }
            _ => {}
        }
        if !self.memory.is_streaming() {
            self.stream.clear();
        }
        Ok(())
    }

    fn period(&self) -> Duration {
        Duration::from_secs_f64(self.memory.frame_period_us() * 1e-6)
    }

    /// A camera that waits for a trigger exposes nothing: none ever comes.
    fn is_triggered(&self) -> bool {
        self.memory.integer("TriggerMode") == 1
    }

    fn expose(&mut self, at: Instant) {
        let Some(acquisition) = &mut self.acquisition else { return };
        let mut defect = Defect::None;
        // One fault a frame, in the order in which they were asked for.
        let place = self.faults.iter().position(|fault| fault.is_of_a_frame());
        match place.map(|place| self.faults.remove(place)) {
            Some(Fault::ShortPayload) => defect = Defect::Short,
            Some(Fault::NoTrailer) => defect = Defect::NoTrailer,
            Some(Fault::Freeze) => {
                acquisition.due = None;
                return;
            }
            Some(Fault::FrameIdJump(count)) => (0..count).for_each(|_| _ = acquisition.take_id()),
            _ => {}
        }
        let id = acquisition.take_id();
        let integer = |name| self.memory.integer(name) as u32;
        let frame = Frame {
            id,
            timestamp_ns: at.saturating_duration_since(self.powered_up).as_nanos() as u64,
            pixel_format: integer("PixelFormat"),
            width: integer("Width"),
            height: integer("Height"),
            offset_x: integer("OffsetX"),
            offset_y: integer("OffsetY"),
            payload_bytes: integer("PayloadSize") as usize,
        };
        if self.memory.is_streaming() {
            self.stream.push(&frame, defect);
        }
    }
}

impl Device for Camera {
    fn descriptors(&self) -> Descriptors {
        let speed = Speed::Super;
        let association = [8, 11, 0, 2, CONTROL_CLASS[0], CONTROL_CLASS[1], CONTROL_CLASS[2], 0];
        // Device information (USB3 Vision 1.1, table 3-5): versions 1.3 of GenCP and 1.1 of USB3 Vision, the strings of GUID, vendor,
        // model, family, version, manufacturer's information, serial number, user's name, and SuperSpeed.
        let information = [20, 0x24, 1, 3, 0, 1, 0, 1, 0, 1, 0, GUID, 1, 2, 0, 5, 0, 3, 0, 0x08];
        let body = [
            &association[..],
            &interface(0, 2, CONTROL_CLASS),
            &information,
            &bulk_endpoint(speed, CONTROL | 0x80),
            &bulk_endpoint(speed, CONTROL),
            &interface(1, 1, DATA_CLASS),
            &bulk_endpoint(speed, DATA | 0x80),
        ];
        let Identity { vendor, model, version, serial, .. } = self.identity.clone();
        let guid = format!("UVCAM-{serial}");
        Descriptors {
            speed,
            class: [0xef, 0x02, 0x01],
            // pid.codes keeps this number for tests.
            id: (0x1209, 0x0001),
            strings: vec![vendor, model, serial, guid, version],
            interfaces: 2,
            body: body.concat(),
        }
    }

    fn control(&mut self, _setup: Setup, _data: &[u8]) -> Result<Vec<u8>, Stall> {
        Err(Stall)
    }

    fn write(&mut self, endpoint: u8, data: &[u8]) -> Result<(), Stall> {
        if endpoint != CONTROL {
            return Err(Stall);
        }
        let Some(command) = Command::parse(data) else { return Ok(()) };
        let answer = match &command.request {
            Request::Read { address, bytes } => {
                command.answer(self.memory.read(*address, usize::from(*bytes)))
            }
            Request::Write { address, data } => {
                let outcome = self.write_memory(*address, data);
                command.answer(outcome.map(|()| &[][..]))
            }
            Request::Other => command.answer(Ok(&[])),
        };
        self.answers.push_back(answer);
        Ok(())
    }

    fn read(&mut self, endpoint: u8) -> Result<Option<Bytes>, Stall> {
        match endpoint {
            CONTROL => Ok(self.answers.pop_front().map(Bytes::from)),
            DATA if self.take(Fault::StalledEndpoint) => Err(Stall),
            DATA => Ok(self.stream.pop()),
            _ => Err(Stall),
        }
    }

    fn reset(&mut self, endpoint: u8) {
        match endpoint {
            CONTROL => self.answers.clear(),
            _ => self.stream.clear(),
        }
    }

    fn elapse(&mut self, now: Instant) -> Option<Instant> {
        let period = self.period();
        let triggered = self.is_triggered();
        while let Some(due) = self.acquisition.as_ref()?.due {
            if due > now {
                return Some(due);
            }
            if let Some(acquisition) = &mut self.acquisition {
                acquisition.due = Some(due + period);
            }
            if !triggered {
                self.expose(due);
            }
        }
        None
    }
}
