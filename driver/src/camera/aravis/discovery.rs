//! Which cameras are there, and opening one of them.
//!
//! The library keeps one list of devices for each transport, without a lock of its own: every use of a list, opening included,
//! happens in [`Transport::with`], so that camera threads may open in parallel, and no USB camera waits for a look round the network.

use std::net::Ipv4Addr;
use std::sync::{Mutex, PoisonError};

use aravis::glib::GString;
use aravis::glib::object::Cast;
use aravis::prelude::*;
use aravis::{Device, DeviceError, FakeInterface, GvDevice, Interface, UvInterface, glib};

use super::features::failed;
use super::{KIND, gige};
use crate::camera::{CameraError, GIGE_VISION, Identity, listed, told};

/// The library's camera in this process, which needs no hardware.
const FAKE_DEVICE_ID: &str = "Fake_1";
/// How the library names its other transport of devices.
const USB3_VISION: &str = "USB3Vision";

/// A transport, with a list of its own in the library.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Transport {
    Usb,
    Gige,
    Fake,
}

impl Transport {
    /// Those of devices, in the order of a search.
    const REAL: [Transport; 2] = [Transport::Usb, Transport::Gige];

    /// That of a device that was found before.
    pub(super) fn of(identity: &Identity) -> Self {
        match identity.transport.as_str() {
            USB3_VISION => Transport::Usb,
            GIGE_VISION => Transport::Gige,
            _ => Transport::Fake,
        }
    }

    /// Works with the library's list while nobody else does; `None` where the library has been built without this transport.
    fn with<T>(self, work: impl FnOnce(&Interface) -> T) -> Option<T> {
        static LISTS: [Mutex<()>; 3] = [const { Mutex::new(()) }; 3];
        // A list is updated as a whole: a panic elsewhere leaves nothing half done.
        let _list = LISTS.get(self as usize).map(|list| list.lock().unwrap_or_else(PoisonError::into_inner));
        let interface = match self {
            // Each time anew: the one that the library keeps hears of devices from udevd alone, and where none reaches this program,
            // as in a container, its list never changes.
            Transport::Usb => Some(glib::Object::new::<UvInterface>().upcast()),
            Transport::Gige => gige::interface(),
            Transport::Fake => FakeInterface::instance(),
        };
        interface.map(|interface| work(&interface))
    }
}

/// One entry of a device list.
struct Found {
    /// What the library opens it by.
    device_id: String,
    identity: Identity,
}

impl Found {
    fn is(&self, wanted: &str) -> bool {
        wanted == self.identity.serial || wanted == self.device_id.trim()
    }
}

/// An opened device, and who it is.
pub(super) struct Opened {
    pub(super) camera: aravis::Camera,
    pub(super) identity: Identity,
}

/// All connected USB3 Vision and GigE Vision cameras. GigE Vision takes about a second: every interface is asked by broadcast.
pub(super) fn list() -> Vec<Identity> {
    let found = Transport::REAL.into_iter().filter_map(|transport| transport.with(scan)).flatten();
    found.map(|found| found.identity).collect()
}

/// Opens the device with the serial, device id or IPv4 address `wanted`.
pub(super) fn open(wanted: &str) -> Result<Opened, CameraError> {
    let wanted = wanted.trim();
    if wanted == FAKE_DEVICE_ID {
        return search(wanted, &[Transport::Fake]);
    }
    // Not every string: the library would resolve it as a host name, a serial of digits alone as the address 0.0.x.y.
    match wanted.parse::<Ipv4Addr>() {
        Ok(address) => open_address(address),
        Err(_) => search(wanted, &Transport::REAL),
    }
}

/// Opens a device that was found before by its serial, where it was found. A GigE Vision camera is opened at its address, at which it
/// has just said its serial.
pub(super) fn reopen(identity: &Identity) -> Result<Opened, CameraError> {
    match (Transport::of(identity), identity.address.parse::<Ipv4Addr>()) {
        (Transport::Gige, Ok(address)) => {
            open_address(address).map(|opened| Opened { identity: identity.clone(), ..opened })
        }
        (transport, _) => search(&identity.serial, &[transport]),
    }
}

fn search(wanted: &str, transports: &[Transport]) -> Result<Opened, CameraError> {
    let mut all = Vec::new();
    for transport in transports {
        let outcome = transport.with(|interface| {
            let found = scan(interface);
            open_listed(interface, &found, wanted).ok_or(found)
        });
        match outcome {
            Some(Ok(opened)) => return opened,
            Some(Err(found)) => all.extend(found),
            None => {}
        }
    }
    Err(absent(wanted, &all))
}

fn scan(interface: &Interface) -> Vec<Found> {
    interface.update_device_list();
    (0..interface.n_devices())
        .map(|index| {
            let text = |value: Option<GString>| told(&value.unwrap_or_default());
            let transport = text(interface.device_protocol(index));
            // The library knows no address of a USB device; its GUID is what stays the same on every port.
            let address = match transport.as_str() {
                USB3_VISION => interface.device_physical_id(index),
                _ => interface.device_address(index),
            };
            Found {
                device_id: interface.device_id(index).map(String::from).unwrap_or_default(),
                identity: Identity {
                    kind: KIND,
                    vendor: text(interface.device_vendor(index)),
                    model: text(interface.device_model(index)),
                    serial: text(interface.device_serial_nbr(index)),
                    transport,
                    address: text(address),
                },
            }
        })
        .collect()
}

fn open_listed(interface: &Interface, found: &[Found], wanted: &str) -> Option<Result<Opened, CameraError>> {
    let Found { device_id, identity } = match the_only(found, wanted) {
        Ok(found) => found?,
        Err(error) => return Some(Err(error)),
    };
    let device = interface.open_device(Some(device_id)).map_err(|error| failed(wanted, "opening", error));
    Some(
        device
            .and_then(|device| Ok(Opened { camera: control(&device, wanted)?, identity: identity.clone() })),
    )
}

/// The device that is meant, where there is one. A serial is a maker's own: two makers can have given the same.
fn the_only<'a>(found: &'a [Found], wanted: &str) -> Result<Option<&'a Found>, CameraError> {
    let matching: Vec<&Found> = found.iter().filter(|found| found.is(wanted)).collect();
    let Some(first) = matching.first() else { return Ok(None) };
    if matching.iter().all(|found| found.device_id == first.device_id) {
        return Ok(Some(first));
    }
    Err(CameraError::Refused {
        setting: "serial",
        asked: wanted.to_owned(),
        applied: listed(matching.iter().map(|found| format!("\"{}\"", told(&found.device_id))).collect()),
        remedy: "name the camera by one of these device ids instead".into(),
    })
}

/// Opens a GigE Vision camera without asking every interface for others.
fn open_address(address: Ipv4Addr) -> Result<Opened, CameraError> {
    let wanted = address.to_string();
    let opened = Transport::Gige.with(|interface| match interface.open_device(Some(&wanted)) {
        Ok(device) => Ok(device),
        Err(error) if error.matches(DeviceError::NotFound) => Err(absent(&wanted, &scan(interface))),
        Err(error) => Err(failed(&wanted, "opening", error)),
    });
    let no_network = || CameraError::Device {
        serial: wanted.clone(),
        doing: "opening",
        cause: "this program may not use the network; a service needs the drop-in network.conf".into(),
    };
    let camera = control(&opened.ok_or_else(no_network)??, &wanted)?;
    let text = |value: Result<GString, _>| value.map(|value| told(&value)).unwrap_or_default();
    let identity = Identity {
        kind: KIND,
        vendor: text(camera.vendor_name()),
        model: text(camera.model_name()),
        serial: text(camera.device_serial_number()),
        transport: GIGE_VISION.into(),
        address: wanted,
    };
    Ok(Opened { camera, identity })
}

/// Makes a camera of a device that this program alone controls.
fn control(device: &Device, wanted: &str) -> Result<aravis::Camera, CameraError> {
    if device.downcast_ref::<GvDevice>().is_some_and(|device| !device.is_controller()) {
        return Err(CameraError::Device {
            serial: wanted.to_owned(),
            doing: "opening",
            cause:
                "another program controls it, or did until its heartbeat timeout; stop that program or wait"
                    .into(),
        });
    }
    aravis::Camera::with_device(device).map_err(|error| failed(wanted, "opening", error))
}

fn absent(wanted: &str, found: &[Found]) -> CameraError {
    let found: Vec<String> = found
        .iter()
        .map(|Found { identity, .. }| {
            format!(
                "{} {} \"{}\" ({} {})",
                identity.vendor, identity.model, identity.serial, identity.transport, identity.address
            )
        })
        .collect();
    let found = match found.is_empty() {
        true => "nothing (a USB camera is seen only with the access rights of the udev rules)".into(),
        false => listed(found),
    };
    CameraError::Absent { kind: KIND, wanted: wanted.to_owned(), found }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(vendor: &str, serial: &str) -> Found {
        Found {
            device_id: format!("{vendor}-Model-{serial}"),
            identity: Identity {
                kind: KIND,
                vendor: vendor.into(),
                model: "Model".into(),
                serial: serial.into(),
                transport: USB3_VISION.into(),
                address: String::new(),
            },
        }
    }

    #[test]
    fn a_serial_of_two_makers_is_refused_with_their_device_ids() {
        let all = [found("Maker", "1"), found("Maker", "2"), found("Other", "2")];
        let id = |wanted| the_only(&all, wanted).map(|found| found.map(|found| found.device_id.as_str()));
        assert_eq!(id("1").unwrap(), Some("Maker-Model-1"));
        assert_eq!(id("3").unwrap(), None);
        assert_eq!(id("Other-Model-2").unwrap(), Some("Other-Model-2"));
        let error = id("2").unwrap_err();
        assert!(error.is_refusal(), "{error}");
        assert!(error.to_string().contains("\"Maker-Model-2\", \"Other-Model-2\""), "{error}");
    }
}
