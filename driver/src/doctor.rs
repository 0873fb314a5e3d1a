//! What is wrong on this machine, and the command that mends it.
//!
//! Each check reads files below one root (`/proc`, `/sys`, `/dev`, `/etc`) and the configuration, and changes nothing. What it
//! cannot read it leaves out, or says that it could not know: a finding is a fact, not a guess. A folder that holds such files
//! stands for a machine in tests.

use std::fmt;
use std::path::Path;

use serde::Serialize;

use crate::camera::kinds::is_built_in;
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
    /// What was examined, one word for a script, such as `usb_link`.
    pub check: &'static str,
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
        usb::examine(&machine, config, &cameras),
        video::examine(&machine, &video_cameras),
        access::examine(&machine, &process, &cameras, &nodes),
        network::examine(&machine, config),
        process.examine(&machine, config),
        memory::examine(&machine, &process, config),
        processor::examine(&machine),
        camera::examine(config, &cameras),
    ]
    .concat();
    findings.sort_by_key(|finding| std::cmp::Reverse(finding.severity));
    findings
}

impl Finding {
    fn new(severity: Severity, check: &'static str, finding: String, remedy: impl Into<String>) -> Self {
        Finding { severity, check, finding, remedy: remedy.into() }
    }
}
