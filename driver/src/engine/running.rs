//! A camera as the main thread sees it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use uvcam_shm_ipc::monotonic_ns;

use super::Event;
use super::worker::Worker;
use crate::config::{CameraConfig, Config, MaskChoice, MaskMode};
use crate::counters::Counters;
use crate::error::{Error, with_causes};
use crate::frame_path::Command;
use crate::health::Reporter;
use crate::mask::{MaskInForce, MaskService};
use crate::memory;
use crate::service_manager::Condition;
use crate::supervise::{State, Supervisor};
use crate::thread::spawn;
use crate::told::Told;

/// A camera's thread from which nothing was heard for this long is stuck: the longest calls of a library give up after five seconds.
const STUCK: Duration = Duration::from_secs(10);
/// A camera that streams for this long works; what it did before is forgotten by the log.
const STEADY: Duration = Duration::from_secs(10);
/// Time between looks at a thread that is to end.
const NAP: Duration = Duration::from_millis(1);

/// A camera, its thread and its worker.
pub(super) struct Running {
    pub(super) config: CameraConfig,
    counters: Arc<Counters>,
    pub(super) worker: Worker,
    state: Option<State>,
    is_stuck: bool,
    commands: Sender<Command>,
    thread: JoinHandle<()>,
    masks: Arc<MaskService>,
    health: Reporter,
    told: Told,
    started: Instant,
    /// When it entered its state.
    since: Instant,
    /// Whether it did so because somebody asked for a mask.
    is_asked: bool,
    /// CLOCK_MONOTONIC in ns, and the frames published, at the last tick.
    last_tick: (u64, u64),
    frame_rate: f64,
}

impl Running {
    /// Starts the camera with this index in the configuration.
    ///
    /// # Errors
    /// [`Error::Ipc`] where another driver runs it; [`Error::System`] where the system gives no thread.
    pub(super) fn start(
        camera_index: usize,
        camera: &CameraConfig,
        config: &Config,
        events: &Sender<Event>,
        stop: &Arc<AtomicBool>,
    ) -> Result<Self, Error> {
        // First of all: a driver that finds another one in its place opens no camera.
        let mut health = Reporter::open(config, camera)?;
        let worker = Worker::start(&camera.name)?;
        let (commands, inbox) = channel();
        let counters = Arc::new(Counters::default());
        let supervisor = Supervisor::new(
            camera_index,
            camera.clone(),
            config.ipc.clone(),
            inbox,
            Box::new({
                let events = events.clone();
                // Nobody listens only while the driver ends.
                move |notice| drop(events.send(Event::Camera(notice)))
            }),
            counters.clone(),
            stop.clone(),
        );
        let masks = supervisor.masks();
        counters.live();
        let (realtime, name) = (camera.realtime.clone(), camera.name.clone());
        let thread = spawn(&camera.name, move || {
            realtime.apply(&name);
            supervisor.run();
        })?;
        health.publish(&counters);
        Ok(Running {
            config: camera.clone(),
            counters,
            worker,
            state: None,
            is_stuck: false,
            commands,
            thread,
            masks,
            health,
            told: Told::default(),
            started: Instant::now(),
            since: Instant::now(),
            is_asked: false,
            last_tick: (monotonic_ns(), 0),
            frame_rate: 0.0,
        })
    }

    /// Waits for the end of the camera's thread, which was told to stop, until `farewell`; not for one that is stuck. Then sums up.
    pub(super) fn end(&mut self, farewell: Instant) {
        while !self.thread.is_finished() && !self.is_stuck && Instant::now() < farewell {
            std::thread::sleep(NAP);
        }
        if !self.thread.is_finished() {
            tracing::error!("{}: its thread is stuck and left behind", self.config.name);
        }
        self.health.set_stopped();
        self.health.publish(&self.counters);
        self.summarise();
    }

    /// Takes a new state.
    pub(super) fn enter(&mut self, state: State) {
        self.health.set_state(&state);
        self.health.publish(&self.counters);
        self.since = Instant::now();
        let is_generating = |state: &State| matches!(state, State::Generating);
        self.is_asked = is_generating(&state) || self.state.as_ref().is_some_and(is_generating);
        self.state = Some(state);
    }

    /// Tells of its state, unless that is no news. Where the driver goes on, a camera that failed is tried again.
    pub(super) fn report(&mut self, goes_on: bool) {
        let Some(state) = &self.state else { return };
        let text = match state {
            State::Streaming(device) => {
                format!("streaming, {device}, {}", describe_mask(&self.config))
            }
            State::Generating => "publishes nothing while lit frames are collected for a mask".into(),
            State::Waiting(error) => with_causes(error),
            State::Refused(error) => format!("publishes nothing: {}", with_causes(error)),
        };
        let due = if self.is_asked { Some(text) } else { self.told.due(&text, Instant::now()) };
        let Some(text) = due.map(|text| format!("{}: {text}", self.config.name)) else { return };
        match state {
            State::Streaming(_) | State::Generating => tracing::info!("{text}"),
            State::Waiting(_) if goes_on => tracing::warn!("{text}; trying again"),
            State::Waiting(_) => tracing::warn!("{text}"),
            State::Refused(_) => tracing::error!("{text}"),
        }
    }

    /// A camera that never worked and does not work now. One that has worked is waited for.
    pub(super) fn is_hopeless(&self) -> bool {
        match &self.state {
            None | Some(State::Streaming(_) | State::Generating) => false,
            Some(State::Refused(_)) => true,
            Some(State::Waiting(_)) => self.counters.published.load(Ordering::Relaxed) == 0,
        }
    }

    /// Why it publishes nothing.
    pub(super) fn trouble(&self) -> Option<&Error> {
        match &self.state {
            Some(State::Waiting(error) | State::Refused(error)) => Some(error),
            None | Some(State::Streaming(_) | State::Generating) => None,
        }
    }

    /// What a service manager hears of it.
    pub(super) fn condition(&self) -> Condition {
        let name = &self.config.name;
        let words = match &self.state {
            _ if self.is_stuck => format!("{name} stuck"),
            None => format!("{name} starting"),
            Some(State::Streaming(_)) => {
                format!("{name} streaming, {} lost", self.counters.lost.load(Ordering::Relaxed))
            }
            Some(State::Generating) => format!("{name} generating"),
            Some(State::Waiting(error)) => format!("{name} reconnecting: {}", with_causes(error)),
            Some(State::Refused(error)) => format!("{name} refused: {}", with_causes(error)),
        };
        Condition {
            published: self.counters.published.load(Ordering::Relaxed),
            is_tried: self.state.is_some() || self.started.elapsed() >= STUCK,
            is_stuck: self.is_stuck,
            words,
        }
    }

    /// Keeps the books of the second that has passed.
    pub(super) fn tick(&mut self, config: &Config) {
        let now = (monotonic_ns(), self.counters.published.load(Ordering::Relaxed));
        let seconds = now.0.saturating_sub(self.last_tick.0).max(1) as f64 * 1e-9;
        self.frame_rate = now.1.saturating_sub(self.last_tick.1) as f64 / seconds;
        self.last_tick = now;
        self.health.set_frame_rate(self.frame_rate);
        self.watch(now.0);
        if let Some(text) = memory::nearly_all_taken().and_then(|text| self.told.due(&text, Instant::now())) {
            tracing::warn!("{}: {text}", self.config.name);
        }
        self.keep_findable(config);
        self.health.publish(&self.counters);
        if matches!(self.state, Some(State::Streaming(_))) && !self.is_stuck && self.since.elapsed() >= STEADY
        {
            match self.told.forget() {
                0 => {}
                untold => tracing::info!(
                    "{}: streaming for {} s (messages not told before: {untold})",
                    self.config.name,
                    STEADY.as_secs()
                ),
            }
        }
    }

    /// Makes anew what clients no longer find; frames at their next boundary.
    fn keep_findable(&mut self, config: &Config) {
        if self.counters.has_lost_footing() {
            tracing::warn!(
                "{}: files of its shared memory were removed by another program, and are made anew; see `uvcam doctor`",
                self.config.name
            );
            if let Err(error) = self.command(Command::Republish) {
                tracing::error!("{}: {error}", self.config.name);
            }
        }
        self.health.keep_open(config, &self.config);
        self.masks.keep_open();
    }

    /// Gives health record and mask to readers that have come since.
    pub(super) fn serve_newcomers(&self) {
        self.masks.serve_newcomers();
        self.health.serve_newcomers();
    }

    /// Looks whether the camera's thread is stuck in a call of a library, or free again.
    fn watch(&mut self, now_ns: u64) {
        let silent = Duration::from_nanos(now_ns.saturating_sub(self.counters.last_sign_of_life_ns()));
        // A thread that collects lit frames is watched by whoever requested them.
        let is_stuck = silent > STUCK && !matches!(self.state, Some(State::Generating));
        if is_stuck {
            let text = format!("nothing heard of its thread for {} s", silent.as_secs());
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
    pub(super) fn status(&self) -> String {
        let lost = self.counters.lost.load(Ordering::Relaxed);
        format!("{} {:.0} fps, {lost} lost", self.config.name, self.frame_rate)
    }

    /// Asks something of the camera's thread.
    ///
    /// # Errors
    /// [`Error::Panicked`] where it is gone.
    pub(super) fn command(&self, command: Command) -> Result<(), Error> {
        self.commands.send(command).map_err(|_| Error::Panicked {
            part: "the camera's thread",
            cause: "it takes no commands; start the driver again".into(),
        })
    }

    /// Flies the mask from the next frame on; consumers get it before.
    ///
    /// # Errors
    /// [`Error::Ipc`] where it cannot be given to them, and those of [`Running::command`].
    pub(super) fn fly(&self, mask: MaskInForce) -> Result<(), Error> {
        let id = mask.as_ref().map_or_else(|| "none".into(), |mask| mask.id().to_string());
        self.masks.give(&mask)?;
        self.command(Command::Mask(mask))?;
        tracing::info!("{}: mask {id} from the next frame on", self.config.name);
        Ok(())
    }

    fn summarise(&self) {
        let count = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        let counters = &self.counters;
        tracing::info!(
            "{}: {} frames published, {} lost ({} of them incomplete), no free slot {} times, {} epochs",
            self.config.name,
            count(&counters.published),
            count(&counters.lost),
            count(&counters.incomplete),
            count(&counters.no_free_slot),
            count(&counters.epochs)
        );
    }
}

fn describe_mask(camera: &CameraConfig) -> String {
    match (&camera.mask, camera.mask_mode) {
        (MaskChoice::None, _) => "WITHOUT a mask (mask = \"none\")".into(),
        (MaskChoice::File(path), MaskMode::Blank) => format!("masked with {}", path.display()),
        (MaskChoice::File(path), MaskMode::Attach) => {
            format!("NOT BLANKED, with {} beside the frames (mask_mode = \"attach\")", path.display())
        }
    }
}
