//! What is wrong on this machine, and the command that mends it.
//!
//! Each check reads files below one root (`/proc`, `/sys`, `/dev`, `/etc`) and the configuration, and changes nothing. What it
//! cannot read it leaves out, or says that it could not know: a finding is a fact, not a guess. A folder that holds such files
//! stands for a machine in tests.

use std::fmt;
use std::path::Path;

use serde::Serialize;

use crate::camera::source::is_built_in;
use crate::config::Config;

mod access;
mod camera;
mod machine;
mod memory;
mod network;
mod process;
mod processor;
mod usb;
mod video;

use machine::Machine;
use process::Process;

/// One thing that is wrong, and what mends it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// How much it matters.
    pub severity: Severity,
    /// Which check found it.
    pub check: Check,
    /// What is wrong, with the values found and needed.
    pub finding: String,
    /// The command that mends it; else what to do by hand.
    pub remedy: String,
}

/// How much a [`Finding`] matters, the least first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// Something could not be examined.
    Unknown,
    /// Frames can be late, or lost under load; or something will break later.
    Warning,
    /// A camera cannot fly as configured.
    Fault,
}

/// What is examined.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Check {
    /// Each configured camera is connected.
    Connected,
    /// USB3 Vision cameras have a SuperSpeed link.
    UsbLink,
    /// The cameras of one USB controller fit its bandwidth.
    UsbBandwidth,
    /// The kernel's memory for USB transfers holds the configured slots.
    UsbfsMemory,
    /// The driver may open the cameras' device nodes, and not everyone may.
    DeviceAccess,
    /// A udev rule gives the cameras' device nodes to a group.
    UdevRule,
    /// No other program holds a camera.
    DeviceHolder,
    /// Cameras of the kernel are named by what stays theirs.
    DeviceName,
    /// Sockets hold the packets of GigE Vision cameras.
    SocketBuffer,
    /// A firewall lets nobody but the cameras send to them.
    Firewall,
    /// The driver may lock its memory.
    LockedMemory,
    /// The driver may use the real-time priorities that the configuration names.
    RealTimePriority,
    /// `/dev/shm` may be written to and holds the slots of all cameras.
    SharedMemory,
    /// `root_path` belongs to the driver's user.
    RootPath,
    /// Shared memory stays when the driver's user logs out.
    IpcRemoval,
    /// The processors run at full speed.
    CpuGovernor,
    /// The system's clock is cheap to read.
    ClockSource,
    /// The masks can fly.
    Mask,
    /// Exposure and readout fit the frame period.
    Exposure,
}

impl fmt::Display for Severity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Severity::Unknown => "unknown",
            Severity::Warning => "warning",
            Severity::Fault => "fault",
        })
    }
}

/// Examines the machine whose files lie below `root` (`/` for the one that runs this) for the cameras of `config`, and returns
/// what is wrong, the worst first.
pub fn examine(root: &Path, config: &Config) -> Vec<Finding> {
    let machine = Machine::new(root);
    // Devices that this program could not open are no business of it.
    let cameras = if is_built_in("aravis") { usb::cameras(&machine) } else { Vec::new() };
    let video_cameras = video::cameras(&machine, config);
    let nodes = [access::usb_nodes(&machine, &cameras), video::nodes(&video_cameras)].concat();
    let process = Process::of_the_driver(&machine, config);
    let mut findings = [
        usb::connected(config, &cameras),
        video::connected(&video_cameras),
        usb::link(&cameras),
        usb::bandwidth(&machine, config, &cameras),
        usb::memory(&machine, config, &cameras),
        access::nodes(&machine, &process, &nodes),
        access::rule(&machine, &cameras),
        access::holders(&machine, &process, &nodes),
        video::names(&machine, &video_cameras),
        network::socket_buffer(&machine, config),
        network::firewall(&machine, config),
        process.limits(&machine, config),
        memory::shared(&machine, &process, config),
        memory::root_path(&machine, &process, config),
        memory::removal(&machine, &process),
        processor::governor(&machine),
        processor::clock_source(&machine),
        camera::masks(config),
        camera::exposures(config, &cameras),
    ]
    .concat();
    findings.sort_by_key(|finding| std::cmp::Reverse(finding.severity));
    findings
}

impl Finding {
    fn new(severity: Severity, check: Check, finding: String, remedy: impl Into<String>) -> Self {
        Finding { severity, check, finding, remedy: remedy.into() }
    }
}
