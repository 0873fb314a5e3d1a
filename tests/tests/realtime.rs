//! What the driver asks of the system to be on time, and what it does without.
#![allow(clippy::unwrap_used)]

use std::fs;
use std::process::Command;

use rustix::process::{Pid, Resource, getrlimit};
use rustix::thread::{CapabilitySet, capabilities};
use uvcam_tests::{Process, Stage, next_frame, simulated, stderr};

/// sched(7).
const SCHED_OTHER: u64 = 0;
const SCHED_FIFO: u64 = 1;

fn stage() -> Stage {
    let camera = simulated("left", "none", "");
    Stage::new(&format!("{camera}[camera.realtime]\npriority = 7\ncpus = [0]\n"))
}

/// The fields of a thread's `stat` (proc_pid_stat(5)) from the 3rd on, and its `status`.
fn thread(pid: Pid, name: &str) -> (Vec<String>, String) {
    for task in fs::read_dir(format!("/proc/{}/task", pid.as_raw_nonzero())).unwrap().flatten() {
        let stat = fs::read_to_string(task.path().join("stat")).unwrap();
        if let Some((_, fields)) = stat.split_once(&format!("({name}) ")) {
            let status = fs::read_to_string(task.path().join("status")).unwrap();
            return (fields.split_whitespace().map(str::to_owned).collect(), status);
        }
    }
    panic!("no thread \"{name}\"");
}

fn field(status: &str, key: &str) -> String {
    let line = status.lines().find_map(|line| line.strip_prefix(key)).unwrap();
    line.trim_start_matches(':').trim().to_owned()
}

/// This program, and so the driver, must have the right, or a limit that stands for it.
fn assert_may(capability: CapabilitySet, limit: Resource, needed: u64, remedy: &str) {
    let capable = capabilities(None).unwrap().effective.contains(capability);
    let allowed = getrlimit(limit).current.is_none_or(|limit| limit >= needed);
    assert!(capable || allowed, "this test needs {capability:?}: run it as root, or after `{remedy}`");
}

#[test]
fn with_the_right_a_camera_thread_is_scheduled_as_configured() {
    assert_may(CapabilitySet::SYS_NICE, Resource::Rtprio, 7, "ulimit -r 7");
    let stage = stage();
    let driver = stage.driver();
    next_frame(&mut stage.subscriber("left"));
    let (fields, status) = thread(stage.process_of("left"), "left");
    // Fields 40 and 41: rt_priority and policy.
    let scheduled: [u64; 2] = [37, 38].map(|at| fields[at].parse().unwrap());
    assert_eq!(field(&status, "Cpus_allowed_list"), "0");
    let said = stderr(&driver.stop());
    assert_eq!(scheduled, [7, SCHED_FIFO], "{said}");
}

#[test]
fn what_reads_pictures_ahead_has_no_priority() {
    let stage = Stage::new(
        "[[camera]]\nname = \"left\"\nsource = { kind = \"replay\", path = \"frames\" }\nwidth = 8\nheight = 4\nfps = 60\n\
         exposure_us = 1000\nmask = \"none\"\n[camera.realtime]\npriority = 7\ncpus = [0]\n",
    );
    fs::create_dir(stage.file("frames")).unwrap();
    image::GrayImage::new(8, 4).save(stage.file("frames/1.png")).unwrap();
    let driver = stage.driver();
    next_frame(&mut stage.subscriber("left"));
    let (fields, status) = thread(stage.process_of("left"), "left-read");
    assert_eq!([37, 38].map(|at| fields[at].parse::<u64>().unwrap()), [0, SCHED_OTHER]);
    assert_eq!(field(&status, "Cpus_allowed_list"), "0");
    let said = stderr(&driver.stop());
    assert!(!said.contains("a thread keeps its real-time priority"), "{said}");
}

#[test]
fn with_the_right_memory_is_locked() {
    assert_may(CapabilitySet::IPC_LOCK, Resource::Memlock, u64::MAX, "ulimit -l unlimited");
    let stage = stage();
    let driver = stage.driver();
    next_frame(&mut stage.subscriber("left"));
    let camera = stage.process_of("left").as_raw_nonzero();
    let status = fs::read_to_string(format!("/proc/{camera}/status")).unwrap();
    let locked_kb: u64 = field(&status, "VmLck").trim_end_matches(" kB").parse().unwrap();
    let said = stderr(&driver.stop());
    // All slots of 752x480, at least.
    assert!(locked_kb > 40_000, "{locked_kb} kB: {said}");
}

#[test]
fn without_the_rights_it_warns_and_works() {
    let stage = stage();
    let run = stage.uvcam(&["run"]);
    let mut command = Command::new("prlimit");
    command.args(["--rtprio=0:0", "--memlock=8388608:8388608", "setpriv"]);
    // A program of root has no rights left where they may not be inherited; others have none from the start.
    if rustix::process::geteuid().is_root() {
        command.args(["--bounding-set=-sys_nice,-ipc_lock", "--inh-caps=-sys_nice,-ipc_lock"]);
    }
    let driver = Process::start(command.arg(run.get_program()).args(run.get_args()));
    next_frame(&mut stage.subscriber("left"));
    let (fields, status) = thread(stage.process_of("left"), "left");
    assert_eq!([37, 38].map(|at| fields[at].parse::<u64>().unwrap()), [0, SCHED_OTHER]);
    // Cores need no right.
    assert_eq!(field(&status, "Cpus_allowed_list"), "0");
    let said = stderr(&driver.stop());
    assert!(said.contains("left: not at real-time priority 7") && said.contains("CAP_SYS_NICE"), "{said}");
    assert!(said.contains("memory is not locked") && said.contains("the limit is 8 MB"), "{said}");
}
