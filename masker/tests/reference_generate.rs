//! Both methods on frames with known outlines, the published one beside an independent implementation of it, where its frames and masks are at hand: in a folder `shared` beside
//! the repository, or where `UVCAM_SHARED` says.

#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};

use uvcam_masker::generate::{Accumulator, IgnoredRegion, Parameters, Rectangle, paper};
use uvcam_masker::{Mask, file, metrics};

/// Overlap that two implementations reach, which may break ties between equally distant neighbours differently.
const LEAST_OVERLAP: f64 = 0.995;
/// How far a differing pixel may be from the border of the other mask, px.
const FARTHEST: i64 = 2;

fn reference() -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared");
    let folder = std::env::var_os("UVCAM_SHARED").map_or_else(beside, PathBuf::from).join("data");
    if folder.join("lit/scenes.json").is_file() {
        return Some(folder);
    }
    println!("reference frames not present: {}", folder.display());
    None
}

/// The ignored rectangles of each scene: the numbers of its `ignore` list, four by four.
fn scenes(folder: &Path) -> Vec<(String, IgnoredRegion)> {
    let text = std::fs::read_to_string(folder.join("lit/scenes.json")).unwrap();
    let listed: serde_json::Value = serde_json::from_str(&text).unwrap();
    let scenes = listed.as_array().unwrap().iter().map(|scene| {
        let rectangles = scene["ignore"].as_array().unwrap().iter().map(|rectangle| {
            let end = |index: usize| rectangle[index].as_u64().unwrap() as u32;
            Rectangle { x0: end(0), x1: Some(end(1)), y0: end(2), y1: Some(end(3)) }
        });
        let ignored = IgnoredRegion { rectangles: rectangles.collect(), polygons: Vec::new() };
        (scene["scene"].as_str().unwrap().to_owned(), ignored)
    });
    scenes.collect()
}

/// Whether the mask's border passes within `FARTHEST` of the pixel.
fn is_near_border(mask: &Mask, x: u32, y: u32) -> bool {
    let here = mask.is_masked(x, y);
    let reach = -FARTHEST..=FARTHEST;
    reach.clone().any(|dy| {
        reach.clone().any(|dx| {
            let (x, y) = (i64::from(x) + dx, i64::from(y) + dy);
            let inside =
                (0..i64::from(mask.width())).contains(&x) && (0..i64::from(mask.height())).contains(&y);
            dx * dx + dy * dy <= FARTHEST * FARTHEST && inside && mask.is_masked(x as u32, y as u32) != here
        })
    })
}

#[test]
fn the_published_method_agrees_with_an_independent_implementation() {
    let Some(folder) = reference() else { return };
    let (mut compared, mut refused, mut least) = (0, 0, 1.0f64);
    for (scene, ignored) in scenes(&folder) {
        for number in 0..5 {
            let frame = file::read_gray(&folder.join(format!("lit/{scene}/frame_{number}.png"))).unwrap();
            let outcome = paper(&frame, &ignored, &Parameters::default()).unwrap();
            let expected = folder.join(format!("expected/{scene}/mask_{number}.png"));
            if !expected.exists() {
                assert_eq!(outcome.mask, None, "{scene} {number}: the reference is refused by equation 6");
                refused += 1;
                continue;
            }
            let (mask, expected) = (outcome.mask.unwrap(), Mask::load(&expected).unwrap());
            let overlap = metrics::overlap(&mask, &expected).unwrap();
            assert!(overlap >= LEAST_OVERLAP, "{scene} {number}: overlap {overlap}");
            for (x, y) in (0..mask.height()).flat_map(|y| (0..mask.width()).map(move |x| (x, y))) {
                let differs = mask.is_masked(x, y) != expected.is_masked(x, y);
                assert!(!differs || is_near_border(&expected, x, y), "{scene} {number}: pixel {x},{y}");
            }
            compared += 1;
            least = least.min(overlap);
        }
    }
    println!("{compared} masks compared, least overlap {least:.5}; {refused} dark frames refused by both");
    assert!(compared > 0);
}

#[test]
fn the_fused_method_masks_the_whole_airframe_and_nothing_else() {
    let Some(folder) = reference() else { return };
    for (scene, ignored) in scenes(&folder) {
        let read = |name: &str| file::read_gray(&folder.join(format!("lit/{scene}/{name}.png"))).unwrap();
        let airframe = read("airframe");
        let (width, height) = airframe.dimensions();
        let mut accumulator = Accumulator::new(width, height, &ignored, &Parameters::default()).unwrap();
        for number in 0..5 {
            accumulator.add(&read(&format!("frame_{number}"))).unwrap();
        }
        let outcome = accumulator.finish();
        let Some(mask) = outcome.mask else {
            let may_be_refused = scene.ends_with("dark") || scene.ends_with("weak");
            assert!(may_be_refused, "{scene}: {:?}", outcome.verdict);
            println!("{scene}: refused");
            continue;
        };
        assert!(!scene.ends_with("dark"), "{scene}: masked");
        let pixels = || (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let shown: Vec<(u32, u32)> = pixels().filter(|(x, y)| airframe.get_pixel(*x, *y).0[0] > 0).collect();
        let masked = shown.iter().filter(|(x, y)| mask.is_masked(*x, *y)).count();
        let share = masked as f64 / shown.len() as f64;
        // Its pixels that have a neighbour off the airframe suffice for distances.
        let edge: Vec<(u32, u32)> = shown
            .iter()
            .filter(|(x, y)| {
                let around = [(x.wrapping_sub(1), *y), (x + 1, *y), (*x, y.wrapping_sub(1)), (*x, y + 1)];
                around
                    .iter()
                    .any(|(x, y)| airframe.get_pixel_checked(*x, *y).is_none_or(|pixel| pixel.0[0] == 0))
            })
            .copied()
            .collect();
        let off = pixels().filter(|(x, y)| mask.is_masked(*x, *y) && airframe.get_pixel(*x, *y).0[0] == 0);
        let squared = |a: (u32, u32), b: (u32, u32)| a.0.abs_diff(b.0).pow(2) + a.1.abs_diff(b.1).pow(2);
        let farthest = off.filter_map(|pixel| edge.iter().map(|edge| squared(pixel, *edge)).min()).max();
        let farthest = f64::from(farthest.unwrap_or(0)).sqrt() * 752.0 / f64::from(width);
        println!("{scene}: {:.3} % masked, farthest {farthest:.1} px", share * 100.0);
        assert!(share >= 0.999, "{scene}: {share}");
        assert!(farthest <= 36.0, "{scene}: {farthest} px");
    }
}
