//! Blanking the masked pixels of a frame in place.
//!
//! This runs on every frame: it walks the masked runs and nothing else, so that its cost follows the masked
//! area and not the frame, and it allocates nothing.

use thiserror::Error;

use crate::image::{ImageView, ImageViewMut};
use crate::mask::{Mask, Run};

/// A mask met an image of another size.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error(
    "mask of {mask_width}x{mask_height} pixels does not fit an image of {image_width}x{image_height}; \
     use the mask made for this camera at this resolution"
)]
pub struct ApplyError {
    /// Width of the mask in pixels.
    pub mask_width: u32,
    /// Height of the mask in pixels.
    pub mask_height: u32,
    /// Width of the image in pixels.
    pub image_width: u32,
    /// Height of the image in pixels.
    pub image_height: u32,
}

impl Mask {
    /// Zeroes the masked pixels of `image`; leaves all other bytes, padding included, as they are.
    ///
    /// # Errors
    /// [`ApplyError`] where the sizes differ; the image is then untouched.
    #[inline]
    pub fn apply(&self, image: &mut ImageViewMut<'_>) -> Result<(), ApplyError> {
        self.fits(image.width(), image.height())?;
        let (stride, bytes_per_pixel) = (image.stride(), image.bytes_per_pixel());
        self.blank(image.pixels_mut(), stride, bytes_per_pixel);
        Ok(())
    }

    /// Whether the mask is one for images of this size.
    ///
    /// # Errors
    /// [`ApplyError`] where the sizes differ.
    pub fn fits(&self, image_width: u32, image_height: u32) -> Result<(), ApplyError> {
        let (mask_width, mask_height) = (self.width(), self.height());
        if (mask_width, mask_height) == (image_width, image_height) {
            return Ok(());
        }
        Err(ApplyError { mask_width, mask_height, image_width, image_height })
    }

    /// Number of masked pixels of `image` that are not 0; 0 for every frame this mask was applied to.
    ///
    /// # Errors
    /// [`ApplyError`] where the sizes differ.
    pub fn masked_nonzero(&self, image: &ImageView<'_>) -> Result<u64, ApplyError> {
        self.fits(image.width(), image.height())?;
        let (pixels, bytes_per_pixel) = (image.pixels(), image.bytes_per_pixel());
        let nonzero = self.runs().iter().map(|run| {
            let bytes = &pixels[byte_range(run, image.stride(), bytes_per_pixel)];
            bytes.chunks_exact(bytes_per_pixel).filter(|pixel| pixel.iter().any(|byte| *byte != 0)).count()
                as u64
        });
        Ok(nonzero.sum())
    }

    /// Zeroes the masked runs of an image that is known to have the size of this mask.
    pub(crate) fn blank(&self, pixels: &mut [u8], stride: usize, bytes_per_pixel: usize) {
        for run in self.runs() {
            pixels[byte_range(run, stride, bytes_per_pixel)].fill(0);
        }
    }
}

fn byte_range(run: &Run, stride: usize, bytes_per_pixel: usize) -> std::ops::Range<usize> {
    let start = run.row as usize * stride + run.start as usize * bytes_per_pixel;
    start..start + run.length as usize * bytes_per_pixel
}
