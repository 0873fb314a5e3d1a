//! Connected sets of lit pixels that are too small to be seen from afar.

use super::LIT;
use crate::image::GrayImage;

/// Darkens the 8-connected sets of at most `most_px` [`LIT`] pixels.
///
/// What takes time is the lit pixels alone; rows without any are passed over.
pub(super) fn drop_specks(image: &mut GrayImage, most_px: usize) {
    let columns = image.width() as usize;
    let pixels: &mut [u8] = image;
    let mut set = Vec::new();
    for start in 0..pixels.len().checked_div(columns).unwrap_or(0) {
        let row = start * columns..(start + 1) * columns;
        if !pixels[row.clone()].contains(&LIT) {
            continue;
        }
        for index in row {
            if pixels[index] == LIT {
                collect(pixels, columns, index, &mut set);
                if set.len() <= most_px {
                    set.iter().for_each(|index| pixels[*index] = 0);
                }
            }
        }
    }
    // A loop without branches is done many pixels at a time.
    pixels.iter_mut().for_each(|value| *value = if *value == SEEN { LIT } else { *value });
}

/// Value of lit pixels whose set has been collected.
const SEEN: u8 = LIT - 1;

/// Collects the set of lit pixels around the one at `start` and marks them as [`SEEN`].
fn collect(pixels: &mut [u8], columns: usize, start: usize, set: &mut Vec<usize>) {
    set.clear();
    set.push(start);
    pixels[start] = SEEN;
    let mut next = 0;
    while let Some(index) = set.get(next).copied() {
        next += 1;
        let (x, y) = (index % columns, index / columns);
        let neighbours = x.saturating_sub(1)..(x + 2).min(columns);
        for y in y.saturating_sub(1)..(y + 2).min(pixels.len() / columns) {
            for index in neighbours.clone().map(|x| y * columns + x) {
                if pixels[index] == LIT {
                    pixels[index] = SEEN;
                    set.push(index);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::image::Luma;
    use proptest::prelude::*;

    use crate::components::Components;
    use crate::mask::Mask;

    fn image(mask: &Mask) -> GrayImage {
        GrayImage::from_fn(mask.width(), mask.height(), |x, y| {
            Luma([if mask.is_masked(x, y) { LIT } else { 0 }])
        })
    }

    proptest! {
        #[test]
        fn exactly_the_small_sets_go(pixels in "[.#]{80}", most in 0_usize..9) {
            let mask = Mask::from_fn(10, 8, |x, y| pixels.as_bytes()[(y * 10 + x) as usize] == b'#');
            let components = Components::masked(&mask);
            let labels = components.labels();
            let mut left = image(&mask);
            drop_specks(&mut left, most);
            for (value, label) in left.as_raw().iter().zip(labels) {
                let is_large = label > 0 && components.list()[label as usize - 1].area_px > most as u64;
                prop_assert_eq!(*value, if is_large { LIT } else { 0 });
            }
        }
    }

    #[test]
    fn bears_empty_images() {
        for (width, height) in [(0, 0), (0, 3), (3, 0)] {
            drop_specks(&mut GrayImage::new(width, height), 5);
        }
    }
}
