//! Can this mask fly?

use std::fmt;

use crate::components::{Component, Components};
use crate::image::GrayImage;
use crate::mask::{DISCARD, KEEP, MAX_RUNS, Mask, MaskId, grey_px, runs};

/// White islets whose bounding box is below this size in both directions, in pixels, look like markers.
///
/// The detector of UVDAR compares a pixel with a ring of radius 3 or 4 around it. A bright patch that fits
/// inside a dark ring is a marker to it; a longer edge never is.
pub const ISLET_BELOW: u32 = 8;

/// What a [`Problem`] means for flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// The mask can fly, but someone should look at it.
    Warning,
    /// The mask must not fly.
    Refused,
}

/// Something wrong or odd about a mask.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Problem {
    /// Some pixels are neither 0 nor 255.
    NotBinary {
        /// Number of such pixels.
        grey_px: u64,
    },
    /// The mask was made for another resolution.
    WrongSize {
        /// Width and height of the mask.
        found: (u32, u32),
        /// Width and height of the camera's frames.
        expected: (u32, u32),
    },
    /// The mask has more than [`MAX_RUNS`] runs.
    TooManyRuns {
        /// Number of runs.
        runs: usize,
    },
    /// Every pixel is kept; right for a camera that does not see its airframe.
    NothingMasked,
    /// No pixel is kept; the camera would be blind.
    EverythingMasked,
    /// More than half of the pixels are masked. A warning, because hiding too much is safe but blinds the
    /// camera; often a mask with black and white exchanged.
    OverHalfMasked {
        /// Masked pixels.
        masked_px: u64,
        /// All pixels.
        total_px: u64,
    },
    /// White islets below [`ISLET_BELOW`] in both directions.
    Islets {
        /// Number of islets.
        count: usize,
        /// Their pixels together.
        area_px: u64,
        /// The first one in row order.
        first: Component,
    },
}

impl Problem {
    /// Whether the mask may fly in spite of this problem.
    #[must_use]
    pub fn severity(&self) -> Severity {
        match self {
            Self::NotBinary { .. }
            | Self::WrongSize { .. }
            | Self::TooManyRuns { .. }
            | Self::EverythingMasked => Severity::Refused,
            Self::NothingMasked | Self::OverHalfMasked { .. } | Self::Islets { .. } => Severity::Warning,
        }
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::NotBinary { grey_px } => write!(
                f,
                "grey pixels: {grey_px}, neither {DISCARD} (discard) nor {KEEP} (keep); \
                 repaint them, or binarise explicitly with `uvcam mask repair --threshold`"
            ),
            Self::WrongSize { found, expected } => write!(
                f,
                "the mask is {}x{} pixels, the frames are {}x{}; \
                 use the mask made for this camera at this resolution",
                found.0, found.1, expected.0, expected.1
            ),
            Self::TooManyRuns { runs } => write!(
                f,
                "{runs} runs of masked pixels, more than {MAX_RUNS}; no airframe is so ragged: draw it in plain shapes"
            ),
            Self::NothingMasked => write!(
                f,
                "no pixel is masked, right only for a camera that does not see its airframe; \
                 generate a mask where it does"
            ),
            Self::EverythingMasked => write!(
                f,
                "all pixels are masked, so the camera would be blind; \
                 check that black and white are not exchanged: {DISCARD} discards, {KEEP} keeps"
            ),
            Self::OverHalfMasked { masked_px, total_px } => write!(
                f,
                "{masked_px} of {total_px} pixels are masked, more than half; \
                 check that black and white are not exchanged: {DISCARD} discards, {KEEP} keeps"
            ),
            Self::Islets { count, area_px, first } => write!(
                f,
                "white islets below {ISLET_BELOW} px in both directions: {count}, together {area_px} px, \
                 the first at x {}, y {}; each looks like a marker, so fill them with `uvcam mask repair`",
                first.x, first.y
            ),
        }
    }
}

/// What [`check`] found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Report {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Pixels that are 0.
    pub masked_px: u64,
    /// Number of horizontal runs of such pixels.
    pub runs: usize,
    /// Their 8-connected parts.
    pub parts: Vec<Component>,
    /// Pixels that are neither 0 nor 255.
    pub grey_px: u64,
    /// Identity of the mask; [`MaskId::NONE`] for an image that is not binary and so is no mask.
    pub mask_id: MaskId,
    /// All problems, those that refuse first.
    pub problems: Vec<Problem>,
}

impl Report {
    /// Whether no problem refuses the mask.
    #[must_use]
    pub fn can_fly(&self) -> bool {
        self.problems.iter().all(|problem| problem.severity() < Severity::Refused)
    }
}

/// Examines a mask image, for frames of `expected` width and height where these are known.
///
/// An image with grey pixels is described by its pixels that are 0; its shape is not judged, since it depends
/// on how the image will be binarised.
#[must_use]
pub fn check(gray: &GrayImage, expected: Option<(u32, u32)>) -> Report {
    let (found, grey_px) = (gray.dimensions(), grey_px(gray));
    let size =
        expected.filter(|expected| *expected != found).map(|expected| Problem::WrongSize { found, expected });
    let mut problems = Vec::from_iter(size);
    // The lowest value that is kept is 1: this masks exactly the pixels that are 0.
    let runs = runs(gray, DISCARD + 1);
    if runs > MAX_RUNS {
        // What is ragged beyond use is not taken apart.
        problems.push(Problem::TooManyRuns { runs });
        let masked_px = gray.as_raw().iter().filter(|value| **value == DISCARD).count() as u64;
        let (width, height) = found;
        return Report {
            width,
            height,
            masked_px,
            runs,
            parts: Vec::new(),
            grey_px,
            mask_id: MaskId::NONE,
            problems,
        };
    }
    let mask = Mask::binarised(gray, DISCARD + 1);
    if grey_px > 0 {
        problems.push(Problem::NotBinary { grey_px });
    } else {
        problems.extend(coverage(&mask));
        problems.extend(islets(&mask));
    }
    Report {
        width: mask.width(),
        height: mask.height(),
        masked_px: mask.masked_px(),
        runs: mask.runs().len(),
        parts: Components::masked(&mask).list().to_vec(),
        grey_px,
        mask_id: if grey_px > 0 { MaskId::NONE } else { mask.id() },
        problems,
    }
}

/// Masks the white islets whose bounding box is below `below` pixels in both directions.
///
/// An all-white mask has no islets and stays as it is.
#[must_use]
pub fn fill_islets(mask: &Mask, below: u32) -> Mask {
    if mask.masked_px() == 0 {
        return mask.clone();
    }
    let white = Components::white(mask);
    let labels = white.labels();
    Mask::from_fn(mask.width(), mask.height(), |x, y| {
        let label = labels[y as usize * mask.width() as usize + x as usize];
        // Label 0 is masked already.
        label.checked_sub(1).is_none_or(|index| white.list()[index as usize].is_below(below))
    })
}

fn coverage(mask: &Mask) -> Option<Problem> {
    let (masked_px, total_px) = (mask.masked_px(), u64::from(mask.width()) * u64::from(mask.height()));
    if masked_px == total_px {
        Some(Problem::EverythingMasked)
    } else if masked_px == 0 {
        Some(Problem::NothingMasked)
    } else if masked_px > total_px / 2 {
        Some(Problem::OverHalfMasked { masked_px, total_px })
    } else {
        None
    }
}

fn islets(mask: &Mask) -> Option<Problem> {
    if mask.masked_px() == 0 {
        return None;
    }
    let white = Components::white(mask);
    let islets = || white.list().iter().filter(|component| component.is_below(ISLET_BELOW));
    islets().next().map(|first| Problem::Islets {
        count: islets().count(),
        area_px: islets().map(|islet| islet.area_px).sum(),
        first: *first,
    })
}
