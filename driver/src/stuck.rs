//! When a camera's thread is stuck in a call of a library.

use std::time::{Duration, Instant};

use crate::counters::Counters;

/// A camera's thread from which nothing was heard for this long is stuck: the longest calls of a library give up after five seconds.
pub const STUCK: Duration = Duration::from_secs(10);

/// How long a camera's thread has given no sign of life.
#[derive(Debug)]
pub struct StuckDetector {
    signs_of_life: u64,
    since: Instant,
}

impl StuckDetector {
    /// Begins with the thread, at the instant `now`.
    pub fn new(now: Instant) -> Self {
        StuckDetector { signs_of_life: 0, since: now }
    }

    /// For how long nothing was heard of the thread, where that means that it is stuck. To be called a few times a second.
    pub fn look(&mut self, counters: &Counters, now: Instant) -> Option<Duration> {
        let signs_of_life = counters.signs_of_life();
        if signs_of_life != self.signs_of_life {
            *self = StuckDetector { signs_of_life, since: now };
        }
        let silence = now.saturating_duration_since(self.since);
        (silence > STUCK).then_some(silence)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thread_is_stuck_after_ten_seconds_without_a_sign_of_life_until_the_next() {
        let (counters, start) = (Counters::default(), Instant::now());
        let mut detector = StuckDetector::new(start);
        let mut look = |seconds| detector.look(&counters, start + Duration::from_secs(seconds));
        assert_eq!([1, 10].map(&mut look), [None, None]);
        assert_eq!([11, 12].map(&mut look), [11, 12].map(|silent| Some(Duration::from_secs(silent))));
        counters.live();
        assert_eq!([13, 23].map(&mut look), [None, None]);
        assert_eq!(look(24), Some(Duration::from_secs(11)));
    }
}
