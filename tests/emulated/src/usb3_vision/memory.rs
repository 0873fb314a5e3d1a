//! The camera's memory, as its host reads and writes it: bootstrap registers (GenCP 1.3 chapter 5, USB3 Vision 1.1 chapter 4),
//! the GenICam description, and a register for each feature. Everything is little-endian.

use super::Identity;
use super::description;
use super::features::{Access, FEATURES, Feature, Kind, Limit};

/// Technology-agnostic bootstrap registers begin at 0.
const ABRM: Area = Area { start: 0, bytes: 0x1_0000 };
/// Of USB3 Vision.
const SBRM: u64 = 0x1000;
/// Of the streaming interface.
const SIRM: u64 = 0x2000;
const MANIFEST: u64 = 0x3000;
const FEATURE_REGISTERS: u64 = 0x1_0000;
const FEATURE_SPACING: u64 = 64;
const DESCRIPTION: u64 = 0x10_0000;

const STREAM_CONTROL: u64 = SIRM + 0x04;
const REQUIRED_PAYLOAD: u64 = SIRM + 0x08;
/// Sizes that the host writes, from that of the leader to that of the trailer.
const HOST_SIZES: Area = Area { start: SIRM + 0x18, bytes: 0x18 };

/// Bytes of the longest command and of the longest answer.
pub(super) const LONGEST_MESSAGE: u32 = 1024;

struct Area {
    start: u64,
    bytes: u64,
}

impl Area {
    fn contains(&self, address: u64) -> bool {
        (self.start..self.start + self.bytes).contains(&address)
    }
}

/// Why an access was refused (GenCP 1.3, table 15).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
pub(super) enum Refusal {
    InvalidParameter = 0x8002,
    InvalidAddress = 0x8003,
    WriteProtect = 0x8004,
    AccessDenied = 0x8006,
}

/// All that can be read and written.
pub(super) struct Memory {
    bootstrap: Vec<u8>,
    features: Vec<u8>,
    description: Vec<u8>,
}

/// Where a feature's register is.
pub(super) fn address_of(name: &str) -> u64 {
    let place = FEATURES.iter().position(|feature| feature.name == name);
    FEATURE_REGISTERS + FEATURE_SPACING * place.unwrap_or_else(|| panic!("no feature {name}")) as u64
}

/// How long a register is.
pub(super) fn register_bytes(kind: Kind) -> usize {
    if matches!(kind, Kind::Text) { 64 } else { 8 }
}

impl Memory {
    pub(super) fn new(identity: &Identity, exposure_step_us: Option<f64>) -> Self {
        let mut memory = Memory {
            bootstrap: vec![0; ABRM.bytes as usize],
            features: vec![0; FEATURES.len() * FEATURE_SPACING as usize],
            description: description::xml(&identity.vendor, &identity.model, exposure_step_us).into_bytes(),
        };
        for (address, text) in [
            (0x04, &identity.vendor),
            (0x44, &identity.model),
            (0xc4, &identity.version),
            (0x144, &identity.serial),
        ] {
            memory.put(address, text.as_bytes());
        }
        // Longest time to an answer, ms.
        memory.put(0x1cc, &200u32.to_le_bytes());
        memory.put(0x1d0, &MANIFEST.to_le_bytes());
        memory.put(0x1d8, &SBRM.to_le_bytes());

        memory.put(SBRM, &0x0001_0001u32.to_le_bytes());
        memory.put(SBRM + 0x14, &LONGEST_MESSAGE.to_le_bytes());
        memory.put(SBRM + 0x18, &LONGEST_MESSAGE.to_le_bytes());
        // One stream.
        memory.put(SBRM + 0x1c, &1u32.to_le_bytes());
        memory.put(SBRM + 0x20, &SIRM.to_le_bytes());
        memory.put(SBRM + 0x28, &0x30u32.to_le_bytes());

        memory.put(SIRM + 0x10, &(super::stream::LEADER_BYTES as u32).to_le_bytes());
        memory.put(SIRM + 0x14, &(super::stream::TRAILER_BYTES as u32).to_le_bytes());

        // One entry: version 1.0.0 of schema 1.1, not compressed.
        memory.put(MANIFEST, &1u64.to_le_bytes());
        memory.put(MANIFEST + 0x08, &[0, 0, 0, 1, 0, 0, 1, 1]);
        memory.put(MANIFEST + 0x10, &DESCRIPTION.to_le_bytes());
        let bytes = memory.description.len() as u64;
        memory.put(MANIFEST + 0x18, &bytes.to_le_bytes());

        memory.load_defaults();
        for (name, text) in [
            ("DeviceVendorName", &identity.vendor),
            ("DeviceModelName", &identity.model),
            ("DeviceSerialNumber", &identity.serial),
            ("DeviceVersion", &identity.version),
            ("DeviceUserID", &identity.user_id),
        ] {
            memory.put(address_of(name), text.as_bytes());
        }
        memory
    }

    /// The default user set.
    pub(super) fn load_defaults(&mut self) {
        for feature in FEATURES {
            match feature.kind {
                Kind::Text => {}
                Kind::Float(..) => self.set_float(feature.name, feature.default),
                _ => self.set_integer(feature.name, feature.default as i64),
            }
        }
        self.refresh();
    }

    pub(super) fn read(&self, address: u64, bytes: usize) -> Result<&[u8], Refusal> {
        let (start, memory) = self.area(address);
        let from = (address - start) as usize;
        memory.get(from..from + bytes).ok_or(Refusal::InvalidAddress)
    }

    /// Writes a whole register, and returns the feature that it belongs to.
    pub(super) fn write(
        &mut self,
        address: u64,
        data: &[u8],
        acquiring: bool,
    ) -> Result<Option<&'static str>, Refusal> {
        if HOST_SIZES.contains(address) || address == STREAM_CONTROL {
            self.put(address, data);
            return Ok(None);
        }
        if !(FEATURE_REGISTERS..DESCRIPTION).contains(&address) {
            return Err(Refusal::WriteProtect);
        }
        let place = ((address - FEATURE_REGISTERS) / FEATURE_SPACING) as usize;
        let feature = FEATURES.get(place).ok_or(Refusal::InvalidAddress)?;
        match feature.access {
            Access::Read => return Err(Refusal::WriteProtect),
            Access::WriteIdle if acquiring => return Err(Refusal::AccessDenied),
            _ => {}
        }
        if address != address_of(feature.name) || data.len() > register_bytes(feature.kind) {
            return Err(Refusal::InvalidAddress);
        }
        self.check(feature, data)?;
        self.put(address, data);
        self.refresh();
        Ok(Some(feature.name))
    }

    fn check(&self, feature: &Feature, data: &[u8]) -> Result<(), Refusal> {
        if let Kind::Text = feature.kind {
            return Ok(());
        }
        let bytes: [u8; 8] = data.try_into().map_err(|_| Refusal::InvalidParameter)?;
        let number = i64::from_le_bytes(bytes);
        let fits = match feature.kind {
            Kind::Integer(min, max, step) => {
                let max = match max {
                    Limit::Fixed(max) => max,
                    Limit::Feature(name) => self.integer(name),
                };
                (min..=max).contains(&number) && (number - min) % step == 0
            }
            Kind::Float(min, max, _) => (min..=max).contains(&f64::from_le_bytes(bytes)),
            Kind::Enumeration(entries) => entries.iter().any(|(_, value)| *value == number),
            Kind::Boolean | Kind::Command => (0..=1).contains(&number),
            Kind::Text => true,
        };
        if fits { Ok(()) } else { Err(Refusal::InvalidParameter) }
    }

    /// What follows from other registers.
    fn refresh(&mut self) {
        for (side, offset, binning, sensor, free, offset_max, side_max) in [
            (
                "Width",
                "OffsetX",
                "BinningHorizontal",
                "SensorWidth",
                "RegionWidthMax",
                "OffsetXMax",
                "WidthMax",
            ),
            (
                "Height",
                "OffsetY",
                "BinningVertical",
                "SensorHeight",
                "RegionHeightMax",
                "OffsetYMax",
                "HeightMax",
            ),
        ] {
            let whole = self.integer(sensor) / self.integer(binning);
            self.set_integer(side_max, whole);
            self.set_integer(side, self.integer(side).min(whole));
            self.set_integer(offset, self.integer(offset).min(whole - self.integer(side)));
            self.set_integer(free, whole - self.integer(offset));
            self.set_integer(offset_max, whole - self.integer(side));
        }
        // Bits a pixel are the third byte of a format's number (PFNC 2.4, 5.1).
        let bytes_per_pixel = (self.integer("PixelFormat") >> 16 & 0xff) / 8;
        let payload = self.integer("Width") * self.integer("Height") * bytes_per_pixel;
        self.set_integer("PayloadSize", payload);
        self.put(REQUIRED_PAYLOAD, &payload.to_le_bytes());
        self.set_float("ResultingFrameRate", 1e6 / self.frame_period_us());
    }

    /// How long a frame takes: what was asked for, or exposure and readout, 10 us a row, where these take longer.
    pub(super) fn frame_period_us(&self) -> f64 {
        let shortest = self.float("ExposureTime") + 10.0 * self.integer("Height") as f64;
        match self.integer("AcquisitionFrameRateEnable") {
            0 => shortest,
            _ => shortest.max(1e6 / self.float("AcquisitionFrameRate")),
        }
    }

    /// Whether the host wants the stream.
    pub(super) fn is_streaming(&self) -> bool {
        self.bootstrap[STREAM_CONTROL as usize] & 1 == 1
    }

    pub(super) fn integer(&self, name: &str) -> i64 {
        i64::from_le_bytes(self.number(name))
    }

    pub(super) fn float(&self, name: &str) -> f64 {
        f64::from_le_bytes(self.number(name))
    }

    pub(super) fn set_integer(&mut self, name: &str, value: i64) {
        self.put(address_of(name), &value.to_le_bytes());
    }

    pub(super) fn set_float(&mut self, name: &str, value: f64) {
        self.put(address_of(name), &value.to_le_bytes());
    }

    fn number(&self, name: &str) -> [u8; 8] {
        let at = (address_of(name) - FEATURE_REGISTERS) as usize;
        let mut bytes = [0; 8];
        bytes.copy_from_slice(&self.features[at..at + 8]);
        bytes
    }

    fn area(&self, address: u64) -> (u64, &[u8]) {
        match address {
            DESCRIPTION.. => (DESCRIPTION, &self.description),
            FEATURE_REGISTERS.. => (FEATURE_REGISTERS, &self.features),
            _ => (ABRM.start, &self.bootstrap),
        }
    }

    fn put(&mut self, address: u64, data: &[u8]) {
        let (start, memory) = match address {
            FEATURE_REGISTERS.. => (FEATURE_REGISTERS, &mut self.features),
            _ => (ABRM.start, &mut self.bootstrap),
        };
        let from = (address - start) as usize;
        memory[from..from + data.len()].copy_from_slice(data);
    }
}
