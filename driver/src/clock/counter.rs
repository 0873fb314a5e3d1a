//! Timestamps of devices whose counters wrap around.

/// Lengths of counters that wrap within a flight, in bits; standard ones have 64 (GigE Vision, USB3 Vision).
const SHORT_COUNTERS: [u32; 2] = [16, 32];
/// A turn shorter than this passes too often to tell turns from delays.
const SHORTEST_TURN_NS: f64 = 20e6;
/// How much later than the device says a frame may come while the fall of the counter is still taken for a turn.
const LONGEST_DELAY_NS: f64 = 100e6;

/// Turns a counter that may wrap into time that only grows.
///
/// A device does not say how long its counter is. It shows where the counter first falls: where 16 or 32 bits explain what the host's
/// clock saw pass, it wrapped; otherwise the device was reset.
#[derive(Debug)]
pub(super) struct Counter {
    increment_ns: f64,
    turn_ns: Option<f64>,
    last_ns: u64,
}

impl Counter {
    pub(super) fn new(increment_ns: f64, first_ns: u64) -> Self {
        Counter { increment_ns, turn_ns: None, last_ns: first_ns }
    }

    /// Nanoseconds that the device counted since the timestamp before, when the host counted `host_ns` at most a delay more or
    /// little less; `None` where the device was reset.
    #[inline]
    pub(super) fn step(&mut self, now_ns: u64, host_ns: i64) -> Option<i64> {
        let last_ns = std::mem::replace(&mut self.last_ns, now_ns);
        if self.turn_ns.is_none() && now_ns >= last_ns {
            return i64::try_from(now_ns - last_ns).ok();
        }
        self.step_of_turns(last_ns, now_ns, host_ns)
    }

    /// The step of a counter that has wrapped, or wraps or was reset now.
    #[cold]
    fn step_of_turns(&mut self, last_ns: u64, now_ns: u64, host_ns: i64) -> Option<i64> {
        if let Some(turn_ns) = self.turn_ns {
            return Some(with_turns(last_ns, now_ns, turn_ns, host_ns as f64));
        }
        SHORT_COUNTERS.into_iter().find_map(|bits| {
            let turn_ns = 2f64.powi(bits as i32) * self.increment_ns;
            if turn_ns < SHORTEST_TURN_NS || last_ns as f64 >= turn_ns {
                return None;
            }
            let step_ns = with_turns(last_ns, now_ns, turn_ns, host_ns as f64);
            let delay_ns = host_ns as f64 - step_ns as f64;
            let explains = (-turn_ns / 8.0..LONGEST_DELAY_NS).contains(&delay_ns);
            explains.then(|| {
                self.turn_ns = Some(turn_ns);
                step_ns
            })
        })
    }
}

/// The step that the counter shows, and as many full turns as the host's clock has room for. A frame is often late and never early,
/// so a delay of nearly one turn is still taken for a delay.
fn with_turns(last_ns: u64, now_ns: u64, turn_ns: f64, host_ns: f64) -> i64 {
    let shown_ns = (now_ns as f64 - last_ns as f64).rem_euclid(turn_ns);
    let turns = ((host_ns - shown_ns + turn_ns / 8.0) / turn_ns).floor();
    (shown_ns + turns * turn_ns).round() as i64
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_NS: i64 = 16_666_667;
    const MICROSECOND: f64 = 1000.0;

    /// Timestamps in ns of a counter of `bits` that ticks every microsecond.
    fn shown(true_ns: i64, bits: u32) -> u64 {
        ((true_ns as u64 / 1000) & ((1 << bits) - 1)) * 1000
    }

    fn error_after(frames: i64, bits: u32, period_ns: i64, delay_ns: impl Fn(i64) -> i64) -> i64 {
        let mut counter = Counter::new(MICROSECOND, shown(5_000_000, bits));
        let mut passed_ns = 0;
        for frame in 1..=frames {
            let host_ns = frame * period_ns + delay_ns(frame) - passed_ns;
            let step = counter.step(shown(5_000_000 + frame * period_ns, bits), host_ns);
            passed_ns += step.expect("a turn is no reset");
        }
        (passed_ns - frames * period_ns).abs()
    }

    #[test]
    fn sixteen_bits_of_microseconds_wrap_every_fourth_frame() {
        assert!(error_after(1000, 16, PERIOD_NS, |_| 0) <= 1000);
        assert!(
            error_after(1000, 16, PERIOD_NS, |frame| if frame % 100 == 7 { 20_000_000 } else { 0 }) <= 1000
        );
    }

    #[test]
    fn thirty_two_bits_of_microseconds_wrap_after_71_minutes() {
        assert!(error_after(300_000, 32, PERIOD_NS, |_| 300_000) <= 1000);
    }

    #[test]
    fn several_turns_between_two_frames_are_counted_once_the_length_is_known() {
        let mut counter = Counter::new(MICROSECOND, shown(60_000_000, 16));
        assert_eq!(counter.step(shown(76_000_000, 16), 16_000_000), Some(16_000_000));
        assert_eq!(counter.step(shown(476_000_000, 16), 400_100_000), Some(400_000_000));
    }

    #[test]
    fn a_fall_that_no_turn_explains_is_a_reset() {
        let mut counter = Counter::new(1.0, 3_600_000_000_000);
        assert_eq!(counter.step(3_600_016_666_667, PERIOD_NS), Some(PERIOD_NS));
        assert_eq!(counter.step(1_000_000, PERIOD_NS), None);
        assert_eq!(counter.step(17_666_667, PERIOD_NS), Some(PERIOD_NS));
    }

    #[test]
    fn a_leap_beyond_all_time_is_a_reset() {
        assert_eq!(Counter::new(1.0, 0).step(u64::MAX, PERIOD_NS), None);
    }
}
