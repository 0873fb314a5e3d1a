//! Takes lit frames, and makes the mask: the same for frames from files and from a camera.

use std::time::{Duration, Instant};

use uvcam_masker::GrayImage;
use uvcam_masker::generate::{self, Accumulator, GenerateError, Method};
use uvcam_shm_ipc::control::Progress;

use super::candidate::Generated;
use super::request::Request;
use crate::error::Error;

/// The frames of one request.
#[derive(Debug)]
pub struct Generator {
    request: Request,
    collected: Option<Collected>,
    /// Time spent on computing.
    busy: Duration,
}

/// What the frames left.
#[derive(Debug)]
struct Collected {
    /// The brightest that each pixel was.
    brightest: GrayImage,
    /// None with the published method, whose one frame is the brightest.
    accumulator: Option<Accumulator>,
    frames: u32,
    is_settled: bool,
}

impl Generator {
    /// A generator that has seen no frame.
    pub fn new(request: Request) -> Self {
        Generator { request, collected: None, busy: Duration::ZERO }
    }

    /// Takes a frame. The published method takes one, the fused one as many as were requested at most; more are left out.
    ///
    /// # Errors
    /// [`Error::Generate`] where the frame has another size than the others.
    pub fn add(&mut self, frame: GrayImage) -> Result<(), Error> {
        if self.is_full() {
            return Ok(());
        }
        let start = Instant::now();
        let added = self.accumulate(frame);
        self.busy += start.elapsed();
        Ok(added?)
    }

    fn accumulate(&mut self, frame: GrayImage) -> Result<(), GenerateError> {
        let Some(collected) = &mut self.collected else {
            let (width, height) = frame.dimensions();
            let Request { method, ignored, parameters, .. } = &self.request;
            let mut accumulator = match method {
                Method::Paper => None,
                Method::Fused => Some(Accumulator::new(width, height, ignored, parameters)?),
            };
            let is_settled = add(&mut accumulator, &frame)?;
            self.collected = Some(Collected { brightest: frame, accumulator, frames: 1, is_settled });
            return Ok(());
        };
        collected.is_settled = add(&mut collected.accumulator, &frame)?;
        for (brightest, value) in collected.brightest.iter_mut().zip(frame.as_raw()) {
            *brightest = (*brightest).max(*value);
        }
        collected.frames += 1;
        Ok(())
    }

    /// How far it is.
    pub fn progress(&self) -> Progress {
        let accumulator = self.collected.as_ref().and_then(|collected| collected.accumulator.as_ref());
        Progress {
            frames: self.collected.as_ref().map_or(0, |collected| collected.frames),
            most_frames: self.request.most_frames,
            lit_px: accumulator.map_or(0, |accumulator| accumulator.progress().lit_px),
        }
    }

    /// Whether it takes no more frames.
    pub fn is_full(&self) -> bool {
        self.collected.as_ref().is_some_and(|collected| collected.frames >= self.request.most_frames)
    }

    /// Whether more frames are not worth their time: it is full, or the mask has stopped changing.
    pub fn is_satisfied(&self) -> bool {
        self.is_full() || self.collected.as_ref().is_some_and(|collected| collected.is_settled)
    }

    /// Makes the mask from the frames it has seen. Advice names an exposure time where theirs is known, in microseconds.
    ///
    /// # Errors
    /// [`Error::Generate`] where the mask cannot be computed; [`Error::Usage`] where it has seen no frame.
    pub fn finish(self, exposure_us: Option<f64>) -> Result<Generated, Error> {
        let Some(collected) = self.collected else {
            return Err(Error::Usage("no frame to generate a mask from".into()));
        };
        let start = Instant::now();
        let outcome = match &collected.accumulator {
            Some(accumulator) => accumulator.finish(),
            None => generate::paper(&collected.brightest, &self.request.ignored, &self.request.parameters)?,
        };
        Ok(Generated {
            outcome,
            input: collected.brightest,
            request: self.request,
            frames_used: collected.frames,
            exposure_us,
            light: None,
            seconds: (self.busy + start.elapsed()).as_secs_f64(),
        })
    }
}

/// Adds a frame where frames are accumulated, and says whether more are not worth their time.
fn add(accumulator: &mut Option<Accumulator>, frame: &GrayImage) -> Result<bool, GenerateError> {
    match accumulator {
        Some(accumulator) => Ok(accumulator.add(frame)?.is_settled),
        None => Ok(false),
    }
}
