//! Which cameras are there, and opening one of them.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use rustix::io::Errno;

use super::KIND;
use super::device::{Capability, Device};
use crate::camera::source::V4l2Device;
use crate::camera::{CameraError, Identity, listed, told};

/// Every video device has a folder here, of the name of its node (sysfs).
const NODES: &str = "/sys/class/video4linux";

/// All cameras, in the order of their nodes.
pub(super) fn list() -> Vec<Identity> {
    let mut nodes: Vec<PathBuf> =
        fs::read_dir(NODES).into_iter().flatten().flatten().map(|entry| entry.path()).collect();
    nodes.sort_by_key(|node| (node.as_os_str().len(), node.clone()));
    // A node that is no camera, or not ours to open, is none of the list.
    nodes
        .iter()
        .filter_map(|node| look_at(&Path::new("/dev").join(node.file_name()?)).ok().flatten())
        .map(|(_, identity)| identity)
        .collect()
}

/// Opens the device at a path or with a serial.
pub(super) fn open(wanted: &V4l2Device) -> Result<(Device, Identity), CameraError> {
    let path = match wanted {
        V4l2Device::Path(path) => path.clone(),
        V4l2Device::Serial(serial) => path_of(serial, list())?,
    };
    match look_at(&path) {
        Ok(Some(found)) => Ok(found),
        Ok(None) => {
            Err(absent(&path.display().to_string(), "a device that is no camera of the single-planar API"))
        }
        Err(error) => Err(match error.kind() {
            // What is named by a path and not there, or is there and on its way out.
            io::ErrorKind::NotFound => absent(&path.display().to_string(), &described(&list())),
            _ if super::is_gone(&error) => absent(&path.display().to_string(), "a device that is gone"),
            _ => CameraError::Device {
                serial: path.display().to_string(),
                doing: "opening",
                cause: match Errno::from_io_error(&error) {
                    Some(Errno::NOTTY) => {
                        "it is no video device; uvcam list shows those that are cameras".into()
                    }
                    _ => format!("{error}; check the rights on the device (udev rules)"),
                },
            },
        }),
    }
}

/// The node of the only camera with this serial.
fn path_of(serial: &str, cameras: Vec<Identity>) -> Result<PathBuf, CameraError> {
    let matching: Vec<&Identity> = cameras.iter().filter(|camera| camera.serial == serial.trim()).collect();
    match matching.as_slice() {
        [] => Err(absent(serial, &described(&cameras))),
        [camera] => Ok(camera.address.clone().into()),
        several => Err(CameraError::Refused {
            setting: "serial",
            asked: serial.to_owned(),
            applied: listed(several.iter().map(|camera| camera.address.clone()).collect()),
            remedy: "name the camera by its path instead, such as a link in /dev/v4l/by-path".into(),
        }),
    }
}

/// Opens a node; `None` where it is no camera.
fn look_at(path: &Path) -> io::Result<Option<(Device, Identity)>> {
    // The node behind a link.
    let node = fs::canonicalize(path)?;
    let device = Device::open(&node)?;
    let capability = device.capability()?;
    if !capability.captures {
        return Ok(None);
    }
    let usb = usb_folder(&Path::new(NODES).join(node.file_name().unwrap_or_default()));
    let identity = identity(capability, usb.as_deref(), &node);
    Ok(Some((device, identity)))
}

fn identity(capability: Capability, usb: Option<&Path>, node: &Path) -> Identity {
    let Capability { driver, card, bus_info, .. } = capability;
    let attribute = |name: &str| {
        let text = fs::read_to_string(usb?.join(name)).ok()?;
        Some(told(&text)).filter(|text| !text.is_empty())
    };
    let bus = bus_info.split(':').next().unwrap_or_default().to_owned();
    Identity {
        kind: KIND,
        vendor: attribute("manufacturer").unwrap_or(driver),
        model: attribute("product").unwrap_or(card),
        // Where the device has none, the place where it is connected tells it from others.
        serial: attribute("serial").unwrap_or(bus_info),
        transport: if usb.is_some() { "USB".into() } else { bus },
        address: node.display().to_string(),
    }
}

/// The folder of the USB device that a video device is an interface of.
fn usb_folder(class_folder: &Path) -> Option<PathBuf> {
    let interface = fs::canonicalize(class_folder.join("device")).ok()?;
    let device = interface.parent()?;
    device.join("idVendor").exists().then(|| device.to_owned())
}

fn described(cameras: &[Identity]) -> String {
    if cameras.is_empty() {
        return "nothing (a camera is seen only with the access rights of the udev rules)".into();
    }
    let described: Vec<String> = cameras
        .iter()
        .map(|Identity { model, serial, address, .. }| format!("{model} \"{serial}\" ({address})"))
        .collect();
    listed(described)
}

fn absent(wanted: &str, found: &str) -> CameraError {
    CameraError::Absent { kind: KIND, wanted: wanted.to_owned(), found: found.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn capability() -> Capability {
        Capability {
            driver: "uvcvideo".into(),
            card: "Camera: Came".into(),
            bus_info: "usb-0000:00:14.0-1".into(),
            captures: true,
        }
    }

    fn camera(serial: &str, address: &str) -> Identity {
        Identity { serial: serial.into(), ..identity(capability(), None, Path::new(address)) }
    }

    #[test]
    fn a_usb_camera_is_who_its_descriptors_say() {
        let root = tempfile::tempdir().unwrap();
        let usb = root.path().join("usb1/1-1");
        fs::create_dir_all(usb.join("1-1:1.0")).unwrap();
        for (name, text) in
            [("idVendor", "1234\n"), ("product", "Camera\n"), ("manufacturer", "Maker\n"), ("serial", "42\n")]
        {
            fs::write(usb.join(name), text).unwrap();
        }
        let class = root.path().join("video0");
        fs::create_dir(&class).unwrap();
        std::os::unix::fs::symlink(usb.join("1-1:1.0"), class.join("device")).unwrap();

        let found = identity(capability(), usb_folder(&class).as_deref(), Path::new("/dev/video0"));
        assert_eq!(
            (found.vendor.as_str(), found.model.as_str(), found.serial.as_str()),
            ("Maker", "Camera", "42")
        );
        assert_eq!((found.transport.as_str(), found.address.as_str()), ("USB", "/dev/video0"));
        fs::remove_file(usb.join("serial")).unwrap();
        let found = identity(capability(), usb_folder(&class).as_deref(), Path::new("/dev/video0"));
        assert_eq!(found.serial, "usb-0000:00:14.0-1", "the port of a camera without a serial");
    }

    #[test]
    fn a_serial_leads_to_one_node_or_is_refused() {
        let cameras =
            || vec![camera("1", "/dev/video0"), camera("2", "/dev/video2"), camera("2", "/dev/video4")];
        assert_eq!(path_of("1", cameras()).unwrap(), Path::new("/dev/video0"));
        let error = path_of("2", cameras()).unwrap_err();
        assert!(error.is_refusal() && error.to_string().contains("/dev/video2, /dev/video4"), "{error}");
        let error = path_of("3", cameras()).unwrap_err();
        assert!(
            matches!(error, CameraError::Absent { .. }) && error.to_string().contains("\"1\" (/dev/video0)"),
            "{error}"
        );
    }

    #[test]
    fn a_path_that_leads_nowhere_or_to_no_video_device_is_told() {
        let error = open(&V4l2Device::Path("/nowhere/video0".into())).err().unwrap();
        assert!(
            matches!(error, CameraError::Absent { .. }) && error.to_string().contains("/nowhere/video0"),
            "{error}"
        );
        let error = open(&V4l2Device::Path("/dev/null".into())).err().unwrap();
        assert!(matches!(error, CameraError::Device { .. }), "{error}");
        assert!(error.to_string().contains("it is no video device"), "{error}");
    }
}
