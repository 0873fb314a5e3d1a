//! What a service manager hears of the driver: sd_notify(3). Without one, nothing happens. One that does not listen is not waited for.

use std::ffi::OsStr;
use std::io;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::time::{Duration, Instant};

use sd_notify::NotifyState;

/// A camera, as far as a service manager wants to know.
pub(crate) struct Condition {
    /// Frames published since the driver's start.
    pub(crate) published: u64,
    /// Whether the first attempt to open it is over, or takes so long that nobody should wait for it.
    pub(crate) is_tried: bool,
    /// Whether a call into its library does not return.
    pub(crate) is_stuck: bool,
    /// What it does, in a few words. They change with its state and its losses, not with every frame.
    pub(crate) words: String,
}

/// What the service manager was told, and when it is told again.
pub(crate) struct ServiceManager {
    /// Within which time the watchdog is to be fed (WatchdogSec).
    watchdog: Option<Duration>,
    next_feeding: Instant,
    /// Frames published by all cameras when it was last fed.
    published: u64,
    is_ready: bool,
    status: String,
}

impl ServiceManager {
    pub(crate) fn new() -> Self {
        ServiceManager {
            watchdog: sd_notify::watchdog_enabled(),
            next_feeding: Instant::now(),
            published: 0,
            is_ready: false,
            status: String::new(),
        }
    }

    /// Says what there is to say. To be called several times a second.
    pub(crate) fn attend(&mut self, cameras: &[Condition]) {
        let published: u64 = cameras.iter().map(|camera| camera.published).sum();
        if !self.is_ready && published > 0 && cameras.iter().all(|camera| camera.is_tried) {
            self.is_ready = tell(&NotifyState::Ready);
        }
        let status = cameras.iter().map(|camera| camera.words.as_str()).collect::<Vec<_>>().join("; ");
        if status != self.status && tell(&NotifyState::Status(&status)) {
            self.status = status;
        }
        let Some(watchdog) = self.watchdog.filter(|_| Instant::now() >= self.next_feeding) else {
            return;
        };
        let is_any_stuck = cameras.iter().any(|camera| camera.is_stuck);
        if should_feed_watchdog(published.saturating_sub(self.published), is_any_stuck)
            && tell(&NotifyState::Watchdog)
        {
            self.published = published;
            // Twice within the time, as sd_watchdog_enabled(3) advises, and once for a late look.
            self.next_feeding = Instant::now() + watchdog / 3;
        }
    }

    /// Says that the driver ends.
    pub(crate) fn stopping(&self) {
        tell(&NotifyState::Stopping);
    }
}

/// Whether the driver is to stay: a restart costs every camera frames, so it is not worth it as long as one of them publishes; and cameras
/// that are merely absent, or have no mask, do not come back by it.
fn should_feed_watchdog(published: u64, is_any_stuck: bool) -> bool {
    published > 0 || !is_any_stuck
}

/// Returns whether it was told; what was not is told at the next look.
fn tell(state: &NotifyState<'_>) -> bool {
    let outcome = std::env::var_os("NOTIFY_SOCKET").map_or(Ok(()), |name| send(&name.into_vec(), state));
    if let Err(error) = &outcome {
        tracing::debug!("service manager: {error}");
    }
    outcome.is_ok()
}

/// Unlike `sd_notify::notify`, does not wait for room in the manager's queue.
fn send(name: &[u8], state: &NotifyState<'_>) -> io::Result<()> {
    let address = match name.strip_prefix(b"@") {
        Some(name) => SocketAddr::from_abstract_name(name)?,
        None => SocketAddr::from_pathname(OsStr::from_bytes(name))?,
    };
    let socket = UnixDatagram::unbound()?;
    socket.set_nonblocking(true)?;
    socket.send_to_addr(format!("{state}\n").as_bytes(), &address).map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_manager_is_told_by_its_abstract_name_and_one_that_does_not_listen_is_not_waited_for() {
        let name = format!("uvcam-test-{}", std::process::id());
        let manager = UnixDatagram::bind_addr(&SocketAddr::from_abstract_name(&name).unwrap()).unwrap();
        let name = format!("@{name}");
        let full = (0..100_000).find_map(|_| send(name.as_bytes(), &NotifyState::Ready).err()).unwrap();
        assert_eq!(full.kind(), io::ErrorKind::WouldBlock);
        let mut text = [0; 64];
        let length = manager.recv(&mut text).unwrap();
        assert_eq!(&text[..length], b"READY=1\n");
    }

    #[test]
    fn a_stuck_camera_is_worth_a_restart_only_where_none_publishes() {
        assert!(should_feed_watchdog(60, false) && should_feed_watchdog(60, true));
        assert!(should_feed_watchdog(0, false), "cameras that wait for their device are no reason");
        assert!(!should_feed_watchdog(0, true));
    }
}
