//! The two clocks of the contract.

use std::time::Duration;

use rustix::time::{ClockId, Timespec, clock_gettime};

/// CLOCK_MONOTONIC, in ns: never steps, shared by all processes of one host.
#[inline]
pub fn monotonic_ns() -> u64 {
    nanoseconds(clock_gettime(ClockId::Monotonic))
}

/// CLOCK_REALTIME, in ns since 1970-01-01 UTC: comparable between hosts as far as they are synchronised; may step.
#[inline]
pub fn realtime_ns() -> u64 {
    nanoseconds(clock_gettime(ClockId::Realtime))
}

/// What comes `pause` after an instant.
pub(crate) fn after(pause: Duration, instant_ns: u64) -> u64 {
    instant_ns.saturating_add(u64::try_from(pause.as_nanos()).unwrap_or(u64::MAX))
}

/// From now to a later instant.
pub(crate) fn until(instant_ns: u64, now_ns: u64) -> Duration {
    Duration::from_nanos(instant_ns.saturating_sub(now_ns))
}

fn nanoseconds(time: Timespec) -> u64 {
    let seconds = u64::try_from(time.tv_sec).unwrap_or(0);
    seconds.saturating_mul(1_000_000_000).saturating_add(u64::try_from(time.tv_nsec).unwrap_or(0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clocks_run_forward_in_nanoseconds() {
        let (monotonic, realtime) = (monotonic_ns(), realtime_ns());
        assert!(monotonic_ns() >= monotonic);
        // 2020-01-01 UTC: a clock in other units, or since boot, is far below.
        assert!(realtime > 1_577_836_800_000_000_000);
    }
}
