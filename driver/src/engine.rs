//! The running driver, or the part of it in one process: a thread for each camera, a worker for its files, and a main thread that waits for
//! nothing but events.
//!
//! The main thread hears signals, the cameras' threads, workers, questions of commands, and the clock. It computes nothing and reads no
//! file that a person names: what takes long, or may never return, is a worker's.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

use crate::config::Config;
use crate::error::Error;
use crate::exit::Exit;
use crate::log;
use crate::mask::MaskInForce;
use crate::realtime;
use crate::service_manager::ServiceManager;
use crate::signals;
use crate::supervise::{News, Notice, State};

mod requests;
mod running;
mod worker;

use requests::{Finished, Requests};
use running::Running;

/// How often the main thread looks after dead consumers and its status line.
const TICK: Duration = Duration::from_secs(1);
/// How often it looks for questions.
const GLANCE: Duration = Duration::from_millis(200);
/// How long the driver's end waits for the cameras' threads.
const FAREWELL: Duration = Duration::from_secs(10);

/// What the main thread hears of.
enum Event {
    Signal(i32),
    Camera(Notice),
    Finished(Box<Finished>),
    MaskRead { camera_index: usize, outcome: Result<MaskInForce, Error> },
}

/// What an engine is to the driver.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// All of it: it gives up where no camera works, and hears what is meant for the driver.
    Driver,
    /// A part: a main process hears of it and decides.
    Part,
}

/// Runs the configured cameras until a signal, the end of the time, or until none of them can work, which a part leaves to the whole.
///
/// # Errors
/// [`Error::Ipc`] where another driver runs them; [`Error::System`] where the system gives no thread or no signals.
pub fn run(config: &Config, duration: Option<Duration>, role: Role) -> Result<Exit, Error> {
    realtime::lock_memory();
    let (events, inbox) = channel();
    let signals = signals::listen(&[SIGINT, SIGTERM, SIGHUP], {
        let events = events.clone();
        // Nobody listens only while the driver ends.
        move |signal| drop(events.send(Event::Signal(signal)))
    })?;
    let stop = Arc::new(AtomicBool::new(false));
    let started = config.cameras.iter().enumerate();
    let mut cameras = started
        .map(|(index, camera)| Running::start(index, camera, config, &events, &stop))
        .collect::<Result<Vec<_>, Error>>()?;
    let mut requests = Requests::open(config, events)?;

    let end = duration.map(|duration| Instant::now() + duration);
    let mut manager = ServiceManager::new();
    let exit = attend(&mut cameras, &mut requests, &mut manager, config, &inbox, end, role);

    manager.stopping();
    requests.cancel();
    stop.store(true, Ordering::Relaxed);
    let farewell = Instant::now() + FAREWELL;
    cameras.iter_mut().for_each(|camera| camera.end(farewell));
    signals.close();
    Ok(exit)
}

/// Serves the running cameras until a signal, the end of the time, or until none of them can work.
fn attend(
    cameras: &mut [Running],
    requests: &mut Requests,
    manager: &mut ServiceManager,
    config: &Config,
    inbox: &Receiver<Event>,
    end: Option<Instant>,
    role: Role,
) -> Exit {
    let mut next_tick = Instant::now() + TICK;
    loop {
        let wake = next_tick.min(Instant::now() + GLANCE);
        let wake = end.map_or(wake, |end| end.min(wake));
        match inbox.recv_timeout(wake.saturating_duration_since(Instant::now())) {
            Ok(Event::Signal(SIGHUP)) => requests.read_masks(cameras),
            // A terminal sends it to all processes of the driver, and the main one tells the others.
            Ok(Event::Signal(SIGINT)) if role == Role::Part => {}
            Ok(Event::Signal(_)) => return how_it_went(cameras),
            Ok(Event::Camera(Notice { camera_index, news })) => match news {
                News::State(state) => {
                    if state.is_panic() {
                        requests.abandon(camera_index);
                    }
                    if !enter(cameras, camera_index, state) && role == Role::Driver {
                        tracing::error!("no camera can be used: the driver ends");
                        return how_it_went(cameras);
                    }
                }
                News::Progress(progress) => requests.tell(camera_index, progress),
                News::Collected(cancel, lit_frames) => {
                    requests.make_mask(camera_index, cancel, *lit_frames, cameras);
                }
            },
            Ok(Event::Finished(finished)) => requests.finish(*finished, cameras),
            Ok(Event::MaskRead { camera_index, outcome }) => requests.fly(camera_index, outcome, cameras),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return how_it_went(cameras),
        }
        requests.attend(cameras);
        let now = Instant::now();
        if end.is_some_and(|end| now >= end) {
            return how_it_went(cameras);
        }
        if now >= next_tick {
            next_tick += TICK;
            // One process of a driver is enough for it.
            if role == Role::Driver {
                uvcam_shm_ipc::cleanup_dead_nodes(&config.ipc.settings);
            }
            cameras.iter_mut().for_each(|camera| camera.tick(config));
            requests.keep_findable(config);
            if role == Role::Driver {
                log::show_status(&cameras.iter().map(Running::status).collect::<Vec<_>>().join(" | "));
            }
        }
        cameras.iter().for_each(Running::serve_newcomers);
        manager.attend(&cameras.iter().map(Running::condition).collect::<Vec<_>>());
    }
}

/// Takes a camera's new state. Returns whether there is a camera that works, or may.
fn enter(cameras: &mut [Running], camera_index: usize, state: State) -> bool {
    let Some(camera) = cameras.get_mut(camera_index) else { return true };
    camera.enter(state);
    let goes_on = !cameras.iter().all(Running::is_hopeless);
    if let Some(camera) = cameras.get_mut(camera_index) {
        camera.report(goes_on);
    }
    goes_on
}

/// Done where every camera streams; else the exit code of the first that does not.
fn how_it_went(cameras: &[Running]) -> Exit {
    cameras.iter().find_map(Running::trouble).map_or(Exit::Done, Error::exit)
}
