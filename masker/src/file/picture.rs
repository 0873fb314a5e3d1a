//! From the bytes of a PNG file to grey values, and to what else decides whether they may be used.

use std::io::Cursor;

use ::image::metadata::Orientation;
use png::{BitDepth, ColorType, Decoder, InterlaceInfo, Transformations, expand_interlaced_row};

use super::chunks::{self, PngError};
use crate::image::GrayImage;

/// A picture whose pixels are decoded.
#[derive(Debug)]
pub(super) struct Picture {
    pub(super) gray: GrayImage,
    /// How it is to be turned before it is looked at.
    pub(super) orientation: Orientation,
    /// Pixels that are not wholly opaque.
    pub(super) transparent_px: u64,
    /// The largest sample, where samples have 16 bits.
    pub(super) largest_of_16_bits: Option<u16>,
}

/// Decodes a file whose size in pixels was found bearable.
pub(super) fn decode(file: &[u8], width: u32, height: u32) -> Result<Picture, PngError> {
    let checked = chunks::check(file)?;
    let mut decoder = Decoder::new(Cursor::new(checked.pixels));
    // 16 bits stay: in the lower byte a pixel may be transparent as well.
    decoder.set_transformations(Transformations::EXPAND);
    let mut reader = decoder.read_info()?;
    let mut pixels = Pixels::of(reader.output_color_type());
    let columns = width as usize;
    let mut gray = vec![0; columns * height as usize];
    let mut line = Vec::new();
    if reader.info().interlaced {
        while let Some(row) = reader.next_interlaced_row()? {
            pixels.read(row.data(), &mut line);
            if let InterlaceInfo::Adam7(place) = row.interlace() {
                expand_interlaced_row(&mut gray, columns, &line, place, 8);
            }
        }
    } else {
        let mut rows = gray.chunks_exact_mut(columns.max(1));
        while let Some(row) = reader.next_row()? {
            pixels.read(row.data(), &mut line);
            if let Some(to) = rows.next().filter(|to| to.len() == line.len()) {
                to.copy_from_slice(&line);
            }
        }
    }
    Ok(Picture {
        gray: GrayImage::from_raw(width, height, gray).unwrap_or_default(),
        orientation: checked.orientation,
        transparent_px: pixels.transparent,
        largest_of_16_bits: pixels.is_wide.then_some(pixels.largest),
    })
}

/// Reads rows of samples, and remembers what they show.
struct Pixels {
    /// Samples of a pixel.
    samples: usize,
    /// Whether a sample has 16 bits, the upper byte first.
    is_wide: bool,
    transparent: u64,
    /// The largest sample of 16 bits.
    largest: u16,
}

impl Pixels {
    fn of((colour, depth): (ColorType, BitDepth)) -> Self {
        Self { samples: colour.samples(), is_wide: depth == BitDepth::Sixteen, transparent: 0, largest: 0 }
    }

    /// Reads a row into grey values of 8 bits.
    fn read(&mut self, row: &[u8], line: &mut Vec<u8>) {
        line.clear();
        let sample_bytes = if self.is_wide { 2 } else { 1 };
        // Alpha is the last sample of two or four.
        let colours = if self.samples < 3 { 1 } else { 3 };
        for pixel in row.chunks_exact(self.samples * sample_bytes) {
            let (colour, alpha) = pixel.split_at(colours * sample_bytes);
            self.transparent += u64::from(alpha.iter().any(|byte| *byte != u8::MAX));
            // The upper byte counts.
            line.push(match colours {
                1 => colour[0],
                _ => luma([colour[0], colour[sample_bytes], colour[2 * sample_bytes]]),
            });
            if self.is_wide {
                let samples = colour.chunks_exact(2).map(|sample| u16::from_be_bytes([sample[0], sample[1]]));
                self.largest = samples.fold(self.largest, u16::max);
            }
        }
    }
}

/// BT.601 luma with weights in units of 2^-15; they add up to 1, so greys keep their value.
fn luma(rgb: [u8; 3]) -> u8 {
    let [red, green, blue] = rgb.map(u32::from);
    ((9797 * red + 19234 * green + 3737 * blue) >> 15) as u8
}
