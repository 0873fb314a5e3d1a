//! When a frame was exposed, in terms of the host's clocks.
//!
//! Three clocks meet here. The device's clock is exact between frames and says nothing about the host's time. CLOCK_MONOTONIC is
//! what consumers compute with; a frame's arrival is known in it, later than the frame by a delay that varies. CLOCK_REALTIME is
//! comparable between UAVs and may step. [`ClockFit`] ties the first to the second; the third is added at the end, frame by frame,
//! so that its steps bend no interval of the other two.

use uvcam_shm_ipc::{Flags, FrameHeader, monotonic_ns, realtime_ns};

mod counter;
mod envelope;
mod fit;

pub use fit::{ClockFit, Placed};

/// Devices tie their stamps to the host's clock by the frames of the bus, one a millisecond (USB 2.0, 8.4.3).
const USB_FRAME_NS: u64 = 1_000_000;

/// Which clock a camera's timestamps are read from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DeviceClock {
    /// The device's own, which starts anywhere and drifts.
    Own {
        /// Nanoseconds from one tick of the counter to the next (SFNC `TimestampIncrement`).
        increment_ns: f64,
    },
    /// CLOCK_MONOTONIC, told for the start of the exposure (V4L2_BUF_FLAG_TSTAMP_SRC_SOE).
    HostAtExposureStart,
    /// CLOCK_MONOTONIC, read when the frame ended (V4L2_BUF_FLAG_TSTAMP_SRC_EOF): as an arrival, without the delay of waking up.
    HostAtFrameEnd,
}

impl Default for DeviceClock {
    /// A counter of nanoseconds.
    fn default() -> Self {
        DeviceClock::Own { increment_ns: 1.0 }
    }
}

/// Stamps the frames of one epoch.
#[derive(Debug, Default)]
pub struct FrameClock {
    clock: DeviceClock,
    fit: ClockFit,
}

impl FrameClock {
    /// For a camera with this clock, from its first frame on.
    pub fn new(clock: DeviceClock) -> Self {
        let increment_ns = match clock {
            DeviceClock::Own { increment_ns } => increment_ns,
            DeviceClock::HostAtExposureStart | DeviceClock::HostAtFrameEnd => 1.0,
        };
        FrameClock { clock, fit: ClockFit::new(increment_ns) }
    }

    /// Writes the stamps and [`Flags::NO_DEVICE_CLOCK`], from the header's arrival, exposure and frame period. To be called once for
    /// every frame, in their order. Allocates nothing; takes below a microsecond.
    ///
    /// Arrival, freed from what varies, is the end of the exposure plus the time that readout and transfer always take. Of these the
    /// host knows only that they fit into one frame period, which is therefore part of the uncertainty; it is the same for all frames
    /// of an epoch, so that intervals are far better than single stamps.
    #[inline]
    pub fn stamp(&mut self, header: &mut FrameHeader, device_timestamp_ns: Option<u64>) {
        let half_exposure_ns = (header.exposure_us * 500.0) as u64;
        let arrival_ns = header.arrival_monotonic_ns;
        header.device_timestamp_ns = device_timestamp_ns.unwrap_or(0);
        header.set_flag(Flags::NO_DEVICE_CLOCK, device_timestamp_ns.is_none());
        (header.mid_exposure_monotonic_ns, header.mid_exposure_uncertainty_ns) =
            match (device_timestamp_ns, self.clock) {
                (None, _) => (arrival_ns.saturating_sub(half_exposure_ns), header.frame_period_ns),
                (Some(start_ns), DeviceClock::HostAtExposureStart) => {
                    (start_ns.saturating_add(half_exposure_ns), USB_FRAME_NS)
                }
                (Some(end_ns), DeviceClock::HostAtFrameEnd) => {
                    (end_ns.saturating_sub(half_exposure_ns), header.frame_period_ns)
                }
                (Some(device_ns), DeviceClock::Own { .. }) => {
                    let placed = self.fit.place(device_ns, arrival_ns);
                    let fit_ns = placed.uncertainty_ns.unwrap_or(header.frame_period_ns);
                    (
                        placed.arrival_ns.saturating_sub(half_exposure_ns),
                        header.frame_period_ns.saturating_add(fit_ns),
                    )
                }
            };
        stamp_realtime(header, monotonic_ns(), realtime_ns());
    }

    /// Learns from the frame stamped last, which can wait until it was sent.
    pub fn learn(&mut self) {
        self.fit.learn();
    }
}

/// Adds CLOCK_REALTIME at the middle of the exposure, from what both clocks say now. Nothing is kept of it for the next frame.
fn stamp_realtime(header: &mut FrameHeader, monotonic_ns: u64, realtime_ns: u64) {
    let age_ns = monotonic_ns.saturating_sub(header.mid_exposure_monotonic_ns);
    header.mid_exposure_realtime_ns = realtime_ns.saturating_sub(age_ns);
}

#[cfg(test)]
mod tests {
    use uvcam_shm_ipc::PixelFormat;

    use super::*;

    fn header(arrival_monotonic_ns: u64) -> FrameHeader {
        let mut header = FrameHeader::new(64, 48, 64, PixelFormat::Mono8);
        (header.exposure_us, header.frame_period_ns) = (1000.0, 16_666_667);
        header.arrival_monotonic_ns = arrival_monotonic_ns;
        header
    }

    #[test]
    fn without_a_device_clock_it_is_arrival_minus_half_the_exposure() {
        let mut header = header(5_000_000_000);
        FrameClock::new(DeviceClock::default()).stamp(&mut header, None);
        assert!(header.flags.contains(Flags::NO_DEVICE_CLOCK));
        assert_eq!(header.device_timestamp_ns, 0);
        assert_eq!(header.mid_exposure_monotonic_ns, 4_999_500_000);
        assert_eq!(header.mid_exposure_uncertainty_ns, header.frame_period_ns);
    }

    #[test]
    fn a_stamp_of_the_hosts_own_clock_needs_no_fit() {
        let mut header = header(5_000_000_000);
        FrameClock::new(DeviceClock::HostAtExposureStart).stamp(&mut header, Some(4_990_000_000));
        assert!(!header.flags.contains(Flags::NO_DEVICE_CLOCK));
        assert_eq!(header.mid_exposure_monotonic_ns, 4_990_500_000);
        assert_eq!(header.mid_exposure_uncertainty_ns, 1_000_000);
        FrameClock::new(DeviceClock::HostAtFrameEnd).stamp(&mut header, Some(4_990_000_000));
        assert_eq!(header.mid_exposure_monotonic_ns, 4_989_500_000);
        assert_eq!(header.mid_exposure_uncertainty_ns, header.frame_period_ns);
    }

    #[test]
    fn the_device_clock_takes_the_jitter_out_of_arrivals() {
        let mut clock = FrameClock::new(DeviceClock::default());
        let mut stamps = Vec::new();
        for frame in 0..4 {
            let exact_ns = frame * 16_666_667;
            let mut header = header(5_000_000_000 + exact_ns + 200_000 * (frame % 2));
            clock.stamp(&mut header, Some(77 + exact_ns));
            assert_eq!(header.device_timestamp_ns, 77 + exact_ns);
            stamps.push(header.mid_exposure_monotonic_ns);
        }
        assert!(stamps.windows(2).all(|pair| pair[1] - pair[0] == 16_666_667), "{stamps:?}");
    }

    #[test]
    fn a_step_of_the_wall_clock_shows_in_its_own_stamp_alone() {
        const HOUR_NS: u64 = 3_600_000_000_000;
        let mut clock = FrameClock::new(DeviceClock::default());
        // Set back by an hour, then two hours ahead.
        let walls = [100 * HOUR_NS, 99 * HOUR_NS, 101 * HOUR_NS];
        let mut stamps = Vec::new();
        for (frame, wall_ns) in (0..).zip(walls) {
            let mut header = header(5_000_000_000 + frame * 16_666_667);
            clock.stamp(&mut header, Some(frame * 16_666_667));
            let now_ns = header.arrival_monotonic_ns;
            stamp_realtime(&mut header, now_ns, wall_ns);
            // Half of the exposure of 1 ms ago.
            assert_eq!(header.mid_exposure_realtime_ns, wall_ns - 500_000);
            stamps.push(header.mid_exposure_monotonic_ns);
        }
        assert!(stamps.windows(2).all(|pair| pair[1] - pair[0] == 16_666_667), "{stamps:?}");
    }
}
