//! When the next frame is due.

use std::collections::VecDeque;

use crate::header::FrameHeader;

/// Part of the frame period that a predictive wait may watch, on average; the wake-ups themselves take the rest of the 1 % promised.
const SHARE: f64 = 0.006;
/// Part of that share which is planned to be used: the rest is for frames that come later than any before.
const PLANNED: f64 = 0.8;
/// For how many frames it may save what it did not use.
const SAVED_FRAMES: f64 = 8.0;
/// Most that it watches at a time, ns: bounds what a slow camera or a header that lies can cost.
const MOST_WATCHED_NS: f64 = 1_000_000.0;
/// Part of the window's length that is added to both of its ends, where the plan allows it.
const MARGIN: f64 = 0.5;
/// Least of that margin, ns.
const LEAST_MARGIN_NS: f64 = 5_000.0;
/// Frames that it learns from.
const REMEMBERED: usize = 32;
/// Fewest of them that tell the period better than the camera does.
const ENOUGH: usize = 8;

/// Tells when to wake up for the next frame, from the ones that came.
///
/// Frames have a rhythm, which is not quite what the camera says, and are late by varying amounts; so are wake-ups. Each of the last frames
/// tells when a sleep would have had to end for its wake-up to come just before the frame. What is watched next is the window in which most
/// of them came: as much of it as the share allows.
#[derive(Debug, Default)]
pub(crate) struct Prediction {
    seen: VecDeque<Seen>,
    /// What the camera says.
    frame_period_ns: f64,
    epoch: u64,
    /// How long may still be watched.
    saved_ns: f64,
    /// How late the last wake-up was.
    oversleep_ns: f64,
    /// The frame that is due was watched for already.
    used: bool,
}

#[derive(Debug, Clone, Copy)]
struct Seen {
    /// Frames that the device produced in this epoch before this one.
    index: u64,
    /// CLOCK_MONOTONIC.
    sent_ns: u64,
    /// How late a wake-up is that is meant for this time.
    oversleep_ns: f64,
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
        self.used = false;
        let frame_period_ns = header.frame_period_ns as f64;
        let index = header.produced;
        let goes_on = self.seen.back().is_none_or(|last| last.index < index);
        if !goes_on || (header.epoch, frame_period_ns) != (self.epoch, self.frame_period_ns) {
            self.seen.clear();
            (self.epoch, self.frame_period_ns) = (header.epoch, frame_period_ns);
        }
        if self.seen.len() == REMEMBERED {
            self.seen.pop_front();
        }
        self.seen.push_back(Seen {
            index,
            sent_ns: header.send_monotonic_ns,
            oversleep_ns: self.oversleep_ns,
        });
        self.saved_ns = (self.saved_ns + self.share_ns()).min(self.most_ns());
    }

    /// When to watch for the next frame; `None` where it cannot be told, or was watched for already.
    pub(crate) fn next(&self, now_ns: u64) -> Option<Watch> {
        let last = self.seen.back()?;
        let period_ns = self.period_ns();
        if self.used || period_ns <= 0.0 {
            return None;
        }
        let window = self.window(last, period_ns);
        // Saturates where a header lies.
        let watch = Watch {
            wake_ns: (last.sent_ns as f64 + period_ns + window.begin_ns) as u64,
            budget_ns: window.length_ns.min(self.saved_ns) as u64,
        };
        (watch.wake_ns.saturating_add(watch.budget_ns) > now_ns).then_some(watch)
    }

    /// Takes into account that a sleep until `asked_ns` ended at `woke_ns`.
    pub(crate) fn overslept(&mut self, asked_ns: u64, woke_ns: u64) {
        self.oversleep_ns = woke_ns.saturating_sub(asked_ns) as f64;
    }

    /// Takes into account how long was watched.
    pub(crate) fn watched(&mut self, watched_ns: u64) {
        self.used = true;
        self.saved_ns = (self.saved_ns - watched_ns as f64).max(0.0);
    }

    /// The median of what pairs of frames say that lie half of the memory apart: no late frame bends it.
    fn period_ns(&self) -> f64 {
        if self.seen.len() < ENOUGH {
            return self.frame_period_ns;
        }
        let half = self.seen.len() / 2;
        let pairs = self.seen.iter().zip(self.seen.iter().skip(half));
        let mut periods = [0.0; REMEMBERED];
        let periods = fill(
            &mut periods,
            pairs.map(|(first, second)| {
                second.since_ns(first) / second.index.saturating_sub(first.index) as f64
            }),
        );
        periods.get(periods.len() / 2).copied().unwrap_or_default()
    }

    /// The window in which most of the remembered frames came, of those that would not have taken more than is planned to watch on
    /// average: the whole of it for each frame that came after it.
    fn window(&self, last: &Seen, period_ns: f64) -> Window {
        let mut memory = [0.0; REMEMBERED];
        let due_ns = fill(
            &mut memory,
            self.seen.iter().map(|seen| {
                let periods = last.index.saturating_sub(seen.index) as f64;
                seen.since_ns(last) + periods * period_ns - seen.oversleep_ns
            }),
        );
        let planned_ns = PLANNED * self.share_ns();
        let mut best = Window::default();
        for (first, begin_ns) in due_ns.iter().enumerate() {
            let mut watched_ns = 0.0;
            for (last, end_ns) in due_ns.iter().enumerate().skip(first) {
                let length_ns = end_ns - begin_ns;
                watched_ns += length_ns;
                let after = (due_ns.len() - 1 - last) as f64 * length_ns;
                let window = Window {
                    begin_ns: *begin_ns,
                    length_ns,
                    found: last - first + 1,
                    cost_ns: (watched_ns + after) / due_ns.len() as f64,
                };
                if window.cost_ns <= planned_ns && window.is_better_than(&best) {
                    best = window;
                }
            }
        }
        // The next frame may come somewhat before or after all of these.
        let margin_ns = LEAST_MARGIN_NS.max(best.length_ns * MARGIN).min(planned_ns - best.cost_ns);
        Window { begin_ns: best.begin_ns - margin_ns, length_ns: best.length_ns + 2.0 * margin_ns, ..best }
    }

    /// How long a frame may be watched for on average.
    fn share_ns(&self) -> f64 {
        (self.frame_period_ns * SHARE).min(MOST_WATCHED_NS)
    }

    /// How long a frame may be watched for at most.
    fn most_ns(&self) -> f64 {
        (self.share_ns() * SAVED_FRAMES).min(MOST_WATCHED_NS)
    }
}

/// A time to watch, relative to one period after the last frame, ns.
#[derive(Debug, Clone, Copy, Default)]
struct Window {
    /// When a sleep should end for it.
    begin_ns: f64,
    length_ns: f64,
    /// Remembered frames that came in it.
    found: usize,
    /// How long it would have been watched on average.
    cost_ns: f64,
}

impl Window {
    fn is_better_than(&self, other: &Window) -> bool {
        self.found > other.found || (self.found == other.found && self.cost_ns < other.cost_ns)
    }
}

impl Seen {
    fn since_ns(&self, earlier: &Seen) -> f64 {
        self.sent_ns as f64 - earlier.sent_ns as f64
    }
}

/// The values, in order, in memory that lasts for them.
fn fill(memory: &mut [f64; REMEMBERED], values: impl Iterator<Item = f64>) -> &[f64] {
    let mut count = 0;
    for (place, value) in memory.iter_mut().zip(values) {
        *place = value;
        count += 1;
    }
    let (filled, _) = memory.split_at_mut(count);
    filled.sort_unstable_by(f64::total_cmp);
    filled
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_NS: u64 = 16_666_667;
    const START_NS: u64 = 1_000_000_000_000;

    fn header(frame_period_ns: u64, send_monotonic_ns: u64) -> FrameHeader {
        FrameHeader { frame_period_ns, send_monotonic_ns, ..FrameHeader::default() }
    }

    /// After `frames` that were sent at these times.
    fn after(frames: u64, sent_ns: impl Fn(u64) -> u64) -> Prediction {
        let mut prediction = Prediction::default();
        for produced in 0..frames {
            let header = header(PERIOD_NS, START_NS + sent_ns(produced));
            prediction.frame(&FrameHeader { produced, ..header });
        }
        prediction
    }

    /// What a consumer sees that sleeps `oversleep_ns` too long.
    struct Outcome {
        /// Part of the frames that were there while it watched.
        found: f64,
        /// Part of the time that it watched.
        share: f64,
    }

    fn see(frames: u64, sent_ns: impl Fn(u64) -> u64, oversleep_ns: impl Fn(u64) -> u64) -> Outcome {
        let mut prediction = Prediction::default();
        let (mut found, mut watched_ns) = (0, 0);
        for produced in 0..frames {
            let (now_ns, next_ns) = (START_NS + sent_ns(produced), START_NS + sent_ns(produced + 1));
            prediction.frame(&FrameHeader { produced, ..header(PERIOD_NS, now_ns) });
            let Some(watch) = prediction.next(now_ns) else { continue };
            let woke_ns = watch.wake_ns.max(now_ns).min(next_ns) + oversleep_ns(produced);
            if woke_ns >= watch.wake_ns {
                prediction.overslept(watch.wake_ns, woke_ns);
            }
            let watched = next_ns.saturating_sub(woke_ns).min(watch.budget_ns);
            prediction.watched(watched);
            watched_ns += watched;
            found += u64::from((woke_ns..=woke_ns + watch.budget_ns).contains(&next_ns));
        }
        let passed_ns = sent_ns(frames) - sent_ns(0);
        Outcome { found: found as f64 / frames as f64, share: watched_ns as f64 / passed_ns as f64 }
    }

    /// Something between 0 and `most_ns`, another each time.
    fn noise_ns(frame: u64, most_ns: u64) -> u64 {
        (frame.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40) % most_ns
    }

    #[test]
    fn steady_frames_are_found_and_hardly_watched_for() {
        let outcome =
            see(1000, |frame| frame * PERIOD_NS + noise_ns(frame, 20_000), |frame| noise_ns(!frame, 10_000));
        assert!(outcome.found > 0.98, "{}", outcome.found);
        assert!(outcome.share < 0.002, "{}", outcome.share);
    }

    #[test]
    fn a_rate_that_is_not_quite_what_the_camera_says_is_followed() {
        for parts_per_million in [990_000, 999_000, 1_000_100, 1_001_000, 1_010_000] {
            let sent_ns =
                |frame: u64| frame * PERIOD_NS * parts_per_million / 1_000_000 + noise_ns(frame, 50_000);
            let outcome = see(1000, sent_ns, |frame| noise_ns(!frame, 20_000));
            assert!(outcome.found > 0.96, "{parts_per_million} ppm: {}", outcome.found);
        }
    }

    #[test]
    fn who_oversleeps_is_called_earlier() {
        let oversleep_ns = |frame: u64| 300_000 + noise_ns(!frame, 100_000);
        let outcome = see(1000, |frame| frame * PERIOD_NS + noise_ns(frame, 20_000), oversleep_ns);
        assert!(outcome.found > 0.96, "{}", outcome.found);
    }

    #[test]
    fn frames_that_come_late_now_and_then_are_watched_for_all_the_longer() {
        let late_ns = |frame: u64| if frame.is_multiple_of(8) { 600_000 } else { 0 };
        let outcome = see(1000, |frame| frame * PERIOD_NS + late_ns(frame), |frame| noise_ns(!frame, 10_000));
        assert!(outcome.found > 0.96, "{}", outcome.found);
    }

    #[test]
    fn very_late_frames_spoil_no_others() {
        let late_ns =
            |frame: u64| if frame.is_multiple_of(50) { 14_000_000 } else { noise_ns(frame, 20_000) };
        let outcome = see(1000, |frame| frame * PERIOD_NS + late_ns(frame), |frame| noise_ns(!frame, 10_000));
        assert!(outcome.found > 0.94, "{}", outcome.found);
    }

    #[test]
    fn the_share_is_kept_whatever_comes() {
        let rhythms: [&dyn Fn(u64) -> u64; 3] = [
            &|frame| frame * PERIOD_NS + noise_ns(frame, 5_000_000),
            &|frame| frame * PERIOD_NS + noise_ns(frame, 500_000),
            &|frame| frame * PERIOD_NS * 2 + noise_ns(frame, 20_000),
        ];
        for sent_ns in rhythms {
            let outcome = see(1000, sent_ns, |_| 0);
            assert!(outcome.share <= SHARE, "{}", outcome.share);
        }
    }

    #[test]
    fn frames_that_the_device_lost_are_part_of_the_rhythm() {
        let mut prediction = after(100, |frame| frame * PERIOD_NS);
        let last = header(PERIOD_NS, START_NS + 107 * PERIOD_NS);
        prediction.frame(&FrameHeader { produced: 107, ..last });
        let watch = prediction.next(START_NS).unwrap();
        let due_ns = START_NS + 108 * PERIOD_NS;
        assert!((watch.wake_ns..watch.wake_ns + watch.budget_ns).contains(&due_ns), "{watch:?}");
    }

    #[test]
    fn another_rate_is_followed_from_its_first_frame_on() {
        let mut prediction = after(100, |frame| frame * PERIOD_NS);
        let last = header(50_000_000, START_NS + 300 * PERIOD_NS);
        prediction.frame(&FrameHeader { produced: 100, ..last });
        let watch = prediction.next(START_NS).unwrap();
        let due_ns = START_NS + 300 * PERIOD_NS + 50_000_000;
        assert!((watch.wake_ns..watch.wake_ns + watch.budget_ns).contains(&due_ns), "{watch:?}");
    }

    #[test]
    fn a_frame_is_watched_for_once_and_not_when_it_is_overdue() {
        let mut prediction = after(100, |frame| frame * PERIOD_NS);
        assert_eq!(prediction.next(START_NS + 102 * PERIOD_NS), None);
        assert!(prediction.next(START_NS).is_some());
        prediction.watched(1);
        assert_eq!(prediction.next(START_NS), None);
    }

    #[test]
    fn headers_that_lie_cost_no_more_than_the_bound() {
        for (period_ns, sent_ns) in [(0, 0), (u64::MAX, u64::MAX), (1, u64::MAX), (u64::MAX, 0)] {
            for produced in [0, 3, 1000, u64::MAX] {
                let mut prediction = after(3, |frame| frame * PERIOD_NS);
                for more in 0..40 {
                    let header = header(period_ns, sent_ns);
                    prediction.frame(&FrameHeader { produced: produced.saturating_add(more), ..header });
                    if let Some(watch) = prediction.next(0) {
                        assert!(watch.budget_ns <= MOST_WATCHED_NS as u64);
                    }
                }
            }
        }
    }
}
