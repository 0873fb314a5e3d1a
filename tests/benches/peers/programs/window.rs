//! The time in which a consumer measures, and what it finds there.
//!
//! A consumer prints the line `begin` when frames of every camera have come and a second has passed, and after the time that it is to
//! measure one line of JSON: `{"frames": ..., "lost": ..., "latency_us": {"p50": ..., "p99": ..., "max": ...},
//! "ready_to_send_us": {...}}`, over all cameras. It goes on consuming until its standard input ends, so that the bench can read its
//! processor time at both lines.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard};
use std::thread;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::task::{Task, wait_for_end};

/// Time for caches, connections and schedulers to settle.
const WARM_UP: Duration = Duration::from_secs(1);
/// Longest wait for the first frames.
const PATIENCE: Duration = Duration::from_secs(20);
/// Frames of each camera that are looked at before measuring.
const CHECKED: u64 = 8;

/// Stamps of one frame, CLOCK_MONOTONIC in ns.
pub struct Stamps {
    /// Place in the camera's stream; a gap is a loss.
    pub sequence: u64,
    /// When the camera had written it.
    pub ready_ns: u64,
    /// When the producer handed it to the transport.
    pub send_ns: u64,
    /// When the consumer had it, masked.
    pub masked_ns: u64,
}

/// What was measured, and whether it goes on.
pub struct Window {
    tallies: Vec<Mutex<Tally>>,
    mask: Option<Vec<u8>>,
    seconds: f64,
    measuring: AtomicBool,
    over: AtomicBool,
}

#[derive(Default)]
struct Tally {
    seen: u64,
    last: u64,
    lost: u64,
    latency_ns: Vec<u64>,
    ready_to_send_ns: Vec<u64>,
}

impl Window {
    /// For the cameras of the task. With `masked`, masked pixels that are not black end the program.
    pub fn new(task: &Task, masked: bool) -> Window {
        let expected = task.seconds as usize * 120;
        let tally = || Tally {
            latency_ns: Vec::with_capacity(expected),
            ready_to_send_ns: Vec::with_capacity(expected),
            ..Tally::default()
        };
        Window {
            tallies: (0..task.cameras).map(|_| Mutex::new(tally())).collect(),
            mask: masked.then(|| task.mask()),
            seconds: task.seconds,
            measuring: AtomicBool::new(false),
            over: AtomicBool::new(false),
        }
    }

    /// Counts a frame of `camera`.
    pub fn received(&self, camera: usize, stamps: &Stamps, pixels: &[u8]) {
        let mut tally = self.tally(camera);
        // Relaxed: the flag carries no data; a frame at the edge may count or not.
        if self.measuring.load(Ordering::Relaxed) {
            tally.lost += stamps.sequence.saturating_sub(tally.last + 1);
            tally.latency_ns.push(stamps.masked_ns.saturating_sub(stamps.ready_ns));
            tally.ready_to_send_ns.push(stamps.send_ns.saturating_sub(stamps.ready_ns));
        } else if tally.seen < CHECKED {
            self.check(pixels);
        }
        tally.seen += 1;
        tally.last = stamps.sequence;
    }

    /// Whether consuming is to end.
    pub fn is_over(&self) -> bool {
        // Relaxed: the flag carries no data.
        self.over.load(Ordering::Relaxed)
    }

    /// Says when measuring begins, measures, reports, and waits until the bench has had enough.
    pub fn conduct(&self) {
        let start = Instant::now();
        while (0..self.tallies.len()).any(|camera| self.tally(camera).seen == 0) {
            if start.elapsed() > PATIENCE {
                eprintln!("no frame of every camera within {PATIENCE:?}");
                std::process::exit(1);
            }
            thread::sleep(Duration::from_millis(10));
        }
        thread::sleep(WARM_UP);
        println!("begin");
        self.measuring.store(true, Ordering::Relaxed);
        thread::sleep(Duration::from_secs_f64(self.seconds));
        self.measuring.store(false, Ordering::Relaxed);
        println!("{}", self.report());
        wait_for_end();
        self.over.store(true, Ordering::Relaxed);
    }

    fn tally(&self, camera: usize) -> MutexGuard<'_, Tally> {
        self.tallies[camera].lock().unwrap()
    }

    fn report(&self) -> Value {
        let tallies: Vec<_> = (0..self.tallies.len()).map(|camera| self.tally(camera)).collect();
        let latency_ns = tallies.iter().flat_map(|tally| tally.latency_ns.iter().copied()).collect();
        let ready_to_send_ns =
            tallies.iter().flat_map(|tally| tally.ready_to_send_ns.iter().copied()).collect();
        json!({
            "frames": tallies.iter().map(|tally| tally.latency_ns.len()).sum::<usize>(),
            "lost": tallies.iter().map(|tally| tally.lost).sum::<u64>(),
            "latency_us": quantiles(latency_ns),
            "ready_to_send_us": quantiles(ready_to_send_ns),
        })
    }

    fn check(&self, pixels: &[u8]) {
        let Some(mask) = &self.mask else { return };
        let mut pairs = pixels.iter().zip(mask);
        if pixels.len() != mask.len() || pairs.any(|(pixel, keep)| pixel & !keep != 0) {
            eprintln!("a frame is not masked");
            std::process::exit(1);
        }
    }
}

fn quantiles(mut values_ns: Vec<u64>) -> Value {
    values_ns.sort_unstable();
    let at = |quantile: f64| {
        let index = (values_ns.len() as f64 * quantile) as usize;
        values_ns.get(index.min(values_ns.len().saturating_sub(1))).map(|ns| *ns as f64 / 1000.0)
    };
    json!({ "p50": at(0.5), "p99": at(0.99), "max": at(1.0) })
}
