//! Growth of a shape by a disc.

use super::LIT;
use crate::image::GrayImage;

/// Larger discs cover no more of any image: distances along a column are kept in 16 bits.
const LARGEST_DIAMETER: u32 = 2 * (u16::MAX as u32 - 1);

/// Grows the [`LIT`] pixels of `image` by a disc of `diameter` pixels: a pixel becomes lit where the centre of a lit
/// one lies within half the diameter. Drawing the contours of the shape with that thickness covers the same pixels.
///
/// Exact and linear in the number of pixels, whatever the diameter. The disc's chord through a pixel shrinks with the
/// vertical distance of the nearest lit pixel of its column, so one pass finds these distances and another unites the
/// chords of each row.
pub(super) fn grow(image: &mut GrayImage, diameter: u32) {
    let columns = image.width() as usize;
    if columns == 0 {
        return;
    }
    let half_chords = half_chords(diameter.min(LARGEST_DIAMETER));
    let distances = column_distances(image, half_chords.len() as u16);
    // At a column: chords that begin there minus chords that ended before it.
    let mut changes = vec![0_i32; columns + 1];
    for (row, distances) in image.as_mut().chunks_exact_mut(columns).zip(distances.chunks_exact(columns)) {
        let mut is_empty = true;
        for (x, distance) in distances.iter().enumerate() {
            if let Some(half_chord) = half_chords.get(usize::from(*distance)) {
                changes[x.saturating_sub(*half_chord)] += 1;
                changes[(x + half_chord + 1).min(columns)] -= 1;
                is_empty = false;
            }
        }
        if is_empty {
            continue;
        }
        let mut chords = 0;
        for (pixel, change) in row.iter_mut().zip(&mut changes) {
            chords += std::mem::take(change);
            if chords > 0 {
                *pixel = LIT;
            }
        }
        changes[columns] = 0;
    }
}

/// Half the chord of the disc, in whole pixels, at each whole distance from its centre.
fn half_chords(diameter: u32) -> Vec<usize> {
    let squared = |value: u64| 4 * value * value;
    let limit = u64::from(diameter) * u64::from(diameter);
    (0..)
        .map_while(|distance| limit.checked_sub(squared(distance)))
        .map(|rest| (rest / 4).isqrt() as usize)
        .collect()
}

/// Distance of each pixel to the nearest lit one of its column, in row order, at most `limit`.
fn column_distances(image: &GrayImage, limit: u16) -> Vec<u16> {
    let columns = image.width() as usize;
    let to_lit = |pixel: &u8| if *pixel == LIT { 0 } else { limit };
    let mut distances: Vec<u16> = image.as_raw().iter().map(to_lit).collect();
    let mut rows = distances.chunks_exact_mut(columns);
    if let Some(mut above) = rows.next() {
        for row in rows {
            approach(row, above);
            above = row;
        }
    }
    let mut rows = distances.chunks_exact_mut(columns).rev();
    if let Some(mut below) = rows.next() {
        for row in rows {
            approach(row, below);
            below = row;
        }
    }
    distances
}

/// Lowers the distances of a row to one more than those of its neighbour.
fn approach(row: &mut [u16], neighbour: &[u16]) {
    for (distance, next) in row.iter_mut().zip(neighbour) {
        *distance = (*distance).min(next.saturating_add(1));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::image::Luma;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn reaches_exactly_half_the_diameter(
            width in 1_u32..40, height in 1_u32..40, diameter in 0_u32..60,
            lit in proptest::collection::vec((0_u32..40, 0_u32..40), 0..6),
        ) {
            let lit: Vec<_> = lit.into_iter().filter(|(x, y)| *x < width && *y < height).collect();
            let mut image = GrayImage::new(width, height);
            for (x, y) in &lit {
                image.put_pixel(*x, *y, Luma([LIT]));
            }
            grow(&mut image, diameter);
            for (x, y, Luma([value])) in image.enumerate_pixels() {
                let is_near = lit.iter().any(|(lit_x, lit_y)| {
                    4 * (x.abs_diff(*lit_x).pow(2) + y.abs_diff(*lit_y).pow(2)) <= diameter * diameter
                });
                prop_assert_eq!(*value == LIT, is_near, "at {}, {}", x, y);
            }
        }
    }

    #[test]
    fn bears_any_diameter_and_size() {
        for (width, height) in [(0, 0), (0, 5), (5, 0), (1, 1), (7, 3)] {
            let mut image = GrayImage::from_pixel(width, height, Luma([LIT]));
            grow(&mut image, u32::MAX);
            assert!(image.pixels().all(|Luma([value])| *value == LIT));
        }
    }
}
