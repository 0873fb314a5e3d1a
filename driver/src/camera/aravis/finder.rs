//! Opens one camera again and again, and knows where it was last.
//!
//! A search for a camera takes a second (GigE Vision), or a question to every other camera (USB3 Vision). One that was there before is
//! looked for at its place first: a USB camera in the system's list of devices, a GigE Vision camera at its address. That takes so
//! little that it can be done ten times a second.

use std::net::{Ipv4Addr, UdpSocket};
use std::path::Path;
use std::time::{Duration, Instant};

use super::discovery::{self, Transport};
use super::{AravisCamera, KIND};
use crate::camera::{CameraError, Identity};

/// Time between searches for a camera that is not where it was: a GigE Vision camera may have got another address.
const SEARCH_PERIOD: Duration = Duration::from_secs(2);
/// How long a camera on the local network may take to say that it is there.
const ANSWER: Duration = Duration::from_millis(100);
/// The system's list of USB devices.
const USB_DEVICES: &str = "/sys/bus/usb/devices";

/// Finds one camera.
#[derive(Debug)]
pub struct Finder {
    wanted: String,
    /// The camera as it was found last.
    last: Option<Identity>,
    /// Nothing while the camera is where it was.
    next_search: Option<Instant>,
}

/// What a look without a search tells.
enum Look {
    There(Identity),
    Gone(String),
    Unknown,
}

impl Finder {
    /// For the camera whose serial, device id or IPv4 address is `wanted`.
    pub fn new(wanted: &str) -> Self {
        Finder { wanted: wanted.to_owned(), last: None, next_search: None }
    }

    /// Opens the camera, as [`AravisCamera::open`]; with little effort where it was opened before, or tried to.
    ///
    /// # Errors
    /// Those of [`AravisCamera::open`].
    pub fn open(&mut self) -> Result<AravisCamera, CameraError> {
        let camera = match self.look() {
            Look::There(last) => AravisCamera::of(discovery::reopen(&last)?),
            Look::Unknown => AravisCamera::open(&self.wanted)?,
            Look::Gone(found) => {
                return Err(CameraError::Absent { kind: KIND, wanted: self.wanted.clone(), found });
            }
        };
        self.last = Some(camera.identity.clone());
        self.next_search = None;
        Ok(camera)
    }

    fn look(&mut self) -> Look {
        let address = self.wanted.parse::<Ipv4Addr>().ok();
        let Some(last) = self.last.clone() else {
            let is_seen = match address {
                Some(address) => answers(address, None),
                None => is_plugged_in(Path::new(USB_DEVICES), &self.wanted),
            };
            // The first search tells what is there instead. At an address, there is nothing more to be found.
            let search = is_seen
                || (self.next_search.is_none() || address.is_none()) && self.search_is_due(Duration::ZERO);
            return if search { Look::Unknown } else { Look::Gone("nothing of that name".into()) };
        };
        // Who names an address means whatever camera is there.
        let serial = address.is_none().then_some(last.serial.as_str());
        if is_there(&last, serial) {
            return Look::There(last);
        }
        let may_have_moved = Transport::of(&last) == Transport::Gige && address.is_none();
        match may_have_moved && self.search_is_due(SEARCH_PERIOD) {
            true => Look::Unknown,
            false => Look::Gone(format!("nothing where it was ({} {})", last.transport, last.address)),
        }
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

/// Whether a camera, one of this serial where there is one, is where it was found before.
fn is_there(last: &Identity, serial: Option<&str>) -> bool {
    match (Transport::of(last), last.address.parse()) {
        (Transport::Usb, _) => is_plugged_in(Path::new(USB_DEVICES), &last.serial),
        (Transport::Gige, Ok(address)) => answers(address, serial),
        _ => true,
    }
}

/// Whether the system lists a USB device of this serial. Asks no device.
fn is_plugged_in(devices: &Path, serial: &str) -> bool {
    let Ok(devices) = devices.read_dir() else { return false };
    devices.flatten().any(|device| {
        std::fs::read_to_string(device.path().join("serial")).is_ok_and(|found| found.trim_end() == serial)
    })
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
    let told = answer.get(SERIAL_NUMBER).unwrap_or_default();
    let told = told.split(|byte| *byte == 0).next().unwrap_or_default();
    answer.get(2..4) == Some(&DISCOVERY_ACK) && serial.is_none_or(|serial| told == serial.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_usb_camera_is_plugged_in_where_the_system_lists_its_serial() {
        let devices = tempfile::tempdir().unwrap();
        for (device, serial) in [("1-1", Some("25003774\n")), ("1-2", None), ("usb1", Some("0000:00:14.0\n"))]
        {
            let folder = devices.path().join(device);
            std::fs::create_dir(&folder).unwrap();
            if let Some(serial) = serial {
                std::fs::write(folder.join("serial"), serial).unwrap();
            }
        }
        assert!(is_plugged_in(devices.path(), "25003774"));
        assert!(!is_plugged_in(devices.path(), "2500377"));
        assert!(!is_plugged_in(&devices.path().join("nowhere"), "25003774"));
    }

    #[test]
    fn searches_keep_their_distance() {
        let mut finder = Finder::new("no such serial");
        assert!(finder.search_is_due(Duration::ZERO));
        assert!(!finder.search_is_due(Duration::ZERO));
        finder.next_search = None;
        assert!(!finder.search_is_due(SEARCH_PERIOD));
    }
}
