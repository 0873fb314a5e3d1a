//! `uvcam run`: the driver.
//!
//! The main thread only listens: to signals, to the cameras' threads, and to the clock. What is slow (reading masks, cleaning
//! up after killed consumers) happens here, away from the frames.

use std::io::{IsTerminal, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use signal_hook::iterator::backend::Handle;
use uvcam_shm_ipc::monotonic_ns;

use crate::args;
use crate::config::{CameraConfig, Config, MaskChoice};
use crate::counters::Counters;
use crate::error::{Error, with_causes};
use crate::exit::Exit;
use crate::frame_path::Command;
use crate::generator::Progress;
use crate::health::Reporter;
use crate::mask;
use crate::realtime;
use crate::supervise::{Notice, State, Supervisor};

mod service;
mod service_manager;

use service::{Collected, Service};
use service_manager::ServiceManager;

/// How often the main thread looks after dead consumers and its status line.
const TICK: Duration = Duration::from_secs(1);

/// How often it looks for questions.
const GLANCE: Duration = Duration::from_millis(200);

/// A camera's thread from which nothing was heard for this long is stuck: the longest calls of a library give up after five seconds.
const STUCK_NS: u64 = 10_000_000_000;

/// How long the driver's end waits for a camera's thread.
const FAREWELL: Duration = Duration::from_secs(10);

/// What the main thread hears of.
enum Event {
    Signal(i32),
    Camera(Notice),
    Collected(Box<Collected>),
    Progress { place: usize, progress: Progress },
}

/// A camera as the main thread sees it.
struct Running {
    config: CameraConfig,
    commands: Sender<Command>,
    counters: Arc<Counters>,
    thread: Option<JoinHandle<()>>,
    state: Option<State>,
    health: Reporter,
    is_stuck: bool,
    /// CLOCK_MONOTONIC in ns, and the frames published, at the last tick.
    last_tick: (u64, u64),
    frame_rate: f64,
}

pub(super) fn execute(arguments: &args::Run, config: &Config) -> Result<Exit, Error> {
    realtime::lock_memory();
    let (events, inbox) = channel();
    let signals = listen(events.clone())?;
    let stop = Arc::new(AtomicBool::new(false));
    let started = config.cameras.iter().enumerate();
    let mut cameras = started
        .map(|(place, camera)| start(place, camera, config, &events, &stop))
        .collect::<Result<Vec<_>, Error>>()?;
    let mut service = Service::open(config, events)?;

    let end = arguments.duration.map(|seconds| Instant::now() + Duration::from_secs_f64(seconds));
    let mut manager = ServiceManager::new();
    let exit = attend(&mut cameras, &mut service, &mut manager, config, &inbox, end);

    manager.stopping();
    stop.store(true, Ordering::Relaxed);
    for camera in &mut cameras {
        camera.join();
        camera.health.set_stopped();
        camera.health.publish(&camera.counters);
        summarise(camera);
    }
    signals.close();
    Ok(exit)
}

fn listen(events: Sender<Event>) -> Result<Handle, Error> {
    let mut signals = Signals::new([SIGINT, SIGTERM, SIGHUP]).map_err(|source| Error::System {
        doing: "listening to",
        path: "signals".into(),
        source,
    })?;
    let handle = signals.handle();
    spawn("signals", move || {
        for signal in signals.forever() {
            // Nobody listens only while the driver ends.
            let _ = events.send(Event::Signal(signal));
        }
    })?;
    Ok(handle)
}

fn start(
    place: usize,
    camera: &CameraConfig,
    config: &Config,
    events: &Sender<Event>,
    stop: &Arc<AtomicBool>,
) -> Result<Running, Error> {
    // First of all: a driver that finds another one in its place opens no camera.
    let mut health = Reporter::open(config, camera)?;
    let (commands, orders) = channel();
    let counters = Arc::new(Counters::default());
    let supervisor = Supervisor::new(
        place,
        camera.clone(),
        config.ipc.clone(),
        orders,
        Box::new({
            let events = events.clone();
            // Nobody listens only while the driver ends.
            move |notice| drop(events.send(Event::Camera(notice)))
        }),
        counters.clone(),
        stop.clone(),
    );
    counters.live();
    let (realtime, name) = (camera.realtime.clone(), camera.name.clone());
    let thread = spawn(&camera.name, move || {
        realtime.apply(&name);
        supervisor.run();
    })?;
    health.publish(&counters);
    Ok(Running {
        config: camera.clone(),
        commands,
        counters,
        thread: Some(thread),
        state: None,
        health,
        is_stuck: false,
        last_tick: (monotonic_ns(), 0),
        frame_rate: 0.0,
    })
}

fn spawn(name: &str, body: impl FnOnce() + Send + 'static) -> Result<JoinHandle<()>, Error> {
    std::thread::Builder::new().name(name.into()).spawn(body).map_err(|source| Error::System {
        doing: "starting thread",
        path: name.into(),
        source,
    })
}

/// Serves the running cameras until a signal, the end of the time, or until none of them can work.
fn attend(
    cameras: &mut [Running],
    service: &mut Service,
    manager: &mut ServiceManager,
    config: &Config,
    inbox: &Receiver<Event>,
    end: Option<Instant>,
) -> Exit {
    let mut next_tick = Instant::now() + TICK;
    loop {
        let wake = next_tick.min(Instant::now() + GLANCE);
        let wake = end.map_or(wake, |end| end.min(wake));
        match inbox.recv_timeout(wake.saturating_duration_since(Instant::now())) {
            Ok(Event::Signal(SIGHUP)) => reload_masks(cameras),
            Ok(Event::Signal(_)) => return how_it_went(cameras),
            Ok(Event::Camera(notice)) => {
                if let Some(camera) = cameras.get_mut(notice.camera) {
                    camera.enter(notice.state);
                }
                if cameras.iter().all(is_hopeless) {
                    tracing::error!("no camera can be used: giving up");
                    return how_it_went(cameras);
                }
            }
            Ok(Event::Progress { place, progress }) => service.tell(place, progress),
            Ok(Event::Collected(collected)) => service.conclude(*collected, cameras),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return how_it_went(cameras),
        }
        service.attend(cameras);
        let now = Instant::now();
        if end.is_some_and(|end| now >= end) {
            return how_it_went(cameras);
        }
        if now >= next_tick {
            next_tick += TICK;
            uvcam_shm_ipc::cleanup_dead_nodes(&config.ipc.settings);
            cameras.iter_mut().for_each(|camera| camera.tick(config));
            service.keep_open(config);
            show_status(cameras);
        }
        cameras.iter().for_each(|camera| camera.health.serve_newcomers());
        manager.attend(cameras);
    }
}

/// A camera that never worked and does not work now. One that has worked is waited for.
fn is_hopeless(camera: &Running) -> bool {
    match &camera.state {
        None | Some(State::Streaming | State::Generating) => false,
        Some(State::Refused(_)) => true,
        Some(State::Waiting(_)) => camera.counters.published.load(Ordering::Relaxed) == 0,
    }
}

/// Done where every camera streams; else the exit code of the first that does not.
fn how_it_went(cameras: &[Running]) -> Exit {
    let troubles = cameras.iter().filter_map(|camera| match &camera.state {
        Some(State::Waiting(error) | State::Refused(error)) => Some(error.exit()),
        None | Some(State::Streaming | State::Generating) => None,
    });
    troubles.into_iter().next().unwrap_or(Exit::Done)
}

fn report(camera: &Running, state: &State) {
    let name = &camera.config.name;
    match state {
        State::Streaming => tracing::info!("{name}: streaming, {}", describe_mask(&camera.config.mask)),
        State::Generating => {
            tracing::info!("{name}: publishes nothing while lit frames are collected for a mask")
        }
        State::Waiting(error) => tracing::warn!("{name}: {}; trying again", with_causes(error)),
        State::Refused(error) => tracing::error!("{name}: publishes nothing: {}", with_causes(error)),
    }
}

fn describe_mask(mask: &MaskChoice) -> String {
    match mask {
        MaskChoice::None => "WITHOUT a mask (mask = \"none\")".into(),
        MaskChoice::File(path) => format!("masked with {}", path.display()),
    }
}

/// Reads every mask anew. One that cannot fly is reported, and the mask in force stays.
fn reload_masks(cameras: &[Running]) {
    for camera in cameras {
        if let Err(error) = camera.reload_mask() {
            tracing::error!("{}: {}; what was in force stays", camera.config.name, with_causes(&error));
        }
    }
}

impl Running {
    /// Waits for the end of the camera's thread; not for one that is stuck.
    fn join(&mut self) {
        let Some(thread) = self.thread.take() else { return };
        let end = Instant::now() + FAREWELL;
        while !thread.is_finished() && Instant::now() < end {
            std::thread::sleep(Duration::from_millis(1));
        }
        if !thread.is_finished() {
            tracing::error!("{}: its thread is stuck and left behind", self.config.name);
        } else if thread.join().is_err() {
            tracing::error!("{}: its thread ended by a panic", self.config.name);
        }
    }

    fn enter(&mut self, state: State) {
        // A camera that is looked for ten times a second is not spoken of as often.
        if self.state.as_ref().is_none_or(|before| !before.says_the_same(&state)) {
            report(self, &state);
        }
        self.health.set_state(&state);
        self.health.publish(&self.counters);
        self.state = Some(state);
    }

    /// Keeps the books of the second that has passed.
    fn tick(&mut self, config: &Config) {
        let now = (monotonic_ns(), self.counters.published.load(Ordering::Relaxed));
        let seconds = now.0.saturating_sub(self.last_tick.0).max(1) as f64 * 1e-9;
        self.frame_rate = now.1.saturating_sub(self.last_tick.1) as f64 / seconds;
        self.last_tick = now;
        self.health.set_frame_rate(self.frame_rate);
        self.watch(now.0);
        if self.counters.has_lost_footing() {
            tracing::warn!(
                "{}: files of its shared memory were removed by another program, and are made anew; see `uvcam doctor`",
                self.config.name
            );
            // The thread is gone only where it panicked, which is reported at the end.
            let _ = self.commands.send(Command::Republish);
        }
        self.health.keep_open(config, &self.config);
        self.health.publish(&self.counters);
    }

    /// Looks whether the camera's thread is stuck in a call of a library, or free again.
    fn watch(&mut self, now_ns: u64) {
        let silent_ns = now_ns.saturating_sub(self.counters.last_sign_of_life_ns());
        // A thread that collects lit frames is watched by whoever ordered them.
        let is_stuck = silent_ns > STUCK_NS && !matches!(self.state, Some(State::Generating));
        if is_stuck {
            let text = format!("nothing heard of its thread for {} s", silent_ns / 1_000_000_000);
            if !self.is_stuck {
                tracing::error!(
                    "{}: {text}: a call into the camera's library does not return",
                    self.config.name
                );
            }
            self.health.set_stuck(&text);
        } else if self.is_stuck {
            tracing::warn!("{}: its thread goes on", self.config.name);
            if let Some(state) = &self.state {
                self.health.set_state(state);
            }
        }
        self.is_stuck = is_stuck;
    }

    /// The camera in a few words.
    fn status(&self) -> String {
        let lost = self.counters.lost.load(Ordering::Relaxed);
        format!("{} {:.0} fps, {lost} lost", self.config.name, self.frame_rate)
    }

    /// Reads the mask anew, and flies it from the next frame on.
    fn reload_mask(&self) -> Result<(), Error> {
        let mask = mask::load(&self.config)?;
        let id = mask.as_ref().map_or_else(|| "none".into(), |mask| mask.id().to_string());
        tracing::info!("{}: mask {id} from the next frame on", self.config.name);
        // The thread is gone only where it panicked, which is reported at the end.
        let _ = self.commands.send(Command::Mask(mask));
        Ok(())
    }
}

fn show_status(cameras: &[Running]) {
    let mut stderr = std::io::stderr();
    if stderr.is_terminal() {
        let status = cameras.iter().map(Running::status).collect::<Vec<_>>().join(" | ");
        // A status line that cannot be written is no reason to stop flying.
        let _ = write!(stderr, "\r\x1b[K{status}\r");
    }
}

fn summarise(camera: &Running) {
    let count = |counter: &std::sync::atomic::AtomicU64| counter.load(Ordering::Relaxed);
    let counters = &camera.counters;
    tracing::info!(
        "{}: {} frames published, {} lost ({} of them incomplete), no free slot {} times, {} epochs",
        camera.config.name,
        count(&counters.published),
        count(&counters.lost),
        count(&counters.incomplete),
        count(&counters.no_free_slot),
        count(&counters.epochs)
    );
}
