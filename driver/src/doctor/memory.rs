//! Shared memory: where it is, whose it is, and whether it holds the slots of all cameras.

use std::fs;
use std::os::unix::fs::MetadataExt;

use rustix::fs::{Access, AtFlags, CWD, StatVfsMountFlags, accessat, statvfs};
use rustix::process::geteuid;

use super::machine::Machine;
use super::process::Process;
use super::{Finding, Severity};
use crate::config::Config;

/// Where frames live.
const SHARED_MEMORY: &str = "/dev/shm";

/// What helps in a container, whose `/dev/shm` is its own and has 64 MB where nobody says otherwise.
const CONTAINER: &str = "in a container: --ipc=host, or --shm-size";

/// Shared memory: its room, its owner, and whether it stays.
pub(super) fn examine(machine: &Machine, process: &Process, config: &Config) -> Vec<Finding> {
    [shared(machine, process, config), root_path(machine, process, config), removal(machine, process)]
        .concat()
}

/// Whether `/dev/shm` can be written to and holds them. What a running driver has taken already counts as free.
fn shared(machine: &Machine, process: &Process, config: &Config) -> Vec<Finding> {
    let folder = machine.path(SHARED_MEMORY);
    let fault = |finding, remedy| vec![Finding::new(Severity::Fault, "shared_memory", finding, remedy)];
    let ipc = &config.ipc;
    let needed = config.shared_memory_needed();
    let Ok(system) = statvfs(&folder) else {
        return fault(
            format!("{SHARED_MEMORY} is absent; frames live there"),
            format!(
                "sudo mkdir -p {SHARED_MEMORY} && sudo mount -t tmpfs -o size={} tmpfs {SHARED_MEMORY}; {CONTAINER}={}",
                mebibytes(needed),
                mebibytes(needed)
            ),
        );
    };
    if system.f_flag.contains(StatVfsMountFlags::RDONLY) {
        return fault(
            format!("{SHARED_MEMORY} is read-only; frames live there"),
            format!("sudo mount -o remount,rw {SHARED_MEMORY}; {CONTAINER}={}", mebibytes(needed)),
        );
    }
    // What another user may is not known here.
    if process.uid == geteuid().as_raw()
        && accessat(CWD, &folder, Access::WRITE_OK | Access::EXEC_OK, AtFlags::EACCESS).is_err()
    {
        return fault(
            format!("{} may not write to {SHARED_MEMORY}; frames live there", process.describe(machine)),
            format!("sudo chmod 1777 {SHARED_MEMORY}; {CONTAINER}={}", mebibytes(needed)),
        );
    }
    let ours = fs::read_dir(&folder).into_iter().flatten().flatten();
    let ours =
        ours.filter(|entry| entry.file_name().to_string_lossy().starts_with(ipc.settings.prefix.as_str()));
    // stat(2) counts blocks of 512 bytes.
    let taken: u64 = ours.filter_map(|entry| Some(entry.metadata().ok()?.blocks() * 512)).sum();
    let free = system.f_bavail.saturating_mul(system.f_frsize).saturating_add(taken);
    if needed <= free {
        return Vec::new();
    }
    let total = system.f_blocks.saturating_mul(system.f_frsize);
    let size = total.saturating_add(needed - free);
    fault(
        format!(
            "{SHARED_MEMORY} has room for {}, the slots of all cameras need {}",
            mebibytes(free),
            mebibytes(needed)
        ),
        format!(
            "sudo mount -o remount,size={} {SHARED_MEMORY}, or fewer max_subscribers, buffer or borrowed in [ipc]; {CONTAINER}={}",
            mebibytes(size),
            mebibytes(size)
        ),
    )
}

/// Rounded up, in the notation of mount(8).
fn mebibytes(bytes: u64) -> String {
    format!("{}M", bytes.div_ceil(1 << 20))
}

/// Whether `root_path`, where it exists, belongs to the user of the driver: nobody else finds it, or can run there.
fn root_path(machine: &Machine, process: &Process, config: &Config) -> Vec<Finding> {
    let root_path = config.ipc.settings.root_path.to_string_lossy();
    let Ok(found) = fs::metadata(machine.path(&root_path)) else { return Vec::new() };
    if found.uid() == process.uid {
        return Vec::new();
    }
    let owner = machine.name_of("/etc/passwd", found.uid());
    // Root looks at a machine on which another user will run the driver.
    let severity = if process.uid == 0 { Severity::Warning } else { Severity::Fault };
    vec![Finding::new(
        severity,
        "root_path",
        format!(
            "root_path {root_path} belongs to user {owner}: {} may run neither driver nor consumers there",
            process.describe(machine)
        ),
        format!(
            "run them as that user (sudo -u {owner} ...), or where nobody uses it: sudo rm -r {root_path}"
        ),
    )]
}

/// Whether logind removes shared memory under the driver when its user logs out (`RemoveIPC`, logind.conf(5)): not that of users of the
/// system, whose numbers end with 999.
fn removal(machine: &Machine, process: &Process) -> Vec<Finding> {
    const LARGEST_SYSTEM_USER: u32 = 999;
    const NOBODY: u32 = 65534;
    let runs = machine.path("/run/systemd/users").exists();
    if !runs || process.uid <= LARGEST_SYSTEM_USER || process.uid == NOBODY || !removes_ipc(machine) {
        return Vec::new();
    }
    let user = machine.name_of("/etc/passwd", process.uid);
    vec![Finding::new(
        Severity::Warning,
        "ipc_removal",
        format!(
            "when user {user} logs out, logind removes the shared memory of a running driver; it makes it anew, and frames are lost"
        ),
        "sudo mkdir -p /etc/systemd/logind.conf.d && printf '[Login]\\nRemoveIPC=no\\n' | sudo tee /etc/systemd/logind.conf.d/70-uvcam.conf && \
         sudo systemctl restart systemd-logind, or run the driver as a system user such as uvcam",
    )]
}

/// What the configuration of logind says; where it says nothing, logind removes it. A drop-in counts more than the file itself, a later
/// name more than an earlier one.
fn removes_ipc(machine: &Machine) -> bool {
    let mut files = vec!["/usr/lib/systemd/logind.conf".to_owned(), "/etc/systemd/logind.conf".to_owned()];
    let folders =
        ["/usr/lib/systemd/logind.conf.d", "/run/systemd/logind.conf.d", "/etc/systemd/logind.conf.d"];
    let mut pieces: Vec<(String, String)> = Vec::new();
    for folder in folders {
        // The same name in a later folder takes the place of the earlier one.
        for name in machine.names(folder).into_iter().filter(|name| name.ends_with(".conf")) {
            pieces.retain(|(other, _)| *other != name);
            pieces.push((name.clone(), format!("{folder}/{name}")));
        }
    }
    pieces.sort();
    files.extend(pieces.into_iter().map(|(_, file)| file));
    let texts = files.iter().filter_map(|file| machine.text(file));
    let said = texts.flat_map(|text| {
        let values =
            text.lines().filter_map(|line| line.trim().strip_prefix("RemoveIPC")?.trim().strip_prefix('='));
        values.map(|value| value.trim().to_ascii_lowercase()).collect::<Vec<_>>()
    });
    said.last().is_none_or(|value| !matches!(value.as_str(), "no" | "false" | "off" | "0" | "n" | "f"))
}
