//! What happens to a supervisor in a test, and what it did.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use uvcam_shm_ipc::control::{GenerateRequest, Method};
use uvcam_shm_ipc::{Slot, monotonic_ns};

use super::time::{Passing, ScriptedTime};
use crate::camera::source::CameraSource;
use crate::camera::{Applied, Camera, CameraError, Capture, Event, Identity, Settings};
use crate::causes::with_causes;
use crate::config::{CameraConfig, Generate, Ipc, MaskChoice, MaskMode, Simulated, Source};
use crate::counters::Counters;
use crate::frame_path::Command;
use crate::frame_path::tests::Place;
use crate::generate::{CancelToken, Request, Task};
use crate::realtime::Realtime;
use crate::supervise::closing::Closing;
use crate::supervise::{News, Notice, State, Supervisor};

const SLOTS: usize = 2;
/// Exposure time of lit frames, microseconds.
const LIT_US: f64 = 5000.0;

/// What comes of an attempt to open the camera.
#[derive(Debug, Clone, Copy)]
pub(super) enum Opening {
    /// It is not there.
    Absent,
    /// It is there after so many seconds, in which nothing else happens, and then not.
    Slow { seconds: u64 },
    /// This device is there, delivers so many frames at each start, and ends like this.
    Device { serial: &'static str, frames: u64, ending: Ending },
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Ending {
    /// It takes no settings.
    AtConfigure,
    /// It takes the flight's, and those of lit frames, and then none.
    AtThirdConfigure,
    /// It is unplugged while it streams.
    Gone,
    /// Its library panics while it streams.
    Panics,
    /// It would go on, but the driver is told to stop.
    DriverStops,
}

/// How a lit frame lets itself be waited for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Lit {
    /// It is there at once.
    AtOnce,
    /// It comes after so many seconds, and whoever waits hears in between that it has not come yet.
    Slow { seconds: u64 },
    /// The library does not return for so many seconds.
    Hang { seconds: u64 },
}

#[derive(Clone, Default)]
pub(super) struct Journal(Arc<Mutex<Vec<String>>>);

impl Journal {
    pub(super) fn write(&self, line: String) {
        self.0.lock().unwrap().push(line);
    }

    pub(super) fn count(&self, what: &str) -> usize {
        self.0.lock().unwrap().iter().filter(|line| line.starts_with(what)).count()
    }
}

type Reaction = (&'static str, Box<dyn FnOnce(&Sender<Command>) + Send>);
pub(super) type AfterPauses = (Duration, Box<dyn FnOnce(usize) + Send>);

/// A supervisor about to run.
pub(super) struct Rig {
    pub(super) counters: Arc<Counters>,
    pub(super) stop: Arc<AtomicBool>,
    pub(super) mask: MaskChoice,
    /// Those that there can be of the camera's frames; without any, there is no shared memory.
    pub(super) max_subscribers: usize,
    pub(super) lit: Lit,
    openings: VecDeque<Opening>,
    journal: Journal,
    reaction: Option<Reaction>,
    after_pauses: Option<AfterPauses>,
    held: Option<Receiver<()>>,
}

impl Rig {
    /// The driver is told to stop when the openings have come to their end.
    pub(super) fn new<const N: usize>(openings: [Opening; N]) -> Self {
        Rig {
            counters: Arc::default(),
            stop: Arc::default(),
            mask: MaskChoice::None,
            max_subscribers: 8,
            lit: Lit::AtOnce,
            openings: openings.into(),
            journal: Journal::default(),
            reaction: None,
            after_pauses: None,
            held: None,
        }
    }

    /// Reacts to the first notice that starts like this, on the supervisor's thread.
    pub(super) fn on(
        &mut self,
        notice: &'static str,
        reaction: impl FnOnce(&Sender<Command>) + Send + 'static,
    ) {
        self.reaction = Some((notice, Box::new(reaction)));
    }

    /// Acts when the supervisor has slept for so long altogether; told how many devices were opened by then.
    pub(super) fn after_pauses_of(&mut self, ms: u64, act: impl FnOnce(usize) + Send + 'static) {
        self.after_pauses = Some((Duration::from_millis(ms), Box::new(act)));
    }

    /// Cameras take until something is sent, or the sender dropped, to be closed.
    pub(super) fn hold_cameras_open(&mut self) -> Sender<()> {
        let (release, held) = channel();
        self.held = Some(held);
        release
    }

    /// Runs the supervisor to its end, and returns what happened.
    pub(super) fn run(self) -> Vec<String> {
        let place = Place::new();
        let mut ipc = Ipc { settings: place.settings.clone(), slots: SLOTS };
        ipc.settings.max_subscribers = self.max_subscribers;
        let camera = CameraConfig {
            name: "left".into(),
            source: Source::Simulated(Simulated {
                serial: "A".into(),
                still: true,
                readout_us: 0.0,
                faults: vec![],
            }),
            settings: Settings::new(8, 4, 50.0, 1000.0),
            mask: self.mask,
            mask_mode: MaskMode::default(),
            generate: Generate::default(),
            realtime: Realtime::default(),
        };
        let (send, commands) = channel();
        let journal = self.journal.clone();
        let reaction = Mutex::new(self.reaction);
        let stop = self.stop.clone();
        let notify = move |notice: Notice| {
            if stop.load(Ordering::Relaxed) {
                return;
            }
            let line = match notice.news {
                News::State(State::Streaming(identity)) => format!("streaming {}", identity.serial),
                News::State(State::Generating) => "generating".into(),
                News::State(State::Waiting(error)) => format!("waiting: {}", with_causes(&error)),
                News::State(State::Refused(error)) => format!("refused: {}", with_causes(&error)),
                News::Progress(_) => return,
                News::Collected(_, collected) => match *collected {
                    Ok(lit_frames) => format!("done: light of {}", lit_frames.serial()),
                    Err(error) => format!("done: {}", with_causes(&error)),
                },
            };
            journal.write(line.clone());
            let mut reaction = reaction.lock().unwrap();
            if let Some((_, react)) = reaction.take_if(|(start, _)| line.starts_with(*start)) {
                react(&send);
            }
        };
        let is_held = self.held.is_some();
        let passing = Arc::new(Passing::new(self.counters.clone(), self.journal.clone()));
        let source = ScriptedSource {
            openings: self.openings,
            journal: self.journal.clone(),
            stop: self.stop.clone(),
            held: self.held.map(|held| Arc::new(Mutex::new(held))),
            lit: self.lit,
            passing: passing.clone(),
        };
        let time = ScriptedTime::new(passing, self.after_pauses);
        let supervisor =
            Supervisor::new(0, camera, ipc, commands, Box::new(notify), self.counters, self.stop);
        // Without threads nothing but the script decides what comes first.
        let closing = match is_held {
            true => Closing::default(),
            false => Closing::by(|_, camera| {
                drop(camera);
                None
            }),
        };
        Supervisor { source: Box::new(source), time: Box::new(time), closing, ..supervisor }.run();
        std::mem::take(&mut self.journal.0.lock().unwrap())
    }
}

/// A task of one lit frame, of 5 ms.
pub(super) fn task() -> Box<Task> {
    let request = GenerateRequest {
        method: Method::Paper,
        exposure_us: Some(LIT_US),
        gain_db: Some(0.0),
        ..GenerateRequest::default()
    };
    let request = Request::try_from((&request, &Generate::default())).unwrap();
    Box::new(Task { request, cancel: CancelToken::default() })
}

struct ScriptedSource {
    openings: VecDeque<Opening>,
    journal: Journal,
    stop: Arc<AtomicBool>,
    held: Option<Arc<Mutex<Receiver<()>>>>,
    lit: Lit,
    passing: Arc<Passing>,
}

impl CameraSource for ScriptedSource {
    fn open(&mut self) -> Result<Box<dyn Camera>, CameraError> {
        let absent =
            || CameraError::Absent { kind: "simulated", wanted: "A".into(), found: "nothing".into() };
        let opening = self.openings.pop_front();
        match opening {
            None => {
                self.stop.store(true, Ordering::Relaxed);
                Err(absent())
            }
            Some(Opening::Absent) => Err(absent()),
            Some(Opening::Slow { seconds }) => {
                self.passing.pass(Duration::from_secs(seconds));
                Err(CameraError::Device { serial: "A".into(), doing: "opening", cause: "slowly".into() })
            }
            Some(Opening::Device { serial, frames, ending }) => {
                self.journal.write(format!("open {serial}"));
                Ok(Box::new(ScriptedCamera {
                    identity: Identity {
                        kind: "simulated",
                        vendor: String::new(),
                        model: "scripted".into(),
                        serial: serial.into(),
                        transport: "none".into(),
                        address: "none".into(),
                    },
                    frames,
                    left: 0,
                    next_id: 0,
                    ending,
                    configured: 0,
                    queued: VecDeque::new(),
                    journal: self.journal.clone(),
                    stop: self.stop.clone(),
                    held: self.held.clone(),
                    lit: self.lit,
                    is_lit: false,
                    waited: Duration::ZERO,
                    passing: self.passing.clone(),
                }))
            }
        }
    }
}

struct ScriptedCamera {
    identity: Identity,
    frames: u64,
    left: u64,
    next_id: u64,
    ending: Ending,
    configured: u32,
    queued: VecDeque<Slot>,
    journal: Journal,
    stop: Arc<AtomicBool>,
    held: Option<Arc<Mutex<Receiver<()>>>>,
    lit: Lit,
    /// Whether it was configured for lit frames.
    is_lit: bool,
    /// How long the next frame was waited for.
    waited: Duration,
    passing: Arc<Passing>,
}

impl ScriptedCamera {
    /// Lets the time pass that the next frame takes, up to `timeout`. Returns whether it is there.
    fn wait(&mut self, timeout: Duration) -> bool {
        let (seconds, at_most) = match self.lit {
            Lit::Slow { seconds } if self.is_lit => (seconds, timeout),
            Lit::Hang { seconds } if self.is_lit => (seconds, Duration::MAX),
            _ => return true,
        };
        let takes = Duration::from_secs(seconds);
        let step = (takes - self.waited).min(at_most);
        self.passing.pass(step);
        self.waited += step;
        let is_there = self.waited == takes;
        if is_there {
            self.waited = Duration::ZERO;
        }
        is_there
    }

    fn tell(&self, what: &str) {
        self.journal.write(format!("{what} {}", self.identity.serial));
    }
}

impl Camera for ScriptedCamera {
    fn identity(&self) -> &Identity {
        &self.identity
    }

    fn configure(&mut self, settings: &Settings) -> Result<Applied, CameraError> {
        self.configured += 1;
        let fails_at = match self.ending {
            Ending::AtConfigure => 1,
            Ending::AtThirdConfigure => 3,
            _ => u32::MAX,
        };
        if self.configured >= fails_at {
            let serial = self.identity.serial.clone();
            return Err(CameraError::Device { serial, doing: "configuring", cause: "by script".into() });
        }
        self.journal.write(format!("configure {}: {} us", self.identity.serial, settings.exposure_us));
        self.is_lit = settings.exposure_us == LIT_US;
        Ok(Applied::exactly(settings))
    }

    fn queue(&mut self, slot: Slot) -> Result<(), CameraError> {
        self.queued.push_back(slot);
        Ok(())
    }

    fn start(&mut self) -> Result<(), CameraError> {
        self.tell("start");
        (self.left, self.next_id) = (self.frames, 0);
        Ok(())
    }

    fn next(&mut self, timeout: Duration) -> Result<Event, CameraError> {
        if !self.wait(timeout) {
            return Ok(Event::Timeout);
        }
        let slot = match self.left {
            0 => None,
            _ => self.queued.pop_front(),
        };
        let Some(slot) = slot else {
            if self.ending == Ending::Gone {
                let serial = self.identity.serial.clone();
                return Err(CameraError::Disconnected { serial, doing: "streaming" });
            }
            if self.ending == Ending::Panics {
                panic!("by script");
            }
            self.stop.store(true, Ordering::Relaxed);
            return Ok(Event::Timeout);
        };
        self.left -= 1;
        self.next_id += 1;
        Ok(Event::Complete(Capture {
            slot,
            frame_id: self.next_id - 1,
            device_timestamp_ns: None,
            arrival_monotonic_ns: monotonic_ns(),
        }))
    }

    fn stop(&mut self) {
        self.tell("stop");
        self.queued.clear();
    }
}

impl Drop for ScriptedCamera {
    fn drop(&mut self) {
        if let Some(held) = &self.held {
            let _ = held.lock().unwrap().recv();
        }
        self.tell("close");
    }
}
