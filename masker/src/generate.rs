//! Makes a mask from frames in which a lamp lights the airframe.
//!
//! The method is that of "Towards Scalable and Fast UAV Deployment", section 3.2: bright pixels outside the ignored region are
//! candidates; each is connected with its nearest neighbours by a filled polygon; the union grows by half the contour's thickness.

mod growth;
mod ignored;
mod neighbours;
mod paper;
mod parameters;
mod polygon;

use thiserror::Error;

pub use ignored::{CameraPlace, IgnoredRegion, Rectangle, RectangleError};
pub use neighbours::LEAF_SIZES;
pub use parameters::{ParameterError, Parameters};

use crate::image::GrayImage;
use crate::mask::{KEEP, Mask};

/// Value of pixels that belong to a shape, in images that hold one.
const LIT: u8 = 255;

/// Why no mask can be computed.
#[derive(Debug, Error)]
pub enum GenerateError {
    /// A parameter is out of its range.
    #[error("the parameters cannot be used")]
    Parameter(#[from] ParameterError),
    /// The k-d tree cannot hold the candidates.
    #[error("the candidates do not fit into a k-d tree; generate from smaller images")]
    Tree(#[source] kiddo::kd_tree::ConstructionError),
}

/// What was made of a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// Number of candidate pixels, |P|.
    pub candidates: usize,
    /// The mask; none where |P| > eta does not hold (equation 6): the scene is too dark.
    pub mask: Option<Mask>,
}

/// The published method on one frame, equations 2 to 10.
///
/// # Errors
/// [`GenerateError::Parameter`] where a parameter is out of its range, [`GenerateError::Tree`] for more candidates than a tree holds.
pub fn paper(
    image: &GrayImage,
    ignored: &IgnoredRegion,
    parameters: &Parameters,
) -> Result<Outcome, GenerateError> {
    parameters.check()?;
    let considered = ignored.considered(image.width(), image.height());
    let lit = paper::candidates(image, &considered, parameters.sigma);
    let candidates = paper::count(&lit);
    if candidates <= parameters.eta as usize {
        return Ok(Outcome { candidates, mask: None });
    }
    let mut shape = paper::connect(&lit, parameters)?;
    shape.iter_mut().for_each(|value| *value = !*value);
    Ok(Outcome { candidates, mask: Some(Mask::binarised(&shape, KEEP)) })
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
            eta in 0_u32..4, k in 0_u32..30, tau in any::<f64>(), kappa in any::<u32>(),
        ) {
            let image = GrayImage::from_fn(width, height, |x, y| {
                Luma([(seed.rotate_left((x * 7 + y * 13) % 64) & 0xff) as u8])
            });
            let parameters = Parameters { sigma, eta, leaf: 10, k, tau, kappa };
            let _ = paper(&image, &IgnoredRegion::default(), &parameters);
        }
    }
}
