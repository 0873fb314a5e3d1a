//! What a device tells about itself (USB 3.2, chapter 9.6).

use super::Speed;

const DEVICE: u8 = 1;
const CONFIGURATION: u8 = 2;
const STRING: u8 = 3;
const QUALIFIER: u8 = 6;
const BOS: u8 = 15;
const INTERFACE: u8 = 4;
const ENDPOINT: u8 = 5;
const ENDPOINT_COMPANION: u8 = 48;
const ENGLISH: u16 = 0x0409;

/// A device with one configuration.
#[derive(Debug, Clone)]
pub struct Descriptors {
    /// How fast its link is.
    pub speed: Speed,
    /// Class, subclass and protocol of the device.
    pub class: [u8; 3],
    /// Vendor and product number.
    pub id: (u16, u16),
    /// Strings by their index, from 1 on: manufacturer, product, serial number, others.
    pub strings: Vec<String>,
    /// How many interfaces `body` describes.
    pub interfaces: u8,
    /// All descriptors behind that of the configuration.
    pub body: Vec<u8>,
}

/// Describes an interface with `endpoints` endpoints.
pub fn interface(number: u8, endpoints: u8, class: [u8; 3]) -> Vec<u8> {
    vec![9, INTERFACE, number, 0, endpoints, class[0], class[1], class[2], 0]
}

/// Describes a bulk endpoint; bit 7 of `address` is set where the host reads.
pub fn bulk_endpoint(speed: Speed, address: u8) -> Vec<u8> {
    let [low, high] = speed.bulk_packet().to_le_bytes();
    let mut bytes = vec![7, ENDPOINT, address, 2, low, high, 0];
    if speed == Speed::Super {
        bytes.extend([6, ENDPOINT_COMPANION, 15, 0, 0, 0]);
    }
    bytes
}

impl Descriptors {
    /// The descriptor that a request of the kind `value >> 8` with index `value & 0xff` asks for.
    pub fn get(&self, value: u16) -> Option<Vec<u8>> {
        let [index, kind] = value.to_le_bytes();
        match kind {
            DEVICE => Some(self.device()),
            CONFIGURATION => Some(self.configuration()),
            STRING => self.string(index),
            BOS if self.speed == Speed::Super => Some(bos()),
            QUALIFIER => None,
            _ => None,
        }
    }

    fn device(&self) -> Vec<u8> {
        let (version, packet) = match self.speed {
            Speed::High => (0x0200u16, 64),
            // As a power of two.
            Speed::Super => (0x0300, 9),
        };
        let mut bytes = vec![18, DEVICE];
        bytes.extend(version.to_le_bytes());
        bytes.extend(self.class);
        bytes.push(packet);
        bytes.extend(self.id.0.to_le_bytes());
        bytes.extend(self.id.1.to_le_bytes());
        // Version 1.0; the strings of manufacturer, product and serial number; one configuration.
        bytes.extend([0, 1, 1, 2, 3, 1]);
        bytes
    }

    fn configuration(&self) -> Vec<u8> {
        let mut bytes = vec![9, CONFIGURATION];
        bytes.extend((9 + self.body.len() as u16).to_le_bytes());
        // Bus powered, in units of 2 or 8 mA.
        bytes.extend([self.interfaces, 1, 0, 0x80, 50]);
        bytes.extend(&self.body);
        bytes
    }

    fn string(&self, index: u8) -> Option<Vec<u8>> {
        let units: Vec<u16> = match index {
            0 => vec![ENGLISH],
            _ => self.strings.get(usize::from(index) - 1)?.encode_utf16().collect(),
        };
        let mut bytes = vec![2 + 2 * units.len() as u8, STRING];
        bytes.extend(units.into_iter().flat_map(u16::to_le_bytes));
        Some(bytes)
    }
}

/// One capability, SuperSpeed: no power management, 5 Gbit/s.
fn bos() -> Vec<u8> {
    vec![5, BOS, 15, 0, 1, 10, 16, 3, 0, 0x0e, 0, 3, 0, 0, 0]
}
