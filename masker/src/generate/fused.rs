//! The fused method: several frames while the lamp moves.
//!
//! The published method asks of each pixel whether it is brighter than sigma. Here a pixel is compared with the floor
//! of its frame, the light that is there without the lamp, whose mean and noise are measured. The airframe is many
//! times brighter than the floor at any exposure, so the same outline is found at all of them, and arms far darker
//! than sigma are found whole.
//!
//! 1. A pixel counts as strongly or faintly lit where it is so in enough frames. How many are enough follows from how
//!    much passing light the frames show; hot pixels in passing and reflections of a moment are below.
//! 2. Strong pixels without enough neighbours are dropped: hot pixels that stay.
//! 3. Faint pixels beside strong ones join them, as an edge of the airframe is as wide as its blur.
//! 4. Faint pixels elsewhere are a doubt. An airframe has edges, while the glow of a lamp fades out and an arm in poor
//!    light shows in part; either refuses the mask, as a part of an airframe must never pass for all of it.
//! 5. The pixels found grow by kappa, and holes that would look like markers are closed.

use super::evidence::{Evidence, SATURATED};
use super::floor::quantile;
use super::growth::grow;
use super::specks::drop_specks;
use super::verdict::Finding;
use super::{LIT, Parameters, Rectangle, count};
use crate::image::GrayImage;

/// Pixels between faint and strong light across an edge of the airframe, at most: a lens that is far out of focus.
const EDGE_PX: u32 = 3;

/// Light on the airframe below this share of sigma is not trusted: little is left of it above noise and stray light.
const LEAST_LEVEL: f64 = 0.25;

/// More pixels than this that count by chance are a reflection taken for the airframe sooner or later.
const LIKELY_PX: f64 = 0.5;

/// What several frames say about the airframe.
pub(super) struct Found {
    /// Pixels of the airframe, [`LIT`].
    pub(super) airframe: GrayImage,
    /// Their number.
    pub(super) candidates: usize,
    /// What speaks against them.
    pub(super) findings: Vec<Finding>,
}

/// Finds the airframe in what was seen.
pub(super) fn find(evidence: &Evidence, parameters: &Parameters) -> Found {
    let eta = parameters.eta as usize;
    let (needed, by_chance_px) = evidence.frames_needed(passing_px(evidence, eta));
    let near = near_strong(evidence, needed, eta);

    let mut airframe = evidence.faint(needed);
    let mut doubtful = airframe.clone();
    keep(&mut airframe, &near);
    remove(&mut doubtful, &near);
    drop_specks(&mut doubtful, eta);
    let (candidates, uncertain_px) = (count(&airframe), count(&doubtful));
    let level = level(evidence, candidates.max(eta + 1), needed);
    let is_weak = f64::from(level) < LEAST_LEVEL * f64::from(parameters.sigma);

    let mut findings = Vec::new();
    if evidence.highest_floor > f64::from(SATURATED) {
        let (floor, lost_frames) = (evidence.highest_floor.round() as u32, evidence.lost_frames);
        findings.push(Finding::OverExposed { floor, lost_frames });
    }
    if candidates <= eta {
        findings.push(Finding::TooDark { candidates, eta: parameters.eta, level });
    } else if is_weak {
        findings.push(Finding::TooWeak { level });
    } else if let Some(place) = bounds(&doubtful, evidence.top) {
        findings.push(if uncertain_px > candidates {
            Finding::Unclear { uncertain_px, candidates, place }
        } else {
            Finding::LampInside { slope_px: uncertain_px, place }
        });
    }
    if evidence.frames < 2 || by_chance_px > LIKELY_PX {
        findings.push(Finding::TooFewFrames { frames: evidence.frames });
    }
    findings.extend(unstable(evidence, needed, &near, parameters));
    Found { airframe, candidates, findings }
}

/// Image of the pixels that are strongly lit in enough frames, in sets of more than `eta`, and of those beside them.
fn near_strong(evidence: &Evidence, needed: u32, eta: usize) -> GrayImage {
    let mut near = evidence.strong(needed);
    drop_specks(&mut near, eta);
    grow(&mut near, 2 * EDGE_PX);
    near
}

/// Number of pixels that are lit in one frame alone. The edge of what is lit in more of them is no passing light, though
/// noise decides in how many of them it shows.
fn passing_px(evidence: &Evidence, eta: usize) -> usize {
    if evidence.frames < 2 {
        return 0;
    }
    let lasting = near_strong(evidence, 2, eta);
    let mut passing = evidence.lit_once();
    remove(&mut passing, &lasting);
    count(&passing)
}

/// Strong light in too few frames, away from the airframe, in one piece larger than half the pen that draws the
/// contours. Smaller ones are passing reflections.
fn unstable(evidence: &Evidence, needed: u32, near: &GrayImage, parameters: &Parameters) -> Option<Finding> {
    if needed < 2 {
        return None;
    }
    let pen_px = f64::from(parameters.kappa).powi(2) * std::f64::consts::FRAC_PI_4;
    let mut passing = evidence.passing(needed);
    remove(&mut passing, near);
    drop_specks(&mut passing, (pen_px / 2.0) as usize);
    bounds(&passing, evidence.top).map(|place| Finding::Unstable {
        unsure_px: count(&passing),
        place,
        needed,
    })
}

/// Typical grey value of the brightest `lit_px` pixels where they are lit, in `needed` frames.
pub(super) fn level(evidence: &Evidence, lit_px: usize, needed: u32) -> u8 {
    let all: u64 = evidence.histogram.iter().sum();
    let brightest = lit_px as f64 * f64::from(needed) / (all as f64).max(1.0);
    quantile(&evidence.histogram, (1.0 - brightest / 2.0).max(0.0)).unwrap_or(0.0) as u8
}

/// Darkens the [`LIT`] pixels that are not [`LIT`] in `shape`.
fn keep(image: &mut GrayImage, shape: &GrayImage) {
    image.iter_mut().zip(shape.as_raw()).for_each(|(pixel, shape)| *pixel &= shape);
}

/// Darkens the [`LIT`] pixels that are [`LIT`] in `shape`.
fn remove(image: &mut GrayImage, shape: &GrayImage) {
    image.iter_mut().zip(shape.as_raw()).for_each(|(pixel, shape)| *pixel &= !shape);
}

/// The bounding box of the [`LIT`] pixels of rows from row `top` on; `None` where there is none.
fn bounds(image: &GrayImage, top: u32) -> Option<Rectangle> {
    let is_lit = |value: &u8| *value == LIT;
    let rows = (top..).zip(image.as_raw().chunks_exact((image.width() as usize).max(1)));
    let lit = rows.filter_map(|(y, row)| {
        let (left, right) = (row.iter().position(is_lit)?, row.iter().rposition(is_lit)?);
        Some(Rectangle::around(left as u32, y, right as u32 + 1, y + 1))
    });
    lit.reduce(|a, b| a.united(&b))
}
