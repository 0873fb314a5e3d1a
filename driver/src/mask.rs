//! Which mask a camera flies. Fail closed: no mask that can fly, no frames.

use std::ops::Deref;
use std::path::Path;
use std::sync::Arc;

use uvcam_masker::apply::ApplyError;
use uvcam_masker::check::Problem;
use uvcam_masker::{ImageViewMut, Mask, check, file};
use uvcam_shm_ipc::FrameHeader;
use uvcam_shm_ipc::mask::LONGEST_PROVENANCE;

use crate::config::{CameraConfig, MaskChoice, MaskMode};
use crate::error::Error;

mod service;

pub use service::MaskService;

/// What a camera flies: a mask, or none because the configuration says so.
pub type MaskInForce = Option<Arc<FlyingMask>>;

/// A mask as a camera flies it.
#[derive(Debug)]
pub struct FlyingMask {
    mask: Mask,
    mode: MaskMode,
    /// Texts of its file, as a JSON object.
    provenance: String,
}

impl FlyingMask {
    /// A mask that is flown in this mode and comes from nowhere.
    pub fn new(mask: Mask, mode: MaskMode) -> Self {
        FlyingMask { mask, mode, provenance: "{}".into() }
    }

    /// Does to a frame what the mode asks for. A mask of another size than the frame is for no mode.
    ///
    /// # Errors
    /// [`ApplyError`] where the sizes differ.
    #[inline]
    pub fn apply(&self, image: &mut ImageViewMut<'_>) -> Result<(), ApplyError> {
        match self.mode {
            MaskMode::Blank => self.mask.apply(image),
            MaskMode::Attach => self.mask.fits(image.width(), image.height()),
        }
    }

    /// Where the mask comes from: a JSON object of texts.
    pub fn provenance(&self) -> &str {
        &self.provenance
    }
}

impl Deref for FlyingMask {
    type Target = Mask;

    fn deref(&self) -> &Mask {
        &self.mask
    }
}

/// Says in the header of a frame which mask it flies, and whether that was applied.
pub fn mark(header: &mut FrameHeader, mask: &MaskInForce) {
    match mask.as_deref() {
        None => header.set_mask(None),
        Some(mask) if mask.mode == MaskMode::Blank => header.set_mask(Some(mask.id().0)),
        Some(mask) => header.set_attached_mask(mask.id().0),
    }
}

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
    let Flyable { mask, bytes, warnings } = read(path, (camera.settings.width, camera.settings.height))?;
    for problem in &warnings {
        tracing::warn!("{}: {}: {problem}", camera.name, path.display());
    }
    Ok(Some(Arc::new(FlyingMask { mask, mode: camera.mask_mode, provenance: provenance(&bytes) })))
}

/// The texts of a mask's file as a JSON object. They are told to consumers and decide nothing: what cannot be read, or does not fit, is
/// left out.
fn provenance(file: &[u8]) -> String {
    let mut told = serde_json::Map::new();
    let mut room = LONGEST_PROVENANCE - "{}".len();
    for (keyword, text) in file::texts(file).unwrap_or_default() {
        let entry = serde_json::json!({ &keyword: &text }).to_string();
        // Without its braces, with a comma.
        let bytes = entry.len() - 1;
        if bytes <= room && !told.contains_key(&keyword) {
            told.insert(keyword, text.into());
            room -= bytes;
        }
    }
    serde_json::Value::Object(told).to_string()
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

#[cfg(test)]
mod tests {
    use uvcam_masker::GrayImage;

    use super::*;

    fn texts_of(texts: &[(&str, String)]) -> String {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mask.png");
        file::write_gray(&path, &GrayImage::new(2, 2), texts).unwrap();
        provenance(&file::read_bytes(&path).unwrap())
    }

    #[test]
    fn the_texts_of_a_file_are_its_provenance_as_far_as_there_is_room() {
        assert_eq!(texts_of(&[]), "{}");
        assert_eq!(texts_of(&[("Method", "fused \"x\"".into())]), r#"{"Method":"fused \"x\""}"#);
        let long = "\n".repeat(LONGEST_PROVENANCE / 4);
        let told = texts_of(&[("A", long.clone()), ("B", long), ("C", "short".into())]);
        assert!(told.len() <= LONGEST_PROVENANCE, "{}", told.len());
        let told: serde_json::Value = serde_json::from_str(&told).unwrap();
        assert_eq!((told.get("B"), &told["C"]), (None, &"short".into()));
        assert_eq!(provenance(b"no picture"), "{}");
    }

    #[test]
    fn an_attached_mask_leaves_pixels_and_must_fit_as_any_other() {
        let attached = FlyingMask::new(Mask::from_fn(2, 2, |x, _| x == 0), MaskMode::Attach);
        let mut pixels = [7; 6];
        attached.apply(&mut ImageViewMut::new(&mut pixels[..4], 2, 2, 2, 1).unwrap()).unwrap();
        assert!(attached.apply(&mut ImageViewMut::new(&mut pixels, 3, 2, 3, 1).unwrap()).is_err());
        assert_eq!(pixels, [7; 6]);
        let mut header = FrameHeader::default();
        mark(&mut header, &Some(Arc::new(attached)));
        assert!(header.flags == uvcam_shm_ipc::Flags::MASK_ATTACHED && header.mask_id != [0; 16]);
    }
}
