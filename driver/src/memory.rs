//! The memory that this process may take for itself.
//!
//! The kernel counts what only this process can use: its heap, and the stacks of its threads (RLIMIT_DATA of setrlimit(2)). Slots, and what
//! else is shared memory, do not count. Where the limit is reached an allocation fails, at which our runtime and most libraries abort.

use std::fs;

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

/// Of what it may take, so many per cent are nearly all.
const NEARLY_ALL: u64 = 80;

/// Lets this process take no more than so much. A limit that is lower already stays.
pub(crate) fn bound(bytes: u64) {
    let lower = |limit: Option<u64>| Some(limit.map_or(bytes, |limit| limit.min(bytes)));
    let Rlimit { current, maximum } = getrlimit(Resource::Data);
    let bounded = Rlimit { current: lower(current), maximum: lower(maximum) };
    // To lower one's own limit needs no right; a sandbox may forbid it nevertheless.
    if let Err(error) = setrlimit(Resource::Data, bounded) {
        tracing::warn!(
            "the memory of this process is not bounded (process_memory_mb): {error}; allow prlimit64(2)"
        );
    }
}

/// What this process has taken and what it may take, in words, where the first is nearly the second.
pub(crate) fn nearly_all_taken() -> Option<String> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    describe(&status, getrlimit(Resource::Data).current?)
}

/// The same of this text of proc_pid_status(5), in which memory is in kB, and this limit.
fn describe(status: &str, limit: u64) -> Option<String> {
    let taken = status.lines().find_map(|line| line.strip_prefix("VmData:")?.strip_suffix("kB"))?;
    let taken = taken.trim().parse::<u64>().ok()?.saturating_mul(1024);
    let is_nearly_all = taken / NEARLY_ALL > limit / 100;
    is_nearly_all.then(|| {
        format!(
            "its process has taken {} of the {} MB that it may, and ends when it wants more: its library leaks, or process_memory_mb \
             is too small",
            taken >> 20,
            limit >> 20
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_that_has_nearly_all_is_told_and_no_other() {
        let status =
            |kilobytes| format!("Name:\tuvcam\nVmRSS:\t 9 kB\nVmData:\t  {kilobytes} kB\nVmStk:\t 132 kB\n");
        assert_eq!(describe(&status(800 << 10), 1024 << 20), None);
        let told = describe(&status(900 << 10), 1024 << 20).unwrap();
        assert!(told.contains("taken 900 of the 1024 MB") && told.contains("process_memory_mb"), "{told}");
        assert_eq!(describe("", 1), None);
        assert_eq!(nearly_all_taken(), None, "of this process, which has no limit");
    }
}
