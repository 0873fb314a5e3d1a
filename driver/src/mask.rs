//! Which mask a camera flies. Fail closed: no mask that can fly, no frames.

use std::sync::Arc;

use uvcam_masker::{Mask, check, file};

use crate::config::{CameraConfig, MaskChoice};
use crate::error::Error;

/// What a camera flies: a mask, or none because the configuration says so.
pub type MaskInForce = Option<Arc<Mask>>;

/// Loads the camera's mask; `None` where its configuration says to fly without.
///
/// # Errors
/// [`Error::Mask`] where the file is missing, unreadable, not binary, of the wrong size, or masks everything.
pub fn load(camera: &CameraConfig) -> Result<MaskInForce, Error> {
    let MaskChoice::File(path) = &camera.mask else { return Ok(None) };
    let refused = |cause: String| Error::Mask(format!("{}: {cause}", path.display()));
    let gray = file::read_gray(path).map_err(Error::MaskFile)?;
    let report = check::check(&gray, Some((camera.settings.width, camera.settings.height)));
    if !report.can_fly() {
        return Err(refused(report.problems.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")));
    }
    for problem in &report.problems {
        tracing::warn!("{}: {}: {problem}", camera.name, path.display());
    }
    Ok(Some(Arc::new(Mask::from_gray(&gray).map_err(|error| refused(error.to_string()))?)))
}
