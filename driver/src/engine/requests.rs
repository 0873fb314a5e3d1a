//! What the running driver does for others: it reads masks anew, and generates them.
//!
//! Replies are given by the main thread, where requests are. In between are the camera's thread, which collects lit frames, and the
//! camera's [`Worker`](super::worker::Worker), which reads, computes and stores.

use std::collections::VecDeque;
use std::sync::mpsc::Sender;
use std::time::{Duration, Instant};

use uvcam_shm_ipc::control::{self, ActiveRequest, GenerateReport, GenerateRequest, Progress, Reply};

use super::Event;
use super::running::Running;
use crate::config::Config;
use crate::control::{ControlServers, failed};
use crate::error::{Error, with_causes};
use crate::frame_path::Command;
use crate::generate::{CancelToken, LitFrames, Request, Task};
use crate::mask::{self, MaskInForce};
use crate::mask_store::MaskStore;

/// How often whoever waits for a mask hears that it is still being computed.
const WORD: Duration = Duration::from_secs(1);

/// What came of a task; the mask is to be flown where it was put in force.
pub(super) struct Finished {
    pub(super) camera_index: usize,
    pub(super) outcome: Result<(GenerateReport, Option<MaskInForce>), Error>,
}

/// What is being worked on.
pub(super) struct Requests {
    servers: ControlServers,
    /// The mask that is being generated for each camera.
    generations: Vec<Option<Generation>>,
    /// Who requested that a mask be read, one for each job of the camera's worker, in their order; nobody for a signal.
    reads: Vec<VecDeque<Option<ActiveRequest>>>,
    events: Sender<Event>,
}

/// A request for a mask, and how far it is.
struct Generation {
    request: ActiveRequest,
    cancel: CancelToken,
    progress: Option<Progress>,
    /// When to say that the mask is still being computed; nothing while frames are being collected.
    next_word: Option<Instant>,
}

impl Requests {
    pub(super) fn open(config: &Config, events: Sender<Event>) -> Result<Self, Error> {
        let generations = config.cameras.iter().map(|_| None).collect();
        let reads = config.cameras.iter().map(|_| VecDeque::new()).collect();
        Ok(Requests { servers: ControlServers::open(config)?, generations, reads, events })
    }

    /// Makes anew what clients no longer find, where nobody waits for a reply.
    pub(super) fn keep_findable(&mut self, config: &Config) {
        for (camera_index, (generation, reads)) in self.generations.iter().zip(&self.reads).enumerate() {
            if generation.is_none() && reads.is_empty() {
                self.servers.keep_open(config, camera_index);
            }
        }
    }

    /// Takes new requests, and gives up work that nobody waits for any more.
    pub(super) fn attend(&mut self, cameras: &[Running]) {
        for (camera_index, active, request) in self.servers.requests() {
            let Some(camera) = cameras.get(camera_index) else { continue };
            match request {
                control::Request::ReloadMask => self.read_mask(camera_index, camera, Some(active)),
                control::Request::Generate(request) => self.generate(camera_index, camera, active, &request),
            }
        }
        let now = Instant::now();
        for generation in self.generations.iter_mut().flatten() {
            if !generation.request.is_awaited() {
                generation.cancel.cancel();
            }
            if generation.next_word.is_some_and(|next| now >= next) {
                generation.next_word = Some(now + WORD);
                generation.tell();
            }
        }
    }

    /// Nothing more is to be stored.
    pub(super) fn cancel(&self) {
        self.generations.iter().flatten().for_each(|generation| generation.cancel.cancel());
    }

    /// Reads every mask anew.
    pub(super) fn read_masks(&mut self, cameras: &[Running]) {
        for (camera_index, camera) in cameras.iter().enumerate() {
            self.read_mask(camera_index, camera, None);
        }
    }

    fn read_mask(&mut self, camera_index: usize, camera: &Running, request: Option<ActiveRequest>) {
        let Some(reads) = self.reads.get_mut(camera_index) else { return };
        let (config, events) = (camera.config.clone(), self.events.clone());
        let submitted = camera.worker.submit(
            "reading the mask",
            move || mask::load(&config),
            // Nobody listens only while the driver ends.
            move |outcome| drop(events.send(Event::MaskRead { camera_index, outcome })),
        );
        match submitted {
            Ok(()) => reads.push_back(request),
            Err(error) => refuse_mask(camera, request, &error),
        }
    }

    /// Flies a mask that was read. Where it cannot fly, what was in force stays.
    pub(super) fn fly(
        &mut self,
        camera_index: usize,
        outcome: Result<MaskInForce, Error>,
        cameras: &[Running],
    ) {
        let request = self.reads.get_mut(camera_index).and_then(VecDeque::pop_front).flatten();
        let Some(camera) = cameras.get(camera_index) else { return };
        match (outcome.and_then(|mask| camera.fly(mask)), request) {
            (Ok(()), Some(request)) => drop(request.reply(&Reply::Done.to_text())),
            (Ok(()), None) => {}
            (Err(error), request) => refuse_mask(camera, request, &error),
        }
    }

    fn generate(
        &mut self,
        camera_index: usize,
        camera: &Running,
        active: ActiveRequest,
        request: &GenerateRequest,
    ) {
        let Some(generation) = self.generations.get_mut(camera_index) else { return };
        let is_busy = generation.is_some();
        match begin(camera, request, is_busy) {
            Ok(cancel) => {
                *generation = Some(Generation { request: active, cancel, progress: None, next_word: None });
            }
            Err(error) => drop(active.reply(&failed(&error).to_text())),
        }
    }

    /// Tells whoever waits for a mask how far it is.
    pub(super) fn tell(&mut self, camera_index: usize, progress: Progress) {
        if let Some(generation) = self.generations.get_mut(camera_index).and_then(Option::as_mut) {
            generation.progress = Some(progress);
            generation.tell();
        }
    }

    /// The camera's thread panicked, and the task that it may have had is gone.
    pub(super) fn abandon(&mut self, camera_index: usize) {
        let generation = self.generations.get_mut(camera_index);
        let is_collecting = |generation: &mut Generation| generation.next_word.is_none();
        if let Some(generation) = generation.and_then(|generation| generation.take_if(is_collecting)) {
            generation.cancel.cancel();
            let cause = "see the driver's log; nothing was stored".into();
            generation.reply(&failed(&Error::Panicked { part: "the camera's thread", cause }));
        }
    }

    /// Has the mask made from the lit frames of a task.
    pub(super) fn make_mask(
        &mut self,
        camera_index: usize,
        cancel: CancelToken,
        lit_frames: Result<LitFrames, Error>,
        cameras: &[Running],
    ) {
        let Some(slot) = self.generations.get_mut(camera_index) else { return };
        // The task may be one that was given up before this one.
        let Some(generation) = slot.as_mut().filter(|it| it.cancel.is_of_same_task(&cancel)) else { return };
        let Some(camera) = cameras.get(camera_index) else { return };
        let (config, events) = (camera.config.clone(), self.events.clone());
        let submitted = lit_frames.and_then(|lit_frames| {
            camera.worker.submit(
                "computing the mask",
                move || {
                    let go_on = || if cancel.is_cancelled() { Err(Error::Stopped) } else { Ok(()) };
                    go_on()?;
                    let generated = lit_frames.generate()?;
                    go_on()?;
                    let report = generated.store(&config)?;
                    let mask = report.in_force.then(|| mask::load(&config)).transpose()?;
                    Ok((report, mask))
                },
                // Nobody listens only while the driver ends.
                move |outcome| {
                    drop(events.send(Event::Finished(Box::new(Finished { camera_index, outcome }))));
                },
            )
        });
        match submitted {
            Ok(()) => generation.next_word = Some(Instant::now() + WORD),
            Err(error) => slot.take().iter().for_each(|generation| generation.reply(&failed(&error))),
        }
    }

    /// Flies the mask that was made where it was put in force, and replies.
    pub(super) fn finish(&mut self, finished: Finished, cameras: &[Running]) {
        let Finished { camera_index, outcome } = finished;
        let Some(generation) = self.generations.get_mut(camera_index).and_then(Option::take) else { return };
        let Some(camera) = cameras.get(camera_index) else { return };
        if matches!(outcome, Err(Error::Stopped)) {
            tracing::warn!("{}: nobody waits for the mask any more; nothing was stored", camera.config.name);
            return;
        }
        let reply = outcome.and_then(|(report, mask)| {
            mask.map_or(Ok(()), |mask| camera.fly(mask))?;
            Ok(Reply::Generated { report: Box::new(report) })
        });
        generation.reply(&reply.unwrap_or_else(|error| failed(&error)));
    }
}

/// Sends a request to the camera's thread, where it can be fulfilled. Returns what ends it early.
fn begin(camera: &Running, request: &GenerateRequest, is_busy: bool) -> Result<CancelToken, Error> {
    // What cannot be stored need not be made.
    MaskStore::of(&camera.config)?;
    let request = Request::try_from((request, &camera.config.generate))?;
    if is_busy {
        let name = &camera.config.name;
        return Err(Error::Busy(format!("the mask of camera {name} is being generated: wait for it")));
    }
    let cancel = CancelToken::default();
    camera.command(Command::Generate(Box::new(Task { request, cancel: cancel.clone() })))?;
    Ok(cancel)
}

impl Generation {
    fn tell(&self) {
        if let Some(progress) = self.progress {
            self.reply(&Reply::Collecting { progress });
        }
    }

    fn reply(&self, reply: &Reply) {
        self.request.reply(&reply.to_text());
    }
}

fn refuse_mask(camera: &Running, request: Option<ActiveRequest>, error: &Error) {
    match request {
        Some(request) => drop(request.reply(&failed(error).to_text())),
        None => {
            tracing::error!("{}: {}; what was in force stays", camera.config.name, with_causes(error));
        }
    }
}
