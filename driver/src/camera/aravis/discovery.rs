//! Which cameras are there, and opening one of them.
//!
//! The library keeps one list of devices for each transport, without a lock of its own: every use of a list, opening included,
//! happens under [`LIBRARY`], so that camera threads may open in parallel.

use std::net::Ipv4Addr;
use std::sync::{Mutex, MutexGuard, PoisonError};

use aravis::glib::GString;
use aravis::glib::object::Cast;
use aravis::prelude::*;
use aravis::{Device, DeviceError, FakeInterface, GvDevice, GvInterface, Interface, UvInterface};

use super::KIND;
use super::features::failed;
use crate::camera::{CameraError, Identity};

static LIBRARY: Mutex<()> = Mutex::new(());

/// The library's camera in this process, which needs no hardware.
const FAKE_DEVICE_ID: &str = "Fake_1";

fn library() -> MutexGuard<'static, ()> {
    // The lists are updated as a whole: a panic elsewhere leaves nothing half done.
    LIBRARY.lock().unwrap_or_else(PoisonError::into_inner)
}

/// One entry of a device list.
struct Found {
    /// What the library opens it by.
    device_id: String,
    identity: Identity,
}

impl Found {
    fn is(&self, wanted: &str) -> bool {
        wanted == self.identity.serial || wanted == self.device_id
    }
}

/// An opened device, and who it is.
pub(super) struct Opened {
    pub(super) camera: aravis::Camera,
    pub(super) identity: Identity,
}

/// All connected USB3 Vision and GigE Vision cameras. GigE Vision takes about a second: every interface is asked by broadcast.
pub(super) fn list() -> Vec<Identity> {
    let _library = library();
    [UvInterface::instance(), GvInterface::instance()]
        .into_iter()
        .flatten()
        .flat_map(|interface| scan(&interface))
        .map(|found| found.identity)
        .collect()
}

/// Opens the device with the serial, device id or IPv4 address `wanted`.
pub(super) fn open(wanted: &str) -> Result<Opened, CameraError> {
    let _library = library();
    if wanted == FAKE_DEVICE_ID {
        return match FakeInterface::instance() {
            Some(interface) => {
                open_listed(&interface, &scan(&interface), wanted).unwrap_or_else(|| Err(absent(wanted, &[])))
            }
            None => Err(absent(wanted, &[])),
        };
    }
    // Not every string: the library would resolve it as a host name, a serial of digits alone as the address 0.0.x.y.
    if let Ok(address) = wanted.parse::<Ipv4Addr>() {
        return open_address(address);
    }
    let mut all = Vec::new();
    for interface in [UvInterface::instance(), GvInterface::instance()].into_iter().flatten() {
        let found = scan(&interface);
        if let Some(opened) = open_listed(&interface, &found, wanted) {
            return opened;
        }
        all.extend(found);
    }
    Err(absent(wanted, &all))
}

fn scan(interface: &Interface) -> Vec<Found> {
    interface.update_device_list();
    (0..interface.n_devices())
        .map(|index| {
            let text = |value: Option<GString>| value.map(String::from).unwrap_or_default();
            let transport = text(interface.device_protocol(index));
            // The library knows no address of a USB device; its GUID is what stays the same on every port.
            let address = match transport.as_str() {
                "USB3Vision" => interface.device_physical_id(index),
                _ => interface.device_address(index),
            };
            Found {
                device_id: text(interface.device_id(index)),
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
    let Found { device_id, identity } = found.iter().find(|found| found.is(wanted))?;
    let device = interface.open_device(Some(device_id)).map_err(|error| failed(wanted, "opening", error));
    Some(
        device
            .and_then(|device| Ok(Opened { camera: control(&device, wanted)?, identity: identity.clone() })),
    )
}

/// Opens a GigE Vision camera without asking every interface for others.
fn open_address(address: Ipv4Addr) -> Result<Opened, CameraError> {
    let wanted = address.to_string();
    let Some(interface) = GvInterface::instance() else { return Err(absent(&wanted, &[])) };
    let device = match interface.open_device(Some(&wanted)) {
        Ok(device) => device,
        Err(error) if error.matches(DeviceError::NotFound) => return Err(absent(&wanted, &scan(&interface))),
        Err(error) => return Err(failed(&wanted, "opening", error)),
    };
    let camera = control(&device, &wanted)?;
    let text = |value: Result<GString, _>| value.map(String::from).unwrap_or_default();
    let identity = Identity {
        kind: KIND,
        vendor: text(camera.vendor_name()),
        model: text(camera.model_name()),
        serial: text(camera.device_serial_number()),
        transport: "GigEVision".into(),
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
        false => found.join(", "),
    };
    CameraError::Absent { kind: KIND, wanted: wanted.to_owned(), found }
}
