//! What a service manager hears of the driver: sd_notify(3). Without one, nothing happens.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use sd_notify::NotifyState;

use super::Running;
use crate::error::with_causes;
use crate::supervise::State;

/// What the service manager was told, and when it is told again.
pub(super) struct ServiceManager {
    /// Within which time it wants to hear that the driver works (WatchdogSec).
    watchdog: Option<Duration>,
    next_sign_of_life: Instant,
    /// Frames published by all cameras at the last sign of life.
    published: u64,
    is_ready: bool,
    status: String,
}

impl ServiceManager {
    pub(super) fn new() -> Self {
        ServiceManager {
            watchdog: sd_notify::watchdog_enabled(),
            next_sign_of_life: Instant::now(),
            published: 0,
            is_ready: false,
            status: String::new(),
        }
    }

    /// Says what there is to say. To be called several times a second.
    pub(super) fn attend(&mut self, cameras: &[Running]) {
        let published: u64 =
            cameras.iter().map(|camera| camera.counters.published.load(Ordering::Relaxed)).sum();
        if !self.is_ready && published > 0 && cameras.iter().all(|camera| camera.state.is_some()) {
            self.is_ready = true;
            tell(&[NotifyState::Ready]);
        }
        let status = cameras.iter().map(describe).collect::<Vec<_>>().join("; ");
        if status != self.status {
            tell(&[NotifyState::Status(&status)]);
            self.status = status;
        }
        let Some(watchdog) = self.watchdog.filter(|_| Instant::now() >= self.next_sign_of_life) else {
            return;
        };
        let is_any_stuck = cameras.iter().any(|camera| camera.is_stuck);
        if works(published.saturating_sub(self.published), is_any_stuck) {
            self.published = published;
            // Twice within the time, as sd_watchdog_enabled(3) advises, and once for a late look.
            self.next_sign_of_life = Instant::now() + watchdog / 3;
            tell(&[NotifyState::Watchdog]);
        }
    }

    /// Says that the driver ends.
    pub(super) fn stopping(&self) {
        tell(&[NotifyState::Stopping]);
    }
}

/// Whether a restart of the driver could bring nothing. It costs every camera frames: as long as one of them publishes, it is not worth
/// it; and cameras that are merely absent, or have no mask, do not come back by it.
fn works(published: u64, is_any_stuck: bool) -> bool {
    published > 0 || !is_any_stuck
}

/// One camera in a few words. Changes with its state and its losses, not with every frame.
fn describe(camera: &Running) -> String {
    let name = &camera.config.name;
    match &camera.state {
        _ if camera.is_stuck => format!("{name} stuck"),
        None => format!("{name} starting"),
        Some(State::Streaming(_)) => {
            format!("{name} streaming, {} lost", camera.counters.lost.load(Ordering::Relaxed))
        }
        Some(State::Generating) => format!("{name} generating"),
        Some(State::Waiting(error)) => format!("{name} reconnecting: {}", with_causes(error)),
        Some(State::Refused(error)) => format!("{name} refused: {}", with_causes(error)),
    }
}

fn tell(state: &[NotifyState]) {
    if let Err(error) = sd_notify::notify(state) {
        tracing::debug!("service manager: {error}");
    }
}

#[cfg(test)]
mod tests {
    use super::works;

    #[test]
    fn a_stuck_camera_is_worth_a_restart_only_where_none_publishes() {
        assert!(works(60, false) && works(60, true));
        assert!(works(0, false), "cameras that wait for their device are no reason");
        assert!(!works(0, true));
    }
}
