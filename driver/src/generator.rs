//! From lit frames to a stored candidate, or to the reason why there is none: the same for frames from files, from a camera, and
//! from a camera of a running driver.

mod report;

use std::time::{Duration, Instant};

use clap::{Args, ValueEnum};
use serde::{Deserialize, Serialize};
use uvcam_masker::generate::{
    self, Accumulator, GenerateError, IgnoredRegion, Outcome, Parameters, Rectangle,
};
use uvcam_masker::{GrayImage, metrics};

pub use report::{Finding, Part, Report, parts};

use crate::config::{CameraConfig, Generate, MaskChoice};
use crate::error::Error;
use crate::mask;
use crate::mask_store::{Candidate, MaskStore};

/// How a mask is computed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Several frames while the lamp moves; ends when the mask has stopped changing
    #[default]
    Fused,
    /// The published method, from one frame
    Paper,
}

/// What whoever asks for a mask may choose. What is left open is as configured.
#[derive(Debug, Clone, Args, Serialize, Deserialize)]
pub struct Wish {
    /// How the mask is computed
    #[arg(long, value_enum, default_value_t)]
    pub method: Method,
    /// Frames that the fused method takes at most
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=255))]
    pub frames: u32,
    /// Columns x0 to x1 and rows y0 to y1 that are not the airframe, H_cam; an empty end is the image border
    #[arg(long, value_name = "X0:X1:Y0:Y1", allow_hyphen_values = true)]
    pub ignore: Vec<Rectangle>,
    /// Make a mask that is very different from the one in force, for another airframe or another place of the camera
    #[arg(long)]
    pub replace: bool,
    /// Exposure time of lit frames, microseconds
    #[arg(long, value_name = "E", allow_negative_numbers = true)]
    pub exposure_us: Option<f64>,
    /// Gain of lit frames, decibels
    #[arg(long, value_name = "G", allow_negative_numbers = true)]
    pub gain_db: Option<f64>,
    /// sigma: a pixel brighter than this is a candidate, 0 to 255; with the fused method, light below a quarter of it is too weak
    #[arg(long, value_name = "LEVEL")]
    pub sigma: Option<u8>,
    /// eta: the mask needs more candidates |P| than this, 0 to 1000
    #[arg(long, value_name = "PIXELS")]
    pub eta: Option<u32>,
    /// Bucket size of the k-d tree of the published method, 5, 10, 20 or 40; matters for speed alone
    #[arg(long, value_name = "POINTS")]
    pub leaf: Option<u32>,
    /// k: neighbours that the published method connects with each candidate, itself included, 1 to 100
    #[arg(long, value_name = "POINTS")]
    pub k: Option<u32>,
    /// tau: the published method connects neighbours nearer than this, up to 1000
    #[arg(long, value_name = "PIXELS")]
    pub tau: Option<f64>,
    /// kappa: thickness of the drawn contours, 0 to 300; the mask grows by half of it
    #[arg(long, value_name = "PIXELS")]
    pub kappa: Option<u32>,
}

impl Wish {
    /// Checks the parameters that this wish makes of those `configured`, before a camera is troubled for them.
    ///
    /// # Errors
    /// [`Error::Generate`] where one is out of its range.
    pub fn check(&self, configured: &Generate) -> Result<(), Error> {
        self.parameters(&configured.parameters).check().map_err(|error| GenerateError::from(error).into())
    }

    fn parameters(&self, configured: &Parameters) -> Parameters {
        Parameters {
            sigma: self.sigma.unwrap_or(configured.sigma),
            eta: self.eta.unwrap_or(configured.eta),
            leaf: self.leaf.unwrap_or(configured.leaf),
            k: self.k.unwrap_or(configured.k),
            tau: self.tau.unwrap_or(configured.tau),
            kappa: self.kappa.unwrap_or(configured.kappa),
        }
    }
}

/// How far the collection of frames is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Progress {
    /// Frames taken.
    pub frames: u32,
    /// Frames that are taken at most.
    pub most_frames: u32,
    /// Pixels found lit so far.
    pub lit_px: u64,
}

/// Takes lit frames, and makes the mask.
#[derive(Debug)]
pub struct Generator {
    wish: Wish,
    ignored: IgnoredRegion,
    parameters: Parameters,
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

/// What a generator made.
#[derive(Debug)]
pub struct Generated {
    /// The mask, where it was not refused, and why.
    pub outcome: Outcome,
    /// The brightest that each pixel was in the frames it was made from.
    pub input: GrayImage,
    wish: Wish,
    parameters: Parameters,
    frames_used: u32,
    exposure_us: Option<f64>,
    seconds: f64,
}

impl Generator {
    /// A generator that has seen no frame. What the wish ignores is ignored besides what is configured.
    pub fn new(wish: Wish, configured: &Generate) -> Self {
        let mut ignored = configured.ignored.clone();
        ignored.rectangles.extend(&wish.ignore);
        let parameters = wish.parameters(&configured.parameters);
        Generator { wish, ignored, parameters, collected: None, busy: Duration::ZERO }
    }

    /// Takes a frame. The published method takes one, the fused one as many as were wished at most; more are left out.
    ///
    /// # Errors
    /// [`Error::Generate`] where a parameter is out of its range, or the frame has another size than the others.
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
            let mut accumulator = match self.wish.method {
                Method::Paper => None,
                Method::Fused => Some(Accumulator::new(width, height, &self.ignored, &self.parameters)?),
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
            most_frames: self.most_frames(),
            lit_px: accumulator.map_or(0, |accumulator| accumulator.progress().lit_px),
        }
    }

    /// Whether it takes no more frames.
    pub fn is_full(&self) -> bool {
        self.collected.as_ref().is_some_and(|collected| collected.frames >= self.most_frames())
    }

    /// Whether more frames are not worth their time: it is full, or the mask has stopped changing.
    pub fn is_satisfied(&self) -> bool {
        self.is_full() || self.collected.as_ref().is_some_and(|collected| collected.is_settled)
    }

    fn most_frames(&self) -> u32 {
        match self.wish.method {
            Method::Paper => 1,
            Method::Fused => self.wish.frames,
        }
    }

    /// Makes the mask from the frames it has seen. Advice names an exposure time where theirs is known, in microseconds.
    ///
    /// # Errors
    /// [`Error::Generate`] where a parameter is out of its range; [`Error::Usage`] where it has seen no frame.
    pub fn finish(self, exposure_us: Option<f64>) -> Result<Generated, Error> {
        let Some(collected) = self.collected else {
            return Err(Error::Usage("no frame to generate a mask from".into()));
        };
        let start = Instant::now();
        let outcome = match &collected.accumulator {
            Some(accumulator) => accumulator.finish(),
            None => generate::paper(&collected.brightest, &self.ignored, &self.parameters)?,
        };
        Ok(Generated {
            outcome,
            input: collected.brightest,
            wish: self.wish,
            parameters: self.parameters,
            frames_used: collected.frames,
            exposure_us,
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

impl Generated {
    /// Stores the mask as the camera's candidate, with its pictures, and puts it in force where `accept` says so. Where there is no mask,
    /// nothing is stored.
    ///
    /// # Errors
    /// [`Error::Usage`] where the camera flies without a mask file; those of [`MaskStore`].
    pub fn store(
        mut self,
        camera: &CameraConfig,
        mut provenance: Vec<(&'static str, String)>,
        accept: bool,
    ) -> Result<Report, Error> {
        let store = store_of(camera)?;
        // One that cannot be read flies nowhere, and so says nothing.
        let in_force = mask::load(camera).ok().flatten();
        let overlap = in_force.as_deref().zip(self.outcome.mask.as_ref());
        let overlap = overlap.and_then(|(in_force, mask)| metrics::overlap(mask, in_force));
        if let Some(in_force) = in_force.filter(|_| !self.wish.replace) {
            self.outcome.compare(&in_force);
        }
        let mut report = self.report();
        report.overlap_with_mask_in_force = overlap;
        let Some(mask) = &self.outcome.mask else { return Ok(report) };
        let overlay = metrics::overlay(&self.input, mask);
        provenance.extend(self.provenance());
        store.store(&Candidate { mask, provenance: &provenance, input: &self.input, overlay: &overlay })?;
        if accept {
            store.accept((camera.settings.width, camera.settings.height))?;
        }
        report.in_force = accept;
        report.file = Some(if accept { store.in_force().into() } else { store.candidate() });
        Ok(report)
    }

    /// How the mask was made and what came of it: keywords and texts for its file.
    pub fn provenance(&self) -> Vec<(&'static str, String)> {
        let Parameters { sigma, eta, leaf, k, tau, kappa } = &self.parameters;
        let recipe = match self.wish.method {
            Method::Paper => {
                format!("paper, sigma {sigma}, eta {eta}, leaf {leaf}, k {k}, tau {tau}, kappa {kappa}")
            }
            Method::Fused => format!("fused, sigma {sigma}, eta {eta}, kappa {kappa}"),
        };
        let parts = self.outcome.mask.as_ref().map(parts).unwrap_or_default();
        let part = |part: &Part| {
            format!(
                "{} px, perimeter {} px, compactness {}",
                part.area_px, part.perimeter_px, part.compactness
            )
        };
        vec![
            ("Software", concat!("uvcam ", env!("CARGO_PKG_VERSION")).into()),
            ("Creation Time", jiff::Timestamp::now().to_string()),
            ("Method", recipe),
            ("Frames", self.frames_used.to_string()),
            ("Parts", parts.iter().map(part).collect::<Vec<_>>().join("; ")),
        ]
    }
}

/// The store of the camera's mask.
///
/// # Errors
/// [`Error::Usage`] where the camera flies without a mask file.
pub fn store_of(camera: &CameraConfig) -> Result<MaskStore, Error> {
    match &camera.mask {
        MaskChoice::File(path) => Ok(MaskStore::new(path)),
        MaskChoice::None => Err(Error::Usage(format!(
            "camera {} has mask = \"none\": name a file in the configuration to generate its mask",
            camera.name
        ))),
    }
}
