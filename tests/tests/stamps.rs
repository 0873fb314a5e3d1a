//! What a consumer can rely on in the stamps.

use uvcam_shm_ipc::Flags;
use uvcam_tests::{Stage, next_frame, simulated};

/// What the fit may bend an interval by: 500 ppm of a frame period each for drift and offset.
const BEND_NS: i64 = 20_000;

#[test]
fn intervals_between_stamps_are_those_of_the_device() {
    let stage = Stage::new(&simulated("left", "none", ""));
    let _driver = stage.driver();
    let mut subscriber = stage.subscriber("left");
    let mut last: Option<(i64, i64)> = None;
    for frame in 0..240 {
        let header = *next_frame(&mut subscriber).header();
        assert!(!header.flags.contains(Flags::NO_DEVICE_CLOCK));
        assert!(header.mid_exposure_uncertainty_ns >= header.frame_period_ns);
        let stamps = (header.device_timestamp_ns as i64, header.mid_exposure_monotonic_ns as i64);
        if let Some((device_ns, mid_exposure_ns)) = last.replace(stamps) {
            let (by_device, by_stamp) = (stamps.0 - device_ns, stamps.1 - mid_exposure_ns);
            // The first second may begin with late frames, which are stepped away from.
            if frame >= 60 {
                assert!(header.mid_exposure_monotonic_ns < header.arrival_monotonic_ns);
                assert!(
                    (by_stamp - by_device).abs() < BEND_NS,
                    "{by_stamp} ns, by the device {by_device} ns"
                );
            }
        }
    }
}
