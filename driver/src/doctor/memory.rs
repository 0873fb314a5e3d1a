//! Shared memory against the slots of all cameras.

use std::fs;
use std::os::unix::fs::MetadataExt;

use rustix::fs::statvfs;

use super::machine::Machine;
use super::{Check, Finding, Severity};
use crate::config::Config;

/// Where frames live.
const SHARED_MEMORY: &str = "/dev/shm";

/// Whether `/dev/shm` holds them. What a running driver has taken already counts as free.
pub(super) fn shared(machine: &Machine, config: &Config) -> Vec<Finding> {
    let folder = machine.path(SHARED_MEMORY);
    let Config { ipc, cameras, .. } = config;
    let frames = cameras.iter().map(|camera| camera.settings.frame_bytes());
    let needed =
        frames.map(|bytes| ipc.settings.shared_memory_needed(bytes, ipc.slots)).fold(0, u64::saturating_add);
    let Ok(system) = statvfs(&folder) else {
        return vec![Finding::new(
            Severity::Fault,
            Check::SharedMemory,
            format!("{SHARED_MEMORY} is absent; frames live there"),
            format!("sudo mount -t tmpfs -o size={} tmpfs {SHARED_MEMORY}", mebibytes(needed)),
        )];
    };
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
    vec![Finding::new(
        Severity::Fault,
        Check::SharedMemory,
        format!(
            "{SHARED_MEMORY} has room for {}, the slots of all cameras need {}",
            mebibytes(free),
            mebibytes(needed)
        ),
        format!(
            "sudo mount -o remount,size={} {SHARED_MEMORY}, or fewer max_subscribers, buffer or borrowed in [ipc]",
            mebibytes(size)
        ),
    )]
}

/// Rounded up, in the notation of mount(8).
fn mebibytes(bytes: u64) -> String {
    format!("{}M", bytes.div_ceil(1 << 20))
}
