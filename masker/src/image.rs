//! Borrowed pixels of a frame, wherever the frame lives.
//!
//! A view covers one plane of unpacked monochrome pixels: PFNC `Mono8` (one byte a pixel) or `Mono10`,
//! `Mono12`, `Mono16` (two bytes a pixel). Packed formats such as `Mono12p` share bytes between pixels and
//! have no view. Pixel (x, y) starts at byte `y * stride + x * bytes_per_pixel`; x runs along a row, y
//! downwards, both from 0.

use thiserror::Error;

/// Owned 8-bit greyscale image.
pub use ::image::{GrayImage, RgbImage};

/// Why pixels cannot be viewed as an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum ImageError {
    /// The pixel size is neither one nor two bytes.
    #[error(
        "{found} bytes per pixel cannot be masked; use Mono8 (1) or unpacked Mono10, Mono12 or Mono16 (2)"
    )]
    BytesPerPixel {
        /// Bytes per pixel that were given.
        found: usize,
    },
    /// A row does not fit into its stride.
    #[error(
        "stride of {stride} bytes is shorter than a row of {row} bytes; give the stride in bytes, not in pixels"
    )]
    Stride {
        /// Stride that was given, in bytes.
        stride: usize,
        /// Bytes of one row of pixels.
        row: usize,
    },
    /// The buffer ends before the last row does.
    #[error(
        "buffer of {found} bytes is too short: {width}x{height} at a stride of {stride} bytes needs {needed}"
    )]
    Buffer {
        /// Length of the buffer in bytes.
        found: usize,
        /// Bytes up to the end of the last row.
        needed: usize,
        /// Width in pixels.
        width: u32,
        /// Height in pixels.
        height: u32,
        /// Bytes from one row to the next.
        stride: usize,
    },
    /// The size in bytes exceeds what memory can address.
    #[error(
        "{width}x{height} at a stride of {stride} bytes exceeds the address space; correct size and stride"
    )]
    Overflow {
        /// Width in pixels.
        width: u32,
        /// Height in pixels.
        height: u32,
        /// Bytes from one row to the next.
        stride: usize,
    },
}

/// Shape of an image in memory; whoever holds one knows that its buffer reaches to the end of the last row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Layout {
    width: u32,
    height: u32,
    stride: usize,
    bytes_per_pixel: usize,
}

impl Layout {
    fn new(
        buffer: usize,
        width: u32,
        height: u32,
        stride: usize,
        bytes_per_pixel: usize,
    ) -> Result<Self, ImageError> {
        if !matches!(bytes_per_pixel, 1 | 2) {
            return Err(ImageError::BytesPerPixel { found: bytes_per_pixel });
        }
        let overflow = ImageError::Overflow { width, height, stride };
        let row = (width as usize).checked_mul(bytes_per_pixel).ok_or(overflow)?;
        if stride < row {
            return Err(ImageError::Stride { stride, row });
        }
        let needed = match height {
            0 => 0,
            _ => stride
                .checked_mul(height as usize - 1)
                .and_then(|above| above.checked_add(row))
                .ok_or(overflow)?,
        };
        if buffer < needed {
            return Err(ImageError::Buffer { found: buffer, needed, width, height, stride });
        }
        Ok(Self { width, height, stride, bytes_per_pixel })
    }
}

/// An image whose pixels somebody else owns.
#[derive(Debug, Clone, Copy)]
pub struct View<Pixels> {
    pixels: Pixels,
    layout: Layout,
}

/// Pixels to read.
pub type ImageView<'a> = View<&'a [u8]>;

/// Pixels to change in place.
pub type ImageViewMut<'a> = View<&'a mut [u8]>;

impl<Pixels: AsRef<[u8]>> View<Pixels> {
    /// Views `pixels` as an image of `width` x `height` pixels whose rows start `stride` bytes apart.
    ///
    /// The last row needs no padding; bytes past it are never touched.
    ///
    /// # Errors
    /// [`ImageError`] where pixel size, stride and buffer do not agree.
    pub fn new(
        pixels: Pixels,
        width: u32,
        height: u32,
        stride: usize,
        bytes_per_pixel: usize,
    ) -> Result<Self, ImageError> {
        let layout = Layout::new(pixels.as_ref().len(), width, height, stride, bytes_per_pixel)?;
        Ok(Self { pixels, layout })
    }
}

impl<Pixels> View<Pixels> {
    /// Width in pixels.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.layout.width
    }

    /// Height in pixels.
    #[must_use]
    pub fn height(&self) -> u32 {
        self.layout.height
    }

    /// Bytes from the start of one row to the start of the next.
    #[must_use]
    pub fn stride(&self) -> usize {
        self.layout.stride
    }

    /// Bytes per pixel, 1 or 2.
    #[must_use]
    pub fn bytes_per_pixel(&self) -> usize {
        self.layout.bytes_per_pixel
    }
}

impl<'a> ImageView<'a> {
    /// The viewed bytes, row by row with padding.
    #[must_use]
    pub fn pixels(&self) -> &'a [u8] {
        self.pixels
    }
}

impl ImageViewMut<'_> {
    /// The viewed bytes, row by row with padding.
    #[must_use]
    pub fn pixels_mut(&mut self) -> &mut [u8] {
        self.pixels
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn last_row_needs_no_padding() {
        assert!(ImageView::new(&[0; 13], 5, 2, 8, 1).is_ok());
        assert_eq!(
            ImageView::new(&[0; 12], 5, 2, 8, 1).err(),
            Some(ImageError::Buffer { found: 12, needed: 13, width: 5, height: 2, stride: 8 })
        );
    }

    #[test]
    fn stride_counts_bytes() {
        assert!(ImageView::new(&[0; 20], 5, 2, 10, 2).is_ok());
        assert_eq!(
            ImageView::new(&[0; 20], 5, 2, 9, 2).err(),
            Some(ImageError::Stride { stride: 9, row: 10 })
        );
    }

    #[test]
    fn packed_and_colour_pixels_are_refused() {
        for found in [0, 3, 4] {
            assert_eq!(
                ImageView::new(&[0; 64], 2, 2, 16, found).err(),
                Some(ImageError::BytesPerPixel { found })
            );
        }
    }

    #[test]
    fn huge_sizes_overflow_into_an_error() {
        let found = ImageView::new(&[], 1, u32::MAX, usize::MAX, 1).err();
        assert_eq!(found, Some(ImageError::Overflow { width: 1, height: u32::MAX, stride: usize::MAX }));
    }

    proptest! {
        #[test]
        fn every_pixel_of_an_accepted_view_lies_in_its_buffer(
            length in 0_usize..600, width in 0_u32..20, height in 0_u32..20, stride in 0_usize..50, bytes in 0_usize..4,
        ) {
            let buffer = vec![0; length];
            let view = ImageView::new(&buffer, width, height, stride, bytes);
            let end = |x: u32, y: u32| y as usize * stride + (x as usize + 1) * bytes;
            let fits = matches!(bytes, 1 | 2)
                && stride >= width as usize * bytes
                && (width == 0 || height == 0 || end(width - 1, height - 1) <= length);
            // An image without columns still spans its rows; one may refuse it for a short buffer.
            if width > 0 {
                prop_assert_eq!(view.is_ok(), fits);
            } else {
                prop_assert!(fits || view.is_err());
            }
        }
    }
}
