//! Makes a mask from frames in which a lamp lights the airframe.
//!
//! Bright pixels outside the [`IgnoredRegion`] are the airframe; grown by a margin, they become the mask. Two methods
//! find them: [`paper`] is that of "Towards Scalable and Fast UAV Deployment", section 3.2, on one frame; an
//! [`Accumulator`] takes several frames while the lamp moves. Either ends in an [`Outcome`]: a mask, and a [`Verdict`]
//! that says what is wrong with the frames and what to change.

mod accumulator;
mod evidence;
mod floor;
mod fused;
mod growth;
mod ignored;
mod neighbours;
mod paper;
mod parameters;
mod polygon;
mod specks;
mod strip;
mod verdict;

use thiserror::Error;

pub use accumulator::{Accumulator, Progress};
pub use ignored::{CameraPlace, IgnoredRegion, Rectangle, RectangleError};
pub use parameters::{LEAF_SIZES, ParameterError, Parameters};
pub use verdict::{Finding, Method, Verdict};

use self::strip::Strip;
use crate::components::Components;
use crate::image::GrayImage;
use crate::mask::{KEEP, Mask};
use crate::metrics;

/// Value of pixels that belong to a shape, in images that hold one.
const LIT: u8 = 255;

/// Least overlap of two masks of the same camera.
const SIMILAR: f64 = 0.5;

/// Why no mask can be computed.
#[derive(Debug, Error)]
pub enum GenerateError {
    /// A parameter is out of its range.
    #[error("the parameters cannot be used")]
    Parameter(#[from] ParameterError),
    /// A frame has another size than the others.
    #[error(
        "a frame of {}x{} pixels among frames of {}x{}; take all from one camera at one resolution",
        found.0, found.1, expected.0, expected.1
    )]
    Size {
        /// Width and height of the frame.
        found: (u32, u32),
        /// Width and height of the others.
        expected: (u32, u32),
    },
    /// Connecting the candidates would take minutes.
    #[error(
        "{candidates} candidates at edges with k = {k} neighbours each are more than can be connected in time; raise sigma, \
         extend the ignored region, or lower k to {}",
        neighbours::MOST_WORK / candidates
    )]
    Work {
        /// Number of candidates that are not surrounded by others.
        candidates: usize,
        /// Neighbours of each.
        k: u32,
    },
    /// The k-d tree cannot hold the candidates.
    #[error("the candidates do not fit into a k-d tree; generate from smaller images")]
    Tree(#[source] kiddo::kd_tree::ConstructionError),
}

/// What was made of the frames.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// Number of candidate pixels, |P|.
    pub candidates: usize,
    /// The mask; `None` exactly where the verdict refuses it.
    pub mask: Option<Mask>,
    /// What was found about the frames and the mask.
    pub verdict: Verdict,
}

impl Outcome {
    /// `mask` comes with the image of the pixels that were considered.
    fn new(
        method: Method,
        candidates: usize,
        mut findings: Vec<Finding>,
        mask: Option<(Mask, &GrayImage)>,
    ) -> Self {
        if let Some((mask, considered)) = &mask {
            findings.extend(shape_findings(mask, considered));
        }
        let verdict = Verdict { method, findings };
        let mask = mask.map(|(mask, _)| mask).filter(|_| !verdict.is_refused());
        Self { candidates, mask, verdict }
    }

    /// Compares the mask with the one in force for the same camera; where they are very different, that is a finding.
    ///
    /// A mask in force that masks nothing or has another size says nothing about the airframe.
    pub fn compare(&mut self, in_force: &Mask) {
        let overlap = self.mask.as_ref().and_then(|mask| metrics::overlap(mask, in_force));
        let overlap = overlap.filter(|overlap| *overlap < SIMILAR && in_force.masked_px() > 0);
        if let Some(overlap) = overlap {
            self.verdict.findings.push(Finding::Different { overlap });
            self.mask = self.mask.take().filter(|_| !self.verdict.is_refused());
        }
    }
}

/// The published method on one frame, equations 2 to 10. Refuses by equation 6 alone, and a mask that leaves next to nothing to see.
///
/// # Errors
/// [`GenerateError::Parameter`] where a parameter is out of its range, [`GenerateError::Work`] for more candidates than can be
/// connected in time, [`GenerateError::Tree`] for more than a tree holds.
pub fn paper(
    image: &GrayImage,
    ignored: &IgnoredRegion,
    parameters: &Parameters,
) -> Result<Outcome, GenerateError> {
    parameters.check()?;
    let considered = ignored.considered(image.width(), image.height());
    let strip = Strip::around(&considered, parameters.reach());
    let considered_part = strip.cut(&considered);
    let lit = paper::candidates(strip.pixels(image), &considered_part, parameters.sigma);
    let candidates = count(&lit);
    let mut evidence = evidence::Evidence::new(&considered_part, strip.top());
    evidence.add(strip.pixels(image));
    let mut findings = fused::find(&evidence, parameters).findings;
    findings.retain(|finding| !matches!(finding, Finding::TooDark { .. } | Finding::TooFewFrames { .. }));
    if candidates <= parameters.eta as usize {
        let level = fused::level(&evidence, parameters.eta as usize + 1, 1);
        findings.insert(0, Finding::TooDark { candidates, eta: parameters.eta, level });
        return Ok(Outcome::new(Method::Paper, candidates, findings, None));
    }
    let mask = mask_of(strip.paste(&paper::connect(&lit, parameters)?));
    Ok(Outcome::new(Method::Paper, candidates, findings, Some((mask, &considered))))
}

/// Number of [`LIT`] pixels.
fn count(image: &GrayImage) -> usize {
    // As many as a byte can count, so that many are added at a time.
    let stretches = image.as_raw().chunks(usize::from(u8::MAX));
    stretches
        .map(|stretch| usize::from(stretch.iter().map(|value| u8::from(*value == LIT)).sum::<u8>()))
        .sum()
}

/// The [`LIT`] pixels as (x, y), row by row.
fn lit_pixels(image: &GrayImage) -> impl Iterator<Item = (u32, u32)> {
    // Most rows are dark, and found to be so faster as a whole.
    let rows = (0..).zip(image.as_raw().chunks_exact(image.width().max(1) as usize));
    rows.filter(|(_, row)| row.contains(&LIT))
        .flat_map(|(y, row)| (0..).zip(row).filter(|(_, value)| **value == LIT).map(move |(x, _)| (x, y)))
}

/// The mask of a shape.
fn mask_of(mut shape: GrayImage) -> Mask {
    shape.iter_mut().for_each(|value| *value = !*value);
    Mask::binarised(&shape, KEEP)
}

/// What the mask itself shows. `considered` is [`LIT`] where pixels are not ignored.
fn shape_findings(mask: &Mask, considered: &GrayImage) -> Vec<Finding> {
    let (width, height) = (mask.width(), mask.height());
    let (masked_px, total_px) = (mask.masked_px(), u64::from(width) * u64::from(height));
    let mut findings = Vec::new();
    if masked_px > total_px / 2 {
        findings.push(Finding::OverHalfMasked { masked_px, total_px });
    }
    let parts = Components::masked(mask);
    let mut is_attached = vec![false; parts.list().len()];
    for (run, part) in parts.runs() {
        let is_at_border = run.row == 0 || run.row + 1 == height || run.start == 0 || run.end() == width;
        let first = run.row as usize * width as usize + run.start as usize;
        let pixels = &considered.as_raw()[first..first + run.length as usize];
        is_attached[part] |= is_at_border || pixels.contains(&0);
    }
    if !is_attached.contains(&true) {
        findings.push(Finding::TouchesNothing { masked_px });
        return findings;
    }
    for (part, _) in parts.list().iter().zip(is_attached).filter(|(_, is_attached)| !is_attached) {
        let place = Rectangle::around(part.x, part.y, part.x + part.width, part.y + part.height);
        findings.push(Finding::Detached { area_px: part.area_px, place });
    }
    findings
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::image::Luma;
    use proptest::prelude::*;

    /// A lit bar of 60 x 8 px in the dark, and a hot pixel far from it.
    fn frame() -> GrayImage {
        GrayImage::from_fn(200, 150, |x, y| {
            let lit = (40..100).contains(&x) && (70..78).contains(&y) || (x, y) == (180, 20);
            Luma([if lit { 200 } else { 10 }])
        })
    }

    #[test]
    fn what_is_lit_is_masked_with_half_of_kappa_around_it() {
        let ignored = IgnoredRegion { rectangles: vec!["150:::".parse().unwrap()], polygons: Vec::new() };
        let outcome = paper(&frame(), &ignored, &Parameters::default()).unwrap();
        assert_eq!(outcome.candidates, 60 * 8);
        let mask = outcome.mask.unwrap();
        for (x, y, masked) in
            [(70, 74, true), (39, 74, true), (15, 74, true), (14, 74, false), (70, 45, true), (70, 44, false)]
        {
            assert_eq!(mask.is_masked(x, y), masked, "{x},{y}");
        }
        assert!(!mask.is_masked(180, 20), "ignored");
    }

    #[test]
    fn eta_candidates_are_too_few_and_one_more_is_enough() {
        let with_eta =
            |eta| paper(&frame(), &IgnoredRegion::default(), &Parameters { eta, ..Parameters::default() });
        assert_eq!(with_eta(481).unwrap().mask, None);
        assert!(with_eta(480).unwrap().mask.is_some());
    }

    #[test]
    fn a_parameter_out_of_its_range_is_named() {
        let parameters = Parameters { k: 0, ..Parameters::default() };
        assert!(matches!(
            paper(&frame(), &IgnoredRegion::default(), &parameters),
            Err(GenerateError::Parameter(ParameterError::K { k: 0 }))
        ));
    }

    proptest! {
        #[test]
        fn no_frame_and_no_parameter_makes_it_panic(
            width in 0_u32..24, height in 0_u32..24, seed in any::<u64>(), sigma in any::<u8>(),
            eta in 0_u32..4, k in 0_u32..30, tau in prop_oneof![4 => 0.0..=Parameters::LARGEST_TAU, 1 => any::<f64>()],
            kappa in prop_oneof![4 => Parameters::KAPPA, 1 => any::<u32>()],
        ) {
            let image = GrayImage::from_fn(width, height, |x, y| {
                Luma([(seed.rotate_left((x * 7 + y * 13) % 64) & 0xff) as u8])
            });
            let parameters = Parameters { sigma, eta, leaf: 10, k, tau, kappa };
            let outcome = paper(&image, &IgnoredRegion::default(), &parameters);
            prop_assert_eq!(outcome.is_ok(), parameters.check().is_ok());
        }
    }
}
