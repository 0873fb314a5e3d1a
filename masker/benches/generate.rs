//! What the methods cost: the published one by the number of candidates, up to an over-exposed frame of 200,000, where each may cost no
//! more than n log n allows; and the fused one on five frames beside the published one on one of them.

#[path = "../tests/lit_scene/mod.rs"]
mod lit_scene;

use divan::Bencher;
use divan::counter::ItemsCount;
use image::{GrayImage, Luma};
use lit_scene::LitScene;
use uvcam_masker::generate::{Accumulator, IgnoredRegion, Parameters, Rectangle, paper};

fn main() {
    divan::main();
}

const SIZE: (u32, u32) = (1920, 1200);

/// A frame of 1920 x 1200 px with about as many candidates, in speckles: the tree is asked for every one of them.
fn speckled(candidates: u32) -> GrayImage {
    let share = u64::from(candidates) * (1 << 32) / u64::from(SIZE.0 * SIZE.1);
    GrayImage::from_fn(SIZE.0, SIZE.1, |x, y| {
        let hash = (u64::from(y) << 32 | u64::from(x)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let hash = (hash ^ hash >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 32;
        Luma([if hash < share { 200 } else { 10 }])
    })
}

/// An airframe under the lamp; the lamp is in the ignored upper half.
fn lit(width: u32, height: u32) -> (Vec<GrayImage>, IgnoredRegion) {
    let scene = LitScene { width, height, ..LitScene::default() };
    let upper = Rectangle { y1: Some(height / 2), ..Rectangle::default() };
    (
        (0..5).map(|number| scene.frame(number)).collect(),
        IgnoredRegion { rectangles: vec![upper], polygons: Vec::new() },
    )
}

#[divan::bench(args = [3125, 6250, 12_500, 25_000, 50_000, 100_000, 200_000], sample_count = 5)]
fn paper_by_candidates(bencher: Bencher, candidates: u32) {
    let frame = speckled(candidates);
    bencher
        .counter(ItemsCount::new(candidates))
        .bench(|| paper(&frame, &IgnoredRegion::default(), &Parameters::default()));
}

#[divan::bench(args = [752, 1920], sample_count = 20)]
fn paper_on_one_frame(bencher: Bencher, width: u32) {
    let (frames, ignored) = lit(width, width * 5 / 8);
    bencher.bench(|| paper(&frames[0], &ignored, &Parameters::default()));
}

#[divan::bench(args = [752, 1920], sample_count = 20)]
fn fused_on_five_frames(bencher: Bencher, width: u32) {
    let (frames, ignored) = lit(width, width * 5 / 8);
    bencher.bench(|| {
        let mut accumulator = Accumulator::new(width, width * 5 / 8, &ignored, &Parameters::default());
        if let Ok(accumulator) = &mut accumulator {
            for frame in &frames {
                let _ = accumulator.add(frame);
            }
        }
        accumulator.map(|accumulator| accumulator.finish())
    });
}
