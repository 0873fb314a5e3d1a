//! The published method on one frame, equations 2 to 10 of "Towards Scalable and Fast UAV Deployment".

use super::growth::grow;
use super::neighbours::{MOST_WORK, visit_neighbourhoods};
use super::polygon::PolygonFiller;
use super::{GenerateError, LIT, Parameters, lit_pixels};
use crate::image::GrayImage;

/// Those of `pixels`, in row order, that may show the airframe: [`LIT`] where brighter than sigma and considered (equations 2 to 5).
pub(super) fn candidates(pixels: &[u8], considered: &GrayImage, sigma: u8) -> GrayImage {
    let mut candidates = considered.clone();
    for (candidate, value) in candidates.iter_mut().zip(pixels) {
        *candidate = if *value > sigma { *candidate } else { 0 };
    }
    candidates
}

/// Connects the candidates with their neighbours and grows the result (equations 7 to 10).
pub(super) fn connect(candidates: &GrayImage, parameters: &Parameters) -> Result<GrayImage, GenerateError> {
    let half_side = half_side_of_neighbours(parameters.k);
    let queried: Vec<(u32, u32)> =
        lit_pixels(candidates).filter(|(x, y)| !is_surrounded(candidates, *x, *y, half_side)).collect();
    if queried.len().saturating_mul(parameters.k as usize) > MOST_WORK {
        return Err(GenerateError::Work { candidates: queried.len(), k: parameters.k });
    }
    let start = || (candidates.clone(), PolygonFiller::default());
    let drawn =
        visit_neighbourhoods(candidates, &queried, parameters, start, |(drawn, filler), neighbours| {
            filler.fill(drawn, neighbours);
        })?;
    let unite = |mut shape: GrayImage, drawn: GrayImage| {
        shape.iter_mut().zip(drawn.as_raw()).for_each(|(pixel, drawn)| *pixel |= drawn);
        shape
    };
    let mut shape = drawn.into_iter().map(|(drawn, _)| drawn).reduce(unite).unwrap_or_default();
    grow(&mut shape, parameters.kappa);
    Ok(shape)
}

/// Whether all pixels in a square around (x, y) are candidates.
///
/// Where the square holds the k nearest pixels of (x, y), its polygon lies within the square and so adds nothing to
/// the candidates, each of which is a corner of its own polygon.
fn is_surrounded(candidates: &GrayImage, x: u32, y: u32, half_side: u32) -> bool {
    let (width, height) = candidates.dimensions();
    if x < half_side || y < half_side || width - x <= half_side || height - y <= half_side {
        return false;
    }
    let columns = (x - half_side) as usize..=(x + half_side) as usize;
    (y - half_side..=y + half_side).all(|y| {
        let row = &candidates.as_raw()[y as usize * width as usize..][columns.clone()];
        row.iter().all(|value| *value == LIT)
    })
}

/// Half the side of the smallest square that holds the k nearest pixels of its centre, whichever of equally distant
/// ones are taken: all pixels nearer than the first row outside number at least k.
fn half_side_of_neighbours(k: u32) -> u32 {
    let holds = |half_side: u32| {
        let (half_side, outside) = (i64::from(half_side), (i64::from(half_side) + 1).pow(2));
        let square = || -half_side..=half_side;
        let nearer = square().flat_map(|y| square().map(move |x| x * x + y * y)).filter(|d| *d < outside);
        nearer.count() >= k as usize
    };
    (0..).find(|half_side| holds(*half_side)).unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every second pixel of a row in every second row: none is surrounded.
    fn dots(width: u32, height: u32) -> GrayImage {
        GrayImage::from_fn(width, height, |x, y| [if (x | y) % 2 == 0 { LIT } else { 0 }].into())
    }

    #[test]
    fn more_work_than_can_be_done_in_time_is_refused_with_what_to_change() {
        let parameters = Parameters { k: 100, ..Parameters::default() };
        let refused = connect(&dots(1000, 1000), &parameters).unwrap_err();
        assert_eq!(
            refused.to_string(),
            "250000 candidates at edges with k = 100 neighbours each are more than can be connected in time; raise sigma, \
             extend the ignored region, or lower k to 96"
        );
        assert!(connect(&dots(80, 64), &parameters).is_ok());
    }
}
