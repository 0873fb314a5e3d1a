//! Opens one camera again and again, and knows where it was last.
//!
//! A search for a camera takes a second (GigE Vision), or a question to every other camera (USB3 Vision). One that was there before is
//! looked for at its place first: a USB camera in the system's list of devices, a GigE Vision camera at its address. That takes so
//! little that it can be done ten times a second.

use std::net::{Ipv4Addr, UdpSocket};
use std::path::Path;
use std::time::{Duration, Instant};

use super::discovery::{self, Transport};
use super::usb::{self, UsbDevice};
use super::{AravisCamera, KIND};
use crate::camera::source::CameraSource;
use crate::camera::{Camera, CameraError, Identity, told};

/// Time between searches for a camera that is not where it was: a GigE Vision camera may have got another address.
const SEARCH_PERIOD: Duration = Duration::from_secs(2);
/// How long a camera on the local network may take to say that it is there.
const ANSWER: Duration = Duration::from_millis(100);

/// Finds one camera.
#[derive(Debug)]
pub(in crate::camera) struct Finder {
    /// The serial, device id or IPv4 address, as the configuration has it.
    wanted: String,
    /// The camera as it was found last.
    last: Option<Identity>,
    /// Whether the system listed it then, by the serial that it told. Where it does not, its list says nothing of it.
    was_listed: bool,
    /// Nothing while the camera is where it was.
    next_search: Option<Instant>,
    /// What the last search found instead. Told again until the next one: an absent camera is news once.
    found: Option<String>,
}

/// What a look without a search tells.
enum Look {
    There(Identity),
    Gone(String),
    Unknown,
}

impl Finder {
    /// For the camera whose serial, device id or IPv4 address is `wanted`.
    pub(in crate::camera) fn new(wanted: &str) -> Self {
        Finder {
            wanted: wanted.trim().to_owned(),
            last: None,
            was_listed: false,
            next_search: None,
            found: None,
        }
    }

    /// Opens the camera, as [`AravisCamera::open`]; with little effort where it was opened before, or tried to.
    ///
    /// # Errors
    /// Those of [`AravisCamera::open`].
    fn open_camera(&mut self) -> Result<AravisCamera, CameraError> {
        let opened = match self.look() {
            Look::There(last) if self.address().is_none() => discovery::reopen(&last).map(AravisCamera::of),
            Look::There(_) | Look::Unknown => AravisCamera::open(&self.wanted),
            Look::Gone(found) => return Err(self.absent(found)),
        };
        match opened {
            Ok(camera) => {
                self.was_listed = plugged_in(&camera.identity.serial).is_some();
                self.last = Some(camera.identity.clone());
                self.next_search = None;
                self.found = None;
                Ok(camera)
            }
            Err(CameraError::Absent { found, .. }) => {
                let serial = self.last.as_ref().map_or(&self.wanted, |last| &last.serial);
                let found = plugged_in(serial).map_or(found, |device| device.why_unseen());
                self.found = Some(found.clone());
                Err(self.absent(found))
            }
            Err(error) => Err(error),
        }
    }

    fn look(&mut self) -> Look {
        let address = self.address();
        let Some(last) = self.last.clone() else {
            let is_seen = match address {
                Some(address) => answers(address, None),
                None => plugged_in(&self.wanted).is_some(),
            };
            // The first search tells what is there instead. At an address, there is nothing more to be found.
            let search = is_seen
                || (self.next_search.is_none() || address.is_none()) && self.search_is_due(Duration::ZERO);
            return match search {
                true => Look::Unknown,
                false => self.gone("nothing of that name".into()),
            };
        };
        let nothing_there = format!("nothing where it was ({} {})", last.transport, last.address);
        match (Transport::of(&last), last.address.parse()) {
            (Transport::Usb, _) if self.was_listed => match plugged_in(&last.serial) {
                Some(_) => Look::There(last),
                None => Look::Gone(nothing_there),
            },
            (Transport::Usb, _) => match self.search_is_due(Duration::ZERO) {
                true => Look::There(last),
                false => self.gone(nothing_there),
            },
            (Transport::Gige, Ok(at)) => {
                // Who names an address means whatever camera is there.
                let serial = address.is_none().then_some(last.serial.as_str());
                if answers(at, serial) {
                    Look::There(last)
                } else if address.is_none() && self.search_is_due(SEARCH_PERIOD) {
                    Look::Unknown
                } else {
                    self.gone(nothing_there)
                }
            }
            _ => Look::There(last),
        }
    }

    fn address(&self) -> Option<Ipv4Addr> {
        self.wanted.parse().ok()
    }

    /// What the last search found, or else this.
    fn gone(&self, otherwise: String) -> Look {
        Look::Gone(self.found.clone().unwrap_or(otherwise))
    }

    fn absent(&self, found: String) -> CameraError {
        CameraError::Absent { kind: KIND, wanted: self.wanted.clone(), found }
    }

    fn search_is_due(&mut self, first: Duration) -> bool {
        let now = Instant::now();
        let is_due = now >= *self.next_search.get_or_insert(now + first);
        if is_due {
            self.next_search = Some(now + SEARCH_PERIOD);
        }
        is_due
    }
}

impl CameraSource for Finder {
    fn open(&mut self) -> Result<Box<dyn Camera>, CameraError> {
        Ok(Box::new(self.open_camera()?))
    }
}

/// A camera of this serial on USB, where the system lists one.
fn plugged_in(serial: &str) -> Option<UsbDevice> {
    usb::find(Path::new(usb::DEVICES), serial)
}

/// Whether a GigE Vision camera of this serial answers at this address: DISCOVERY_CMD of GVCP to one address, and the serial number
/// among the bootstrap registers that DISCOVERY_ACK brings (GigE Vision, GVCP and bootstrap registers).
fn answers(address: Ipv4Addr, serial: Option<&str>) -> bool {
    const PORT: u16 = 3956;
    /// Key, flags (acknowledge), command, length 0, request id 1.
    const DISCOVERY_CMD: [u8; 8] = [0x42, 0x01, 0x00, 0x02, 0x00, 0x00, 0x00, 0x01];
    const DISCOVERY_ACK: [u8; 2] = [0x00, 0x03];
    /// Header of the answer, and its bootstrap registers.
    const HEADER: usize = 8;
    const SERIAL_NUMBER: std::ops::Range<usize> = HEADER + 0xd8..HEADER + 0xe8;
    let ask = || {
        let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
        socket.connect((address, PORT))?;
        socket.set_read_timeout(Some(ANSWER))?;
        socket.send(&DISCOVERY_CMD)?;
        let mut answer = [0; 576];
        socket.recv(&mut answer).map(|length| answer.get(..length).unwrap_or_default().to_vec())
    };
    let Ok(answer) = ask() else { return false };
    let number = answer.get(SERIAL_NUMBER).unwrap_or_default();
    let number = number.split(|byte| *byte == 0).next().unwrap_or_default();
    let is_wanted = |serial: &str| told(&String::from_utf8_lossy(number)) == serial;
    answer.get(2..4) == Some(&DISCOVERY_ACK) && serial.is_none_or(is_wanted)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn searches_keep_their_distance() {
        let mut finder = Finder::new("no such serial");
        assert!(finder.search_is_due(Duration::ZERO));
        assert!(!finder.search_is_due(Duration::ZERO));
        finder.next_search = None;
        assert!(!finder.search_is_due(SEARCH_PERIOD));
    }

    #[test]
    fn between_two_searches_the_last_finding_is_told_again() {
        let mut finder = Finder::new("no such serial");
        finder.found = Some("another camera".into());
        finder.next_search = Some(Instant::now() + SEARCH_PERIOD);
        let error = finder.open().unwrap_err().to_string();
        assert!(error.contains("\"no such serial\" is not connected; found: another camera"), "{error}");
    }
}
