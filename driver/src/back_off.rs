//! When to try again what has failed.

use std::time::{Duration, Instant};

/// Time between the starts of two attempts: after the first failure, and the longest.
const SHORTEST: Duration = Duration::from_millis(100);
const LONGEST: Duration = Duration::from_secs(5);

/// Attempts that fail follow one another at growing distance, from start to start. What an attempt spends listening to a camera that
/// sends nothing counts: that one is listened to longer and longer, instead of being left alone.
///
/// A camera that is absent is looked for every 0.1 s, for as long as it takes, and starts with a clean record when it comes: the look
/// is cheap, and there is nothing to spare.
#[derive(Debug)]
pub(crate) struct BackOff {
    distance: Duration,
}

impl Default for BackOff {
    fn default() -> Self {
        BackOff { distance: SHORTEST }
    }
}

impl BackOff {
    /// How long an attempt may listen for its first frame.
    pub(crate) fn listening(&self) -> Duration {
        self.distance
    }

    /// The camera has worked: what went wrong before is forgotten.
    pub(crate) fn forget(&mut self) {
        self.distance = SHORTEST;
    }

    /// How long to wait after a look for a camera that is absent. That is no failure of the camera: it comes with a clean record.
    pub(crate) fn after_absence(&mut self) -> Duration {
        self.forget();
        SHORTEST
    }

    /// How long to wait after an attempt that began at `begin` and failed at `end`.
    pub(crate) fn after_failure(&mut self, begin: Instant, end: Instant) -> Duration {
        let wait = (begin + self.distance).saturating_duration_since(end).max(SHORTEST);
        self.distance = (2 * self.distance).min(LONGEST);
        wait
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_distance_doubles_from_a_tenth_of_a_second_to_five() {
        let (mut back_off, now) = (BackOff::default(), Instant::now());
        let waits: Vec<_> = (0..8).map(|_| back_off.after_failure(now, now).as_millis()).collect();
        assert_eq!(waits, [100, 200, 400, 800, 1600, 3200, 5000, 5000]);
        back_off.forget();
        assert_eq!(back_off.after_failure(now, now), SHORTEST);
    }

    #[test]
    fn a_camera_that_has_worked_or_was_absent_begins_anew() {
        let (mut back_off, now) = (BackOff::default(), Instant::now());
        for _ in 0..5 {
            back_off.after_failure(now, now);
        }
        back_off.forget();
        assert_eq!(back_off.listening(), SHORTEST);
        // Its first failure afterwards is one, however long it has worked.
        assert_eq!(back_off.after_failure(now, now + 100 * LONGEST), SHORTEST);
        assert_eq!(back_off.after_failure(now, now), 2 * SHORTEST);
        // Looked for as often as it takes, it is none the worse for it.
        assert_eq!([back_off.after_absence(), back_off.after_absence()], [SHORTEST; 2]);
        assert_eq!(back_off.listening(), SHORTEST);
        assert_eq!(back_off.after_failure(now, now), SHORTEST);
    }

    #[test]
    fn listening_counts_and_grows() {
        let (mut back_off, now) = (BackOff::default(), Instant::now());
        for _ in 0..10 {
            let listened = back_off.listening().max(Duration::from_secs(1));
            assert_eq!(back_off.after_failure(now, now + listened), SHORTEST);
        }
        assert_eq!(back_off.listening(), LONGEST);
    }
}
