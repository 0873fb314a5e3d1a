//! The system's list of USB devices (sysfs, kernel documentation "sysfs-bus-usb"). Looking into it asks no device.

use std::fs::{self, OpenOptions};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use rustix::net::{AddressFamily, SocketType, netlink, socket};

use crate::camera::told;

/// The list.
pub(super) const DEVICES: &str = "/sys/bus/usb/devices";
/// Where the nodes of the devices are.
const NODES: &str = "/dev/bus/usb";

/// A device as the system lists it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct UsbDevice {
    /// Where it is plugged in, such as `2-1.4`.
    place: String,
    /// What a program opens.
    node: PathBuf,
}

/// The device with this serial, where one is plugged in.
pub(super) fn find(devices: &Path, serial: &str) -> Option<UsbDevice> {
    devices.read_dir().ok()?.flatten().find_map(|device| {
        let read = |file: &str| Some(told(&fs::read_to_string(device.path().join(file)).ok()?));
        if read("serial")? != serial {
            return None;
        }
        let number = |file: &str| read(file).and_then(|text| text.parse::<u32>().ok()).unwrap_or(0);
        let node = format!("{:03}/{:03}", number("busnum"), number("devnum"));
        Some(UsbDevice {
            place: told(&device.file_name().to_string_lossy()),
            node: Path::new(NODES).join(node),
        })
    })
}

impl UsbDevice {
    /// Why the library does not show a device that the system lists, and what to do.
    pub(super) fn why_unseen(&self) -> String {
        let UsbDevice { place, node } = self;
        let node = node.display();
        let here = format!("the camera at USB {place}, but ");
        here + &match OpenOptions::new().read(true).write(true).open(&self.node) {
            Err(error) if error.kind() == ErrorKind::NotFound => {
                format!("{node} is not there; a container needs all of {NODES} (-v {NODES}:{NODES})")
            }
            Err(error) => format!(
                "{node} cannot be opened: {error}; check the udev rules, and in a container its device rules"
            ),
            Ok(_) => match socket(AddressFamily::NETLINK, SocketType::RAW, Some(netlink::KOBJECT_UEVENT)) {
                Err(error) => format!("libusb needs a netlink socket: {error}; allow AF_NETLINK"),
                Ok(_) => "it does not say that it is a USB3 Vision camera; plug it in anew".into(),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plug(devices: &Path, place: &str, serial: Option<&str>) {
        let folder = devices.join(place);
        fs::create_dir(&folder).unwrap();
        for (file, text) in [("busnum", Some("2\n")), ("devnum", Some("17\n")), ("serial", serial)] {
            text.into_iter().for_each(|text| fs::write(folder.join(file), text).unwrap());
        }
    }

    #[test]
    fn a_camera_is_plugged_in_where_the_system_lists_its_serial() {
        let devices = tempfile::tempdir().unwrap();
        plug(devices.path(), "1-1", Some(" 25003774 \n"));
        plug(devices.path(), "1-2", None);
        plug(devices.path(), "usb1", Some("0000:00:14.0\n"));
        let found = find(devices.path(), "25003774");
        assert_eq!(found, Some(UsbDevice { place: "1-1".into(), node: "/dev/bus/usb/002/017".into() }));
        assert_eq!(find(devices.path(), "2500377"), None);
        assert_eq!(find(&devices.path().join("nowhere"), "25003774"), None);
    }

    #[test]
    fn what_keeps_the_library_from_a_camera_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let reason = |node: PathBuf| UsbDevice { place: "2-1".into(), node }.why_unseen();
        let absent = reason(folder.path().join("017"));
        assert!(
            absent.starts_with("the camera at USB 2-1, but ") && absent.contains("017 is not there"),
            "{absent}"
        );
        assert!(absent.contains("-v /dev/bus/usb:/dev/bus/usb"), "{absent}");
        // A folder can be opened for writing by nobody, root included.
        let closed = reason(folder.path().to_owned());
        assert!(closed.contains("cannot be opened") && closed.contains("udev rules"), "{closed}");
        let node = folder.path().join("018");
        fs::write(&node, "").unwrap();
        assert!(reason(node).contains("does not say that it is a USB3 Vision camera"));
    }
}
