//! Who the driver is to the kernel, and what it may do.

use std::path::{Path, PathBuf};

use super::machine::Machine;
use super::{Finding, Severity};
use crate::config::Config;

/// capabilities(7): the numbers of those that matter.
const CAP_DAC_OVERRIDE: u32 = 1;
const CAP_IPC_LOCK: u32 = 14;
const CAP_SYS_NICE: u32 = 23;

/// A process as `/proc` describes it: the running driver of the configuration, else this program, which has the rights that a driver
/// started in its place would have.
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
    /// The driver that runs cameras of this configuration; where none does, this program.
    pub(super) fn of_the_driver(machine: &Machine, config: &Config) -> Self {
        let mut processes = machine.names("/proc").into_iter().filter_map(|name| name.parse().ok());
        let driver =
            processes.find(|id| configuration(machine, *id).is_some_and(|its| is_about(&its, config)));
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

    /// Whether this is the driver, or the process of one of its cameras.
    pub(super) fn is_of_the_driver(&self, machine: &Machine, id: u32) -> bool {
        let status = || machine.text(&format!("/proc/{id}/status")).unwrap_or_default();
        self.id.is_some_and(|driver| {
            driver == id || field(&status(), "PPid:").is_some_and(|parent| parent == driver.to_string())
        })
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

/// The configuration of process `id`, where that is a driver's main process, whose rights those of its cameras have. Nothing where it
/// cannot be read, or not any more: whose driver that is, is not known.
fn configuration(machine: &Machine, id: u32) -> Option<Config> {
    let line = machine.text(&format!("/proc/{id}/cmdline"))?;
    let mut words = line.split('\0');
    if words.next()?.rsplit('/').next() != Some("uvcam") {
        return None;
    }
    let words: Vec<&str> = words.collect();
    if !words.contains(&"run") || words.contains(&"--main-process") {
        return None;
    }
    let following = words.iter().position(|word| *word == "--config").and_then(|at| words.get(at + 1));
    let named = following.copied().or_else(|| words.iter().find_map(|word| word.strip_prefix("--config=")));
    let environment = || machine.text(&format!("/proc/{id}/environ")).unwrap_or_default();
    let variable =
        || environment().split('\0').find_map(|word| word.strip_prefix("UVCAM_CONFIG=")).map(String::from);
    match named.map(String::from).or_else(variable) {
        Some(file) => {
            let folder = PathBuf::from(format!("/proc/{id}/cwd"));
            Config::load(Some(&machine.path(&folder.join(Path::new(&file)).to_string_lossy()))).ok()
        }
        None => Config::load(None).ok(),
    }
}

/// Whether two configurations are about the same: a camera of one name, where the same consumers find it.
fn is_about(one: &Config, other: &Config) -> bool {
    let place = |config: &Config| {
        let settings = &config.ipc.settings;
        (settings.prefix.clone(), settings.root_path.clone())
    };
    let has = |name: &String| other.cameras.iter().any(|camera| camera.name == *name);
    place(one) == place(other) && one.cameras.iter().any(|camera| has(&camera.name))
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
