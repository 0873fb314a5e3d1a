//! Filled polygons on the pixel grid.

use ::image::Luma;

use super::LIT;
use crate::image::GrayImage;

/// Fills polygons one by one into an image, all with the value [`LIT`].
///
/// A polygon covers the pixels on its edges, and those inside by the even-odd rule: a self-intersecting polygon leaves
/// out what it winds around twice, as OpenCV's `fillPoly` does. What an earlier polygon covers stays covered, so
/// overlapping polygons unite.
#[derive(Debug, Default)]
pub(super) struct PolygonFiller {
    /// Pixels of the bounding box in row order; an odd count of `true` up to a pixel means inside.
    crossings: Vec<bool>,
}

impl PolygonFiller {
    /// Fills the closed polygon through `vertices`, pixels as (x, y), all within `image`.
    pub(super) fn fill(&mut self, image: &mut GrayImage, vertices: &[(u32, u32)]) {
        let edges = || {
            let next = vertices.iter().cycle().skip(1);
            vertices.iter().zip(next).map(|(a, b)| (as_signed(*a), as_signed(*b)))
        };
        self.fill_inside(image, vertices, edges());
        for (a, b) in edges() {
            draw_line(image, a, b);
        }
    }

    fn fill_inside(
        &mut self,
        image: &mut GrayImage,
        vertices: &[(u32, u32)],
        edges: impl Iterator<Item = ((i64, i64), (i64, i64))>,
    ) {
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
        for (a, b) in edges {
            let ((x0, y0), (x1, y1)) = if a.1 <= b.1 { (a, b) } else { (b, a) };
            // Half-open in y, so that a vertex between two edges counts once.
            for y in y0..y1 {
                // The first column at or right of the edge.
                let x = x0 + div_ceil((x1 - x0) * (y - y0), y1 - y0);
                let index = (y - i64::from(top)) as usize * columns + (x - i64::from(left)) as usize;
                self.crossings[index] ^= true;
            }
        }
        for (y, row) in (top..).zip(self.crossings.chunks_exact(columns)) {
            let mut inside = false;
            for (x, crossed) in (left..).zip(row) {
                inside ^= crossed;
                if inside {
                    image.put_pixel(x, y, Luma([LIT]));
                }
            }
        }
    }
}

/// Draws a straight line of 8-connected pixels between `a` and `b` (x, y), both included.
///
/// Where the line passes midway between two pixels, the one nearer to its left end in the direction of the minor axis
/// is drawn.
fn draw_line(image: &mut GrayImage, a: (i64, i64), b: (i64, i64)) {
    let (left, right) = if a.0 <= b.0 { (a, b) } else { (b, a) };
    let (dx, dy) = (right.0 - left.0, right.1 - left.1);
    let steps = dx.max(dy.abs()).max(1);
    for step in 0..=steps {
        let along = |length: i64| div_ceil(2 * length.abs() * step - steps, 2 * steps) * length.signum();
        image.put_pixel((left.0 + along(dx)) as u32, (left.1 + along(dy)) as u32, Luma([LIT]));
    }
}

fn as_signed((x, y): (u32, u32)) -> (i64, i64) {
    (i64::from(x), i64::from(y))
}

/// Quotient rounded up; `divisor` is positive.
fn div_ceil(dividend: i64, divisor: i64) -> i64 {
    -(-dividend).div_euclid(divisor)
}

#[cfg(test)]
mod tests {
    use super::*;
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
