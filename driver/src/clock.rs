//! When a frame was exposed, in terms of the host's clocks.

use uvcam_shm_ipc::{FrameHeader, monotonic_ns, realtime_ns};

/// Stamps the middle of the exposure from the frame's arrival.
///
/// Arrival is the end of the exposure plus readout and transfer, of which the host knows only that they fit into one frame
/// period: that is the uncertainty.
pub fn stamp_mid_exposure(header: &mut FrameHeader) {
    let half_exposure_ns = (header.exposure_us * 500.0) as u64;
    header.mid_exposure_monotonic_ns = header.arrival_monotonic_ns.saturating_sub(half_exposure_ns);
    header.mid_exposure_uncertainty_ns = header.frame_period_ns;
    let age_ns = monotonic_ns().saturating_sub(header.mid_exposure_monotonic_ns);
    header.mid_exposure_realtime_ns = realtime_ns().saturating_sub(age_ns);
}
