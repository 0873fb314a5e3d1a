//! Keeping a frame from waiting: memory that is never paged out, and the scheduling of camera threads.
//!
//! Everything here is asked of the system once, before the first frame. Where the rights are missing, a warning says which
//! and how to give them, and the driver goes on without.

use std::io;

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, getrlimit};
use rustix::thread::{CapabilitySet, CpuSet, capabilities, sched_setaffinity};
use tracing::warn;

/// Largest core number that the system's calls can name.
pub const LARGEST_CPU: usize = CpuSet::MAX_CPU - 1;

/// How a camera's threads are scheduled: `[camera.realtime]`.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Realtime {
    /// Priority of SCHED_FIFO (sched(7)), 1 to 99; 0 leaves the threads to the ordinary scheduler.
    pub priority: u8,
    /// Cores that the threads may run on; empty for all.
    pub cpus: Vec<usize>,
}

impl Realtime {
    /// Schedules the calling thread, and with it the threads that it will start.
    ///
    /// To be called on a camera's thread before its camera is opened: frames are completed by threads that the camera's library starts from
    /// there, and these inherit priority and cores (pthread_attr_setinheritsched(3), sched_setaffinity(2)).
    pub fn apply(&self, camera: &str) {
        if self.priority > 0
            && let Err(error) = set_scheduler(libc::SCHED_FIFO, self.priority)
        {
            warn!(
                "{camera}: not at real-time priority {}: {error}; give the program CAP_SYS_NICE, or raise its limit \
                 (LimitRTPRIO, ulimit -r)",
                self.priority
            );
        }
        if self.cpus.is_empty() {
            return;
        }
        let mut cores = CpuSet::new();
        self.cpus.iter().filter(|cpu| **cpu <= LARGEST_CPU).for_each(|cpu| cores.set(*cpu));
        if let Err(error) = sched_setaffinity(None, &cores) {
            warn!("{camera}: not pinned to cpus {:?}: {error}; name cores that this system has", self.cpus);
        }
    }
}

/// Gives the calling thread back to the ordinary scheduler, on the cores that it has: the priority that it inherited is not meant for its work.
pub fn leave() {
    // To give a priority up needs no right (sched(7)).
    if let Err(error) = set_scheduler(libc::SCHED_OTHER, 0) {
        warn!("a thread keeps its real-time priority: {error}");
    }
}

fn set_scheduler(policy: i32, priority: u8) -> io::Result<()> {
    let parameters = libc::sched_param { sched_priority: priority.into() };
    // SAFETY: the call reads the parameters, which live until it returns, and touches no other memory.
    match unsafe { libc::sched_setscheduler(0, policy, &raw const parameters) } {
        0 => Ok(()),
        _ => Err(io::Error::last_os_error()),
    }
}

/// Keeps every page of this process in memory from the moment that it is there, those of slots included, which are all taken before the
/// first frame.
///
/// Under a limit on locked memory, later mappings would fail if everything were locked, so nothing is.
pub fn lock_memory() {
    let limit = getrlimit(Resource::Memlock).current;
    let outcome = match limit {
        Some(bytes) if !has(CapabilitySet::IPC_LOCK) => Err(format!("the limit is {} MB", bytes >> 20)),
        _ => mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE | MlockAllFlags::ONFAULT)
            .map_err(|error| error.to_string()),
    };
    if let Err(cause) = outcome {
        warn!(
            "memory is not locked, so a system that runs out of it can hold frames up: {cause}; give the program CAP_IPC_LOCK, or \
             raise its limit (LimitMEMLOCK=infinity, ulimit -l unlimited)"
        );
    }
}

/// Whether this thread may use a right of capabilities(7).
pub fn has(capability: CapabilitySet) -> bool {
    capabilities(None).is_ok_and(|sets| sets.effective.contains(capability))
}
