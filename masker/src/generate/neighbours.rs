//! Nearest neighbours among the candidate pixels (equation 7).

use std::num::NonZero;

use kiddo::leaf_strategies::VecOfArenas;
use kiddo::stem_strategies::Eytzinger;
use kiddo::{KdTree, SquaredEuclidean};

use super::{GenerateError, ParameterError, Parameters};

/// Bucket sizes of the k-d tree that [`Parameters::leaf`] may name.
pub const LEAF_SIZES: [u32; 4] = [5, 10, 20, 40];

/// Calls `visit` with the neighbours of each of the `queried` points: those among the k nearest `points`, itself
/// included, that are nearer than tau, in the order of their distance.
///
/// Points are pixels as (x, y). The method leaves open which of several equally distant points come first.
pub(super) fn for_each_neighbourhood(
    points: &[(u32, u32)],
    queried: &[(u32, u32)],
    parameters: &Parameters,
    visit: impl FnMut(&[(u32, u32)]),
) -> Result<(), GenerateError> {
    // The bucket size is part of the tree's type.
    match parameters.leaf {
        5 => search::<5>(points, queried, parameters, visit),
        10 => search::<10>(points, queried, parameters, visit),
        20 => search::<20>(points, queried, parameters, visit),
        40 => search::<40>(points, queried, parameters, visit),
        leaf => Err(ParameterError::Leaf { leaf }.into()),
    }
}

fn search<const LEAF: usize>(
    points: &[(u32, u32)],
    queried: &[(u32, u32)],
    parameters: &Parameters,
    mut visit: impl FnMut(&[(u32, u32)]),
) -> Result<(), GenerateError> {
    let Some(k) = NonZero::new(parameters.k as usize) else {
        return Err(ParameterError::K { k: parameters.k }.into());
    };
    let coordinates: Vec<[f32; 2]> = points.iter().map(to_coordinates).collect();
    // Of the tree types this one searches pixels fastest, and it alone bears any number of them in one row.
    type Tree<const LEAF: usize> = KdTree<f32, u32, Eytzinger, VecOfArenas<f32, u32, 2, LEAF>, 2, LEAF>;
    let tree = Tree::<LEAF>::new_from_slice(&coordinates).map_err(GenerateError::Tree)?;
    let tau_squared = (parameters.tau * parameters.tau) as f32;
    let mut neighbours = Vec::with_capacity(k.get().min(points.len()));
    for point in queried {
        let found = tree
            .query(&to_coordinates(point))
            .nearest_n::<SquaredEuclidean<f32>>(k)
            .within(tau_squared)
            .exclusive_boundaries()
            .execute();
        neighbours.clear();
        neighbours.extend(found.iter().map(|neighbour| points[neighbour.item as usize]));
        visit(&neighbours);
    }
    Ok(())
}

/// Exact up to 2^24 pixels in each direction.
fn to_coordinates(&(x, y): &(u32, u32)) -> [f32; 2] {
    [x as f32, y as f32]
}
