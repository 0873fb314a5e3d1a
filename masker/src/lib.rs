//! Masks of the airframe: read, check, apply, generate.
//!
//! A camera on a UAV sees parts of its own airframe. A [`Mask`] names those pixels; [`Mask::apply`] blanks
//! them in place in every frame. Masks are stored as greyscale PNG files, 0 = discard, 255 = keep
//! ([`mod@file`]), and examined before they fly ([`mod@check`]).
//!
//! Sizes and positions are in pixels, always in the order width, height and x, y, with x along a row and y
//! downwards from the top left corner. An error message names the value and the remedy; its cause is its
//! [`source`](std::error::Error::source), so print the whole chain.

pub mod apply;
pub mod check;
pub mod components;
pub mod file;
pub mod generate;
pub mod image;
pub mod mask;
pub mod metrics;

pub use crate::image::{GrayImage, ImageView, ImageViewMut, RgbImage};
pub use crate::mask::{Mask, MaskId, Run};

/// Its example is compiled with the other tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
