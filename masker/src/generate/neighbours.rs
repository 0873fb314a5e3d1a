//! Nearest neighbours among the candidate pixels (equation 7).

use std::num::NonZero;
use std::panic::resume_unwind;
use std::thread::{self, available_parallelism};

use kiddo::leaf_strategies::VecOfArenas;
use kiddo::stem_strategies::Eytzinger;
use kiddo::{KdTree, SquaredEuclidean};

use super::{GenerateError, ParameterError, Parameters};

/// Bucket sizes of the k-d tree that [`Parameters::leaf`] may name.
pub const LEAF_SIZES: [u32; 4] = [5, 10, 20, 40];

/// Shift of the query point to the left and up, in pixels: too small to exchange neighbours whose distances differ.
const TIE_BREAK: (f64, f64) = (1.0 / (1_u64 << 20) as f64, 1.0 / (1_u64 << 32) as f64);

/// Fewer queries than this are not worth another thread.
const LEAST_QUERIES: usize = 500;

/// Calls `visit` with the neighbours of each of the `queried` points: those among the k nearest `points`, itself
/// included, that are nearer than tau, in the order of their distance.
///
/// Points are pixels as (x, y). The method leaves open which of several equally distant points come first; here it is
/// those further left, then those further up, so that the same frame always gives the same mask. The queries are shared
/// out among the cores; each thread works on a value of its own from `start`, and these are returned.
pub(super) fn visit_neighbourhoods<T: Send>(
    points: &[(u32, u32)],
    queried: &[(u32, u32)],
    parameters: &Parameters,
    start: impl Fn() -> T + Sync,
    visit: impl Fn(&mut T, &[(u32, u32)]) + Sync,
) -> Result<Vec<T>, GenerateError> {
    // The bucket size is part of the tree's type.
    match parameters.leaf {
        5 => search::<5, T>(points, queried, parameters, start, visit),
        10 => search::<10, T>(points, queried, parameters, start, visit),
        20 => search::<20, T>(points, queried, parameters, start, visit),
        40 => search::<40, T>(points, queried, parameters, start, visit),
        leaf => Err(ParameterError::Leaf { leaf }.into()),
    }
}

fn search<const LEAF: usize, T: Send>(
    points: &[(u32, u32)],
    queried: &[(u32, u32)],
    parameters: &Parameters,
    start: impl Fn() -> T + Sync,
    visit: impl Fn(&mut T, &[(u32, u32)]) + Sync,
) -> Result<Vec<T>, GenerateError> {
    let k = NonZero::new(parameters.k as usize).ok_or(ParameterError::K { k: parameters.k })?;
    let coordinates: Vec<[f64; 2]> = points.iter().map(|(x, y)| [f64::from(*x), f64::from(*y)]).collect();
    // Of the tree types this one searches pixels fastest, and it bears any number of them in one row.
    type Tree<const LEAF: usize> = KdTree<f64, u32, Eytzinger, VecOfArenas<f64, u32, 2, LEAF>, 2, LEAF>;
    let tree = Tree::<LEAF>::new_from_slice(&coordinates).map_err(GenerateError::Tree)?;
    let tau_squared = parameters.tau * parameters.tau;
    let work = |queried: &[(u32, u32)]| {
        let mut result = start();
        let mut neighbours = Vec::with_capacity(k.get().min(points.len()));
        for queried in queried {
            let shifted = [f64::from(queried.0) - TIE_BREAK.0, f64::from(queried.1) - TIE_BREAK.1];
            let nearest = tree.query(&shifted).nearest_n::<SquaredEuclidean<f64>>(k).execute();
            let nearest = nearest.iter().filter_map(|neighbour| points.get(neighbour.item as usize));
            neighbours.clear();
            neighbours.extend(nearest.filter(|point| squared_distance(point, queried) < tau_squared));
            visit(&mut result, &neighbours);
        }
        result
    };
    let cores = available_parallelism().map_or(1, NonZero::get);
    let share = queried.len().div_ceil(cores).max(LEAST_QUERIES);
    let mut shares = queried.chunks(share);
    let own = shares.next().unwrap_or_default();
    Ok(thread::scope(|scope| {
        let others: Vec<_> = shares.map(|share| scope.spawn(|| work(share))).collect();
        let mut results = vec![work(own)];
        for other in others {
            results.push(other.join().unwrap_or_else(|panic| resume_unwind(panic)));
        }
        results
    }))
}

fn squared_distance(a: &(u32, u32), b: &(u32, u32)) -> f64 {
    let (dx, dy) = (f64::from(a.0.abs_diff(b.0)), f64::from(a.1.abs_diff(b.1)));
    dx * dx + dy * dy
}
