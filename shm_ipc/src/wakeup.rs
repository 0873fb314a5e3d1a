//! How a consumer waits: the choice, and when the next frame is due.

use std::time::Duration;

use crate::header::FrameHeader;

/// How [`Subscriber::wait`](crate::Subscriber::wait) waits for a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Wakeup {
    /// Sleeps on the camera's wake word. Costs nothing while it sleeps.
    #[default]
    Futex,
    /// Sleeps until shortly before the next frame is due, then watches for it, for less than 1 % of the frame period on average; then
    /// sleeps as [`Wakeup::Futex`]. For cameras with a steady rate, the shortest wake-up of a consumer that leaves its core to others.
    Predictive,
    /// Sleeps on the camera's iceoryx2 event, as a `WaitSet` does that the event is attached to. Slower to wake, and slower for the driver.
    Event,
}

/// Part of the frame period that a predictive wait may watch, on average; the wake-ups themselves take the rest of the 1 % promised.
const SHARE: f64 = 0.0075;
/// For how many frames it may save what it did not use.
const SAVED_FRAMES: f64 = 8.0;
/// Most that it watches at a time, ns: bounds what a slow camera or a header that lies can cost.
const MOST_WATCHED_NS: f64 = 1_000_000.0;
/// Weight of the newest frame in the average of wake-up delays.
const WEIGHT: f64 = 0.125;
/// How fast the earliest frame is forgotten: part of its distance to each later frame.
const FORGOTTEN: f64 = 1.0 / 64.0;
/// Frames in a row that may be far off before they are believed: a new rhythm.
const ASTRAY: u32 = 2;

/// Tells when the next frame is due, from the ones that came.
///
/// Frames have a rhythm and come late by varying amounts, hardly ever early. So the watch begins when the earliest of them would come,
/// and what early frames save of its time is there for late ones.
#[derive(Debug, Default)]
pub(crate) struct Prediction {
    period_ns: f64,
    /// CLOCK_MONOTONIC at which the last frame would have been sent, had it been as early as the earliest.
    early_ns: f64,
    /// How long may still be watched.
    saved_ns: f64,
    /// Mean delay from the end of a sleep to the wake-up.
    oversleep_ns: f64,
    /// Frames in a row that were too far from their prediction to be watched for.
    astray: u32,
    /// The frame that is due was watched for already.
    used: bool,
}

/// When to watch for a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Watch {
    /// When to wake up for it, CLOCK_MONOTONIC in ns.
    pub(crate) wake_ns: u64,
    /// How long to watch at most, ns.
    pub(crate) budget_ns: u64,
}

impl Prediction {
    /// Takes a frame into account.
    pub(crate) fn frame(&mut self, header: &FrameHeader) {
        let (period_ns, sent_ns) = (header.frame_period_ns as f64, header.send_monotonic_ns as f64);
        self.used = false;
        let periods = ((sent_ns - self.early_ns) / period_ns).round();
        let due_ns = self.early_ns + periods * period_ns;
        let late_ns = sent_ns - due_ns;
        let share_ns = share_ns(period_ns);
        self.saved_ns = (self.saved_ns + share_ns).min(SAVED_FRAMES * share_ns).min(MOST_WATCHED_NS);
        self.astray = if late_ns.abs() > 2.0 * share_ns { self.astray + 1 } else { 0 };
        if period_ns != self.period_ns || self.astray > ASTRAY {
            (self.period_ns, self.early_ns, self.astray) = (period_ns, sent_ns, 0);
        } else if late_ns < 0.0 {
            self.early_ns = due_ns + late_ns.max(-share_ns);
        } else {
            // A very late frame is worth no more than one at the edge of what can be watched.
            self.early_ns = due_ns + late_ns.min(share_ns) * FORGOTTEN;
        }
    }

    /// When to watch for the next frame; `None` where it cannot be told, or was said already.
    pub(crate) fn next(&mut self, now_ns: u64) -> Option<Watch> {
        if self.period_ns <= 0.0 || std::mem::replace(&mut self.used, true) {
            return None;
        }
        let due_ns = self.early_ns + self.period_ns;
        // Saturates where a header lies.
        let watch = Watch { wake_ns: (due_ns - self.oversleep_ns) as u64, budget_ns: self.saved_ns as u64 };
        ((due_ns + self.saved_ns) as u64 > now_ns).then_some(watch)
    }

    /// Takes into account that a sleep until `asked_ns` ended at `woke_ns`.
    pub(crate) fn overslept(&mut self, asked_ns: u64, woke_ns: u64) {
        let late_ns = woke_ns.saturating_sub(asked_ns) as f64;
        self.oversleep_ns += (late_ns.min(share_ns(self.period_ns)) - self.oversleep_ns) * WEIGHT;
    }

    /// Takes into account how long was watched.
    pub(crate) fn watched(&mut self, watched_ns: u64) {
        self.saved_ns = (self.saved_ns - watched_ns as f64).max(0.0);
    }
}

/// How long a frame may be watched for on average.
fn share_ns(period_ns: f64) -> f64 {
    (period_ns * SHARE).min(MOST_WATCHED_NS)
}

/// What comes `pause` after an instant.
pub(crate) fn after(pause: Duration, instant_ns: u64) -> u64 {
    instant_ns.saturating_add(u64::try_from(pause.as_nanos()).unwrap_or(u64::MAX))
}

/// From now to a later instant.
pub(crate) fn until(instant_ns: u64, now_ns: u64) -> Duration {
    Duration::from_nanos(instant_ns.saturating_sub(now_ns))
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_NS: u64 = 16_666_667;
    const START_NS: u64 = 1_000_000_000_000;

    fn header(frame_period_ns: u64, send_monotonic_ns: u64) -> FrameHeader {
        FrameHeader { frame_period_ns, send_monotonic_ns, ..FrameHeader::default() }
    }

    fn after(frames: u64, sent_ns: impl Fn(u64) -> u64) -> Prediction {
        let mut prediction = Prediction::default();
        (0..frames).for_each(|frame| prediction.frame(&header(PERIOD_NS, START_NS + sent_ns(frame))));
        prediction
    }

    fn contains(watch: Watch, instant_ns: u64) -> bool {
        (watch.wake_ns..watch.wake_ns + watch.budget_ns).contains(&(START_NS + instant_ns))
    }

    #[test]
    fn a_steady_camera_is_watched_when_its_frame_is_due() {
        let mut prediction = after(100, |frame| frame * PERIOD_NS);
        let watch = prediction.next(START_NS).unwrap();
        assert!(contains(watch, 100 * PERIOD_NS));
        assert_eq!(prediction.next(START_NS), None, "once a frame");
    }

    #[test]
    fn frames_that_come_late_now_and_then_are_watched_for_all_the_longer() {
        let late = |frame: u64| frame * PERIOD_NS + if frame.is_multiple_of(8) { 600_000 } else { 0 };
        let watch = after(103, late).next(START_NS).unwrap();
        assert!(contains(watch, late(103)), "{watch:?}");
        let watch = after(104, late).next(START_NS).unwrap();
        assert!(contains(watch, late(104)), "{watch:?}");
    }

    #[test]
    fn on_average_no_more_is_watched_than_its_share() {
        let mut prediction = Prediction::default();
        let mut watched_ns = 0;
        for frame in 0..1000 {
            prediction.frame(&header(PERIOD_NS, START_NS + frame * PERIOD_NS));
            // None of them is found.
            if let Some(watch) = prediction.next(START_NS + frame * PERIOD_NS) {
                prediction.watched(watch.budget_ns);
                watched_ns += watch.budget_ns;
            }
        }
        let share = watched_ns as f64 / (1000 * PERIOD_NS) as f64;
        assert!((0.9 * SHARE..=SHARE).contains(&share), "{share}");
    }

    #[test]
    fn who_oversleeps_is_called_earlier() {
        let mut prediction = after(100, |frame| frame * PERIOD_NS);
        (0..100).for_each(|_| prediction.overslept(START_NS, START_NS + 60_000));
        let mut watch = prediction.next(START_NS).unwrap();
        watch.wake_ns += 60_000;
        assert!(contains(watch, 100 * PERIOD_NS));
    }

    #[test]
    fn jitter_and_lost_frames_do_not_lead_astray() {
        let jittered = |frame: u64| frame * PERIOD_NS + frame * 7919 % 50_000;
        let mut prediction = after(100, |frame| jittered(if frame < 50 { frame } else { frame + 7 }));
        assert!(contains(prediction.next(START_NS).unwrap(), jittered(107)));
    }

    #[test]
    fn another_rate_is_followed_from_its_second_frame_on() {
        let mut prediction = after(100, |frame| frame * PERIOD_NS);
        prediction.frame(&header(50_000_000, START_NS + 3 * PERIOD_NS * 100));
        let due_ns = 3 * PERIOD_NS * 100 + 50_000_000;
        assert!(contains(prediction.next(START_NS).unwrap(), due_ns));
    }

    #[test]
    fn frames_that_stop_are_not_watched_for() {
        let mut prediction = after(100, |frame| frame * PERIOD_NS);
        assert_eq!(prediction.next(START_NS + 102 * PERIOD_NS), None);
    }

    #[test]
    fn headers_that_lie_cost_no_more_than_the_bound() {
        for (period_ns, sent_ns) in [(0, 0), (u64::MAX, u64::MAX), (1, u64::MAX), (u64::MAX, 0)] {
            let mut prediction = after(3, |frame| frame * PERIOD_NS);
            (0..3).for_each(|_| prediction.frame(&header(period_ns, sent_ns)));
            if let Some(watch) = prediction.next(0) {
                assert!(watch.budget_ns <= MOST_WATCHED_NS as u64);
            }
        }
    }
}
