//! The rhythm of a camera made of software: frames fall due at a fixed rate, whether or not anyone fetches them.

use std::collections::VecDeque;
use std::time::Duration;

use rustix::thread::{ClockId, clock_nanosleep_absolute};
use rustix::time::Timespec;
use uvcam_shm_ipc::{Slot, monotonic_ns};

/// Queued slots, and the instants at which frames fall due.
#[derive(Debug, Default)]
pub(super) struct Paced {
    queue: VecDeque<Slot>,
    start_ns: u64,
    period_ns: f64,
    next_id: u64,
}

/// A frame that is due, and the slot it goes to.
pub(super) struct Due {
    /// Count of frames since the start.
    pub(super) frame_id: u64,
    /// Time since the start, by the camera's own clock, nanoseconds.
    pub(super) timestamp_ns: u64,
    /// Where its pixels go.
    pub(super) slot: Slot,
}

impl Paced {
    pub(super) fn queue(&mut self, slot: Slot) {
        self.queue.push_back(slot);
    }

    /// Gives back a slot whose frame was never delivered.
    pub(super) fn requeue(&mut self, slot: Slot) {
        self.queue.push_front(slot);
    }

    /// Takes back the frame that was due: it was never exposed.
    pub(super) fn withdraw(&mut self, due: Due) {
        self.next_id = due.frame_id;
        self.requeue(due.slot);
    }

    pub(super) fn start(&mut self, fps: f64) {
        self.period_ns = 1e9 / fps;
        self.start_ns = monotonic_ns();
        self.next_id = 0;
    }

    /// Goes on as if no time had passed since the last frame.
    pub(super) fn resume(&mut self) {
        let due = self.due_ns(self.next_id);
        self.start_ns += monotonic_ns().saturating_sub(due);
    }

    pub(super) fn stop(&mut self) {
        self.queue.clear();
    }

    /// Waits until `deadline_ns` for the next frame.
    ///
    /// Like a device that writes queued slots by itself, it still holds the frames that fell due while nobody asked, as many
    /// as slots were queued. What exceeds them is lost: the frame ids jump.
    pub(super) fn next(&mut self, deadline_ns: u64) -> Option<Due> {
        loop {
            let due_ns = self.due_ns(self.next_id);
            if due_ns > deadline_ns {
                sleep_until(deadline_ns);
                return None;
            }
            sleep_until(due_ns);
            let late = (monotonic_ns().saturating_sub(due_ns) as f64 / self.period_ns) as u64;
            if late > self.queue.len() as u64 {
                self.next_id += late;
                continue;
            }
            let frame_id = self.next_id;
            self.next_id += 1;
            if let Some(slot) = self.queue.pop_front() {
                let timestamp_ns = due_ns.saturating_sub(self.start_ns);
                return Some(Due { frame_id, timestamp_ns, slot });
            }
        }
    }

    fn due_ns(&self, frame_id: u64) -> u64 {
        self.start_ns + ((frame_id + 1) as f64 * self.period_ns) as u64
    }
}

/// The CLOCK_MONOTONIC instant that lies `timeout` ahead.
pub(super) fn deadline(timeout: Duration) -> u64 {
    monotonic_ns().saturating_add(u64::try_from(timeout.as_nanos()).unwrap_or(u64::MAX))
}

pub(super) fn sleep_until(instant_ns: u64) {
    let time =
        Timespec { tv_sec: (instant_ns / 1_000_000_000) as i64, tv_nsec: (instant_ns % 1_000_000_000) as _ };
    // An interrupted sleep goes on: the instant is absolute.
    while clock_nanosleep_absolute(ClockId::Monotonic, &time) == Err(rustix::io::Errno::INTR) {}
}
