//! Growth of a shape by the thickness of its drawn contours (equation 10).

use super::LIT;
use crate::image::GrayImage;

/// Larger pens cover no more of any image: distances along a column are kept in 16 bits.
const LARGEST_RADIUS: u32 = u16::MAX as u32 - 1;

/// Pixels of a row that are looked at together.
const STRETCH: usize = 32;

/// Grows the [`LIT`] pixels of `image` as if its contours were drawn with a round pen `thickness` pixels wide.
///
/// The pen covers whole pixels around the contour's, as OpenCV's `drawContours` does: it reaches half the thickness,
/// rounded up, in each direction, and none at a thickness of 1.
///
/// Exact and linear in the number of pixels, whatever the thickness. The pen's chord through a pixel depends on the
/// vertical distance of the nearest lit pixel of its column alone, so one pass finds these distances and another
/// unites the chords of each row.
pub(super) fn grow(image: &mut GrayImage, thickness: u32) {
    let columns = image.width() as usize;
    if columns == 0 || thickness <= 1 {
        return;
    }
    let half_chords = half_chords(thickness.div_ceil(2).min(LARGEST_RADIUS));
    // What is farther than the radius from the first and the last lit pixel stays as it is.
    let mut rows = image.chunks_exact(columns);
    let Some(first) = rows.position(|row| row.contains(&LIT)) else { return };
    let last = first + rows.rposition(|row| row.contains(&LIT)).map_or(0, |row| row + 1);
    let top = first.saturating_sub(half_chords.len());
    let bottom = (last + half_chords.len()).min(image.height() as usize);
    let pixels = &mut image.as_mut()[top * columns..bottom * columns];

    let radius = half_chords.len() as u16 - 1;
    let distances = column_distances(pixels, columns, radius + 1);
    // At a column: chords that begin there minus chords that ended before it.
    let mut changes = vec![0_i32; columns + 1];
    for (row, distances) in pixels.chunks_exact_mut(columns).zip(distances.chunks_exact(columns)) {
        // Most of a row is far from what is lit, and found to be so faster many pixels at a time.
        for (place, near) in distances.chunks(STRETCH).enumerate() {
            if near.iter().fold(u16::MAX, |least, distance| least.min(*distance)) > radius {
                continue;
            }
            for (x, distance) in (place * STRETCH..).zip(near) {
                if let Some(half_chord) = half_chords.get(usize::from(*distance)) {
                    changes[x.saturating_sub(*half_chord)] += 1;
                    changes[(x + half_chord + 1).min(columns)] -= 1;
                }
            }
        }
        let mut chords = 0;
        for (pixels, changes) in row.chunks_mut(STRETCH).zip(changes.chunks_mut(STRETCH)) {
            if changes.iter().fold(0, |any, change| any | change) == 0 {
                if chords > 0 {
                    pixels.fill(LIT);
                }
                continue;
            }
            for (pixel, change) in pixels.iter_mut().zip(changes) {
                chords += std::mem::take(change);
                if chords > 0 {
                    *pixel = LIT;
                }
            }
        }
        changes[columns] = 0;
    }
}

/// Half the chord of the pen, in whole pixels, at each whole distance from its centre up to `radius`.
fn half_chords(radius: u32) -> Vec<usize> {
    let radius = u64::from(radius);
    let chord = |distance: u64| (radius * radius - distance * distance).isqrt() as usize;
    let mut half_chords: Vec<usize> = (0..=radius).map(chord).collect();
    // A bar along a diagonal has its edge on the whole pixel nearest to the radius in both directions.
    let diagonal = (radius as f64 * std::f64::consts::FRAC_1_SQRT_2).round() as usize;
    half_chords[diagonal] = half_chords[diagonal].max(diagonal);
    half_chords
}

/// Distance of each pixel to the nearest lit one of its column, in row order, at most `limit`.
fn column_distances(pixels: &[u8], columns: usize, limit: u16) -> Vec<u16> {
    let mut distances: Vec<u16> = pixels.iter().map(|value| if *value == LIT { 0 } else { limit }).collect();
    approach(distances.chunks_exact_mut(columns));
    approach(distances.chunks_exact_mut(columns).rev());
    distances
}

/// Lowers the distances of each row to one more than those of the row before.
fn approach<'a>(rows: impl Iterator<Item = &'a mut [u16]>) {
    let mut before: Option<&mut [u16]> = None;
    for row in rows {
        if let Some(before) = before {
            for (distance, before) in row.iter_mut().zip(before) {
                *distance = (*distance).min(before.saturating_add(1));
            }
        }
        before = Some(row);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::image::Luma;
    use proptest::prelude::*;

    #[test]
    fn thin_pens_cover_whole_pixels() {
        let grown = |thickness| {
            let mut image = GrayImage::new(5, 1);
            image.put_pixel(2, 0, Luma([LIT]));
            grow(&mut image, thickness);
            image.as_raw().iter().filter(|value| **value == LIT).count()
        };
        assert_eq!([0, 1, 2, 3, 4].map(grown), [1, 1, 3, 5, 5]);
    }

    proptest! {
        #[test]
        fn reaches_half_the_thickness(
            width in 1_u32..40, height in 1_u32..40, radius in 1_u32..30,
            lit in proptest::collection::vec((0_u32..40, 0_u32..40), 0..6),
        ) {
            let lit: Vec<_> = lit.into_iter().filter(|(x, y)| *x < width && *y < height).collect();
            let mut image = GrayImage::new(width, height);
            for (x, y) in &lit {
                image.put_pixel(*x, *y, Luma([LIT]));
            }
            grow(&mut image, 2 * radius);
            for (x, y, Luma([value])) in image.enumerate_pixels() {
                let squared = |(lit_x, lit_y): &(u32, u32)| x.abs_diff(*lit_x).pow(2) + y.abs_diff(*lit_y).pow(2);
                let nearest = lit.iter().map(squared).min().map_or(f64::INFINITY, |d| f64::from(d).sqrt());
                // The diagonal alone reaches up to 0.71 px farther.
                prop_assert!(*value == LIT || nearest > f64::from(radius), "at {}, {}", x, y);
                prop_assert!(*value != LIT || nearest < f64::from(radius) + 0.71, "at {}, {}", x, y);
            }
        }
    }

    #[test]
    fn bears_any_thickness_and_size() {
        for (width, height) in [(0, 0), (0, 5), (5, 0), (1, 1), (7, 3)] {
            let mut image = GrayImage::from_pixel(width, height, Luma([LIT]));
            grow(&mut image, u32::MAX);
            assert!(image.pixels().all(|Luma([value])| *value == LIT));
        }
    }
}
