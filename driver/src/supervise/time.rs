//! Time as a camera's thread sees it. Hours of it pass in a test at once.

use std::time::{Duration, Instant};

/// What tells the time, and lets it pass.
pub(super) trait Time: Send {
    /// The present.
    fn now(&self) -> Instant;

    /// Waits.
    fn sleep(&self, duration: Duration);
}

/// The time of the system.
pub(super) struct SystemClock;

impl Time for SystemClock {
    fn now(&self) -> Instant {
        Instant::now()
    }

    fn sleep(&self, duration: Duration) {
        std::thread::sleep(duration);
    }
}
