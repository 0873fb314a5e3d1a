//! The published method on one frame, equations 2 to 10 of "Towards Scalable and Fast UAV Deployment".

use super::growth::grow;
use super::neighbours::visit_neighbourhoods;
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
