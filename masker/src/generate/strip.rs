//! The rows of an image that can have to do with the mask: often half of them, as the lamp is in the other half.

use std::ops::Range;

use super::LIT;
use crate::image::GrayImage;

/// The rows that are considered somewhere, and those that growth reaches from there.
#[derive(Debug, Clone)]
pub(super) struct Strip {
    width: u32,
    height: u32,
    rows: Range<u32>,
}

impl Strip {
    /// The strip around the rows of `considered` that hold a [`LIT`] pixel, `reach` pixels wider on both sides.
    pub(super) fn around(considered: &GrayImage, reach: u32) -> Self {
        let (width, height) = considered.dimensions();
        let mut rows = considered.as_raw().chunks_exact((width as usize).max(1));
        let is_considered = |row: &[u8]| row.contains(&LIT);
        let rows = rows.position(is_considered).map_or(0..0, |first| {
            let last = first + rows.rposition(is_considered).map_or(0, |row| row + 1);
            (first as u32).saturating_sub(reach)
                ..(last as u32).saturating_add(reach).saturating_add(1).min(height)
        });
        Self { width, height, rows }
    }

    /// Its first row in the image.
    pub(super) fn top(&self) -> u32 {
        self.rows.start
    }

    /// Its part of an image, pixels in row order.
    pub(super) fn pixels<'a>(&self, image: &'a GrayImage) -> &'a [u8] {
        let at = |row: u32| row as usize * self.width as usize;
        image.as_raw().get(at(self.rows.start)..at(self.rows.end)).unwrap_or_default()
    }

    /// Its part of an image, as an image.
    pub(super) fn cut(&self, image: &GrayImage) -> GrayImage {
        let pixels = self.pixels(image).to_vec();
        GrayImage::from_raw(self.width, self.rows.len() as u32, pixels).unwrap_or_default()
    }

    /// The whole image, dark but for this part of it.
    pub(super) fn paste(&self, part: &GrayImage) -> GrayImage {
        let mut image = GrayImage::new(self.width, self.height);
        let first = self.rows.start as usize * self.width as usize;
        let pixels: &mut [u8] = &mut image;
        pixels.iter_mut().skip(first).zip(part.as_raw()).for_each(|(pixel, part)| *pixel = *part);
        image
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::image::Luma;

    #[test]
    fn what_is_cut_out_fits_back() {
        let image = GrayImage::from_fn(3, 9, |_, y| Luma([if (4..6).contains(&y) { LIT } else { 0 }]));
        for (reach, rows) in [(0, 4..6), (1, 3..7), (4, 0..9), (u32::MAX, 0..9)] {
            let strip = Strip::around(&image, reach);
            assert_eq!((strip.rows.clone(), strip.top()), (rows.clone(), rows.start));
            assert_eq!(strip.cut(&image).height(), rows.len() as u32);
            assert_eq!(strip.paste(&strip.cut(&image)), image);
        }
    }

    #[test]
    fn where_nothing_is_considered_nothing_is_left() {
        for (width, height) in [(0, 0), (0, 4), (4, 0), (4, 4)] {
            let image = GrayImage::new(width, height);
            let strip = Strip::around(&image, 3);
            assert_eq!(strip.paste(&strip.cut(&image)), image);
            assert!(strip.pixels(&image).is_empty());
        }
    }
}
