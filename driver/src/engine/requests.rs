//! What the running driver does for others: it reads masks anew, and generates them.
//!
//! Answers are given by the main thread, where requests are. In between are the camera's thread, which collects lit frames, and the
//! camera's [`Worker`](super::worker::Worker), which reads, computes and stores.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Sender;
use std::time::{Duration, Instant};

use uvcam_shm_ipc::control::ActiveRequest;

use super::Event;
use super::running::Running;
use crate::config::Config;
use crate::control::{ControlServers, Reply, Request};
use crate::error::{Error, with_causes};
use crate::frame_path::Command;
use crate::generate::{Light, Order, light};
use crate::generator::{Generator, Progress, Report, Wish, store_of};
use crate::mask::{self, MaskInForce};

/// How often whoever waits for a mask hears that it is still being computed.
const WORD: Duration = Duration::from_secs(1);

/// Lit frames of a camera, or why there are none.
pub(super) struct Collected {
    place: usize,
    cancelled: Arc<AtomicBool>,
    generator: Generator,
    light: Result<Light, Error>,
}

/// What came of a generated mask; it is to be flown where it was put in force.
pub(super) struct Made {
    place: usize,
    outcome: Result<(Report, Option<MaskInForce>), Error>,
}

/// What is being worked on.
pub(super) struct Requests {
    servers: ControlServers,
    /// The mask that is being generated for each camera.
    works: Vec<Option<Work>>,
    /// Who asked that a mask be read, one for each job of the camera's worker, in their order; nobody for a signal.
    reads: Vec<VecDeque<Option<ActiveRequest>>>,
    events: Sender<Event>,
}

struct Work {
    request: ActiveRequest,
    accept: bool,
    cancelled: Arc<AtomicBool>,
    progress: Option<Progress>,
    /// When to say that the mask is still being computed; nothing while frames are being collected.
    next_word: Option<Instant>,
}

impl Requests {
    pub(super) fn open(config: &Config, events: Sender<Event>) -> Result<Self, Error> {
        let works = config.cameras.iter().map(|_| None).collect();
        let reads = config.cameras.iter().map(|_| VecDeque::new()).collect();
        Ok(Requests { servers: ControlServers::open(config)?, works, reads, events })
    }

    /// Makes anew what clients no longer find, where nobody waits for an answer.
    pub(super) fn keep_findable(&mut self, config: &Config) {
        for (place, (work, reads)) in self.works.iter().zip(&self.reads).enumerate() {
            if work.is_none() && reads.is_empty() {
                self.servers.keep_open(config, place);
            }
        }
    }

    /// Takes new requests, and gives up work that nobody waits for any more.
    pub(super) fn attend(&mut self, cameras: &[Running]) {
        for (place, request, wanted) in self.servers.requests() {
            let Some(camera) = cameras.get(place) else { continue };
            match wanted {
                Request::ReloadMask => self.read(place, camera, Some(request)),
                Request::Generate { wish, accept } => self.order(place, camera, request, wish, accept),
            }
        }
        let now = Instant::now();
        for work in self.works.iter_mut().flatten() {
            if !work.request.is_awaited() {
                // Relaxed: the flag carries no data.
                work.cancelled.store(true, Ordering::Relaxed);
            }
            if work.next_word.is_some_and(|next| now >= next) {
                work.next_word = Some(now + WORD);
                work.tell();
            }
        }
    }

    /// Nothing more is to be stored.
    pub(super) fn cancel(&self) {
        self.works.iter().flatten().for_each(|work| work.cancelled.store(true, Ordering::Relaxed));
    }

    /// Reads every mask anew.
    pub(super) fn read_masks(&mut self, cameras: &[Running]) {
        for (place, camera) in cameras.iter().enumerate() {
            self.read(place, camera, None);
        }
    }

    fn read(&mut self, place: usize, camera: &Running, asked: Option<ActiveRequest>) {
        let Some(reads) = self.reads.get_mut(place) else { return };
        let (config, events) = (camera.config.clone(), self.events.clone());
        let ordered = camera.worker.order(
            "reading the mask",
            move || mask::load(&config),
            // Nobody listens only while the driver ends.
            move |outcome| drop(events.send(Event::MaskRead { place, outcome })),
        );
        match ordered {
            Ok(()) => reads.push_back(asked),
            Err(error) => refuse_mask(camera, asked, &error),
        }
    }

    /// Flies a mask that was read. Where it cannot fly, what was in force stays.
    pub(super) fn fly(&mut self, place: usize, outcome: Result<MaskInForce, Error>, cameras: &[Running]) {
        let asked = self.reads.get_mut(place).and_then(VecDeque::pop_front).flatten();
        let Some(camera) = cameras.get(place) else { return };
        match (outcome.and_then(|mask| camera.fly(mask)), asked) {
            (Ok(()), Some(request)) => Reply::Done.send(&request),
            (Ok(()), None) => {}
            (Err(error), asked) => refuse_mask(camera, asked, &error),
        }
    }

    fn order(&mut self, place: usize, camera: &Running, request: ActiveRequest, wish: Wish, accept: bool) {
        let cancelled = Arc::new(AtomicBool::new(false));
        let ordered = self.try_order(place, camera, wish, &cancelled);
        match (ordered, self.works.get_mut(place)) {
            (Ok(()), Some(work)) => {
                *work = Some(Work { request, accept, cancelled, progress: None, next_word: None });
            }
            (Err(error), _) => Reply::failed(&error).send(&request),
            (Ok(()), None) => {}
        }
    }

    fn try_order(
        &self,
        place: usize,
        camera: &Running,
        wish: Wish,
        cancelled: &Arc<AtomicBool>,
    ) -> Result<(), Error> {
        store_of(&camera.config)?;
        wish.check(&camera.config.generate)?;
        let (exposure_us, gain_db) = light(&wish, &camera.config.generate)?;
        if self.works.get(place).is_none_or(Option::is_some) {
            let name = &camera.config.name;
            return Err(Error::Busy(format!("the mask of camera {name} is being generated: wait for it")));
        }
        let events = self.events.clone();
        let order = Order {
            exposure_us,
            gain_db,
            generator: Generator::new(wish, &camera.config.generate),
            progress: Box::new({
                let events = events.clone();
                // Nobody listens only while the driver ends.
                move |progress| drop(events.send(Event::Progress { place, progress }))
            }),
            cancelled: cancelled.clone(),
            done: Box::new({
                let cancelled = cancelled.clone();
                move |generator, light| {
                    let collected = Collected { place, cancelled, generator, light };
                    // Nobody listens only while the driver ends.
                    let _ = events.send(Event::Collected(Box::new(collected)));
                }
            }),
        };
        camera.command(Command::Generate(Box::new(order)))
    }

    /// Tells whoever waits for a mask how far it is.
    pub(super) fn tell(&mut self, place: usize, progress: Progress) {
        if let Some(work) = self.works.get_mut(place).and_then(Option::as_mut) {
            work.progress = Some(progress);
            work.tell();
        }
    }

    /// The camera's thread panicked, and the order for lit frames that it may have had is gone.
    pub(super) fn abandon(&mut self, place: usize) {
        let work = self.works.get_mut(place).and_then(|work| work.take_if(|work| work.next_word.is_none()));
        if let Some(work) = work {
            work.cancelled.store(true, Ordering::Relaxed);
            let cause = "see the driver's log; nothing was stored".into();
            Reply::failed(&Error::Panicked { part: "the camera's thread", cause }).send(&work.request);
        }
    }

    /// Orders the mask from the lit frames.
    pub(super) fn conclude(&mut self, collected: Collected, cameras: &[Running]) {
        let Collected { place, cancelled, generator, light } = collected;
        let Some(slot) = self.works.get_mut(place) else { return };
        // The order may be one that was given up before this one.
        let Some(work) = slot.as_mut().filter(|work| Arc::ptr_eq(&work.cancelled, &cancelled)) else {
            return;
        };
        let Some(camera) = cameras.get(place) else { return };
        let (accept, config, events) = (work.accept, camera.config.clone(), self.events.clone());
        let ordered = light.and_then(|light| {
            camera.worker.order(
                "computing the mask",
                move || {
                    let go_on = || match cancelled.load(Ordering::Relaxed) {
                        true => Err(Error::Stopped),
                        false => Ok(()),
                    };
                    go_on()?;
                    let generated = generator.finish(Some(light.applied.exposure_us))?;
                    go_on()?;
                    let report = generated.store(&config, light.provenance(), accept)?;
                    let mask = report.in_force.then(|| mask::load(&config)).transpose()?;
                    Ok((report, mask))
                },
                // Nobody listens only while the driver ends.
                move |outcome| drop(events.send(Event::Made(Box::new(Made { place, outcome })))),
            )
        });
        match ordered {
            Ok(()) => work.next_word = Some(Instant::now() + WORD),
            Err(error) => {
                let request = slot.take().map(|work| work.request);
                request.iter().for_each(|request| Reply::failed(&error).send(request));
            }
        }
    }

    /// Flies the mask that was made where it was put in force, and answers.
    pub(super) fn answer(&mut self, made: Made, cameras: &[Running]) {
        let Made { place, outcome } = made;
        let Some(work) = self.works.get_mut(place).and_then(Option::take) else { return };
        let Some(camera) = cameras.get(place) else { return };
        if matches!(outcome, Err(Error::Stopped)) {
            tracing::warn!("{}: nobody waits for the mask any more; nothing was stored", camera.config.name);
            return;
        }
        let reply = outcome.and_then(|(report, mask)| {
            mask.map_or(Ok(()), |mask| camera.fly(mask))?;
            Ok(Reply::Generated { report: Box::new(report) })
        });
        reply.unwrap_or_else(|error| Reply::failed(&error)).send(&work.request);
    }
}

impl Work {
    fn tell(&self) {
        if let Some(progress) = self.progress {
            Reply::Collecting { progress }.send(&self.request);
        }
    }
}

fn refuse_mask(camera: &Running, asked: Option<ActiveRequest>, error: &Error) {
    match asked {
        Some(request) => Reply::failed(error).send(&request),
        None => {
            tracing::error!("{}: {}; what was in force stays", camera.config.name, with_causes(error));
        }
    }
}
