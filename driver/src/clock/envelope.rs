//! The line under all delays.
//!
//! Frames arrive late by varying amounts and never early. Over the device's time, the differences of arrival and device time
//! lie on and above a straight line: its slope is the drift of the two clocks, its height their offset plus the delay that is always
//! there. The line under all points that is nearest to them is an edge of their convex hull, the one below their mean (Moon, Skelly,
//! Towsley: Estimation and removal of clock skew from network delay measurements, INFOCOM 1999). Late frames lie above it and do
//! not move it.

/// Length of a bucket. Of each, only the frame that was least late is kept.
const BUCKET_NS: i64 = 500_000_000;
/// Buckets kept: 16 s, in which the drift of a quartz is constant to a hundredth of a ppm.
const BUCKETS: usize = 32;
/// Time that the buckets must span before a drift is computed from them.
const SHORTEST_SPAN_NS: i64 = 2_000_000_000;
/// Largest drift that is believed: NTP may slew CLOCK_MONOTONIC by as much (adjtime(3)), a quartz drifts by 100 ppm at most.
const MOST_DRIFT: f64 = 500e-6;
/// Buckets whose least late frames tell how well the line fits at present: the last 2 s.
const RECENT: usize = 4;

/// The nearest whole number, halves away from zero.
///
/// `f64::round` is a call into the mathematics library, whose code is in no cache when a frame comes.
pub(super) fn nearest(value: f64) -> i64 {
    (value + 0.5_f64.copysign(value)) as i64
}

/// A frame: device time since the first one, and by how much its arrival is later than that; nanoseconds.
#[derive(Debug, Clone, Copy, Default)]
struct Point {
    device_ns: i64,
    delay_ns: i64,
}

/// The line under the delays of the last 16 s. A frame costs a few additions, and every half second one pass over 32 points.
#[derive(Debug, Default)]
pub(super) struct Envelope {
    /// The least late of each half second, a ring of which `next` is the oldest.
    closed: [Point; BUCKETS],
    filled: usize,
    next: usize,
    /// The least late of the bucket that began at `open_since_ns`.
    open: Option<Point>,
    open_since_ns: i64,
    line: Line,
    /// Set with the first drift; later ones replace it.
    knows_drift: bool,
}

#[derive(Debug, Clone, Copy, Default)]
struct Line {
    /// The line's height is known here.
    anchor: Point,
    /// Delay gained per device time.
    drift: f64,
}

impl Line {
    fn delay_at(&self, device_ns: i64) -> i64 {
        let since = device_ns.saturating_sub(self.anchor.device_ns);
        self.anchor.delay_ns.saturating_add(nearest(since as f64 * self.drift))
    }

    /// How far `point` lies above the line.
    fn excess_ns(&self, point: Point) -> i64 {
        point.delay_ns.saturating_sub(self.delay_at(point.device_ns))
    }
}

impl Envelope {
    /// Forgets all frames; the drift stays until there is a better one: a device that was reset keeps its quartz.
    pub(super) fn restart(&mut self) {
        let Line { drift, .. } = self.line;
        *self = Envelope {
            line: Line { anchor: Point::default(), drift },
            knows_drift: self.knows_drift,
            ..Envelope::default()
        };
    }

    /// Takes in a frame. Device time must not fall.
    pub(super) fn add(&mut self, device_ns: i64, delay_ns: i64) {
        let point = Point { device_ns, delay_ns };
        let Some(least) = self.open else {
            self.open = Some(point);
            self.open_since_ns = device_ns;
            self.line.anchor = point;
            return;
        };
        if device_ns.saturating_sub(self.open_since_ns) >= BUCKET_NS {
            self.close(least);
            self.open = Some(point);
            self.open_since_ns = device_ns;
        } else if self.line.excess_ns(point) < self.line.excess_ns(least) {
            self.open = Some(point);
        }
        if self.line.excess_ns(point) < 0 {
            self.line.anchor = point;
        }
    }

    /// The smallest delay that a frame of this device time can have, ns.
    pub(super) fn delay_at(&self, device_ns: i64) -> i64 {
        self.line.delay_at(device_ns)
    }

    /// Delay gained per device time: 50e-6 where the device's clock is slow by 50 ppm.
    pub(super) fn drift(&self) -> f64 {
        self.line.drift
    }

    /// How far above the line the least late frames of the last 2 s lay at most, ns; `None` before there are as many
    /// and the drift is known.
    ///
    /// Small where the line fits. Grows where the clocks no longer run as they did.
    pub(super) fn misfit_ns(&self) -> Option<i64> {
        let recent = self.newest_first().take(RECENT).map(|point| self.line.excess_ns(point));
        recent.max().filter(|_| self.knows_drift && self.filled >= RECENT)
    }

    /// How far above the line the least late frame of the last `seconds` lay, ns; `None` before that time has passed.
    pub(super) fn late_since(&self, seconds: usize) -> Option<i64> {
        let buckets = seconds * (1_000_000_000 / BUCKET_NS) as usize;
        let late = self.newest_first().take(buckets).map(|point| self.line.excess_ns(point)).min();
        late.filter(|_| self.filled >= buckets)
    }

    fn newest_first(&self) -> impl Iterator<Item = Point> {
        (1..=self.filled).map(|back| self.closed[(self.next + BUCKETS - back) % BUCKETS])
    }

    fn oldest_first(&self) -> impl Iterator<Item = Point> {
        (0..self.filled).map(|place| self.closed[(self.next + BUCKETS - self.filled + place) % BUCKETS])
    }

    fn close(&mut self, least: Point) {
        self.closed[self.next] = least;
        self.next = (self.next + 1) % BUCKETS;
        self.filled = (self.filled + 1).min(BUCKETS);
        if let Some(drift) = self.drift_under_all() {
            self.line.drift = drift.clamp(-MOST_DRIFT, MOST_DRIFT);
            self.knows_drift = true;
        }
        let lowest = self.oldest_first().min_by_key(|point| self.line.excess_ns(*point));
        self.line.anchor = lowest.unwrap_or(least);
    }

    /// The slope of the lower convex hull below the mean device time; `None` where the points span too little time.
    fn drift_under_all(&self) -> Option<f64> {
        let (first, last) = (self.oldest_first().next()?, self.newest_first().next()?);
        if last.device_ns.saturating_sub(first.device_ns) < SHORTEST_SPAN_NS {
            return None;
        }
        // Relative to the first: the differences are small enough for exact products.
        let relative = |point: Point| {
            ((point.device_ns - first.device_ns) as f64, (point.delay_ns - first.delay_ns) as f64)
        };
        let mean = self.oldest_first().map(|point| relative(point).0).sum::<f64>() / self.filled as f64;
        let mut hull = [(0.0, 0.0); BUCKETS];
        let mut corners = 0;
        for (x, y) in self.oldest_first().map(relative) {
            while corners >= 2 {
                let ((x0, y0), (x1, y1)) = (hull[corners - 2], hull[corners - 1]);
                let is_below = (y1 - y0) * (x - x0) < (y - y0) * (x1 - x0);
                if is_below {
                    break;
                }
                corners -= 1;
            }
            hull[corners] = (x, y);
            corners += 1;
        }
        let edge = hull[..corners].windows(2).find(|edge| edge[1].0 >= mean)?;
        Some((edge[1].1 - edge[0].1) / (edge[1].0 - edge[0].0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_NS: i64 = 16_666_667;

    fn envelope(frames: i64, delay_ns: impl Fn(i64) -> i64) -> Envelope {
        let mut envelope = Envelope::default();
        (0..frames).for_each(|frame| envelope.add(frame * PERIOD_NS, delay_ns(frame)));
        envelope
    }

    #[test]
    fn exact_delays_give_the_exact_line() {
        let envelope = envelope(600, |frame| 7_000_000 + frame * PERIOD_NS / 20_000);
        assert!((envelope.drift() - 50e-6).abs() < 1e-9, "{}", envelope.drift());
        assert!((envelope.delay_at(0) - 7_000_000).abs() < 10);
        assert!(envelope.misfit_ns().unwrap() < 10);
    }

    #[test]
    fn late_frames_do_not_move_the_line() {
        let envelope = envelope(600, |frame| if frame % 3 == 0 { 20_000_000 } else { 5 });
        assert_eq!((envelope.drift(), envelope.delay_at(600 * PERIOD_NS)), (0.0, 5));
    }

    #[test]
    fn no_drift_is_told_before_two_seconds() {
        let envelope = envelope(60, |frame| 1000 * (frame % 7));
        assert_eq!((envelope.drift(), envelope.misfit_ns()), (0.0, None));
    }

    #[test]
    fn what_does_not_come_back_is_late_for_as_long() {
        let envelope = envelope(600, |frame| if frame < 300 { 0 } else { 2_000_000 });
        assert!(envelope.late_since(3).unwrap() > 1_000_000);
        assert_eq!(envelope.late_since(9), Some(0));
        assert_eq!(envelope.late_since(20), None);
    }

    #[test]
    fn a_slow_camera_has_one_frame_a_bucket() {
        let mut envelope = Envelope::default();
        (0..100).for_each(|frame| envelope.add(frame * 1_000_000_000, frame * 50_000));
        assert!((envelope.drift() - 50e-6).abs() < 1e-9);
    }
}
