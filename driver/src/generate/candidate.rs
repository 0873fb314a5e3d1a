//! What a generator made: told, and stored as the camera's candidate.

use uvcam_masker::check::Severity;
use uvcam_masker::generate::{Method, Outcome, Parameters};
use uvcam_masker::{GrayImage, Mask, metrics};
use uvcam_shm_ipc::control::{Finding, GenerateReport, Part, Verdict};

use super::light::Light;
use super::request::Request;
use crate::config::CameraConfig;
use crate::error::Error;
use crate::mask;
use crate::mask_store::{Candidate, MaskStore};

/// What a generator made.
#[derive(Debug)]
pub struct Generated {
    /// The mask, where it was not refused, and why.
    pub outcome: Outcome,
    /// The brightest that each pixel was in the frames it was made from.
    pub input: GrayImage,
    pub(super) request: Request,
    pub(super) frames_used: u32,
    pub(super) exposure_us: Option<f64>,
    /// None where the frames come from files.
    pub(super) light: Option<Light>,
    pub(super) seconds: f64,
}

impl Generated {
    /// Stores the mask as the camera's candidate, with its pictures, and puts it in force where that was requested. Where there is no mask,
    /// nothing is stored.
    ///
    /// # Errors
    /// [`Error::Usage`] where the camera flies without a mask file; those of [`MaskStore`].
    pub fn store(mut self, camera: &CameraConfig) -> Result<GenerateReport, Error> {
        let store = MaskStore::of(camera)?;
        // One that cannot be read flies nowhere, and so says nothing.
        let in_force = mask::load(camera).ok().flatten();
        let overlap = in_force.as_deref().zip(self.outcome.mask.as_ref());
        let overlap = overlap.and_then(|(in_force, mask)| metrics::overlap(mask, in_force));
        if let Some(in_force) = in_force.filter(|_| !self.request.replace) {
            self.outcome.compare(&in_force);
        }
        let mut report = self.report();
        report.overlap_with_mask_in_force = overlap;
        let Some(mask) = &self.outcome.mask else { return Ok(report) };
        let overlay = metrics::overlay(&self.input, mask);
        let provenance = self.provenance();
        store.store(&Candidate { mask, provenance: &provenance, input: &self.input, overlay: &overlay })?;
        let accept = self.request.accept;
        if accept {
            store.accept((camera.settings.width, camera.settings.height))?;
        }
        report.in_force = accept;
        report.file = Some(if accept { store.in_force().into() } else { store.candidate() });
        Ok(report)
    }

    /// Where the frames come from, how the mask was made and what came of it: keywords and texts for its file.
    pub fn provenance(&self) -> Vec<(&'static str, String)> {
        let Parameters { sigma, eta, leaf, k, tau, kappa } = &self.request.parameters;
        let method = self.request.method;
        let recipe = match method {
            Method::Paper => {
                format!("{method}, sigma {sigma}, eta {eta}, leaf {leaf}, k {k}, tau {tau}, kappa {kappa}")
            }
            Method::Fused => format!("{method}, sigma {sigma}, eta {eta}, kappa {kappa}"),
        };
        let parts = self.outcome.mask.as_ref().map(parts).unwrap_or_default();
        let part = |part: &Part| {
            format!(
                "{} px, perimeter {} px, compactness {}",
                part.area_px, part.perimeter_px, part.compactness
            )
        };
        let mut texts = self.light.as_ref().map(Light::provenance).unwrap_or_default();
        texts.extend([
            ("Software", concat!("uvcam ", env!("CARGO_PKG_VERSION")).into()),
            ("Creation Time", jiff::Timestamp::now().to_string()),
            ("Method", recipe),
            ("Frames", self.frames_used.to_string()),
            ("Parts", parts.iter().map(part).collect::<Vec<_>>().join("; ")),
        ]);
        texts
    }

    /// What is to be told of it, nothing being stored yet.
    pub fn report(&self) -> GenerateReport {
        let verdict = &self.outcome.verdict;
        let findings = verdict.findings.iter().map(|finding| Finding {
            name: finding.name().into(),
            refuses: finding.severity(verdict.method) == Severity::Refused,
            message: finding.message(self.exposure_us),
        });
        let mask = self.outcome.mask.as_ref();
        GenerateReport {
            verdict: if mask.is_some() { Verdict::Ok } else { Verdict::Refused },
            findings: findings.collect(),
            frames_used: self.frames_used,
            candidates: self.outcome.candidates as u64,
            parts: mask.map(parts).unwrap_or_default(),
            seconds: self.seconds,
            mask_id: mask.map(|mask| mask.id().to_string()),
            overlap_with_mask_in_force: None,
            file: None,
            in_force: false,
        }
    }
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
