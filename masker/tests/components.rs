//! Connected components against a flood fill that follows the definition pixel by pixel.

use proptest::prelude::*;
use uvcam_masker::Mask;
use uvcam_masker::components::{Component, Components};

/// Labels in row order of the first pixel, found by flooding from every pixel that has none yet.
fn flooded(mask: &Mask, masked: bool) -> (Vec<u32>, Vec<Component>) {
    let (width, height) = (i64::from(mask.width()), i64::from(mask.height()));
    let mut labels = vec![0; (width * height) as usize];
    let mut components = Vec::new();
    let belongs = |x: i64, y: i64| {
        (0..width).contains(&x) && (0..height).contains(&y) && mask.is_masked(x as u32, y as u32) == masked
    };
    for start in 0..width * height {
        let mut pixels = Vec::new();
        let mut flood = vec![(start % width, start / width)];
        while let Some((x, y)) = flood.pop() {
            if !belongs(x, y) || labels[(y * width + x) as usize] != 0 {
                continue;
            }
            labels[(y * width + x) as usize] = components.len() as u32 + 1;
            pixels.push((x as u32, y as u32));
            for (dx, dy) in (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| (dx, dy))) {
                if masked || dx == 0 || dy == 0 {
                    flood.push((x + dx, y + dy));
                }
            }
        }
        let columns = pixels.iter().map(|(x, _)| *x);
        let rows = pixels.iter().map(|(_, y)| *y);
        let sides = (columns.clone().min(), columns.max(), rows.clone().min(), rows.max());
        if let (Some(x), Some(right), Some(y), Some(bottom)) = sides {
            let (width, height) = (right + 1 - x, bottom + 1 - y);
            components.push(Component { area_px: pixels.len() as u64, x, y, width, height });
        }
    }
    (labels, components)
}

fn mask_of(rows: &[&str]) -> Mask {
    Mask::from_fn(rows[0].len() as u32, rows.len() as u32, |x, y| {
        rows[y as usize].as_bytes()[x as usize] == b'#'
    })
}

#[test]
fn masked_pixels_join_at_corners_and_white_ones_do_not() {
    let mask = mask_of(&[
        "#.", //
        ".#",
    ]);
    assert_eq!(Components::masked(&mask).list(), [Component { area_px: 2, x: 0, y: 0, width: 2, height: 2 }]);
    assert_eq!(Components::white(&mask).list().len(), 2);
}

#[test]
fn arms_that_meet_below_are_one() {
    let mask = mask_of(&[
        "#.#.#", //
        "#.#.#", "#####",
    ]);
    assert_eq!(
        Components::masked(&mask).list(),
        [Component { area_px: 11, x: 0, y: 0, width: 5, height: 3 }]
    );
}

proptest! {
    #[test]
    fn components_equal_a_flood_fill(
        (width, height) in (1_u32..24, 1_u32..24),
        share in 0.0..=1.0,
        masked in prop::collection::vec(0.0..1.0, 24 * 24),
    ) {
        let mask = Mask::from_fn(width, height, |x, y| masked[(y * width + x) as usize] < share);
        for (components, colour) in [(Components::masked(&mask), true), (Components::white(&mask), false)] {
            let (labels, list) = flooded(&mask, colour);
            prop_assert_eq!(components.labels(), labels);
            prop_assert_eq!(components.list(), list);
        }
    }
}
