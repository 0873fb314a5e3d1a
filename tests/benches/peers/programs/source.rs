//! The camera of a peer: pictures that fall due at a fixed rate. The peer writes them to memory of its choice, as a device would.

use std::sync::Arc;

use rustix::thread::{ClockId, clock_nanosleep_absolute};
use rustix::time::Timespec;
use uvcam_shm_ipc::monotonic_ns;

use crate::task::Task;

/// Time between frames, nanoseconds: 60 fps.
const PERIOD_NS: f64 = 1e9 / 60.0;

/// One camera.
pub struct Source {
    pictures: Arc<Vec<u8>>,
    frame_bytes: usize,
    start_ns: u64,
    sequence: u64,
}

impl Source {
    /// The cameras of the task, a part of the period apart: the best case of a chain that shares a machine.
    pub fn all(task: &Task) -> Vec<Source> {
        let pictures = Arc::new(std::fs::read(task.folder.join("frames.raw")).unwrap());
        let frame_bytes = task.frame_bytes();
        assert!(!pictures.is_empty() && pictures.len().is_multiple_of(frame_bytes), "frames.raw");
        let begin_ns = monotonic_ns();
        let source = |camera: usize| Source {
            pictures: pictures.clone(),
            frame_bytes,
            start_ns: begin_ns + (PERIOD_NS * camera as f64 / task.cameras as f64) as u64,
            sequence: 0,
        };
        (0..task.cameras).map(source).collect()
    }

    /// Waits until the next frame is due. Returns its place in the stream, from 0, and its pixels.
    pub fn next(&mut self) -> (u64, &[u8]) {
        let sequence = self.sequence;
        self.sequence += 1;
        sleep_until(self.start_ns + (sequence as f64 * PERIOD_NS) as u64);
        let pictures = self.pictures.len() / self.frame_bytes;
        let at = sequence as usize % pictures * self.frame_bytes;
        (sequence, &self.pictures[at..at + self.frame_bytes])
    }
}

fn sleep_until(instant_ns: u64) {
    let time =
        Timespec { tv_sec: (instant_ns / 1_000_000_000) as i64, tv_nsec: (instant_ns % 1_000_000_000) as _ };
    // An interrupted sleep goes on: the instant is absolute.
    while clock_nanosleep_absolute(ClockId::Monotonic, &time) == Err(rustix::io::Errno::INTR) {}
}
