//! Stamps of a device that counts as it likes.
#![no_main]

use arbitrary::Arbitrary;
use libfuzzer_sys::fuzz_target;
use uvcam::clock::{DeviceClock, FrameClock};
use uvcam_shm_ipc::{FrameHeader, PixelFormat};

/// When the host's clock began, ns: a machine that has run for a while.
const BEGIN_NS: u64 = 1 << 45;

#[derive(Debug, Arbitrary)]
struct Stream {
    increment_ns: Increment,
    counter: Length,
    stretches: Vec<Stretch>,
}

#[derive(Debug, Arbitrary)]
enum Increment {
    Nanosecond,
    Microsecond,
    Any(f64),
}

#[derive(Debug, Arbitrary)]
enum Length {
    Bits16,
    Bits32,
    Bits64,
}

/// Frames in a row.
#[derive(Debug, Arbitrary)]
enum Stretch {
    /// As a camera sends them: every `period_us`, the device's clock fast by `drift_ppm`, arrivals late by up to `jitter_us`.
    Steady { frames: u8, period_us: u16, drift_ppm: i16, jitter_us: u16 },
    /// Nothing came for a while.
    Pause { seconds: u16 },
    /// The device was reset, or its clock set.
    Set { device_ns: u64 },
    /// One frame with any stamp and any delay.
    Frame { device_ns: Option<u64>, later_ns: u32 },
}

fuzz_target!(|stream: Stream| {
    let increment_ns = match stream.increment_ns {
        Increment::Nanosecond => 1.0,
        Increment::Microsecond => 1000.0,
        Increment::Any(any) => any,
    };
    let turn_ns = |ticks: u64| (increment_ns as u64).max(1).saturating_mul(ticks);
    let turn_ns = match stream.counter {
        Length::Bits16 => turn_ns(1 << 16),
        Length::Bits32 => turn_ns(1 << 32),
        Length::Bits64 => u64::MAX,
    };
    let mut clock = FrameClock::new(DeviceClock::Own { increment_ns });
    let mut place = Place::default();
    let (mut device_ns, mut now_ns) = (0u64, BEGIN_NS);
    for stretch in stream.stretches {
        match stretch {
            Stretch::Steady { frames, period_us, drift_ppm, jitter_us } => {
                let period_ns = 1000 * i64::from(period_us);
                let device_period_ns = period_ns + period_ns * i64::from(drift_ppm) / 1_000_000;
                for frame in 0..u64::from(frames) {
                    device_ns = device_ns.wrapping_add_signed(device_period_ns);
                    now_ns += period_ns as u64;
                    let late_ns = frame * 7919 % (1 + 1000 * u64::from(jitter_us));
                    place.next(&mut clock, Some(device_ns % turn_ns), now_ns + late_ns);
                }
            }
            Stretch::Pause { seconds } => now_ns += 1_000_000_000 * u64::from(seconds),
            Stretch::Set { device_ns: set_ns } => device_ns = set_ns,
            Stretch::Frame { device_ns, later_ns } => {
                now_ns += u64::from(later_ns);
                place.next(&mut clock, device_ns, now_ns);
            }
        }
    }
});

/// Where the frame before was placed.
#[derive(Default)]
struct Place {
    arrival_ns: u64,
    device_stamp_ns: Option<u64>,
}

impl Place {
    fn next(&mut self, clock: &mut FrameClock, device_ns: Option<u64>, arrival_ns: u64) {
        // The host's clock does not go back.
        self.arrival_ns = self.arrival_ns.max(arrival_ns);
        let mut header = FrameHeader::new(64, 48, 64, PixelFormat::Mono8);
        (header.exposure_us, header.frame_period_ns) = (1000.0, 16_666_667);
        header.arrival_monotonic_ns = self.arrival_ns;
        clock.stamp(&mut header, device_ns);
        clock.learn();
        assert!(header.mid_exposure_uncertainty_ns >= header.frame_period_ns);
        if device_ns.is_some() {
            let stamp_ns = header.mid_exposure_monotonic_ns;
            assert!(self.device_stamp_ns.is_none_or(|before| before < stamp_ns), "stamps out of order");
            self.device_stamp_ns = Some(stamp_ns);
        }
    }
}
