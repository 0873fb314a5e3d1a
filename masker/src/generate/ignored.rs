//! The ignored region H_cam (equation 2): parts of the image where light is not the airframe's.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::LIT;
use super::polygon::PolygonFiller;
use crate::image::GrayImage;

/// Rectangle of columns `x0` to `x1` and rows `y0` to `y1` in pixels, the ends excluded.
///
/// `None` as an end is the border of the image, and what reaches beyond the border is cut off. As text
/// `x0:x1:y0:y1`, where an empty number is the border: `:376::` is the left half of an image 752 pixels wide.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Rectangle {
    /// First column.
    pub x0: u32,
    /// First column past the rectangle.
    pub x1: Option<u32>,
    /// First row.
    pub y0: u32,
    /// First row past the rectangle.
    pub y1: Option<u32>,
}

/// How much of a text a message repeats, characters.
const SHOWN: usize = 60;

/// A text that is no [`Rectangle`].
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error(
    "`{text}` is no rectangle; give x0:x1:y0:y1 in pixels with x0 < x1 and y0 < y1, empty for the image border"
)]
pub struct RectangleError {
    text: String,
}

impl Rectangle {
    /// The rectangle from column `x0` and row `y0` to column `x1` and row `y1`, these excluded.
    pub(super) fn around(x0: u32, y0: u32, x1: u32, y1: u32) -> Self {
        Self { x0, x1: Some(x1), y0, y1: Some(y1) }
    }

    /// The least rectangle that holds both.
    pub(super) fn united(&self, other: &Self) -> Self {
        let farther = |a: Option<u32>, b: Option<u32>| Some(a?.max(b?));
        Self {
            x0: self.x0.min(other.x0),
            x1: farther(self.x1, other.x1),
            y0: self.y0.min(other.y0),
            y1: farther(self.y1, other.y1),
        }
    }
}

impl fmt::Display for Rectangle {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let end = |end: Option<u32>| end.map_or_else(String::new, |end| end.to_string());
        write!(formatter, "{}:{}:{}:{}", self.x0, end(self.x1), self.y0, end(self.y1))
    }
}

impl From<Rectangle> for String {
    fn from(rectangle: Rectangle) -> Self {
        rectangle.to_string()
    }
}

impl TryFrom<String> for Rectangle {
    type Error = RectangleError;

    fn try_from(text: String) -> Result<Self, Self::Error> {
        text.parse()
    }
}

impl FromStr for Rectangle {
    type Err = RectangleError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let parse = || {
            let ends: Vec<Option<u32>> = text
                .split(':')
                .map(|end| if end.trim().is_empty() { Ok(None) } else { end.trim().parse().map(Some) })
                .collect::<Result<_, _>>()
                .ok()?;
            let [x0, x1, y0, y1] = ends[..] else { return None };
            let (x0, y0) = (x0.unwrap_or(0), y0.unwrap_or(0));
            let is_empty = x1.is_some_and(|x1| x1 <= x0) || y1.is_some_and(|y1| y1 <= y0);
            (!is_empty).then_some(Self { x0, x1, y0, y1 })
        };
        parse().ok_or_else(|| RectangleError {
            text: text.chars().filter(|c| !c.is_control()).take(SHOWN).collect(),
        })
    }
}

/// Where on the UAV a camera sits; each place has its own ignored region.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CameraPlace {
    /// Left of the UAV, looking to the left.
    Left,
    /// Right of the UAV, looking to the right.
    Right,
    /// At the back of the UAV, looking backwards.
    Back,
}

/// The ignored region H_cam: a union of rectangles and polygons.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct IgnoredRegion {
    /// Rectangles.
    pub rectangles: Vec<Rectangle>,
    /// Polygons, each a closed path of pixels (x, y), edges included; even-odd where a path crosses itself. Vertices
    /// beyond the image are moved onto its border.
    pub polygons: Vec<Vec<(u32, u32)>>,
}

impl IgnoredRegion {
    /// The region that the published method ignores for a camera with images of `width` x `height` pixels.
    ///
    /// The lamp's cut is the upper three quarters of the image for side cameras and the left three quarters for the
    /// back camera. Side cameras also ignore the columns beside their arms, given by the authors for 752 columns and
    /// scaled here to `width`.
    #[must_use]
    pub fn preset(place: CameraPlace, width: u32, height: u32) -> Self {
        let scaled = |column: u32| (u64::from(column) * u64::from(width) / 752) as u32;
        let three_quarters = |length: u32| Some((u64::from(length) * 3 / 4) as u32);
        let columns = |x0: u32, x1: Option<u32>| Rectangle { x0, x1, ..Rectangle::default() };
        let upper = Rectangle { y1: three_quarters(height), ..Rectangle::default() };
        let rectangles = match place {
            CameraPlace::Left => {
                vec![upper, columns(scaled(123), Some(scaled(452))), columns(scaled(633), None)]
            }
            CameraPlace::Right => {
                vec![upper, columns(0, Some(scaled(120))), columns(scaled(301), Some(scaled(630)))]
            }
            CameraPlace::Back => vec![columns(0, three_quarters(width))],
        };
        Self { rectangles, polygons: Vec::new() }
    }

    /// The region as an image of `width` x `height` pixels, [`LIT`] where pixels are *not* ignored.
    pub(super) fn considered(&self, width: u32, height: u32) -> GrayImage {
        let mut ignored = GrayImage::new(width, height);
        for rectangle in &self.rectangles {
            let rows = rectangle.y0 as usize..rectangle.y1.unwrap_or(height) as usize;
            let (left, right) = (rectangle.x0.min(width), rectangle.x1.unwrap_or(width).min(width));
            let image = ignored.chunks_exact_mut(width.max(1) as usize);
            for row in image.take(rows.end).skip(rows.start) {
                row[left as usize..right.max(left) as usize].fill(LIT);
            }
        }
        if let (Some(right), Some(bottom)) = (width.checked_sub(1), height.checked_sub(1)) {
            let mut filler = PolygonFiller::default();
            for polygon in &self.polygons {
                let clamped: Vec<_> =
                    polygon.iter().map(|(x, y)| ((*x).min(right), (*y).min(bottom))).collect();
                filler.fill(&mut ignored, &clamped);
            }
        }
        ignored.iter_mut().for_each(|value| *value = !*value);
        ignored
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::image::Luma;

    fn considered(region: &IgnoredRegion) -> Vec<String> {
        let image = region.considered(6, 4);
        let text = |row: &[u8]| row.iter().map(|value| if *value == LIT { '#' } else { '.' }).collect();
        image.as_raw().chunks_exact(6).map(text).collect()
    }

    #[test]
    fn rectangle_reads_as_half_open_columns_and_rows() {
        assert_eq!("1:3:2:4".parse(), Ok(Rectangle { x0: 1, x1: Some(3), y0: 2, y1: Some(4) }));
        assert_eq!(":::".parse(), Ok(Rectangle::default()));
        for text in ["1:3:2:4", "7::0:", "0::5:9"] {
            assert_eq!(text.parse::<Rectangle>().unwrap().to_string(), text);
        }
        for text in ["", "1:2:3", "1:2:3:4:5", "3:3::", "::4:1", "-1:2::", "a:::"] {
            assert!(text.parse::<Rectangle>().is_err(), "{text}");
        }
    }

    #[test]
    fn rectangles_and_polygons_unite() {
        let region = IgnoredRegion {
            rectangles: vec![
                Rectangle { x0: 4, y0: 1, ..Rectangle::default() },
                Rectangle { x0: 0, x1: Some(9), y0: 3, y1: Some(99) },
            ],
            polygons: vec![vec![(0, 0), (1, 0), (1, 1), (0, 1)], vec![(5, 0), (900, 0)], vec![]],
        };
        assert_eq!(considered(&region), ["..###.", "..##..", "####..", "......"]);
    }

    #[test]
    fn presets_scale_with_the_image() {
        let left = |width, height| {
            let image = IgnoredRegion::preset(CameraPlace::Left, width, height).considered(width, height);
            image.pixels().filter(|Luma([value])| *value == LIT).count()
        };
        assert_eq!(left(752, 480), (123 + 633 - 452) * 120);
        assert_eq!(left(1504, 960), 4 * left(752, 480));
        let back = IgnoredRegion::preset(CameraPlace::Back, 752, 480).considered(752, 480);
        assert_eq!((back.get_pixel(563, 479), back.get_pixel(564, 0)), (&Luma([0]), &Luma([LIT])));
        let right = IgnoredRegion::preset(CameraPlace::Right, 752, 480).considered(752, 480);
        assert_eq!((right.get_pixel(120, 359), right.get_pixel(120, 360)), (&Luma([0]), &Luma([LIT])));
    }
}
