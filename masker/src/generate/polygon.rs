//! Filled polygons on the pixel grid.

use super::LIT;
use crate::image::GrayImage;

/// Fills polygons one by one into an image, all with the value [`LIT`].
///
/// A polygon covers the pixels on its edges, and those inside by the even-odd rule: a self-intersecting polygon leaves
/// out what it winds around twice. OpenCV's `fillPoly` covers the same pixels. What an earlier polygon covers stays
/// covered, so overlapping polygons unite.
#[derive(Debug, Default)]
pub(super) struct PolygonFiller {
    /// Pixels of the bounding box in row order; an odd count of `true` up to a pixel means inside.
    crossings: Vec<bool>,
}

impl PolygonFiller {
    /// Fills the closed polygon through `vertices`, pixels as (x, y), all within `image`.
    pub(super) fn fill(&mut self, image: &mut GrayImage, vertices: &[(u32, u32)]) {
        let edges = || vertices.iter().zip(vertices.iter().cycle().skip(1));
        let xs = || vertices.iter().map(|vertex| vertex.0);
        let ys = || vertices.iter().map(|vertex| vertex.1);
        let (Some(left), Some(right), Some(top), Some(bottom)) =
            (xs().min(), xs().max(), ys().min(), ys().max())
        else {
            return;
        };
        let columns = (right - left + 1) as usize;
        self.crossings.clear();
        self.crossings.resize(columns * (bottom - top + 1) as usize, false);
        for (a, b) in edges() {
            self.cross((a.0 - left, a.1 - top), (b.0 - left, b.1 - top), columns);
        }
        let stride = image.width() as usize;
        let rows = image.chunks_exact_mut(stride).skip(top as usize);
        for (row, crossings) in rows.zip(self.crossings.chunks_exact(columns)) {
            let mut inside = false;
            for (pixel, crossed) in row[left as usize..].iter_mut().zip(crossings) {
                inside ^= crossed;
                if inside {
                    *pixel = LIT;
                }
            }
        }
        for (a, b) in edges() {
            draw_line(image, *a, *b);
        }
    }

    /// Marks in each row the first pixel at or right of the edge from `a` to `b`, (x, y) in the bounding box.
    fn cross(&mut self, a: (u32, u32), b: (u32, u32), columns: usize) {
        let (upper, lower) = if a.1 <= b.1 { (a, b) } else { (b, a) };
        let rows = i64::from(lower.1 - upper.1);
        let slope = i64::from(lower.0) - i64::from(upper.0);
        // The edge is `remainder` / `rows` of a pixel left of column x.
        let (mut x, mut remainder) = (i64::from(upper.0), 0);
        // Half-open in y, so that a vertex between two edges counts once.
        for y in upper.1..lower.1 {
            self.crossings[y as usize * columns + x as usize] ^= true;
            remainder -= slope;
            while remainder < 0 {
                (x, remainder) = (x + 1, remainder + rows);
            }
            while remainder >= rows {
                (x, remainder) = (x - 1, remainder - rows);
            }
        }
    }
}

/// Draws a straight line of 8-connected pixels between `a` and `b` (x, y), both included.
///
/// Where the line passes midway between two pixels, the one nearer to the row or column of its left end is drawn.
fn draw_line(image: &mut GrayImage, a: (u32, u32), b: (u32, u32)) {
    let (left, right) = if a.0 <= b.0 { (a, b) } else { (b, a) };
    let (dx, dy) = (right.0 - left.0, right.1.abs_diff(left.1));
    let stride = image.width() as usize;
    let down = |index: usize| if right.1 < left.1 { index - stride } else { index + stride };
    let (long, short) = (i64::from(dx.max(dy)), i64::from(dx.min(dy)));
    let pixels: &mut [u8] = image;
    let mut index = left.1 as usize * stride + left.0 as usize;
    let mut deviation = long - 2 * short;
    pixels[index] = LIT;
    for _ in 0..long {
        let is_diagonal = deviation < 0;
        deviation += 2 * if is_diagonal { long - short } else { -short };
        if is_diagonal || dx >= dy {
            index += 1;
        }
        if is_diagonal || dx < dy {
            index = down(index);
        }
        pixels[index] = LIT;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::image::Luma;
    use proptest::prelude::*;

    fn filled(width: u32, height: u32, vertices: &[(u32, u32)]) -> GrayImage {
        let mut image = GrayImage::new(width, height);
        PolygonFiller::default().fill(&mut image, vertices);
        image
    }

    fn rows(image: &GrayImage) -> Vec<String> {
        let text = |row: &[u8]| row.iter().map(|value| if *value == LIT { '#' } else { '.' }).collect();
        image.as_raw().chunks_exact(image.width() as usize).map(text).collect()
    }

    #[test]
    fn covers_its_border() {
        let image = filled(5, 4, &[(1, 0), (3, 0), (3, 2), (1, 2)]);
        assert_eq!(rows(&image), [".###.", ".###.", ".###.", "....."]);
    }

    #[test]
    fn point_and_line_are_polygons() {
        assert_eq!(rows(&filled(3, 1, &[(1, 0)])), [".#."]);
        assert_eq!(rows(&filled(4, 2, &[(0, 0), (3, 0)])), ["####", "...."]);
        assert_eq!(rows(&filled(2, 1, &[])), [".."]);
    }

    #[test]
    fn winding_twice_leaves_a_hole() {
        // A pentagram: its heart is wound around twice.
        let star = [(20, 0), (32, 36), (0, 14), (40, 14), (8, 36)];
        let image = filled(41, 37, &star);
        assert_eq!(image.get_pixel(20, 20), &Luma([0]));
        assert_eq!(image.get_pixel(20, 8), &Luma([LIT]));
    }

    #[test]
    fn polygons_unite() {
        let mut image = GrayImage::new(4, 1);
        let mut filler = PolygonFiller::default();
        filler.fill(&mut image, &[(0, 0), (1, 0)]);
        filler.fill(&mut image, &[(1, 0), (2, 0)]);
        assert_eq!(rows(&image), ["###."]);
    }

    proptest! {
        #[test]
        fn stays_within_its_bounding_box(
            vertices in proptest::collection::vec((0_u32..30, 0_u32..30), 1..12),
        ) {
            let image = filled(30, 30, &vertices);
            let inside = |value: u32, values: &[u32]| {
                values.iter().min() <= Some(&value) && Some(&value) <= values.iter().max()
            };
            let (xs, ys): (Vec<u32>, Vec<u32>) = vertices.iter().copied().unzip();
            for (x, y, Luma([value])) in image.enumerate_pixels() {
                prop_assert!(*value == 0 || (inside(x, &xs) && inside(y, &ys)));
            }
            for (x, y) in vertices {
                prop_assert_eq!(image.get_pixel(x, y), &Luma([LIT]));
            }
        }
    }
}
