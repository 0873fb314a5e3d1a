//! A process for each camera, and the main process, which looks after them.
//!
//! What a camera's library does, crashes, hangs and memory included, it does to the process of one camera: that one is started again, and
//! the others do not notice. The main process opens no camera and publishes nothing. It starts the others, tells them what it is told, and
//! knows of each what any reader of its health knows, and how it ended.

use std::path::Path;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use signal_hook::consts::{SIGCHLD, SIGHUP, SIGINT, SIGTERM};

use crate::config::Config;
use crate::error::Error;
use crate::exit::Exit;
use crate::log;
use crate::service_manager::{Condition, ServiceManager};
use crate::signals;

mod camera;
mod launcher;
mod part;
mod stderr;

use camera::CameraProcess;
use launcher::Launcher;
pub(crate) use part::run as run_part;

/// How often the main process looks at health records.
const GLANCE: Duration = Duration::from_millis(200);
/// Time between two looks from which on the main process was stopped.
const PAUSE: Duration = Duration::from_secs(1);
/// How often it shows its status line, and cleans up.
const TICK: Duration = Duration::from_secs(1);
/// How long the driver's end waits for the cameras' processes, each of which waits for its camera's thread: longer than that.
const FAREWELL: Duration = Duration::from_secs(15);
/// How long it waits for those that it kills then.
const LAST_FAREWELL: Duration = Duration::from_secs(1);

/// Runs a process for each configured camera until a signal, the end of the time, or until none of them can work.
///
/// To be called on the main thread: the processes end with the thread that started them (PR_SET_PDEATHSIG of prctl(2)).
///
/// # Errors
/// [`Error::System`] where the system gives no thread or no signals.
pub(crate) fn run(config: &Config, file: Option<&Path>, duration: Option<Duration>) -> Result<Exit, Error> {
    let (signals, inbox) = channel();
    let handle = signals::listen(&[SIGINT, SIGTERM, SIGHUP, SIGCHLD], move |signal| {
        // Nobody listens only while the driver ends.
        let _ = signals.send(signal);
    })?;
    let mut driver = Driver {
        config,
        launcher: Launcher::new(config, file),
        cameras: config.cameras.iter().map(|camera| CameraProcess::new(&camera.name)).collect(),
        inbox,
        manager: ServiceManager::new(),
    };
    let end = duration.map(|duration| Instant::now() + duration);
    driver.attend(end);
    let exit = driver.end();
    handle.close();
    Ok(exit)
}

struct Driver<'a> {
    config: &'a Config,
    launcher: Launcher<'a>,
    cameras: Vec<CameraProcess>,
    /// Signals that have come.
    inbox: Receiver<i32>,
    manager: ServiceManager,
}

impl Driver<'_> {
    /// Looks after the processes until a signal, the end of the time, or until no camera can work.
    fn attend(&mut self, end: Option<Instant>) {
        let mut next_tick = Instant::now() + TICK;
        let mut awake = Instant::now();
        loop {
            let now = Instant::now();
            // Who was stopped, or the whole machine, has missed what was said meanwhile: that is no silence of others.
            if now.duration_since(awake) > PAUSE {
                self.cameras.iter_mut().for_each(|camera| camera.listen_anew(now));
            }
            awake = now;
            self.reap(now);
            for camera in &mut self.cameras {
                camera.start_where_due(&self.launcher, now);
                camera.look(&self.config.ipc.settings, now);
            }
            self.manager
                .attend(&self.cameras.iter().map(CameraProcess::condition).collect::<Vec<Condition>>());
            self.cameras.iter_mut().for_each(CameraProcess::kill_where_hung);
            if self.cameras.iter().all(CameraProcess::is_hopeless) {
                tracing::error!("no camera can be used: the driver ends");
                return;
            }
            if end.is_some_and(|end| now >= end) {
                return;
            }
            if now >= next_tick {
                next_tick = now + TICK;
                // One that starts cleans up by itself: two would be in each other's way.
                if !self.cameras.iter().any(CameraProcess::is_starting) {
                    uvcam_shm_ipc::cleanup_dead_nodes(&self.config.ipc.settings);
                }
                log::show_status(
                    &self.cameras.iter().map(CameraProcess::status).collect::<Vec<_>>().join(" | "),
                );
            }
            let wake = end.map_or(now + GLANCE, |end| end.min(now + GLANCE));
            match self.inbox.recv_timeout(wake.saturating_duration_since(Instant::now())) {
                Ok(SIGHUP) => self.cameras.iter_mut().for_each(CameraProcess::read_mask),
                Ok(SIGCHLD) | Err(RecvTimeoutError::Timeout) => {}
                Ok(_) | Err(RecvTimeoutError::Disconnected) => return,
            }
        }
    }

    /// Takes note of processes that have ended, and gives free at once what they held, before others come in their place.
    fn reap(&mut self, now: Instant) {
        let ended = self.cameras.iter_mut().filter_map(|camera| camera.reap(now).then_some(())).count();
        if ended > 0 {
            uvcam_shm_ipc::cleanup_dead_nodes(&self.config.ipc.settings);
        }
    }

    /// Ends the processes. Done where every camera streamed; else the exit code of the first that did not.
    fn end(&mut self) -> Exit {
        self.manager.stopping();
        self.cameras.iter().for_each(CameraProcess::stop);
        self.wait_for_the_end(FAREWELL);
        for camera in self.cameras.iter_mut().filter(|camera| camera.is_running()) {
            camera.kill("it does not end");
        }
        self.wait_for_the_end(LAST_FAREWELL);
        let end = Instant::now() + LAST_FAREWELL;
        self.cameras.iter().for_each(|camera| camera.finish(end));
        uvcam_shm_ipc::cleanup_dead_nodes(&self.config.ipc.settings);
        self.cameras.iter().map(CameraProcess::exit).find(|exit| *exit != Exit::Done).unwrap_or(Exit::Done)
    }

    fn wait_for_the_end(&mut self, patience: Duration) {
        let end = Instant::now() + patience;
        loop {
            let now = Instant::now();
            let running = self.cameras.iter_mut().filter_map(|camera| {
                camera.reap_quietly();
                camera.is_running().then_some(())
            });
            if running.count() == 0 || now >= end {
                return;
            }
            // A signal for the main process, the end of another one, or time for a look.
            let _ = self.inbox.recv_timeout(GLANCE.min(end.saturating_duration_since(now)));
        }
    }
}
