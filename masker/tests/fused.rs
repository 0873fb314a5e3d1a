//! The fused method on rendered frames: the whole airframe, nothing else, or a refusal that says what to change.

#![allow(clippy::unwrap_used)]

mod lit_scene;

use image::{GrayImage, Luma};
use lit_scene::LitScene;
use proptest::prelude::*;
use uvcam_masker::check::{ISLET_BELOW, fill_islets};
use uvcam_masker::generate::{Accumulator, GenerateError, IgnoredRegion, Outcome, Parameters, paper};
use uvcam_masker::{Mask, MaskId};

/// How far from the airframe a masked pixel may be, px of a 752 x 480 image.
const FARTHEST: f64 = 36.0;

fn region(rectangles: &[&str]) -> IgnoredRegion {
    let rectangles = rectangles.iter().map(|text| text.parse().unwrap()).collect();
    IgnoredRegion { rectangles, polygons: Vec::new() }
}

/// The upper half, where the lamp is.
fn upper_half(scene: &LitScene) -> IgnoredRegion {
    region(&[&format!("::0:{}", scene.height / 2)])
}

fn fused(scene: &LitScene, frames: u32, ignored: &IgnoredRegion) -> Outcome {
    let mut accumulator =
        Accumulator::new(scene.width, scene.height, ignored, &Parameters::default()).unwrap();
    for number in 0..frames {
        accumulator.add(&scene.frame(number)).unwrap();
    }
    accumulator.finish()
}

fn names(outcome: &Outcome) -> Vec<&'static str> {
    outcome.verdict.findings.iter().map(|finding| finding.name()).collect()
}

/// Every pixel of the airframe is masked, and none farther from it than the margin.
fn assert_masks_airframe(scene: &LitScene, mask: &Mask) {
    let reach = FARTHEST * f64::from(scene.width) / 752.0;
    let near = |x: u32, y: u32| {
        let rays = (0..64).map(|ray| f64::from(ray) * std::f64::consts::TAU / 64.0);
        rays.flat_map(|angle| [0.0, 0.25, 0.5, 0.75, 1.0].map(|part| (angle, part * reach))).any(
            |(angle, radius)| {
                let (x, y) = (f64::from(x) + radius * angle.cos(), f64::from(y) + radius * angle.sin());
                x >= 0.0 && y >= 0.0 && scene.arm(x as u32, y as u32).is_some()
            },
        )
    };
    for (x, y) in (0..scene.height).flat_map(|y| (0..scene.width).map(move |x| (x, y))) {
        if scene.arm(x, y).is_some() {
            assert!(mask.is_masked(x, y), "airframe at {x},{y} is not masked");
        } else {
            assert!(!mask.is_masked(x, y) || near(x, y), "masked at {x},{y}, far from the airframe");
        }
    }
}

#[test]
fn finds_the_whole_airframe_and_nothing_else() {
    let lit = LitScene::default();
    let scenes = [
        ("dim", LitScene { exposure_us: 2500.0, ..lit.clone() }),
        ("weak", LitScene { exposure_us: 1600.0, ..lit.clone() }),
        ("bright", LitScene { exposure_us: 25_000.0, ..lit.clone() }),
        ("hot pixels", LitScene { stuck_px: 30, passing_px: 30, ..lit.clone() }),
        ("glints", LitScene { glints: 4, ..lit.clone() }),
        (
            "an arm that is dark in every second frame",
            LitScene { arm_is_lit: |arm, frame| (arm + frame) % 2 == 0, ..lit.clone() },
        ),
        ("other size", LitScene { width: 1128, height: 720, ..lit.clone() }),
        ("lit", lit),
    ];
    for (name, scene) in scenes {
        let outcome = fused(&scene, 5, &upper_half(&scene));
        let findings = names(&outcome);
        assert_masks_airframe(&scene, &outcome.mask.unwrap_or_else(|| panic!("{name}: {findings:?}")));
    }
}

#[test]
fn the_published_method_finds_part_of_a_weak_airframe() {
    // What the fused method is for; without the difference the scenes above would show nothing.
    let scene = LitScene { exposure_us: 1600.0, ..LitScene::default() };
    let mask = paper(&scene.frame(0), &upper_half(&scene), &Parameters::default()).unwrap().mask.unwrap();
    let pixels = (0..scene.height).flat_map(|y| (0..scene.width).map(move |x| (x, y)));
    assert!(pixels.into_iter().any(|(x, y)| scene.arm(x, y).is_some() && !mask.is_masked(x, y)));
}

#[test]
fn never_a_part_however_weak_the_light() {
    for exposure_us in [50.0, 100.0, 150.0, 200.0, 300.0, 400.0, 600.0, 800.0, 1000.0, 1300.0] {
        let scene = LitScene { exposure_us, ..LitScene::default() };
        match fused(&scene, 5, &upper_half(&scene)) {
            Outcome { mask: Some(mask), .. } => assert_masks_airframe(&scene, &mask),
            refused => assert!(
                names(&refused).iter().any(|name| ["too_dark", "too_weak", "unclear"].contains(name)),
                "{exposure_us} us: {:?}",
                names(&refused)
            ),
        }
    }
}

#[test]
fn what_cannot_be_trusted_is_refused_with_its_reason() {
    let lit = LitScene::default();
    let cases = [
        ("too_dark", LitScene { lamp: 0.0, ..lit.clone() }),
        ("over_exposed", LitScene { exposure_us: 90_000.0, ..lit.clone() }),
        ("lamp_inside", LitScene { glow_at: Some((380.0, 230.0)), ..lit.clone() }),
        ("unstable", LitScene { arm_is_lit: |arm, frame| arm == 0 || frame == 3, ..lit.clone() }),
    ];
    for (name, scene) in cases {
        let outcome = fused(&scene, 5, &upper_half(&scene));
        assert_eq!(outcome.mask, None, "{name}: {:?}", names(&outcome));
        assert!(names(&outcome).contains(&name), "{name}: {:?}", names(&outcome));
    }
}

#[test]
fn arms_touch_the_border_or_the_ignored_region() {
    let frame = |discs: &[(f64, f64)]| {
        GrayImage::from_fn(400, 300, |x, y| {
            let shines = discs.iter().any(|disc| (f64::from(x) - disc.0).hypot(f64::from(y) - disc.1) < 20.0);
            Luma([if shines { 200 } else { 10 + (x % 3) as u8 }])
        })
    };
    let outcome = |discs: &[(f64, f64)]| {
        let mut accumulator =
            Accumulator::new(400, 300, &region(&["::0:20"]), &Parameters::default()).unwrap();
        for _ in 0..3 {
            accumulator.add(&frame(discs)).unwrap();
        }
        accumulator.finish()
    };
    let amid = outcome(&[(200.0, 150.0)]);
    assert_eq!((amid.mask.is_some(), names(&amid)), (false, vec!["touches_nothing"]));
    let both = outcome(&[(200.0, 150.0), (20.0, 290.0)]);
    assert_eq!((both.mask.is_some(), names(&both)), (true, vec!["detached"]));
    for touching in [(200.0, 35.0), (200.0, 290.0), (5.0, 150.0)] {
        assert_eq!(names(&outcome(&[touching])), Vec::<&str>::new());
    }
}

#[test]
fn more_than_half_of_the_image_is_refused() {
    let mut accumulator = Accumulator::new(200, 100, &region(&[]), &Parameters::default()).unwrap();
    let frame = GrayImage::from_fn(200, 100, |x, _| Luma([if x < 100 { 220 } else { 10 }]));
    for _ in 0..5 {
        accumulator.add(&frame).unwrap();
    }
    let outcome = accumulator.finish();
    assert_eq!((outcome.mask.is_some(), names(&outcome)), (false, vec!["over_half_masked"]));
}

#[test]
fn a_mask_very_different_from_the_one_in_force_is_refused_and_a_blank_one_says_nothing() {
    let scene = LitScene::default();
    let made = fused(&scene, 5, &upper_half(&scene));
    let mask = made.mask.clone().unwrap();
    let compared = |in_force: &Mask| {
        let mut outcome = made.clone();
        outcome.compare(in_force);
        (outcome.mask.is_some(), names(&outcome))
    };
    let shifted =
        |by: u32| Mask::from_fn(mask.width(), mask.height(), |x, y| x >= by && mask.is_masked(x - by, y));
    assert_eq!(compared(&shifted(5)), (true, vec![]));
    assert_eq!(compared(&shifted(60)), (false, vec!["different"]));
    assert_eq!(compared(&Mask::from_fn(mask.width(), mask.height(), |_, _| false)), (true, vec![]));
    assert_eq!(compared(&Mask::from_fn(10, 10, |_, _| true)), (true, vec![]));
}

#[test]
fn the_area_depends_less_on_the_exposure_than_that_of_the_published_method() {
    let mut areas = (Vec::new(), Vec::new());
    for exposure_us in [2500.0, 5000.0, 25_000.0] {
        for seed in 0..3 {
            let scene = LitScene { exposure_us, seed, ..LitScene::default() };
            let ignored = upper_half(&scene);
            let published = paper(&scene.frame(0), &ignored, &Parameters::default()).unwrap().mask;
            areas.0.push(fused(&scene, 5, &ignored).mask.unwrap().masked_px() as f64);
            areas.1.push(published.unwrap().masked_px() as f64);
        }
    }
    let deviation = |areas: &[f64]| uvcam_masker::metrics::Spread::of(areas).unwrap().standard_deviation;
    let (fused, published) = (deviation(&areas.0), deviation(&areas.1));
    assert!(fused < published / 3.0, "{fused} px against {published} px");
}

#[test]
fn holes_that_look_like_markers_are_closed() {
    // A frame of 9 px around a hole of 6 px, drawn with a thin pen.
    let frame = GrayImage::from_fn(200, 100, |x, y| {
        let (x, y) = (x.abs_diff(100), y.abs_diff(90));
        Luma([if x.max(y) < 12 && x.max(y) > 3 { 220 } else { 10 + (x % 2) as u8 }])
    });
    let parameters = Parameters { kappa: 1, ..Parameters::default() };
    let mut accumulator = Accumulator::new(200, 100, &region(&[]), &parameters).unwrap();
    for _ in 0..3 {
        accumulator.add(&frame).unwrap();
    }
    let mask = accumulator.finish().mask.unwrap();
    assert!(mask.is_masked(100, 90), "the hole");
    assert_eq!(fill_islets(&mask, ISLET_BELOW).id(), mask.id());
}

#[test]
fn it_settles_when_the_mask_has_stopped_changing() {
    let settled_after = |scene: &LitScene| {
        let mut accumulator =
            Accumulator::new(scene.width, scene.height, &upper_half(scene), &Parameters::default()).unwrap();
        (0..60).find(|number| accumulator.add(&scene.frame(*number)).unwrap().is_settled)
    };
    let steady = settled_after(&LitScene::default()).unwrap();
    let late =
        settled_after(&LitScene { arm_is_lit: |arm, frame| arm == 0 || frame > 17, ..LitScene::default() });
    assert!(late.unwrap() > steady, "{late:?} {steady}");
    assert!((15..30).contains(&steady), "{steady}");
}

#[test]
fn a_frame_of_another_size_is_refused_and_the_others_still_count() {
    let scene = LitScene::default();
    let mut accumulator =
        Accumulator::new(scene.width, scene.height, &upper_half(&scene), &Parameters::default()).unwrap();
    let mut ids: Vec<Option<MaskId>> = Vec::new();
    for number in 0..5 {
        accumulator.add(&scene.frame(number)).unwrap();
    }
    ids.push(accumulator.finish().mask.map(|mask| mask.id()));
    let error = accumulator.add(&GrayImage::new(480, 752)).unwrap_err();
    assert!(matches!(error, GenerateError::Size { found: (480, 752), expected: (752, 480) }), "{error}");
    ids.push(accumulator.finish().mask.map(|mask| mask.id()));
    assert!(ids[0].is_some() && ids[0] == ids[1]);
}

proptest! {
    #[test]
    fn no_frames_make_it_panic(
        width in 0_u32..40, height in 0_u32..40, frames in proptest::collection::vec(any::<u64>(), 0..6),
        kappa in prop_oneof![4 => Parameters::KAPPA, 1 => any::<u32>()], eta in 0_u32..9, sigma in any::<u8>(),
    ) {
        let parameters = Parameters { kappa, eta, sigma, ..Parameters::default() };
        let accumulator = Accumulator::new(width, height, &IgnoredRegion::default(), &parameters);
        prop_assert_eq!(accumulator.is_ok(), Parameters::KAPPA.contains(&kappa));
        let Ok(mut accumulator) = accumulator else { return Ok(()) };
        for seed in frames {
            let value = |x: u32, y: u32| (seed.rotate_left((x * 7 + y * 13) % 64) & 0xff) as u8;
            accumulator.add(&GrayImage::from_fn(width, height, |x, y| Luma([value(x, y)]))).unwrap();
        }
        let _ = accumulator.finish();
    }
}
