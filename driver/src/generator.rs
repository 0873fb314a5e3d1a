//! From lit frames to a stored candidate, or to the reason why there is none: the same for frames from files, from a camera, and
//! from a camera of a running driver.

use std::path::PathBuf;
use std::time::Instant;

use clap::{Args, ValueEnum};
use serde::{Deserialize, Serialize};
use uvcam_masker::generate::{self, IgnoredRegion, Outcome, Parameters};
use uvcam_masker::{GrayImage, Mask, metrics};

use crate::config::{CameraConfig, MaskChoice};
use crate::error::Error;
use crate::mask;
use crate::mask_store::{Candidate, MaskStore};

/// How a mask is computed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// The published method, from one frame
    #[default]
    Paper,
}

/// What whoever asks for a mask may choose.
#[derive(Debug, Clone, Default, Args, Serialize, Deserialize)]
pub struct Wish {
    /// How the mask is computed
    #[arg(long, value_enum, default_value_t)]
    pub method: Method,
    /// Exposure time of lit frames, microseconds
    #[arg(long, value_name = "E")]
    pub exposure_us: Option<f64>,
    /// Gain of lit frames, decibels
    #[arg(long, value_name = "G", allow_negative_numbers = true)]
    pub gain_db: Option<f64>,
    /// sigma: a pixel brighter than this is a candidate, 0 to 255
    #[arg(long, value_name = "LEVEL", default_value_t = 120)]
    pub sigma: u8,
    /// eta: the mask needs more candidates |P| than this
    #[arg(long, value_name = "PIXELS", default_value_t = 20)]
    pub eta: u32,
    /// Bucket size of the k-d tree; matters for speed alone
    #[arg(long, value_name = "POINTS", default_value_t = 10)]
    pub leaf: u32,
    /// k: neighbours that are connected with each candidate, itself included
    #[arg(long, value_name = "POINTS", default_value_t = 20)]
    pub k: u32,
    /// tau: only neighbours nearer than this are connected
    #[arg(long, value_name = "PIXELS", default_value_t = 50.0)]
    pub tau: f64,
    /// kappa: thickness of the drawn contours; the mask grows by half of it
    #[arg(long, value_name = "PIXELS", default_value_t = 50)]
    pub kappa: u32,
}

impl Wish {
    fn parameters(&self) -> Parameters {
        let Wish { sigma, eta, leaf, k, tau, kappa, .. } = *self;
        Parameters { sigma, eta, leaf, k, tau, kappa }
    }

    /// The method and its parameters, as a text for the mask's file.
    fn recipe(&self) -> String {
        let Wish { sigma, eta, leaf, k, tau, kappa, .. } = self;
        format!("paper, sigma {sigma}, eta {eta}, leaf {leaf}, k {k}, tau {tau}, kappa {kappa}")
    }
}

/// Takes lit frames, and makes the mask.
#[derive(Debug)]
pub struct Generator {
    wish: Wish,
    ignored: IgnoredRegion,
    frames: Vec<GrayImage>,
}

/// What a generator made.
#[derive(Debug)]
pub struct Generated {
    /// The mask, where it was not refused.
    pub mask: Option<Mask>,
    /// The picture it was made from.
    pub input: GrayImage,
    /// What is to be told of it.
    pub report: Report,
}

impl Generator {
    /// A generator that has seen no frame.
    pub fn new(wish: Wish, ignored: IgnoredRegion) -> Self {
        Generator { wish, ignored, frames: Vec::new() }
    }

    /// Takes a frame. Returns whether it has seen enough.
    pub fn add(&mut self, frame: GrayImage) -> bool {
        self.frames.push(frame);
        self.is_satisfied()
    }

    /// Whether it has seen enough. The published method takes one frame.
    pub fn is_satisfied(&self) -> bool {
        !self.frames.is_empty()
    }

    /// Makes the mask from the frames it has seen.
    ///
    /// # Errors
    /// [`Error::Generate`] where a parameter is out of its range; [`Error::Usage`] where it has seen no frame.
    pub fn finish(mut self) -> Result<Generated, Error> {
        let Some(input) = self.frames.pop() else {
            return Err(Error::Usage("no frame to generate a mask from".into()));
        };
        let start = Instant::now();
        let Outcome { candidates, mask } = generate::paper(&input, &self.ignored, &self.wish.parameters())?;
        let seconds = start.elapsed().as_secs_f64();
        let mut findings = Vec::new();
        if mask.is_none() {
            findings.push(format!(
                "too dark: {candidates} pixels are brighter than sigma = {}, more than eta = {} are needed; \
                 raise the exposure, or move the lamp nearer",
                self.wish.sigma, self.wish.eta
            ));
        }
        let report = Report {
            verdict: if mask.is_some() { OK } else { REFUSED }.into(),
            findings,
            frames_used: 1,
            candidates: candidates as u64,
            parts: mask.as_ref().map(parts).unwrap_or_default(),
            seconds,
            mask_id: mask.as_ref().map(|mask| mask.id().to_string()),
            overlap_with_mask_in_force: None,
            file: None,
            in_force: false,
        };
        Ok(Generated { mask, input, report })
    }

    /// The method and its parameters, as a text for the mask's file.
    pub fn recipe(&self) -> String {
        self.wish.recipe()
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
        provenance: &[(&str, String)],
        accept: bool,
    ) -> Result<Report, Error> {
        let store = store_of(camera)?;
        let Some(mask) = self.mask else { return Ok(self.report) };
        let in_force = mask::load(camera).ok().flatten();
        self.report.overlap_with_mask_in_force = in_force.and_then(|old| metrics::overlap(&old, &mask));
        let overlay = metrics::overlay(&self.input, &mask);
        store.store(&Candidate { mask: &mask, provenance, input: &self.input, overlay: &overlay })?;
        if accept {
            store.accept()?;
        }
        self.report.in_force = accept;
        self.report.file = Some(if accept { store.in_force().into() } else { store.candidate() });
        Ok(self.report)
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

const OK: &str = "ok";
const REFUSED: &str = "refused";

/// What came of it.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Report {
    /// `ok`, or `refused`.
    pub verdict: String,
    /// Why it was refused, and what else is to be known.
    pub findings: Vec<String>,
    /// Frames that the mask was made from.
    pub frames_used: u32,
    /// Candidate pixels |P|.
    pub candidates: u64,
    /// The connected parts of the mask.
    pub parts: Vec<Part>,
    /// Time that the computation took.
    pub seconds: f64,
    /// Identity of the mask.
    pub mask_id: Option<String>,
    /// Overlap with the mask that is in force, 0 to 1.
    pub overlap_with_mask_in_force: Option<f64>,
    /// Where the mask was stored.
    pub file: Option<PathBuf>,
    /// Whether it is in force.
    pub in_force: bool,
}

impl Report {
    /// Whether there is a mask.
    pub fn is_ok(&self) -> bool {
        self.verdict == OK
    }
}

/// A connected part of a mask (equation 14).
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Part {
    /// Area, px.
    pub area_px: u64,
    /// Length of its outer border, px.
    pub perimeter_px: f64,
    /// Perimeter squared over area.
    pub compactness: f64,
}

/// The parts of a mask.
pub fn parts(mask: &Mask) -> Vec<Part> {
    let shapes = metrics::shapes(mask);
    let parts = shapes.iter().map(|shape| Part {
        area_px: shape.component.area_px,
        perimeter_px: (shape.perimeter_px * 100.0).round() / 100.0,
        compactness: (shape.compactness * 100.0).round() / 100.0,
    });
    parts.collect()
}
