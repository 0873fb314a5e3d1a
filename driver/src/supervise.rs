//! One thread a camera: opens it, walks the frame path, and opens it again when it fails.
//!
//! A camera that has no mask that can fly is left closed until a command brings another mask; everything else is tried again, at
//! once at first, then every few seconds. A camera that failed is closed on another thread.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::Duration;

use uvcam_shm_ipc::control::Progress;
use uvcam_shm_ipc::{FrameHeader, Publisher};

use crate::back_off::BackOff;
use crate::camera::kinds;
use crate::camera::source::CameraSource;
use crate::camera::{Applied, Camera, CameraError, Identity};
use crate::config::{CameraConfig, Ipc};
use crate::counters::{Counters, add};
use crate::error::{Error, panic_text};
use crate::frame_path::{Command, FramePath, Leave, Position};
use crate::generate::{CancelToken, LitFrames};
use crate::mask::{self, MaskInForce, MaskService};

mod closing;
mod lit_frames;
mod time;

use closing::Closing;
use time::{SystemClock, Time};

/// How long a waiting thread takes to see that it is to stop.
const PATIENCE: Duration = Duration::from_millis(100);

/// What a camera's thread is doing.
#[derive(Debug)]
pub enum State {
    /// Frames of this device are going out.
    Streaming(Identity),
    /// Lit frames are collected for a mask; nothing goes out.
    Generating,
    /// The camera failed and will be tried again.
    Waiting(Error),
    /// The camera stays closed: what is wrong does not change by itself.
    Refused(Error),
}

impl State {
    /// Whether the camera's thread panicked, and with it lost what it was told to do.
    pub fn is_panic(&self) -> bool {
        matches!(self, State::Waiting(Error::Panicked { .. }))
    }
}

/// What a camera's thread tells of.
#[derive(Debug)]
pub struct Notice {
    /// The camera's index in the configuration.
    pub camera_index: usize,
    /// What has happened.
    pub news: News,
}

/// What has happened to a camera.
#[derive(Debug)]
pub enum News {
    /// Its thread does something else now.
    State(State),
    /// Another lit frame came.
    Progress(Progress),
    /// Lit frames were collected for a task, or not, and the camera has its flight settings again, or failed.
    Collected(CancelToken, Box<Result<LitFrames, Error>>),
}

/// A camera's thread.
pub struct Supervisor {
    camera_index: usize,
    camera: CameraConfig,
    ipc: Ipc,
    source: Box<dyn CameraSource>,
    /// The device that was opened first: name and mask of the configuration belong to it.
    first: Option<Identity>,
    publisher: Option<Publisher>,
    masks: Arc<MaskService>,
    closing: Closing,
    commands: Receiver<Command>,
    notify: Box<dyn Fn(Notice) + Send>,
    counters: Arc<Counters>,
    stop: Arc<AtomicBool>,
    time: Box<dyn Time>,
}

impl Supervisor {
    /// Prepares the thread of the camera with this index in the configuration.
    pub fn new(
        camera_index: usize,
        camera: CameraConfig,
        ipc: Ipc,
        commands: Receiver<Command>,
        notify: Box<dyn Fn(Notice) + Send>,
        counters: Arc<Counters>,
        stop: Arc<AtomicBool>,
    ) -> Self {
        let source = kinds::source_of(&camera.source);
        let masks = Arc::new(MaskService::new(&ipc.settings, &camera.name));
        Supervisor {
            camera_index,
            camera,
            ipc,
            source,
            first: None,
            publisher: None,
            masks,
            closing: Closing::default(),
            commands,
            notify,
            counters,
            stop,
            time: Box::new(SystemClock),
        }
    }

    /// What gives the camera's mask to consumers, for whoever wants it flown.
    pub fn masks(&self) -> Arc<MaskService> {
        self.masks.clone()
    }

    /// Runs until told to stop. A panic, of the camera's library or of ours, ends an attempt as an error does: the camera is closed, and
    /// tried again.
    pub fn run(mut self) {
        let mut mask = None;
        let mut back_off = BackOff::default();
        while !self.stopped() {
            let begin = self.time.now();
            let published_before = self.published();
            // What an attempt leaves is valid at every point: the mask is set as a whole, counters are plain numbers.
            let attempt = catch_unwind(AssertUnwindSafe(|| self.work(&mut mask)));
            let Err(payload) = attempt else { break };
            // Gone with the attempt, where it held it.
            self.counters.set_footing(self.publisher.as_ref().map(|publisher| publisher.footing().clone()));
            add(&self.counters.failures, 1);
            if self.published() > published_before {
                back_off.forget();
            }
            let part = "the camera's thread";
            self.notify(State::Waiting(Error::Panicked { part, cause: panic_text(&*payload) }));
            self.pause(back_off.after_failure(begin, self.time.now()));
        }
        self.closing.finish();
    }

    fn work(&mut self, mask: &mut Option<MaskInForce>) {
        if mask.is_none() {
            *mask = self.first_mask();
        }
        if let Some(mask) = mask {
            self.keep_streaming(mask);
        }
    }

    /// Opens the camera as often as needed, until told to stop.
    fn keep_streaming(&mut self, mask: &mut MaskInForce) {
        let mut back_off = BackOff::default();
        while !self.stopped() {
            let begin = self.time.now();
            let published_before = self.published();
            let Err(error) = self.stream(mask, back_off.listening()) else { return };
            let is_absent = matches!(error, Error::Camera(CameraError::Absent { .. }));
            if !is_absent {
                add(&self.counters.failures, 1);
            }
            if self.published() > published_before {
                back_off.forget();
            }
            if error.is_final() {
                self.notify(State::Refused(error));
                match self.next_mask() {
                    Some(another) => *mask = another,
                    None => return,
                }
            } else {
                self.notify(State::Waiting(error));
                self.pause(match is_absent {
                    true => back_off.after_absence(),
                    false => back_off.after_failure(begin, self.time.now()),
                });
            }
        }
    }

    /// The mask that the configuration names, or the first one after it that can fly; nothing where the driver stops before.
    fn first_mask(&mut self) -> Option<MaskInForce> {
        match mask::load(&self.camera) {
            Ok(mask) => Some(mask),
            Err(error) => {
                self.notify(State::Refused(error));
                self.next_mask()
            }
        }
    }

    /// Waits until a command brings a mask that can fly; nothing where the driver stops before.
    fn next_mask(&mut self) -> Option<MaskInForce> {
        while !self.stopped() {
            self.counters.live();
            match self.commands.recv_timeout(PATIENCE) {
                Ok(Command::Mask(mask)) => return Some(mask),
                Ok(Command::Generate(task)) => self.generate_while_closed(*task),
                // Looked at when the next publisher is needed.
                Ok(Command::Republish) => {}
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return None,
            }
        }
        None
    }

    /// Opens the camera and publishes its frames until it fails or the driver stops.
    fn stream(&mut self, mask: &mut MaskInForce, listening: Duration) -> Result<(), Error> {
        while !self.closing.has_room() && !self.stopped() {
            self.pause(PATIENCE);
        }
        if self.stopped() {
            return Ok(());
        }
        self.counters.live();
        let mut camera = self.open()?;
        let outcome = self.stream_from(camera.as_mut(), mask, listening);
        if outcome.is_err() {
            self.closing.close(&self.camera.name, camera);
        }
        outcome
    }

    /// Opens the camera. A configuration may name a place (an address, a node), where another device can be by now.
    fn open(&mut self) -> Result<Box<dyn Camera>, CameraError> {
        let camera = self.source.open()?;
        let found = camera.identity();
        let first = self.first.get_or_insert_with(|| found.clone());
        match first.is_same_device(found) {
            true => Ok(camera),
            false => Err(CameraError::Replaced { expected: first.to_string(), found: found.to_string() }),
        }
    }

    /// Publishes the frames of an opened camera. Lit frames are collected between two epochs.
    fn stream_from(
        &mut self,
        camera: &mut dyn Camera,
        mask: &mut MaskInForce,
        listening: Duration,
    ) -> Result<(), Error> {
        loop {
            self.counters.live();
            let applied = camera.configure(&self.camera.settings)?;
            self.masks.begin(mask)?;
            let mut publisher = self.publisher_for(applied.payload_bytes)?;
            let header = self.header(&applied, mask, publisher.begin_epoch());
            let identity = camera.identity().clone();
            let mut path = FramePath {
                camera,
                applied: &applied,
                publisher: &mut publisher,
                mask,
                commands: &self.commands,
                counters: &self.counters,
                header,
                first_frame_patience: listening,
                slots: self.ipc.slots,
                position: Position::default(),
            };
            let left = path.run(&self.stop, || self.notify(State::Streaming(identity)));
            self.publisher = Some(publisher);
            match left? {
                Leave::Generate(task) => {
                    self.notify(State::Generating);
                    self.generate(camera, *task)?;
                }
                Leave::Republish => {}
                Leave::Stop => return Ok(()),
            }
        }
    }

    /// The publisher of this camera. Consumers stay connected to one that still fits and that they find; another one must be gone before
    /// its successor comes.
    fn publisher_for(&mut self, payload_bytes: usize) -> Result<Publisher, Error> {
        let fits = |publisher: &Publisher| {
            publisher.frame_bytes() == payload_bytes && publisher.footing().is_in_place()
        };
        if let Some(publisher) = self.publisher.take().filter(fits) {
            return Ok(publisher);
        }
        self.counters.set_footing(None);
        let Ipc { settings, .. } = &self.ipc;
        let publisher = Publisher::create(settings, &self.camera.name, payload_bytes, self.ipc.loans())?;
        self.counters.set_footing(Some(publisher.footing().clone()));
        Ok(publisher)
    }

    /// What stays the same over one epoch.
    fn header(&self, applied: &Applied, mask: &MaskInForce, epoch: u64) -> FrameHeader {
        let mut header =
            FrameHeader::new(applied.width, applied.height, applied.stride, applied.pixel_format);
        header.epoch = epoch;
        header.frame_period_ns = (1e9 / applied.fps) as u64;
        header.exposure_us = applied.exposure_us;
        header.gain_db = applied.gain_db;
        header.set_flag(self.source.flag(), true);
        mask::mark(&mut header, mask);
        header
    }

    fn pause(&self, duration: Duration) {
        let end = self.time.now() + duration;
        while !self.stopped() && self.time.now() < end {
            self.counters.live();
            self.time.sleep(PATIENCE.min(end.saturating_duration_since(self.time.now())));
        }
    }

    fn published(&self) -> u64 {
        self.counters.published.load(Ordering::Relaxed)
    }

    fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    fn notify(&self, state: State) {
        self.tell(News::State(state));
    }

    fn tell(&self, news: News) {
        (self.notify)(Notice { camera_index: self.camera_index, news });
    }
}

#[cfg(test)]
mod tests;
