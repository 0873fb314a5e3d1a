//! What the running driver does for other commands: it generates masks and reads them anew.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Sender;

use uvcam_shm_ipc::control::Question;

use super::{Event, Running};
use crate::config::Config;
use crate::control::{Ask, Desk, Reply};
use crate::error::Error;
use crate::frame_path::Command;
use crate::generate::{Light, Order};
use crate::generator::{Generator, Progress, Wish, store_of};

/// Lit frames of a camera, or why there are none.
pub(super) struct Collected {
    place: usize,
    generator: Generator,
    light: Result<Light, Error>,
}

/// Questions that are being worked on, one a camera.
pub(super) struct Service {
    desk: Desk,
    works: Vec<Option<Work>>,
    events: Sender<Event>,
}

struct Work {
    question: Question,
    accept: bool,
    cancelled: Arc<AtomicBool>,
}

impl Service {
    pub(super) fn open(config: &Config, events: Sender<Event>) -> Result<Self, Error> {
        let works = config.cameras.iter().map(|_| None).collect();
        Ok(Service { desk: Desk::open(config)?, works, events })
    }

    /// Makes anew what clients no longer find, where nobody waits for an answer.
    pub(super) fn keep_open(&mut self, config: &Config) {
        for (place, _) in self.works.iter().enumerate().filter(|(_, work)| work.is_none()) {
            self.desk.keep_open(config, place);
        }
    }

    /// Takes new questions, and gives up work that nobody waits for any more.
    pub(super) fn attend(&mut self, cameras: &[Running]) {
        for (place, question, ask) in self.desk.questions() {
            let Some(camera) = cameras.get(place) else { continue };
            match ask {
                Ask::ReloadMask => {
                    let reply =
                        camera.reload_mask().map_or_else(|error| Reply::failed(&error), |()| Reply::Done);
                    reply.send(&question);
                }
                Ask::Generate { wish, accept } => self.order(place, camera, question, wish, accept),
            }
        }
        for work in self.works.iter().flatten() {
            if !work.question.is_awaited() {
                // Relaxed: the flag carries no data.
                work.cancelled.store(true, Ordering::Relaxed);
            }
        }
    }

    fn order(&mut self, place: usize, camera: &Running, question: Question, wish: Wish, accept: bool) {
        if let Err(error) = store_of(&camera.config) {
            Reply::failed(&error).send(&question);
            return;
        }
        let Some(work) = self.works.get_mut(place).filter(|work| work.is_none()) else {
            let name = &camera.config.name;
            let error = Error::Usage(format!("the mask of camera {name} is being generated: wait for it"));
            Reply::failed(&error).send(&question);
            return;
        };
        let cancelled = Arc::new(AtomicBool::new(false));
        let events = self.events.clone();
        let order = Order {
            exposure_us: wish.exposure_us.unwrap_or(camera.config.generate.exposure_us),
            gain_db: wish.gain_db.unwrap_or(camera.config.generate.gain_db),
            generator: Generator::new(wish, &camera.config.generate),
            progress: Box::new({
                let events = events.clone();
                // Nobody listens only while the driver ends.
                move |progress| drop(events.send(Event::Progress { place, progress }))
            }),
            cancelled: cancelled.clone(),
            done: Box::new(move |generator, light| {
                // Nobody listens only while the driver ends.
                let _ = events.send(Event::Collected(Box::new(Collected { place, generator, light })));
            }),
        };
        *work = Some(Work { question, accept, cancelled });
        // The thread is gone only where it panicked, which is reported at the end.
        let _ = camera.commands.send(Command::Generate(Box::new(order)));
    }

    /// Tells whoever waits for a mask how far it is.
    pub(super) fn tell(&self, place: usize, progress: Progress) {
        if let Some(work) = self.works.get(place).and_then(Option::as_ref) {
            Reply::Collecting { progress }.send(&work.question);
        }
    }

    /// Makes the mask from the lit frames, stores it, and answers.
    pub(super) fn conclude(&mut self, collected: Collected, cameras: &[Running]) {
        let Collected { place, generator, light } = collected;
        let Some(work) = self.works.get_mut(place).and_then(Option::take) else { return };
        let Some(camera) = cameras.get(place) else { return };
        if work.cancelled.load(Ordering::Relaxed) {
            tracing::warn!("{}: nobody waits for the mask any more; nothing was stored", camera.config.name);
            return;
        }
        let reply = conclude(camera, generator, light, work.accept);
        reply.unwrap_or_else(|error| Reply::failed(&error)).send(&work.question);
    }
}

fn conclude(
    camera: &Running,
    generator: Generator,
    light: Result<Light, Error>,
    accept: bool,
) -> Result<Reply, Error> {
    let light = light?;
    let generated = generator.finish(Some(light.applied.exposure_us))?;
    let report = generated.store(&camera.config, light.provenance(), accept)?;
    if report.in_force {
        camera.reload_mask()?;
    }
    Ok(Reply::Generated { report: Box::new(report) })
}
