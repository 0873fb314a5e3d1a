//! Numbers and pictures that describe a mask: shape, spread over several masks, overlap, overlay.

use ::image::{Luma, Rgb};

use crate::components::{Component, Components};
use crate::image::{GrayImage, RgbImage};
use crate::mask::Mask;

/// Steps to the eight neighbours as (x, y), counterclockwise on the screen, the first to the right.
const STEPS: [(i64, i64); 8] = [(1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1), (0, 1), (1, 1)];

/// Shape of one connected part of a mask (equation 14 of "Towards Scalable and Fast UAV Deployment").
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shape {
    /// Area in pixels and bounding box.
    pub component: Component,
    /// Length of the outer border in pixels.
    ///
    /// The border is the closed path through the centres of the outermost pixels, from neighbour to neighbour: a step
    /// along a row or column counts 1, a diagonal one the square root of 2. Holes add nothing, a single pixel has
    /// length 0, and a line one pixel wide is walked there and back. OpenCV's `arcLength` of the outer contour is the
    /// same path.
    pub perimeter_px: f64,
    /// Perimeter squared over area: about 14 for a disc, the more the longer or the more ragged the part.
    pub compactness: f64,
}

/// Shapes of the connected parts of a mask, masked pixels 8-connected, in the row order of their first pixels.
#[must_use]
pub fn shapes(mask: &Mask) -> Vec<Shape> {
    let components = Components::masked(mask);
    let labels = Labels { width: mask.width(), height: mask.height(), labels: components.labels() };
    let mut shapes: Vec<Shape> = Vec::with_capacity(components.list().len());
    for (run, index) in components.runs() {
        // Components are numbered by their first runs.
        if index == shapes.len() {
            let component = components.list()[index];
            let perimeter_px = labels.perimeter(i64::from(run.start), i64::from(run.row));
            let compactness = perimeter_px * perimeter_px / component.area_px as f64;
            shapes.push(Shape { component, perimeter_px, compactness });
        }
    }
    shapes
}

/// Label of each pixel in row order.
struct Labels {
    width: u32,
    height: u32,
    labels: Vec<u32>,
}

impl Labels {
    fn at(&self, x: i64, y: i64) -> Option<u32> {
        let inside = (0..i64::from(self.width)).contains(&x) && (0..i64::from(self.height)).contains(&y);
        inside.then(|| self.labels[y as usize * self.width as usize + x as usize])
    }

    /// Length of the outer border of the part whose first pixel in row order is (x, y).
    fn perimeter(&self, x: i64, y: i64) -> f64 {
        let label = self.at(x, y);
        let step_from = |x: i64, y: i64, came_from: usize| {
            (1..=8).map(|turn| (came_from + turn) % 8).find(|direction| {
                let (dx, dy) = STEPS[*direction];
                self.at(x + dx, y + dy) == label
            })
        };
        // The pixel to the left of the first one lies outside, so the walk begins as if it came from there.
        let Some(first) = step_from(x, y, 4) else { return 0.0 };
        let (mut current, mut direction, mut length) = ((x, y), first, 0.0);
        loop {
            let (dx, dy) = STEPS[direction];
            current = (current.0 + dx, current.1 + dy);
            length += if dx != 0 && dy != 0 { std::f64::consts::SQRT_2 } else { 1.0 };
            // There is at least the way back.
            let Some(next) = step_from(current.0, current.1, (direction + 4) % 8) else { return length };
            // A pixel may be passed several times; the walk ends where it would repeat its first step.
            if current == (x, y) && next == first {
                return length;
            }
            direction = next;
        }
    }
}

/// Mean and spread of one number over several masks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread {
    /// Arithmetic mean.
    pub mean: f64,
    /// Standard deviation of the sample, with n - 1 in the denominator; 0 for a single value.
    pub standard_deviation: f64,
}

impl Spread {
    /// Mean and spread of `values`; `None` where there is none.
    #[must_use]
    pub fn of(values: &[f64]) -> Option<Self> {
        let count = values.len() as f64;
        let mean = (count > 0.0).then(|| values.iter().sum::<f64>() / count)?;
        let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
        Some(Self { mean, standard_deviation: (squares / (count - 1.0).max(1.0)).sqrt() })
    }
}

/// Overlap of two masks: pixels masked in both over pixels masked in either, 0 to 1; 1 where neither masks any.
///
/// `None` where the sizes differ.
#[must_use]
pub fn overlap(a: &Mask, b: &Mask) -> Option<f64> {
    if (a.width(), a.height()) != (b.width(), b.height()) {
        return None;
    }
    let mut both = 0;
    let mut others = b.runs().iter().peekable();
    for run in a.runs() {
        while others.next_if(|other| (other.row, other.end()) <= (run.row, run.start)).is_some() {}
        // The last run that reaches this one may reach the next one as well.
        let mut reaching = others.clone();
        while let Some(other) = reaching.next_if(|other| (other.row, other.start) < (run.row, run.end())) {
            both += u64::from(run.end().min(other.end()) - run.start.max(other.start));
        }
    }
    let either = a.masked_px() + b.masked_px() - both;
    Some(if either == 0 { 1.0 } else { both as f64 / either as f64 })
}

/// The input image with the mask shown over it in red (equation 11), for a look before a mask is accepted.
///
/// Pixels that the mask lacks because its size differs are shown as they are.
#[must_use]
pub fn overlay(image: &GrayImage, mask: &Mask) -> RgbImage {
    let mut picture = RgbImage::from_fn(image.width(), image.height(), |x, y| {
        let Luma([grey]) = *image.get_pixel(x, y);
        Rgb([grey; 3])
    });
    for run in mask.runs() {
        for x in run.start..run.end() {
            if let Some(Rgb([red, green, blue])) = picture.get_pixel_mut_checked(x, run.row) {
                *red = *red / 2 + 127;
                *green /= 2;
                *blue /= 2;
            }
        }
    }
    picture
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::{PI, SQRT_2};

    fn drawn(rows: &[&str]) -> Mask {
        Mask::from_fn(rows[0].len() as u32, rows.len() as u32, |x, y| {
            rows[y as usize].as_bytes()[x as usize] == b'#'
        })
    }

    fn perimeters(rows: &[&str]) -> Vec<f64> {
        shapes(&drawn(rows)).iter().map(|shape| shape.perimeter_px).collect()
    }

    #[test]
    fn perimeter_runs_through_pixel_centres() {
        assert_eq!(perimeters(&["###", "###", "###"]), [8.0]);
        assert_eq!(perimeters(&["....", ".#..", "...."]), [0.0]);
        assert_eq!(perimeters(&["#...", ".#..", "..#."]), [4.0 * SQRT_2]);
    }

    #[test]
    fn holes_add_nothing_to_the_perimeter() {
        assert_eq!(perimeters(&["####", "#..#", "#..#", "####"]), [12.0]);
    }

    #[test]
    fn a_pixel_passed_twice_does_not_end_the_walk() {
        let perimeter = perimeters(&["#.#", ".#.", ".#."])[0];
        // The steps are summed in another order here.
        assert!((perimeter - 2.0 * (2.0 * SQRT_2 + 1.0)).abs() < 1e-9, "{perimeter}");
    }

    #[test]
    fn disc_approaches_the_compactness_of_a_circle() {
        let disc =
            Mask::from_fn(400, 400, |x, y| (x as i32 - 200).pow(2) + (y as i32 - 200).pow(2) <= 150 * 150);
        let [shape] = shapes(&disc)[..] else { panic!("a disc is one part") };
        // Steps in eight directions make a round border about 5 % longer.
        assert!((shape.compactness / (4.0 * PI) - 1.11).abs() < 0.02, "{}", shape.compactness);
    }

    #[test]
    fn spread_of_a_sample() {
        assert_eq!(Spread::of(&[]), None);
        assert_eq!(Spread::of(&[7.0]), Some(Spread { mean: 7.0, standard_deviation: 0.0 }));
        assert_eq!(Spread::of(&[1.0, 3.0]), Some(Spread { mean: 2.0, standard_deviation: SQRT_2 }));
    }

    #[test]
    fn overlap_needs_equal_sizes() {
        assert_eq!(overlap(&drawn(&["##"]), &drawn(&["##", ".."])), None);
        assert_eq!(overlap(&drawn(&[".."]), &drawn(&[".."])), Some(1.0));
        assert_eq!(overlap(&drawn(&["##."]), &drawn(&[".##"])), Some(1.0 / 3.0));
    }

    #[test]
    fn overlay_leaves_white_pixels_alone() {
        let picture = overlay(&GrayImage::from_pixel(2, 1, Luma([100])), &drawn(&["#."]));
        assert_eq!(picture.as_raw(), &[177, 50, 50, 100, 100, 100]);
    }

    #[test]
    fn overlay_bears_a_mask_of_another_size() {
        assert_eq!(overlay(&GrayImage::new(1, 1), &drawn(&["##", "##"])).dimensions(), (1, 1));
    }

    proptest! {
        #[test]
        fn overlap_counts_pixels(a in "[.#]{24}", b in "[.#]{24}") {
            let mask = |text: &str| {
                Mask::from_fn(6, 4, |x, y| text.as_bytes()[(y * 6 + x) as usize] == b'#')
            };
            let pairs = || a.bytes().zip(b.bytes());
            let both = pairs().filter(|pair| *pair == (b'#', b'#')).count();
            let either = pairs().filter(|pair| *pair != (b'.', b'.')).count();
            let expected = if either == 0 { 1.0 } else { both as f64 / either as f64 };
            prop_assert_eq!(overlap(&mask(&a), &mask(&b)), Some(expected));
        }

        #[test]
        fn every_part_is_measured_once(pixels in "[.#]{64}") {
            let mask = Mask::from_fn(8, 8, |x, y| pixels.as_bytes()[(y * 8 + x) as usize] == b'#');
            let shapes = shapes(&mask);
            prop_assert_eq!(shapes.iter().map(|shape| shape.component.area_px).sum::<u64>(), mask.masked_px());
            for shape in shapes {
                let box_px = 2.0 * f64::from(shape.component.width - 1 + shape.component.height - 1);
                // No closed path around a box is shorter than its diagonal there and back.
                prop_assert!(shape.perimeter_px >= box_px / SQRT_2 - 1e-9);
            }
        }
    }
}
