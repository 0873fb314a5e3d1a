//! Time that a test lets pass, and what others see of a supervisor meanwhile.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use super::script::{AfterPauses, Journal};
use crate::counters::Counters;
use crate::stuck::StuckDetector;
use crate::supervise::time::Time;

/// How often the main thread looks whether the supervisor is stuck.
const LOOK: Duration = Duration::from_millis(200);

/// Time that passes where the script says so, while the main thread looks after the supervisor.
pub(super) struct Passing {
    start: Instant,
    /// Nanoseconds since then.
    passed: AtomicU64,
    /// With whether it is stuck.
    stuck_detector: Mutex<(StuckDetector, bool)>,
    counters: Arc<Counters>,
    journal: Journal,
}

impl Passing {
    /// Begins with the supervisor that gives these signs of life.
    pub(super) fn new(counters: Arc<Counters>, journal: Journal) -> Self {
        let start = Instant::now();
        let stuck_detector = Mutex::new((StuckDetector::new(start), false));
        Passing { start, passed: AtomicU64::new(0), stuck_detector, counters, journal }
    }

    fn now(&self) -> Instant {
        self.start + Duration::from_nanos(self.passed.load(Ordering::Relaxed))
    }

    /// Lets time pass.
    pub(super) fn pass(&self, duration: Duration) {
        let mut left = duration;
        while !left.is_zero() {
            let step = left.min(LOOK);
            left -= step;
            self.passed.fetch_add(step.as_nanos() as u64, Ordering::Relaxed);
            let (detector, was_stuck) = &mut *self.stuck_detector.lock().unwrap();
            let silence = detector.look(&self.counters, self.now());
            if let Some(silence) = silence.filter(|_| !*was_stuck) {
                self.journal.write(format!("stuck for {} s", silence.as_secs()));
            }
            *was_stuck = silence.is_some();
        }
    }
}

/// The supervisor's time, of which it sleeps a part.
pub(super) struct ScriptedTime {
    passing: Arc<Passing>,
    /// Nanoseconds that were slept.
    slept: AtomicU64,
    act: Mutex<Option<AfterPauses>>,
}

impl ScriptedTime {
    /// Time of which a sum of sleep calls for an action.
    pub(super) fn new(passing: Arc<Passing>, after_pauses: Option<AfterPauses>) -> Self {
        ScriptedTime { passing, slept: AtomicU64::new(0), act: Mutex::new(after_pauses) }
    }
}

impl Time for ScriptedTime {
    fn now(&self) -> Instant {
        self.passing.now()
    }

    fn sleep(&self, duration: Duration) {
        self.passing.pass(duration);
        let ns = duration.as_nanos() as u64;
        let slept = self.slept.fetch_add(ns, Ordering::Relaxed) + ns;
        self.passing.journal.write(format!("pause {}", duration.as_millis()));
        let mut act = self.act.lock().unwrap();
        if let Some((_, act)) = act.take_if(|(after, _)| slept >= after.as_nanos() as u64) {
            act(self.passing.journal.count("open "));
        }
        // Threads that close cameras take real time.
        std::thread::yield_now();
    }
}
