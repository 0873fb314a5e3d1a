//! What is told of a generated mask.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use uvcam_masker::check::Severity;
use uvcam_masker::{Mask, metrics};

use super::Generated;

const OK: &str = "ok";
const REFUSED: &str = "refused";

/// What came of it.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Report {
    /// `ok`, or `refused`.
    pub verdict: String,
    /// Why it was refused, and what else is to be known.
    pub findings: Vec<Finding>,
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

/// Something to know about the frames or the mask.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Finding {
    /// Its name, such as `too_dark`.
    pub name: String,
    /// Whether it refuses the mask.
    pub refuses: bool,
    /// What was found, and what to change.
    pub message: String,
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

impl Report {
    /// Whether there is a mask.
    pub fn is_ok(&self) -> bool {
        self.verdict == OK
    }
}

impl Generated {
    /// What is to be told of it, nothing being stored yet.
    pub fn report(&self) -> Report {
        let verdict = &self.outcome.verdict;
        let findings = verdict.findings.iter().map(|finding| Finding {
            name: finding.name().into(),
            refuses: finding.severity(verdict.method) == Severity::Refused,
            message: finding.message(self.exposure_us),
        });
        let mask = self.outcome.mask.as_ref();
        Report {
            verdict: if mask.is_some() { OK } else { REFUSED }.into(),
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
