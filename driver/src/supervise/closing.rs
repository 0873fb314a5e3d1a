//! Cameras that have failed, on their way out.
//!
//! To close a device that does not answer takes its library up to ten seconds (GigE Vision: every farewell is sent five times, half a
//! second apart). It happens on a thread of its own, while the next attempt to open it runs. The slots that the dead device holds come
//! back with it.

use std::thread::{Builder, JoinHandle};
use std::time::{Duration, Instant};

use crate::camera::Camera;
use crate::config::Ipc;

/// How long the end of the driver waits for them.
const PATIENCE: Duration = Duration::from_secs(3);
/// Time between looks at them.
const NAP: Duration = Duration::from_millis(10);

/// Closes the camera of this name; returns the thread that does it, where it is not done.
type Close = fn(&str, Box<dyn Camera>) -> Option<JoinHandle<()>>;

/// The threads that close cameras.
#[derive(Debug)]
pub(super) struct Closing {
    close: Close,
    threads: Vec<JoinHandle<()>>,
}

impl Default for Closing {
    fn default() -> Self {
        Closing::by(elsewhere)
    }
}

/// Closes a camera on a thread of its own; here, where there is none to be had.
fn elsewhere(name: &str, camera: Box<dyn Camera>) -> Option<JoinHandle<()>> {
    Builder::new().name(format!("{name}-close")).spawn(move || drop(camera)).ok()
}

impl Closing {
    /// Closes cameras in this way.
    pub(super) fn by(close: Close) -> Self {
        Closing { close, threads: Vec::new() }
    }

    /// Closes a camera.
    pub(super) fn close(&mut self, name: &str, camera: Box<dyn Camera>) {
        self.threads.extend((self.close)(name, camera));
    }

    /// Whether no more than [`Ipc::CLOSING`] cameras are on their way out.
    pub(super) fn has_room(&mut self) -> bool {
        self.unfinished() <= Ipc::CLOSING
    }

    /// Waits for all of them, for a while: a dead device must not hold up the end of the driver.
    pub(super) fn finish(&mut self) {
        let end = Instant::now() + PATIENCE;
        while self.unfinished() > 0 && Instant::now() < end {
            std::thread::sleep(NAP);
        }
    }

    fn unfinished(&mut self) -> usize {
        self.threads.retain(|thread| !thread.is_finished());
        self.threads.len()
    }
}
