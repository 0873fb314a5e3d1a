//! Who may open the cameras' device nodes, and who has.

use std::fs;
use std::io::ErrorKind;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use super::machine::Machine;
use super::process::Process;
use super::usb::UsbCamera;
use super::{Finding, Severity};
use crate::camera::told;

/// Where udev looks for rules (udev(7)).
const RULES: [&str; 5] = [
    "/etc/udev/rules.d",
    "/run/udev/rules.d",
    "/usr/local/lib/udev/rules.d",
    "/usr/lib/udev/rules.d",
    "/lib/udev/rules.d",
];
/// What a rule for every USB3 Vision device matches: its interface's class and subclass.
const USB3_VISION_MATCH: &str = "ef05";

/// A device node that the driver opens.
#[derive(Clone)]
pub(super) struct Node {
    /// What messages call its camera.
    pub(super) camera: String,
    /// Its absolute path, without links.
    pub(super) path: String,
    /// The subsystem of the kernel that it belongs to.
    pub(super) subsystem: &'static str,
    /// Whether an installed udev rule gives it to a group.
    pub(super) has_rule: bool,
}

/// The nodes of cameras on USB.
pub(super) fn usb_nodes(machine: &Machine, connected: &[UsbCamera]) -> Vec<Node> {
    let node = |camera: &UsbCamera| Node {
        camera: camera.describe(),
        path: camera.node(),
        subsystem: "usb",
        has_rule: has_rule(machine, camera),
    };
    connected.iter().map(node).collect()
}

/// Who may open the cameras' device nodes, and who holds them.
pub(super) fn examine(
    machine: &Machine,
    process: &Process,
    cameras: &[UsbCamera],
    camera_nodes: &[Node],
) -> Vec<Finding> {
    [nodes(machine, process, camera_nodes), rule(machine, cameras), holders(machine, process, camera_nodes)]
        .concat()
}

/// Whether the driver may open each node, and not everyone may.
fn nodes(machine: &Machine, process: &Process, nodes: &[Node]) -> Vec<Finding> {
    let finding = |Node { camera, path: node, subsystem, has_rule }: &Node| {
        let path = machine.path(node);
        let metadata = match fs::metadata(&path) {
            Ok(metadata) => metadata,
            Err(error) if error.kind() == ErrorKind::NotFound => {
                return Some(Finding::new(
                    Severity::Fault,
                    "device_access",
                    format!("{camera}: the kernel lists it, and its node {node} is not there"),
                    "give the container all nodes: -v /dev/bus/usb:/dev/bus/usb; outside of one, plug the camera in anew",
                ));
            }
            Err(_) => return None,
        };
        let mode = metadata.mode() & 0o777;
        let group = machine.name_of("/etc/group", metadata.gid());
        if mode & 0o002 != 0 {
            return Some(Finding::new(
                Severity::Warning,
                "device_access",
                format!("{camera}: everyone may write to {node} (mode {mode:o})"),
                format!("grep -rn 0666 {}; remove that rule, then {}", RULES.join(" "), reload(subsystem)),
            ));
        }
        if may_use(process, &metadata, &path) {
            return None;
        }
        let user = machine.name_of("/etc/passwd", process.uid);
        let remedy = if !has_rule {
            install_rule()
        } else if metadata.gid() == 0 {
            reload(subsystem)
        } else {
            format!("sudo usermod --append --groups {group} {user}, and log in again or restart the driver")
        };
        Some(Finding::new(
            Severity::Fault,
            "device_access",
            format!(
                "{camera}: {} may not open {node} (mode {mode:o}, group {group})",
                process.describe(machine)
            ),
            remedy,
        ))
    };
    nodes.iter().filter_map(finding).collect()
}

/// Whether modes and access list let the process read and write.
fn may_use(process: &Process, metadata: &fs::Metadata, path: &Path) -> bool {
    let allows = |bits: u32| metadata.mode() >> bits & 0o6 == 0o6;
    if process.ignores_file_modes() {
        return true;
    }
    if process.uid == metadata.uid() {
        return allows(6);
    }
    // The group's bits are also the most that an access list grants.
    allows(3) && (process.groups.contains(&metadata.gid()) || is_listed(process.uid, path))
}

/// Whether the file's access list, by which a seat's user gets devices, names this user (acl(5)).
///
/// The attribute holds a version of 4 bytes, then entries of 8: tag, permissions, user; little-endian.
fn is_listed(uid: u32, path: &Path) -> bool {
    const NAMED_USER: u16 = 2;
    let mut value = [0; 1024];
    let Ok(length) = rustix::fs::getxattr(path, "system.posix_acl_access", &mut value[..]) else {
        return false;
    };
    value[..length].get(4..).unwrap_or_default().chunks_exact(8).any(|entry| {
        let half = |at: usize| u16::from_le_bytes([entry[at], entry[at + 1]]);
        let user = u32::from_le_bytes([entry[4], entry[5], entry[6], entry[7]]);
        half(0) == NAMED_USER && user == uid && half(2) & 0o6 == 0o6
    })
}

/// Whether an installed rule names each camera: by its vendor, or as any USB3 Vision device.
fn rule(machine: &Machine, connected: &[UsbCamera]) -> Vec<Finding> {
    let lacking = connected.iter().filter(|camera| !has_rule(machine, camera));
    let finding = |camera: &UsbCamera| {
        Finding::new(
            Severity::Warning,
            "udev_rule",
            format!(
                "{}: no udev rule names its vendor {}, so only root may open it once it is plugged in again",
                camera.describe(),
                camera.vendor
            ),
            install_rule(),
        )
    };
    lacking.map(finding).collect()
}

fn has_rule(machine: &Machine, camera: &UsbCamera) -> bool {
    RULES.iter().any(|folder| {
        let rules = machine.names(folder).into_iter().filter(|name| name.ends_with(".rules"));
        let mut texts = rules.filter_map(|name| machine.text(&format!("{folder}/{name}")));
        texts.any(|text| {
            let mut lines = text.lines().filter(|line| !line.trim_start().starts_with('#'));
            lines.any(|line| {
                line.contains("idVendor") && line.contains(&format!("\"{}\"", camera.vendor))
                    || camera.is_usb3_vision && line.contains(USB3_VISION_MATCH)
            })
        })
    })
}

fn install_rule() -> String {
    format!("sudo cp udev/70-uvcam.rules /etc/udev/rules.d/ && {}", reload("usb"))
}

/// What makes udev apply new rules.
fn reload(subsystem: &str) -> String {
    format!("sudo udevadm control --reload && sudo udevadm trigger --subsystem-match={subsystem}")
}

/// Whether another program than the driver holds a node open.
fn holders(machine: &Machine, driver: &Process, nodes: &[Node]) -> Vec<Finding> {
    let mut findings = Vec::new();
    let mut hidden = 0;
    let processes = machine.names("/proc").into_iter().filter_map(|name| name.parse::<u32>().ok());
    let others = processes.filter(|process| !driver.is_of_the_driver(machine, *process));
    for process in others.filter(|_| !nodes.is_empty()) {
        let program = told(&machine.text(&format!("/proc/{process}/comm")).unwrap_or_default());
        let folder = machine.path(&format!("/proc/{process}/fd"));
        let files = match fs::read_dir(&folder) {
            Ok(files) => files,
            Err(error) => {
                hidden += usize::from(error.kind() == ErrorKind::PermissionDenied);
                continue;
            }
        };
        let open: Vec<_> = files.flatten().filter_map(|file| fs::read_link(file.path()).ok()).collect();
        let held = nodes.iter().filter(|node| open.iter().any(|file| *file == Path::new(&node.path)));
        findings.extend(held.map(|Node { camera, subsystem, .. }| {
            Finding::new(
                // Several may open a video node, but one alone may take its frames.
                if *subsystem == "usb" { Severity::Fault } else { Severity::Warning },
                "device_holder",
                format!("{camera}: {program} (process {process}) holds it open"),
                format!("sudo kill {process}"),
            )
        }));
    }
    if hidden > 0 {
        findings.push(Finding::new(
            Severity::Unknown,
            "device_holder",
            format!("the open files of {hidden} processes of other users were not examined"),
            "sudo uvcam doctor",
        ));
    }
    findings
}
