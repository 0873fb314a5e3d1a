//! What the protocol of the page stands on: atomics that processes share, and the futex (futex(2)).

use std::ops::Deref;
use std::time::Duration;

pub(super) use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

use rustix::thread::{futex, sched_getcpu};

/// A number that threads of any process can sleep on.
#[derive(Debug, Default)]
#[repr(transparent)]
pub(super) struct Futex(AtomicU32);

impl Futex {
    /// Sleeps where the number is `expected`, at most `timeout`. May return early. Returns whether all of the time passed.
    pub(super) fn wait(&self, expected: u32, timeout: Duration) -> bool {
        let Ok(timeout) = timeout.try_into() else { return false };
        let outcome = futex::wait(&self.0, futex::Flags::empty(), expected, Some(&timeout));
        outcome == Err(rustix::io::Errno::TIMEDOUT)
    }

    /// Wakes all who sleep.
    pub(super) fn wake_all(&self) {
        // The frame is out. A consumer that cannot be woken finds it when its own sleep ends.
        let _ = futex::wake(&self.0, futex::Flags::empty(), i32::MAX as u32);
    }
}

impl Deref for Futex {
    type Target = AtomicU32;

    fn deref(&self) -> &AtomicU32 {
        &self.0
    }
}

/// The core that this thread runs on.
pub(super) fn current_core() -> Option<u32> {
    u32::try_from(sched_getcpu()).ok()
}
