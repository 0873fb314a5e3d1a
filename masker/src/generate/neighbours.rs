//! Nearest neighbours among the candidate pixels (equation 7).

use std::iter;
use std::num::NonZero;
use std::panic::resume_unwind;
use std::sync::LazyLock;
use std::thread::{self, available_parallelism};

use kiddo::kd_tree::ConstructionError;
use kiddo::leaf_strategies::VecOfArenas;
use kiddo::stem_strategies::Eytzinger;
use kiddo::{KdTree, SquaredEuclidean};

use super::{GenerateError, LIT, ParameterError, Parameters, lit_pixels};
use crate::image::GrayImage;

/// Most neighbours that are looked for in all: those of every second pixel of 1920 x 1200 with the published k.
pub(super) const MOST_WORK: usize = 24_000_000;

/// Shift of the query point to the left and up, in pixels: too small to exchange neighbours whose distances differ.
const TIE_BREAK: (f64, f64) = (1.0 / (1_u64 << 20) as f64, 1.0 / (1_u64 << 32) as f64);

/// Fewer queries than this are not worth another thread.
const LEAST_QUERIES: usize = 2000;

/// Nearest neighbours are looked for among the pixels within this distance, in pixels. Where the airframe is, they hold all of
/// them, and looking at a pixel is faster than walking through a tree.
const NEAR_PX: i32 = 8;

/// Calls `visit` with the neighbours of each of the `queried` points: those among its k nearest `candidates`, itself
/// included, that are nearer than tau, in the order of their distance.
///
/// Candidates are the [`LIT`] pixels; points are pixels as (x, y). The method leaves open which of several equally distant
/// points come first; here it is those further left, then those further up, so that the same frame always gives the same mask.
/// The queries are shared out among the cores; each thread works on a value of its own from `start`, and these are returned.
pub(super) fn visit_neighbourhoods<T: Send>(
    candidates: &GrayImage,
    queried: &[(u32, u32)],
    parameters: &Parameters,
    start: impl Fn() -> T + Sync,
    visit: impl Fn(&mut T, &[(u32, u32)]) + Sync,
) -> Result<Vec<T>, GenerateError> {
    // The bucket size is part of the tree's type: one arm for each of `LEAF_SIZES`.
    match parameters.leaf {
        5 => search::<5, T>(candidates, queried, parameters, start, visit),
        10 => search::<10, T>(candidates, queried, parameters, start, visit),
        20 => search::<20, T>(candidates, queried, parameters, start, visit),
        40 => search::<40, T>(candidates, queried, parameters, start, visit),
        leaf => Err(ParameterError::Leaf { leaf }.into()),
    }
}

fn search<const LEAF: usize, T: Send>(
    candidates: &GrayImage,
    queried: &[(u32, u32)],
    parameters: &Parameters,
    start: impl Fn() -> T + Sync,
    visit: impl Fn(&mut T, &[(u32, u32)]) + Sync,
) -> Result<Vec<T>, GenerateError> {
    let k = NonZero::new(parameters.k as usize).ok_or(ParameterError::K { k: parameters.k })?;
    let near = Near::new(candidates, k.get());
    let far = LazyLock::new(|| Far::<LEAF>::new(candidates));
    let tau_squared = parameters.tau * parameters.tau;
    let work = |queried: &[(u32, u32)]| {
        let mut result = start();
        let mut neighbours = Vec::with_capacity(k.get());
        for queried in queried {
            if !near.find(*queried, &mut neighbours) {
                far.as_ref().map_err(|error| GenerateError::Tree(error.clone()))?.find(
                    *queried,
                    k,
                    &mut neighbours,
                );
            }
            neighbours.retain(|point| squared_distance(point, queried) < tau_squared);
            visit(&mut result, &neighbours);
        }
        Ok(result)
    };
    // Asking for the number of cores reads files.
    let cores =
        if queried.len() > LEAST_QUERIES { available_parallelism().map_or(1, NonZero::get) } else { 1 };
    let share = queried.len().div_ceil(cores).max(LEAST_QUERIES);
    let mut shares = queried.chunks(share);
    let own = shares.next().unwrap_or_default();
    thread::scope(|scope| {
        let others: Vec<_> = shares.map(|share| scope.spawn(|| work(share))).collect();
        let own = work(own);
        let others =
            others.into_iter().map(|other| other.join().unwrap_or_else(|panic| resume_unwind(panic)));
        iter::once(own).chain(others).collect()
    })
}

/// The pixels around a point.
struct Near<'a> {
    candidates: &'a GrayImage,
    /// From the point to each of them, (x, y), the nearest first.
    offsets: Vec<(i32, i32)>,
    k: usize,
}

impl<'a> Near<'a> {
    fn new(candidates: &'a GrayImage, k: usize) -> Self {
        let side = || -NEAR_PX..=NEAR_PX;
        let mut offsets: Vec<(i32, i32)> = side().flat_map(|dx| side().map(move |dy| (dx, dy))).collect();
        let squared = |(dx, dy): &(i32, i32)| dx * dx + dy * dy;
        offsets.retain(|offset| squared(offset) <= NEAR_PX * NEAR_PX);
        offsets.sort_by_key(|offset| (squared(offset), *offset));
        Near { candidates, offsets, k }
    }

    /// Finds the k nearest candidates of a point, and says whether it did: not where some lie farther away.
    fn find(&self, (x, y): (u32, u32), neighbours: &mut Vec<(u32, u32)>) -> bool {
        neighbours.clear();
        let (width, height) = self.candidates.dimensions();
        for (dx, dy) in &self.offsets {
            // What is left of or above the image wraps to numbers beyond it.
            let (x, y) = (x.wrapping_add_signed(*dx), y.wrapping_add_signed(*dy));
            if x < width
                && y < height
                && self.candidates.as_raw()[y as usize * width as usize + x as usize] == LIT
            {
                neighbours.push((x, y));
                if neighbours.len() == self.k {
                    return true;
                }
            }
        }
        false
    }
}

/// All candidates in a tree: of the tree types this one searches pixels fastest, and it bears any number of them in one row.
struct Far<const LEAF: usize> {
    points: Vec<(u32, u32)>,
    tree: KdTree<f64, u32, Eytzinger, VecOfArenas<f64, u32, 2, LEAF>, 2, LEAF>,
}

impl<const LEAF: usize> Far<LEAF> {
    fn new(candidates: &GrayImage) -> Result<Self, ConstructionError> {
        let points: Vec<(u32, u32)> = lit_pixels(candidates).collect();
        let coordinates: Vec<[f64; 2]> = points.iter().map(|(x, y)| [f64::from(*x), f64::from(*y)]).collect();
        Ok(Far { tree: KdTree::new_from_slice(&coordinates)?, points })
    }

    /// Finds the k nearest candidates of a point.
    fn find(&self, (x, y): (u32, u32), k: NonZero<usize>, neighbours: &mut Vec<(u32, u32)>) {
        let shifted = [f64::from(x) - TIE_BREAK.0, f64::from(y) - TIE_BREAK.1];
        let nearest = self.tree.query(&shifted).nearest_n::<SquaredEuclidean<f64>>(k).execute();
        neighbours.clear();
        neighbours.extend(nearest.iter().filter_map(|neighbour| self.points.get(neighbour.item as usize)));
    }
}

fn squared_distance(a: &(u32, u32), b: &(u32, u32)) -> f64 {
    let (dx, dy) = (f64::from(a.0.abs_diff(b.0)), f64::from(a.1.abs_diff(b.1)));
    dx * dx + dy * dy
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::image::Luma;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn near_and_far_find_the_same(lit in proptest::collection::btree_set((0_u32..40, 0_u32..30), 1..300)) {
            let candidates =
                GrayImage::from_fn(40, 30, |x, y| Luma([if lit.contains(&(x, y)) { LIT } else { 0 }]));
            let k = NonZero::new(20).unwrap();
            let (near, far) = (Near::new(&candidates, k.get()), Far::<10>::new(&candidates).unwrap());
            let (mut by_near, mut by_far) = (Vec::new(), Vec::new());
            for point in lit {
                if near.find(point, &mut by_near) {
                    far.find(point, k, &mut by_far);
                    prop_assert_eq!(&by_near, &by_far, "around {:?}", point);
                }
            }
        }
    }
}
