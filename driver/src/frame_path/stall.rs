//! When a camera that sends nothing whole has stalled.

use std::time::Duration;

use uvcam_shm_ipc::monotonic_ns;

use crate::camera::{CameraError, GIGE_VISION, Identity};

/// A camera that delivers nothing whole for this long, and for ten frame periods, has stalled.
const STALL_NS: u64 = 1_000_000_000;

/// How long no whole frame has come, and how many others.
#[derive(Debug)]
pub(super) struct StallDetector {
    since_ns: u64,
    usual_patience_ns: u64,
    patience_ns: u64,
    /// Without any frame for this long, a camera is silent: what came before it was cut off, not damaged on the way.
    pause_ns: u64,
    incomplete: u64,
    incomplete_ns: u64,
}

impl StallDetector {
    /// Begins with the stream. Its first frame may take `first_frame_patience`, where that is longer than the usual patience.
    pub(super) fn new(frame_period_ns: u64, first_frame_patience: Duration) -> Self {
        let pause_ns = frame_period_ns.saturating_mul(10);
        let usual_patience_ns = STALL_NS.max(pause_ns);
        let first_ns = u64::try_from(first_frame_patience.as_nanos()).unwrap_or(u64::MAX);
        let patience_ns = usual_patience_ns.max(first_ns);
        let since_ns = monotonic_ns();
        StallDetector {
            since_ns,
            usual_patience_ns,
            patience_ns,
            pause_ns,
            incomplete: 0,
            incomplete_ns: since_ns,
        }
    }

    /// A whole frame came, at `now_ns` of CLOCK_MONOTONIC.
    pub(super) fn saw_whole_frame(&mut self, now_ns: u64) {
        *self =
            StallDetector { since_ns: now_ns, patience_ns: self.usual_patience_ns, incomplete: 0, ..*self };
    }

    /// Fails where the camera has stalled; `incomplete` frames came instead of a whole one.
    pub(super) fn check(&mut self, camera: &Identity, incomplete: u64) -> Result<(), CameraError> {
        self.check_at(monotonic_ns(), camera, incomplete)
    }

    fn check_at(&mut self, now_ns: u64, camera: &Identity, incomplete: u64) -> Result<(), CameraError> {
        if incomplete > 0 {
            self.incomplete += incomplete;
            self.incomplete_ns = now_ns;
        }
        let silent_ns = now_ns.saturating_sub(self.since_ns);
        if silent_ns <= self.patience_ns {
            return Ok(());
        }
        let (serial, seconds) = (camera.serial.clone(), silent_ns as f64 * 1e-9);
        let paused = now_ns.saturating_sub(self.incomplete_ns) > self.pause_ns;
        Err(match self.incomplete {
            frames if frames > 0 && !paused => {
                CameraError::Incomplete { serial, frames, seconds, remedy: for_missing_parts(camera) }
            }
            _ => CameraError::Silent { serial, seconds, remedy: for_nothing(camera) },
        })
    }
}

/// Where to look when nothing comes of a camera that answers.
#[cold]
fn for_nothing(Identity { transport, address, .. }: &Identity) -> String {
    match transport == GIGE_VISION {
        true => format!(
            "check its cable; and whether a firewall keeps out UDP from {address} (sudo nft list ruleset), or the network drops \
             packets larger than its MTU (ip link): lower the camera's packet size (GevSCPSPacketSize) or raise the MTU"
        ),
        false => "check cable and power".into(),
    }
}

/// Where to look when a part of every frame is missing.
#[cold]
fn for_missing_parts(Identity { transport, address, .. }: &Identity) -> String {
    match transport == GIGE_VISION {
        true => format!(
            "packets are lost on the way: check cable and bandwidth; whether interface and switches carry the camera's packet size \
             (ip link: mtu; GevSCPSPacketSize); whether a firewall lets all UDP from {address} in (sudo nft list ruleset); and \
             net.core.rmem_max (uvcam doctor)"
        ),
        false => "check cable and bandwidth".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_NS: u64 = 16_666_667;

    fn camera(transport: &str) -> Identity {
        Identity {
            kind: "aravis",
            vendor: String::new(),
            model: String::new(),
            serial: "left".into(),
            transport: transport.into(),
            address: "192.168.0.7".into(),
        }
    }

    fn usb() -> Identity {
        camera("USB3Vision")
    }

    #[test]
    fn a_second_of_silence_is_a_failure_unless_ten_periods_are_longer() {
        for (period_ns, patience_ns) in [(PERIOD_NS, STALL_NS), (STALL_NS, 10 * STALL_NS)] {
            let mut detector = StallDetector::new(period_ns, Duration::ZERO);
            let begin_ns = detector.since_ns;
            assert!(detector.check_at(begin_ns + patience_ns, &usb(), 0).is_ok());
            let failed = detector.check_at(begin_ns + patience_ns + 1, &usb(), 0);
            assert!(matches!(failed, Err(CameraError::Silent { .. })), "{failed:?}");
        }
    }

    #[test]
    fn the_first_frame_has_its_own_patience_and_later_ones_the_usual() {
        let mut detector = StallDetector::new(PERIOD_NS, Duration::from_secs(5));
        let first_ns = detector.since_ns + 5 * STALL_NS;
        assert!(detector.check_at(first_ns, &usb(), 0).is_ok());
        detector.saw_whole_frame(first_ns);
        assert!(detector.check_at(first_ns + STALL_NS, &usb(), 0).is_ok());
        assert!(detector.check_at(first_ns + STALL_NS + 1, &usb(), 0).is_err());
    }

    #[test]
    fn incomplete_frames_do_not_break_it() {
        let mut detector = StallDetector::new(PERIOD_NS, Duration::ZERO);
        let begin_ns = detector.since_ns;
        for frame in 1..=60 {
            assert!(detector.check_at(begin_ns + frame * PERIOD_NS / 2, &usb(), 1).is_ok());
        }
        let failed = detector.check_at(begin_ns + STALL_NS + 1, &usb(), 1);
        assert!(matches!(failed, Err(CameraError::Incomplete { frames: 61, .. })), "{failed:?}");
    }

    #[test]
    fn a_camera_that_dies_within_a_frame_is_silent() {
        let mut detector = StallDetector::new(PERIOD_NS, Duration::ZERO);
        let begin_ns = detector.since_ns;
        assert!(detector.check_at(begin_ns + PERIOD_NS, &usb(), 1).is_ok());
        let failed = detector.check_at(begin_ns + STALL_NS + 1, &usb(), 0);
        assert!(matches!(failed, Err(CameraError::Silent { .. })), "{failed:?}");
    }

    #[test]
    fn on_a_network_firewall_and_packet_size_are_named() {
        let failed = |transport, incomplete| {
            let mut detector = StallDetector::new(PERIOD_NS, Duration::ZERO);
            let late_ns = detector.since_ns + STALL_NS + 1;
            detector.check_at(late_ns, &camera(transport), incomplete).unwrap_err().to_string()
        };
        for incomplete in [0, 60] {
            let message = failed(GIGE_VISION, incomplete);
            for word in ["UDP from 192.168.0.7", "nft list ruleset", "GevSCPSPacketSize", "mtu"] {
                assert!(message.to_lowercase().contains(&word.to_lowercase()), "{message}");
            }
            assert!(!failed("USB3Vision", incomplete).contains("firewall"));
        }
        assert!(failed(GIGE_VISION, 60).contains("60 frames in 1.0 s, none of them whole"));
        assert!(failed("USB3Vision", 0).contains("no whole frame for 1.0 s; check cable and power"));
    }
}
