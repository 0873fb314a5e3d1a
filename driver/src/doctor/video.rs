//! Cameras of the kernel: the nodes that the configuration names.

use std::fs;

use super::access::Node;
use super::machine::Machine;
use super::{Finding, Severity};
use crate::config::{Config, Source, V4l2Device};

const NODES: &str = "/sys/class/video4linux";

/// A configured camera of the kernel.
pub(super) struct VideoCamera<'a> {
    /// Its name in the configuration.
    name: &'a str,
    device: &'a V4l2Device,
    /// The path of its node, links followed; nothing where it is not connected.
    node: Option<String>,
}

/// The configured cameras of the kernel.
pub(super) fn cameras<'a>(machine: &Machine, config: &'a Config) -> Vec<VideoCamera<'a>> {
    let cameras = config.cameras.iter().filter_map(|camera| match &camera.source {
        Source::V4l2(source) => {
            let node = match &source.device {
                V4l2Device::Path(path) => machine.behind(path),
                V4l2Device::Serial(serial) => with_serial(machine, serial),
            };
            Some(VideoCamera { name: &camera.name, device: &source.device, node })
        }
        _ => None,
    });
    cameras.collect()
}

/// The first node of the USB device with this serial, which carries the frames. Others carry data about them.
fn with_serial(machine: &Machine, serial: &str) -> Option<String> {
    let is_of_device = |name: &String| {
        let interface = fs::canonicalize(machine.path(&format!("{NODES}/{name}/device"))).ok();
        let file = interface.and_then(|interface| Some(interface.parent()?.join("serial")));
        file.and_then(|file| fs::read_to_string(file).ok()).is_some_and(|text| text.trim() == serial)
    };
    let is_first = |name: &String| machine.value(&format!("{NODES}/{name}/index")) == Some(0_u32);
    let name = machine.names(NODES).into_iter().find(|name| is_of_device(name) && is_first(name))?;
    Some(format!("/dev/{name}"))
}

/// The nodes of those that are connected.
pub(super) fn nodes(cameras: &[VideoCamera]) -> Vec<Node> {
    let nodes = cameras.iter().filter_map(|camera| {
        let path = camera.node.clone()?;
        let described = format!("camera {}", camera.name);
        // The system's own rules give every video node to the group video.
        Some(Node { camera: described, path, subsystem: "video4linux", has_rule: true })
    });
    nodes.collect()
}

/// Whether they are connected, and named by what stays theirs.
pub(super) fn examine(machine: &Machine, cameras: &[VideoCamera]) -> Vec<Finding> {
    [connected(cameras), names(machine, cameras)].concat()
}

/// Whether each is connected. One that is not found by its serial may be named by its place instead, which sysfs does not say.
fn connected(cameras: &[VideoCamera]) -> Vec<Finding> {
    let absent = cameras.iter().filter(|camera| camera.node.is_none());
    let finding = |VideoCamera { name, device, .. }: &VideoCamera| {
        let (severity, what) = match device {
            V4l2Device::Path(path) => (Severity::Fault, format!("{name}: there is no {}", path.display())),
            V4l2Device::Serial(serial) => {
                let what = format!("{name}: no video device on USB has the serial {serial}");
                (Severity::Unknown, what + ", so its access was not examined")
            }
        };
        let remedy =
            "uvcam list shows every camera that answers, with its serial and node; check cable and power";
        Finding::new(severity, "connected", what, remedy)
    };
    absent.map(finding).collect()
}

/// Whether a camera is named by the number of its node, which another one can have after the next start.
fn names(machine: &Machine, cameras: &[VideoCamera]) -> Vec<Finding> {
    let finding = |VideoCamera { name, device, node }: &VideoCamera| {
        let V4l2Device::Path(path) = device else { return None };
        let path = path.to_str()?;
        let is_number = |number: &str| !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit());
        path.strip_prefix("/dev/video").filter(|number| is_number(number))?;
        let link = node.as_ref().and_then(|node| link_to(machine, node));
        let remedy = match link {
            Some(link) => format!("write path = \"{link}\" into its source"),
            None => "write its serial into its source, or a link in /dev/v4l; uvcam list shows every camera"
                .into(),
        };
        Some(Finding::new(
            Severity::Warning,
            "device_name",
            format!(
                "{name}: {path} is a number in the order of plugging: another camera can have it after the next start"
            ),
            remedy,
        ))
    };
    cameras.iter().filter_map(finding).collect()
}

/// A link to this node that stays: by what the camera is, else by where it is.
fn link_to(machine: &Machine, node: &str) -> Option<String> {
    ["/dev/v4l/by-id", "/dev/v4l/by-path"].into_iter().find_map(|folder| {
        let links = machine.names(folder).into_iter().map(|name| format!("{folder}/{name}"));
        links.into_iter().find(|link| machine.behind(link.as_ref()).as_deref() == Some(node))
    })
}
