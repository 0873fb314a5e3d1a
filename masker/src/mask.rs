//! Which pixels of a frame show the airframe.
//!
//! In the stored form a mask is a greyscale image: 0 discards a pixel, 255 keeps it (the convention of
//! UVDAR). In memory it is the list of its masked runs, because that is what has to be blanked in every
//! frame.

use std::fmt;
use std::str::FromStr;

use ::image::Luma;
use sha2::{Digest, Sha256};
use thiserror::Error;

use crate::image::GrayImage;

/// Value of a masked pixel in the stored form.
pub const DISCARD: u8 = 0;

/// Value of a white pixel, one that is kept, in the stored form.
pub const KEEP: u8 = 255;

/// Most runs of a mask. Masks in use have 150 to 1000.
pub const MAX_RUNS: usize = 1 << 20;

/// Horizontal run of masked pixels: columns `start` to `start + length - 1` of row `row`, counted from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Run {
    /// Row, downwards from the top.
    pub row: u32,
    /// First masked column.
    pub start: u32,
    /// Masked pixels, at least 1.
    pub length: u32,
}

impl Run {
    /// First column past the run.
    #[must_use]
    pub fn end(&self) -> u32 {
        self.start + self.length
    }
}

/// Identity of a mask: equal for equal masks, whatever file they came from.
///
/// The first 16 bytes of the SHA-256 of the mask as a binary PGM image: the header `P5\n{width}
/// {height}\n255\n` in ASCII, then one byte a pixel in row order, 0 masked and 255 kept. Netpbm writes that
/// form, so anyone can check:
///
/// ```text
/// pngtopnm mask.png | sha256sum | cut -c -32
/// ```
///
/// Displayed as 32 lower-case hexadecimal digits.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct MaskId(pub [u8; 16]);

impl MaskId {
    /// No mask at all, all zero. Not the identity of an all-white mask.
    pub const NONE: Self = Self([0; 16]);

    fn of(mask: &Mask) -> Self {
        let (width, height) = (mask.width, mask.height);
        let mut hash = Sha256::new();
        hash.update(format!("P5\n{width} {height}\n255\n"));
        // Row by row: an image of its own would take longer than the hash.
        let mut pixels = vec![KEEP; width as usize];
        let mut runs = mask.runs.iter().peekable();
        for row in 0..height {
            pixels.fill(KEEP);
            while let Some(run) = runs.next_if(|run| run.row == row) {
                pixels[run.start as usize..run.end() as usize].fill(0);
            }
            hash.update(&pixels);
        }
        let mut id = [0; 16];
        id.iter_mut().zip(hash.finalize()).for_each(|(to, from)| *to = from);
        Self(id)
    }
}

impl fmt::Display for MaskId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for MaskId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "MaskId({self})")
    }
}

/// A text that is no [`MaskId`].
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("`{text}` is no mask identity; give 32 hexadecimal digits")]
pub struct MaskIdError {
    text: String,
}

impl FromStr for MaskId {
    type Err = MaskIdError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        // `from_str_radix` alone would take a leading sign.
        if text.len() != 32 || !text.bytes().all(|digit| digit.is_ascii_hexdigit()) {
            return Err(MaskIdError { text: text.to_owned() });
        }
        u128::from_str_radix(text, 16)
            .map(|id| Self(id.to_be_bytes()))
            .map_err(|_| MaskIdError { text: text.to_owned() })
    }
}

/// Why an image is no mask.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum MaskError {
    /// Some pixels are neither 0 nor 255.
    #[error(
        "grey pixels: {grey_px}, the first at x {x}, y {y} with value {value}; \
         a mask has only 0 (discard) and 255 (keep): repaint it, or binarise it explicitly with `uvcam mask repair --threshold`"
    )]
    NotBinary {
        /// Number of grey pixels.
        grey_px: u64,
        /// Column of the first grey pixel.
        x: u32,
        /// Row of the first grey pixel.
        y: u32,
        /// Value of the first grey pixel.
        value: u8,
    },
    /// Some pixels are not opaque: what a person sees there is not the value that is stored.
    #[error("{transparent_px} transparent pixels; flatten the picture: black is discarded, white kept")]
    Transparent {
        /// Number of pixels whose alpha is below its maximum.
        transparent_px: u64,
    },
    /// A person sees the image turned or mirrored, while its pixels are taken as they are stored.
    #[error(
        "EXIF orientation {orientation}; save the mask upright, as the camera's frames are (orientation 1)"
    )]
    Turned {
        /// The orientation, 2 to 8.
        orientation: u8,
    },
    /// The mask was made for another resolution.
    #[error(
        "the mask is {}x{} pixels, the frames are {}x{}; use the mask made for this camera at this resolution",
        found.0, found.1, expected.0, expected.1
    )]
    WrongSize {
        /// Width and height of the mask.
        found: (u32, u32),
        /// Width and height of the camera's frames.
        expected: (u32, u32),
    },
    /// The mask is ragged beyond any airframe: each run costs time in every frame.
    #[error(
        "{runs} runs of masked pixels, more than {MAX_RUNS}; no airframe is so ragged: draw it in plain shapes"
    )]
    TooManyRuns {
        /// Number of runs.
        runs: usize,
    },
}

/// Pixels to blank in every frame of one camera.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mask {
    width: u32,
    height: u32,
    runs: Vec<Run>,
    masked_px: u64,
    id: MaskId,
}

impl Mask {
    /// Mask of an image that has only 0 (discard) and 255 (keep).
    ///
    /// # Errors
    /// [`MaskError::NotBinary`] where a pixel has another value, [`MaskError::TooManyRuns`] beyond [`MAX_RUNS`].
    pub fn from_gray(gray: &GrayImage) -> Result<Self, MaskError> {
        let mut pixels = gray.enumerate_pixels();
        match pixels.find(|(_, _, Luma([value]))| is_grey(*value)) {
            Some((x, y, Luma([value]))) => {
                Err(MaskError::NotBinary { grey_px: grey_px(gray), x, y, value: *value })
            }
            None => Self::try_binarised(gray, KEEP),
        }
    }

    /// Mask of an image from outside: pixels of at least `threshold` are kept, the others masked.
    ///
    /// # Errors
    /// [`MaskError::TooManyRuns`] beyond [`MAX_RUNS`].
    pub fn try_binarised(gray: &GrayImage, threshold: u8) -> Result<Self, MaskError> {
        match runs(gray, threshold) {
            runs if runs > MAX_RUNS => Err(MaskError::TooManyRuns { runs }),
            _ => Ok(Self::binarised(gray, threshold)),
        }
    }

    /// Mask of any image, however ragged: pixels of at least `threshold` are kept, the others masked.
    #[must_use]
    pub fn binarised(gray: &GrayImage, threshold: u8) -> Self {
        let (width, height) = gray.dimensions();
        let mut runs = Vec::new();
        for (row, pixels) in (0..height).zip(gray.as_raw().chunks_exact(width.max(1) as usize)) {
            // Most rows have nothing masked, and are found to be so faster as a whole.
            if pixels.iter().fold(u8::MAX, |least, value| least.min(*value)) >= threshold {
                continue;
            }
            let mut x = 0;
            for stretch in pixels.chunk_by(|a, b| (*a < threshold) == (*b < threshold)) {
                let length = stretch.len() as u32;
                if stretch.first().is_some_and(|value| *value < threshold) {
                    runs.push(Run { row, start: x, length });
                }
                x += length;
            }
        }
        let masked_px = runs.iter().map(|run| u64::from(run.length)).sum();
        let mut mask = Self { width, height, runs, masked_px, id: MaskId::NONE };
        mask.id = MaskId::of(&mask);
        mask
    }

    /// Mask of `width` x `height` pixels of which those are masked for which `masked(x, y)` holds.
    #[must_use]
    pub fn from_fn(width: u32, height: u32, mut masked: impl FnMut(u32, u32) -> bool) -> Self {
        let gray =
            GrayImage::from_fn(width, height, |x, y| Luma([if masked(x, y) { DISCARD } else { KEEP }]));
        Self::binarised(&gray, KEEP)
    }

    /// Width in pixels.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height in pixels.
    #[must_use]
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Masked runs in row order, from left to right; each as long as possible, so two never touch.
    #[must_use]
    pub fn runs(&self) -> &[Run] {
        &self.runs
    }

    /// Number of masked pixels.
    #[must_use]
    pub fn masked_px(&self) -> u64 {
        self.masked_px
    }

    /// Identity of the mask.
    #[must_use]
    pub fn id(&self) -> MaskId {
        self.id
    }

    /// Whether the pixel in column `x` of row `y` is masked; false outside the mask.
    #[must_use]
    pub fn is_masked(&self, x: u32, y: u32) -> bool {
        let after = self.runs.partition_point(|run| (run.row, run.start) <= (y, x));
        after.checked_sub(1).is_some_and(|index| {
            let run = self.runs[index];
            run.row == y && x < run.end()
        })
    }

    /// The mask as an image: 0 discard, 255 keep.
    #[must_use]
    pub fn to_gray(&self) -> GrayImage {
        let mut gray = GrayImage::from_pixel(self.width, self.height, Luma([KEEP]));
        self.blank(&mut gray, self.width as usize, 1);
        gray
    }
}

/// Number of runs of pixels below `threshold`.
pub(crate) fn runs(gray: &GrayImage, threshold: u8) -> usize {
    let begins = |row: &[u8]| {
        let first = usize::from(row.first().is_some_and(|value| *value < threshold));
        first + row.windows(2).filter(|pair| pair[0] >= threshold && pair[1] < threshold).count()
    };
    gray.as_raw().chunks_exact(gray.width().max(1) as usize).map(begins).sum()
}

/// Number of pixels that are neither 0 nor 255.
pub(crate) fn grey_px(gray: &GrayImage) -> u64 {
    gray.as_raw().iter().filter(|value| is_grey(**value)).count() as u64
}

fn is_grey(value: u8) -> bool {
    !matches!(value, DISCARD | KEEP)
}
