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
