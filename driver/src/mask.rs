//! Which mask a camera flies. Fail closed: no mask that can fly, no frames.

use std::path::Path;
use std::sync::Arc;

use uvcam_masker::check::Problem;
use uvcam_masker::{Mask, check, file};

use crate::config::{CameraConfig, MaskChoice};
use crate::error::Error;

/// What a camera flies: a mask, or none because the configuration says so.
pub type MaskInForce = Option<Arc<Mask>>;

/// A mask that may fly.
#[derive(Debug)]
pub struct Flyable {
    /// The mask.
    pub mask: Mask,
    /// The bytes of the file it was read from, those that were checked.
    pub bytes: Vec<u8>,
    /// What someone should look at nevertheless.
    pub warnings: Vec<Problem>,
}

/// Loads the camera's mask; `None` where its configuration says to fly without.
///
/// # Errors
/// Those of [`read`].
pub fn load(camera: &CameraConfig) -> Result<MaskInForce, Error> {
    let MaskChoice::File(path) = &camera.mask else { return Ok(None) };
    let Flyable { mask, warnings, .. } = read(path, (camera.settings.width, camera.settings.height))?;
    for problem in &warnings {
        tracing::warn!("{}: {}: {problem}", camera.name, path.display());
    }
    Ok(Some(Arc::new(mask)))
}

/// Reads a mask for frames of `size`, width and height, and checks everything that keeps one from flying.
///
/// # Errors
/// [`Error::MaskFile`] where the file is missing, unreadable, no sound PNG, of the wrong size, transparent or turned; [`Error::Mask`]
/// where it is not binary or masks everything.
pub fn read(path: &Path, size: (u32, u32)) -> Result<Flyable, Error> {
    let bytes = file::read_bytes(path).map_err(Error::MaskFile)?;
    let gray = file::mask_image(path, &bytes, Some(size)).map_err(Error::MaskFile)?;
    let refused = |cause: String| Error::Mask(format!("{}: {cause}", path.display()));
    let report = check::check(&gray, Some(size));
    if !report.can_fly() {
        return Err(refused(report.problems.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")));
    }
    let mask = Mask::from_gray(&gray).map_err(|error| refused(error.to_string()))?;
    Ok(Flyable { mask, bytes, warnings: report.problems })
}
