//! Who the driver is to the kernel, and what it may do.

use super::machine::Machine;
use super::{Finding, Severity};
use crate::config::Config;

/// capabilities(7): the numbers of those that matter.
const CAP_DAC_OVERRIDE: u32 = 1;
const CAP_IPC_LOCK: u32 = 14;
const CAP_SYS_NICE: u32 = 23;

/// A process as `/proc` describes it: the running driver, else this program, which has the rights that a driver started in its
/// place would have.
pub(super) struct Process {
    /// Its id; nothing for this program.
    id: Option<u32>,
    /// Effective user.
    pub(super) uid: u32,
    /// Effective group and supplementary groups.
    pub(super) groups: Vec<u32>,
    capabilities: u64,
    locked_memory_bytes: Option<Limit>,
    real_time_priority: Option<Limit>,
}

/// A soft limit (getrlimit(2)).
#[derive(Clone, Copy, PartialEq, Eq)]
enum Limit {
    Unlimited,
    At(u64),
}

impl Process {
    /// The running driver; where none runs, this program.
    pub(super) fn of_the_driver(machine: &Machine) -> Self {
        let drivers = machine.names("/proc").into_iter().filter_map(|name| name.parse().ok());
        let driver = drivers.into_iter().find(|id| is_driver(machine, *id));
        let folder = driver.map_or_else(|| "/proc/self".to_owned(), |id: u32| format!("/proc/{id}"));
        let status = machine.text(&format!("{folder}/status")).unwrap_or_default();
        let limits = machine.text(&format!("{folder}/limits")).unwrap_or_default();
        let numbers = |key: &str| -> Vec<u32> {
            let words = field(&status, key).unwrap_or_default().split_whitespace();
            words.filter_map(|word| word.parse().ok()).collect()
        };
        // proc_pid_status(5): real, effective, saved and file system id. Whoever has none is nobody.
        let effective = |key: &str| numbers(key).get(1).copied();
        let mut groups = numbers("Groups:");
        groups.extend(effective("Gid:"));
        Process {
            id: driver,
            uid: effective("Uid:").unwrap_or(u32::MAX),
            groups,
            capabilities: field(&status, "CapEff:")
                .and_then(|mask| u64::from_str_radix(mask, 16).ok())
                .unwrap_or(0),
            locked_memory_bytes: limit(&limits, "Max locked memory"),
            real_time_priority: limit(&limits, "Max realtime priority"),
        }
    }

    /// What messages call it.
    pub(super) fn describe(&self, machine: &Machine) -> String {
        let user = machine.name_of("/etc/passwd", self.uid);
        match self.id {
            Some(id) => format!("the running driver (process {id}, user {user})"),
            None => format!("user {user}"),
        }
    }

    pub(super) fn ignores_file_modes(&self) -> bool {
        self.has(CAP_DAC_OVERRIDE)
    }

    fn has(&self, capability: u32) -> bool {
        self.capabilities >> capability & 1 == 1
    }

    /// Whether it may lock its memory, which it does only without a limit, and use the real-time priorities
    /// that the configuration names.
    pub(super) fn examine(&self, machine: &Machine, config: &Config) -> Vec<Finding> {
        let user = machine.name_of("/etc/passwd", self.uid);
        let mut findings = Vec::new();
        if let Some(Limit::At(bytes)) = self.locked_memory_bytes
            && !self.has(CAP_IPC_LOCK)
        {
            findings.push(Finding::new(
                Severity::Warning,
                "locked_memory",
                format!(
                    "at most {} KiB may be locked in memory, so nothing is: a system short of memory can hold frames up",
                    bytes >> 10
                ),
                limits_remedy(&user, "memlock", "unlimited"),
            ));
        }
        let asked = config.cameras.iter().map(|camera| camera.realtime.priority).max().unwrap_or(0);
        if let Some(Limit::At(allowed)) = self.real_time_priority
            && allowed < u64::from(asked)
            && !self.has(CAP_SYS_NICE)
        {
            findings.push(Finding::new(
                Severity::Warning,
                "real_time_priority",
                format!(
                    "the configuration asks for real-time priority {asked}, the most that is allowed is {allowed}: \
                     frames wait for other programs"
                ),
                limits_remedy(&user, "rtprio", "99"),
            ));
        }
        findings
    }
}

/// Whether process `id` is `uvcam run`: the main process, whose rights those of its cameras have.
fn is_driver(machine: &Machine, id: u32) -> bool {
    let line = machine.text(&format!("/proc/{id}/cmdline")).unwrap_or_default();
    let mut words = line.split('\0');
    let program = words.next().unwrap_or_default().rsplit('/').next();
    let mut is_run = false;
    program == Some("uvcam")
        && words.all(|word| {
            is_run |= word == "run";
            word != "--main-process"
        })
        && is_run
}

/// The rest of the line that begins with `key`.
fn field<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    text.lines().find_map(|line| line.strip_prefix(key)).map(str::trim)
}

/// A soft limit of `/proc/PID/limits` (proc_pid_limits(5)).
fn limit(limits: &str, name: &str) -> Option<Limit> {
    match field(limits, name)?.split_whitespace().next()? {
        "unlimited" => Some(Limit::Unlimited),
        number => number.parse().ok().map(Limit::At),
    }
}

fn limits_remedy(user: &str, item: &str, value: &str) -> String {
    format!(
        "run the driver as the service uvcam.service, which has it; else: \
         echo '{user} - {item} {value}' | sudo tee /etc/security/limits.d/70-uvcam-{item}.conf, and log in again"
    )
}
