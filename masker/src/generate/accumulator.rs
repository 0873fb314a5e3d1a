//! Takes frames one by one and ends in a mask.

use super::evidence::Evidence;
use super::growth::grow;
use super::strip::Strip;
use super::verdict::Method;
use super::{GenerateError, IgnoredRegion, Outcome, Parameters, fused, mask_of};
use crate::check::{ISLET_BELOW, fill_islets};
use crate::components::Components;
use crate::image::GrayImage;
use crate::mask::Mask;

/// Frames that are taken in any case: two seconds at ten a second, for a hand to start moving the lamp.
const LEAST_FRAMES: u32 = 20;
/// Frames in a row that must leave the mask as it is, while the lamp goes on.
const CALM_FRAMES: u32 = 10;
/// Share of the lit pixels that noise may change.
const CALM_SHARE: f64 = 0.005;

/// How far an [`Accumulator`] is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// Frames taken.
    pub frames: u32,
    /// Pixels that were clearly lit in more than one frame.
    pub lit_px: u64,
    /// Frames since that number has last changed.
    pub calm_frames: u32,
    /// Whether the mask has stopped changing, so that more frames are not worth their time.
    pub is_settled: bool,
}

/// The fused method: takes frames of one camera while the lamp moves, and makes the mask.
///
/// Two bytes are kept per pixel, however many frames there are.
#[derive(Debug, Clone)]
pub struct Accumulator {
    evidence: Evidence,
    considered: GrayImage,
    strip: Strip,
    parameters: Parameters,
    calm_frames: u32,
}

impl Accumulator {
    /// An accumulator for frames of `width` x `height` pixels.
    ///
    /// # Errors
    /// [`GenerateError::Parameter`] where a parameter is out of its range.
    pub fn new(
        width: u32,
        height: u32,
        ignored: &IgnoredRegion,
        parameters: &Parameters,
    ) -> Result<Self, GenerateError> {
        parameters.check()?;
        let considered = ignored.considered(width, height);
        let strip = Strip::around(&considered, parameters.reach());
        let evidence = Evidence::new(&strip.cut(&considered), strip.top());
        Ok(Self { evidence, considered, strip, parameters: parameters.clone(), calm_frames: 0 })
    }

    /// Takes a frame.
    ///
    /// # Errors
    /// [`GenerateError::Size`] where the frame has another size; it is left out.
    pub fn add(&mut self, frame: &GrayImage) -> Result<Progress, GenerateError> {
        let (found, expected) = (frame.dimensions(), self.considered.dimensions());
        if found != expected {
            return Err(GenerateError::Size { found, expected });
        }
        let before = self.evidence.lit_px;
        self.evidence.add(self.strip.pixels(frame));
        let lit_px = self.evidence.lit_px;
        let is_calm = (lit_px - before) as f64 <= CALM_SHARE * lit_px as f64;
        self.calm_frames = if is_calm { self.calm_frames + 1 } else { 0 };
        Ok(self.progress())
    }

    /// How far it is.
    #[must_use]
    pub fn progress(&self) -> Progress {
        let frames = self.evidence.frames;
        let is_settled = frames >= LEAST_FRAMES && self.calm_frames >= CALM_FRAMES;
        Progress { frames, lit_px: self.evidence.lit_px, calm_frames: self.calm_frames, is_settled }
    }

    /// Makes the mask from the frames taken.
    #[must_use]
    pub fn finish(&self) -> Outcome {
        let found = fused::find(&self.evidence, &self.parameters);
        let mut shape = found.airframe;
        let mask = (found.candidates > self.parameters.eta as usize).then(|| {
            grow(&mut shape, self.parameters.kappa);
            (without_islets(mask_of(self.strip.paste(&shape))), &self.considered)
        });
        Outcome::new(Method::Fused, found.candidates, found.findings, mask)
    }
}

/// The mask with white islets closed that would look like markers.
fn without_islets(mask: Mask) -> Mask {
    let white = Components::white(&mask);
    let has_islets = white.list().iter().any(|component| component.is_below(ISLET_BELOW));
    if has_islets { fill_islets(&mask, ISLET_BELOW) } else { mask }
}
