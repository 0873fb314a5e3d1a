//! What it costs to stamp a frame.

use divan::Bencher;
use uvcam::clock::{ClockFit, DeviceClock, FrameClock};
use uvcam_shm_ipc::{FrameHeader, PixelFormat};

const PERIOD_NS: u64 = 16_666_667;

fn main() {
    divan::main();
}

/// A frame's place in the host's time, with the half-second passes over the envelope shared among all frames.
#[divan::bench]
fn fit(bencher: Bencher) {
    let mut fit = ClockFit::default();
    let mut frame = 0;
    bencher.bench_local(|| {
        frame += 1;
        fit.place(frame * PERIOD_NS, frame * PERIOD_NS + frame * 7919 % 300_000)
    });
}

/// All stamps of a frame, two readings of the host's clocks included.
#[divan::bench]
fn stamp(bencher: Bencher) {
    let mut clock = FrameClock::new(DeviceClock::default());
    let mut header = FrameHeader::new(752, 480, 752, PixelFormat::Mono8);
    header.frame_period_ns = PERIOD_NS;
    let mut frame = 0;
    bencher.bench_local(|| {
        frame += 1;
        header.arrival_monotonic_ns = frame * PERIOD_NS + frame * 7919 % 300_000;
        clock.stamp(&mut header, Some(frame * PERIOD_NS));
    });
}
