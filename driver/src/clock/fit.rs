//! The device's clock, fitted to CLOCK_MONOTONIC while frames come in.

use super::counter::Counter;
use super::envelope::{Envelope, nearest};

/// A frame that arrives earlier than the fit allows by more than this shows that the device's clock was set, or that the fit began with
/// late frames. It is also the largest error that is not mended at once.
const STEP_NS: i64 = 1_000_000;
/// A clock that was set back, or a way that became longer, makes every frame late: believed after this time.
const PATIENCE_S: usize = 3;
/// How fast an error below [`STEP_NS`] is mended: at most this share of the time that passes, and this much a frame. Intervals between stamps
/// are wrong by no more than this and the error of the drift.
const SLEW: f64 = 500e-6;
const MOST_SLEW_NS: f64 = 10_000.0;

/// A frame's place in the host's time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Placed {
    /// CLOCK_MONOTONIC in ns at which the frame would have arrived with the smallest delay there is. Grows from frame to frame.
    pub arrival_ns: u64,
    /// Half width in ns of the interval around it that holds the true instant; `None` where too little is known yet.
    pub uncertainty_ns: Option<u64>,
}

/// Maps device time to CLOCK_MONOTONIC, frame by frame.
///
/// Drift and offset come from the lower envelope of the arrival delays over 16 s, so late frames do not matter. Between two frames it is
/// the device that tells the time, corrected by the drift; what the envelope knows better is mended a few microseconds a frame.
/// Counters that wrap are followed; after a reset of the device the fit starts anew.
///
/// The fit cannot know the delay that every frame has. It is a constant of the stream.
#[derive(Debug)]
pub struct ClockFit {
    increment_ns: f64,
    state: Option<State>,
    envelope: Envelope,
    /// How well the envelope fits at present; `None` where too little is known yet.
    misfit_ns: Option<u64>,
}

#[derive(Debug)]
struct State {
    counter: Counter,
    /// The first frame's arrival: all host times below are relative to it.
    origin_ns: u64,
    /// Device time since the first frame.
    device_ns: i64,
    /// Where the last frame was placed.
    placed_ns: i64,
    /// How much later than the device's time it arrived, where the envelope does not know it yet.
    unlearnt: Option<i64>,
}

impl ClockFit {
    /// For a device whose counter ticks every `increment_ns` (SFNC `TimestampIncrement`).
    pub fn new(increment_ns: f64) -> Self {
        ClockFit { increment_ns, state: None, envelope: Envelope::default(), misfit_ns: None }
    }

    /// Places the next frame, which the device stamped with `device_ns` and which arrived at `arrival_ns`, CLOCK_MONOTONIC.
    ///
    /// Allocates nothing, in bounded time.
    #[inline]
    pub fn place(&mut self, device_ns: u64, arrival_ns: u64) -> Placed {
        if self.state.as_ref().is_some_and(|state| state.unlearnt.is_some()) {
            self.learn();
        }
        let Some(state) = &mut self.state else { return self.begin(device_ns, arrival_ns) };
        let arrival = arrival_ns.wrapping_sub(state.origin_ns) as i64;
        let envelope = &mut self.envelope;
        let on_time =
            |envelope: &Envelope, device_ns: i64| device_ns.saturating_add(envelope.delay_at(device_ns));
        let host_step = arrival.saturating_sub(on_time(envelope, state.device_ns)).max(0);
        let step = state.counter.step(device_ns, host_step).filter(|step| {
            let at = state.device_ns.saturating_add(*step);
            let early = on_time(envelope, at).saturating_sub(arrival);
            // The drift may be off by as much as the slew.
            *step >= 0 && early <= STEP_NS.saturating_add((*step as f64 * SLEW) as i64)
        });
        // A clock that was set says nothing about this frame.
        let device_step = step.unwrap_or(host_step);
        state.device_ns = state.device_ns.saturating_add(device_step);
        let delay = arrival.saturating_sub(state.device_ns);
        match step {
            Some(_) => state.unlearnt = Some(delay),
            None => restart(envelope, &mut self.misfit_ns, state.device_ns, delay),
        }

        let drifted = nearest(device_step as f64 * envelope.drift());
        let expected = state.placed_ns.saturating_add(device_step).saturating_add(drifted);
        let error = on_time(envelope, state.device_ns).saturating_sub(expected);
        let slew = (device_step as f64 * SLEW).min(MOST_SLEW_NS) as i64;
        let mended = if error.saturating_abs() > STEP_NS { error } else { error.clamp(-slew, slew) };
        state.placed_ns = expected.saturating_add(mended).max(state.placed_ns.saturating_add(1));
        let left = (error - mended).unsigned_abs();
        Placed {
            arrival_ns: state.origin_ns.saturating_add_signed(state.placed_ns),
            uncertainty_ns: self.misfit_ns.map(|misfit| misfit.saturating_add(left)),
        }
    }

    /// Learns from the frame placed last. To be called after it was sent; otherwise the next [`ClockFit::place`] does it.
    #[inline(never)]
    pub fn learn(&mut self) {
        let Some(state) = &mut self.state else { return };
        let Some(delay) = state.unlearnt.take() else { return };
        self.envelope.add(state.device_ns, delay);
        if self.envelope.late_since(PATIENCE_S).is_some_and(|late| late > STEP_NS) {
            restart(&mut self.envelope, &mut self.misfit_ns, state.device_ns, delay);
        }
        self.misfit_ns = self.envelope.misfit_ns().map(i64::unsigned_abs);
    }

    #[cold]
    fn begin(&mut self, device_ns: u64, arrival_ns: u64) -> Placed {
        self.state = Some(State {
            counter: Counter::new(self.increment_ns, device_ns),
            origin_ns: arrival_ns,
            device_ns: 0,
            placed_ns: 0,
            unlearnt: None,
        });
        self.envelope.add(0, 0);
        Placed { arrival_ns, uncertainty_ns: None }
    }

    /// By how much the host's clock gains on the device's: 50e-6 where the device is slow by 50 ppm.
    pub fn drift(&self) -> f64 {
        self.envelope.drift()
    }
}

impl Default for ClockFit {
    /// For a device that counts nanoseconds.
    fn default() -> Self {
        ClockFit::new(1.0)
    }
}

/// Begins anew with a frame that the frames before say nothing about.
#[cold]
#[inline(never)]
fn restart(envelope: &mut Envelope, misfit_ns: &mut Option<u64>, device_ns: i64, delay_ns: i64) {
    envelope.restart();
    envelope.add(device_ns, delay_ns);
    *misfit_ns = None;
}

#[cfg(test)]
mod tests;
