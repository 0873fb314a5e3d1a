//! Which masks may fly, and why not.

use proptest::prelude::*;
use uvcam_masker::check::{ISLET_BELOW, Problem, Severity, check, fill_islets};
use uvcam_masker::components::{Component, Components};
use uvcam_masker::{GrayImage, Mask, MaskId};

/// 64x48 pixels, the rectangle from (10, 10) to below (40, 30) masked but for a white one inside it.
fn mask_with_hole(width: u32, height: u32) -> Mask {
    let inside = |value: u32, start: u32, length: u32| (start..start + length).contains(&value);
    Mask::from_fn(64, 48, |x, y| {
        inside(x, 10, 30) && inside(y, 10, 20) && !(inside(x, 15, width) && inside(y, 12, height))
    })
}

fn problems(mask: &Mask) -> Vec<Problem> {
    check(&mask.to_gray(), None).problems
}

#[test]
fn a_sound_mask_is_described() {
    let mask = mask_with_hole(0, 0);
    let report = check(&mask.to_gray(), Some((64, 48)));
    assert_eq!((report.width, report.height), (64, 48));
    assert_eq!((report.masked_px, report.runs, report.grey_px), (600, 20, 0));
    assert_eq!(report.parts, [Component { area_px: 600, x: 10, y: 10, width: 30, height: 20 }]);
    assert_eq!(report.mask_id, mask.id());
    assert_eq!(report.problems, []);
    assert!(report.can_fly());
}

#[test]
fn grey_pixels_are_refused_and_counted() {
    let mut gray = mask_with_hole(0, 0).to_gray();
    gray.put_pixel(0, 0, [1].into());
    gray.put_pixel(1, 0, [254].into());
    let report = check(&gray, None);
    assert_eq!(report.problems, [Problem::NotBinary { grey_px: 2 }]);
    assert_eq!((report.grey_px, report.masked_px, report.mask_id), (2, 600, MaskId::NONE));
    assert!(!report.can_fly());
}

#[test]
fn another_size_is_refused() {
    let report = check(&mask_with_hole(0, 0).to_gray(), Some((48, 64)));
    assert_eq!(report.problems, [Problem::WrongSize { found: (64, 48), expected: (48, 64) }]);
    assert!(!report.can_fly());
}

#[test]
fn an_all_white_mask_flies_with_a_warning() {
    let report = check(&Mask::from_fn(4, 4, |_, _| false).to_gray(), None);
    assert_eq!(report.problems, [Problem::NothingMasked]);
    assert!(report.can_fly());
}

#[test]
fn an_all_black_mask_is_refused() {
    let report = check(&Mask::from_fn(4, 4, |_, _| true).to_gray(), None);
    assert_eq!(report.problems, [Problem::EverythingMasked]);
    assert!(!report.can_fly());
}

#[test]
fn more_than_half_is_a_warning_and_half_is_not() {
    let rows = |rows| Mask::from_fn(20, 20, move |_, y| y < rows);
    assert_eq!(problems(&rows(10)), []);
    assert_eq!(problems(&rows(11)), [Problem::OverHalfMasked { masked_px: 220, total_px: 400 }]);
    assert!(check(&rows(11).to_gray(), None).can_fly());
}

#[test]
fn a_white_islet_counts_below_8_px_in_both_directions() {
    let first = Component { area_px: 49, x: 15, y: 12, width: 7, height: 7 };
    assert_eq!(problems(&mask_with_hole(7, 7)), [Problem::Islets { count: 1, area_px: 49, first }]);
    assert_eq!(problems(&mask_with_hole(8, 1)), []);
    assert_eq!(problems(&mask_with_hole(1, 8)), []);
}

#[test]
fn filling_masks_the_islets_and_nothing_else() {
    assert_eq!(fill_islets(&mask_with_hole(7, 7), ISLET_BELOW), mask_with_hole(0, 0));
    assert_eq!(fill_islets(&mask_with_hole(8, 7), ISLET_BELOW), mask_with_hole(8, 7));
}

#[test]
fn an_all_white_mask_is_no_islet() {
    let white = Mask::from_fn(5, 5, |_, _| false);
    assert_eq!(fill_islets(&white, ISLET_BELOW), white);
}

#[test]
fn every_problem_names_its_values_and_a_remedy() {
    let size = Problem::WrongSize { found: (752, 480), expected: (960, 600) };
    assert_eq!(
        size.to_string(),
        "the mask is 752x480 pixels, the frames are 960x600; use the mask made for this camera at this resolution"
    );
    let first = Component { area_px: 9, x: 3, y: 4, width: 3, height: 3 };
    assert_eq!(
        Problem::Islets { count: 2, area_px: 17, first }.to_string(),
        "white islets below 8 px in both directions: 2, together 17 px, the first at x 3, y 4; \
         each looks like a marker, so fill them with `uvcam mask repair`"
    );
    assert_eq!(
        Problem::OverHalfMasked { masked_px: 220, total_px: 400 }.to_string(),
        "220 of 400 pixels are masked, more than half; \
         check that black and white are not exchanged: 0 discards, 255 keeps"
    );
    assert_eq!(
        Problem::NotBinary { grey_px: 812 }.to_string(),
        "grey pixels: 812, neither 0 (discard) nor 255 (keep); repaint them, or binarise explicitly with `uvcam mask repair --threshold`"
    );
}

proptest! {
    #[test]
    fn any_image_can_be_checked(
        (width, height) in (1_u32..20, 1_u32..20),
        palette in prop::sample::select(vec![vec![0, 255], vec![0], vec![255], (0..=255).collect::<Vec<u8>>()]),
        choice in prop::collection::vec(any::<prop::sample::Index>(), 20 * 20),
        expected in prop::option::of((1_u32..20, 1_u32..20)),
    ) {
        let gray = GrayImage::from_fn(width, height, |x, y| {
            [palette[choice[(y * width + x) as usize].index(palette.len())]].into()
        });
        let report = check(&gray, expected);
        prop_assert_eq!(report.masked_px, gray.as_raw().iter().filter(|value| **value == 0).count() as u64);
        prop_assert_eq!(report.parts.iter().map(|part| part.area_px).sum::<u64>(), report.masked_px);
        prop_assert_eq!(report.can_fly(), report.problems.iter().all(|p| p.severity() == Severity::Warning));
        prop_assert_eq!(report.mask_id, Mask::from_gray(&gray).map_or(MaskId::NONE, |mask| mask.id()));
    }

    #[test]
    fn a_filled_mask_covers_the_old_one_and_has_no_islets(
        (width, height) in (1_u32..30, 1_u32..30),
        masked in prop::collection::vec(prop::bool::weighted(0.6), 30 * 30),
        below in 0_u32..10,
    ) {
        let mask = Mask::from_fn(width, height, |x, y| masked[(y * width + x) as usize]);
        let filled = fill_islets(&mask, below);
        let has_islets = Components::white(&filled).list().iter().any(|component| component.is_below(below));
        prop_assert!(!has_islets || filled.masked_px() == 0);
        for run in mask.runs() {
            prop_assert!((run.start..run.end()).all(|x| filled.is_masked(x, run.row)));
        }
    }
}
