//! What happens to a supervisor in a test, and what it did.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use uvcam_shm_ipc::control::{GenerateRequest, Method};
use uvcam_shm_ipc::{Slot, monotonic_ns};

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
use crate::supervise::time::Time;
use crate::supervise::{News, Notice, State, Supervisor};

const SLOTS: usize = 2;

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

#[derive(Clone, Default)]
pub(super) struct Journal(Arc<Mutex<Vec<String>>>);

impl Journal {
    fn write(&self, line: String) {
        self.0.lock().unwrap().push(line);
    }

    fn count(&self, what: &str) -> usize {
        self.0.lock().unwrap().iter().filter(|line| line.starts_with(what)).count()
    }
}

type Reaction = (&'static str, Box<dyn FnOnce(&Sender<Command>) + Send>);
type AfterPauses = (Duration, Box<dyn FnOnce(usize) + Send>);

/// A supervisor about to run.
pub(super) struct Rig {
    pub(super) counters: Arc<Counters>,
    pub(super) stop: Arc<AtomicBool>,
    pub(super) mask: MaskChoice,
    /// Those that there can be of the camera's frames; without any, there is no shared memory.
    pub(super) max_subscribers: usize,
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
        let passed: Arc<AtomicU64> = Arc::default();
        let source = ScriptedSource {
            openings: self.openings,
            journal: self.journal.clone(),
            stop: self.stop.clone(),
            held: self.held.map(|held| Arc::new(Mutex::new(held))),
            passed: passed.clone(),
        };
        let time = ScriptedTime {
            start: Instant::now(),
            passed,
            slept: AtomicU64::new(0),
            journal: self.journal.clone(),
            act: Mutex::new(self.after_pauses),
        };
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
        exposure_us: Some(5000.0),
        gain_db: Some(0.0),
        ..GenerateRequest::default()
    };
    let request = Request::try_from((&request, &Generate::default())).unwrap();
    Box::new(Task { request, cancel: CancelToken::default() })
}

/// Time that passes by sleep alone.
struct ScriptedTime {
    start: Instant,
    /// Nanoseconds since then.
    passed: Arc<AtomicU64>,
    /// Nanoseconds of them that were slept.
    slept: AtomicU64,
    journal: Journal,
    act: Mutex<Option<AfterPauses>>,
}

impl Time for ScriptedTime {
    fn now(&self) -> Instant {
        self.start + Duration::from_nanos(self.passed.load(Ordering::Relaxed))
    }

    fn sleep(&self, duration: Duration) {
        let ns = duration.as_nanos() as u64;
        self.passed.fetch_add(ns, Ordering::Relaxed);
        let slept = self.slept.fetch_add(ns, Ordering::Relaxed) + ns;
        self.journal.write(format!("pause {}", duration.as_millis()));
        let mut act = self.act.lock().unwrap();
        if let Some((_, act)) = act.take_if(|(after, _)| slept >= after.as_nanos() as u64) {
            act(self.journal.count("open "));
        }
        // Threads that close cameras take real time.
        std::thread::yield_now();
    }
}

struct ScriptedSource {
    openings: VecDeque<Opening>,
    journal: Journal,
    stop: Arc<AtomicBool>,
    held: Option<Arc<Mutex<Receiver<()>>>>,
    passed: Arc<AtomicU64>,
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
                self.passed.fetch_add(seconds * 1_000_000_000, Ordering::Relaxed);
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
}

impl ScriptedCamera {
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

    fn next(&mut self, _: Duration) -> Result<Event, CameraError> {
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
