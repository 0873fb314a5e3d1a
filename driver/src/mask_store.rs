//! One camera's mask in its [`files`](crate::mask_files): a candidate is stored, accepted, or discarded, and what was in force is kept.
//!
//! Where the mask in force is a symbolic link, the file behind it is the one that is replaced.
//!
//! Everything is checked before anything changes, and what is put in force are the bytes that were checked. That is one rename, so that
//! a process that is killed at any point leaves a whole mask in force. No two of the files are one: an editor that writes into the mask
//! in force leaves the history as it was.

mod history;

use std::fs;
use std::io::{self, ErrorKind};
use std::ops::Deref;
use std::path::{Path, PathBuf};

use uvcam_masker::file::{self, FileError};
use uvcam_masker::{GrayImage, Mask};

use self::history::History;
use crate::config::{CameraConfig, MaskChoice};
use crate::error::Error;
use crate::mask;
use crate::mask_files::MaskFiles;

/// The files around the mask in force, and what is done with them.
#[derive(Debug, Clone)]
pub struct MaskStore(MaskFiles);

impl Deref for MaskStore {
    type Target = MaskFiles;

    fn deref(&self) -> &MaskFiles {
        &self.0
    }
}

/// What is stored for a person to look at, and to accept or discard.
#[derive(Debug)]
pub struct Candidate<'a> {
    /// The mask.
    pub mask: &'a Mask,
    /// Where it comes from: keywords and texts for the PNG.
    pub provenance: &'a [(&'a str, String)],
    /// The picture it was made from.
    pub input: &'a GrayImage,
    /// That picture with the mask over it.
    pub overlay: &'a image::RgbImage,
}

impl MaskStore {
    /// The store of the camera's mask.
    ///
    /// # Errors
    /// [`Error::Usage`] where the camera flies without a mask file.
    pub fn of(camera: &CameraConfig) -> Result<Self, Error> {
        match &camera.mask {
            MaskChoice::File(path) => Ok(MaskStore::new(path)),
            MaskChoice::None => Err(Error::Usage(format!(
                "camera {} has mask = \"none\": name a file in the configuration to generate its mask",
                camera.name
            ))),
        }
    }

    /// The store around the mask file that the configuration names.
    pub fn new(in_force: &Path) -> Self {
        MaskStore(MaskFiles::around(in_force))
    }

    /// Stores a candidate in place of an earlier one. Its mask is written last: where it is there, its pictures are as well.
    ///
    /// # Errors
    /// [`Error::Picture`] or [`Error::System`] where a file cannot be written; there is no candidate then.
    pub fn store(&self, candidate: &Candidate<'_>) -> Result<(), Error> {
        self.discard()?;
        self.write(candidate).inspect_err(|_| {
            // The first error tells what is wrong; what it left would only fill a full disk.
            let _ = self.discard();
        })
    }

    fn write(&self, candidate: &Candidate<'_>) -> Result<(), Error> {
        let [input, overlay] = self.pictures();
        file::write_gray(&input, candidate.input, &[])?;
        file::write_rgb(&overlay, candidate.overlay)?;
        Ok(candidate.mask.save(&self.candidate(), candidate.provenance)?)
    }

    /// Puts the candidate in force, and the mask before it into the history. The camera's frames are of `size`, width and height.
    ///
    /// # Errors
    /// [`Error::Usage`] where there is no candidate; [`Error::Mask`] or [`Error::MaskFile`] where it must not fly; [`Error::Picture`] or
    /// [`Error::System`] where a file cannot be written. The candidate and the mask in force are then as they were.
    pub fn accept(&self, size: (u32, u32)) -> Result<Mask, Error> {
        let candidate = self.candidate();
        if !candidate.exists() {
            return Err(Error::Usage(format!(
                "{} does not exist: generate a mask first",
                candidate.display()
            )));
        }
        let mask = self.put_in_force(&candidate, size)?;
        // It is in force, whatever stays behind.
        self.discard().unwrap_or_else(|error| tracing::warn!("{}", crate::causes::with_causes(&error)));
        Ok(mask)
    }

    /// Removes the candidate, where there is one.
    ///
    /// # Errors
    /// [`Error::System`] where a file cannot be removed.
    pub fn discard(&self) -> Result<(), Error> {
        let [input, overlay] = self.pictures();
        [self.candidate(), input, overlay].iter().try_for_each(|path| remove(path))
    }

    /// The masks that were in force before, the newest first.
    ///
    /// # Errors
    /// [`Error::System`] where the folder cannot be read.
    pub fn history(&self) -> Result<Vec<PathBuf>, Error> {
        History::new(self.history_folder()).files()
    }

    /// Puts a mask of the history in force again: 1 is the newest. The camera's frames are of `size`, width and height.
    ///
    /// # Errors
    /// [`Error::Usage`] where the history has no such mask; else those of [`MaskStore::accept`].
    pub fn restore(&self, number: usize, size: (u32, u32)) -> Result<Mask, Error> {
        let history = self.history()?;
        let Some(chosen) = number.checked_sub(1).and_then(|index| history.get(index)) else {
            let found = history.len();
            return Err(Error::Usage(format!(
                "the history holds {found} masks: there is no number {number}"
            )));
        };
        self.put_in_force(chosen, size)
    }

    /// Copies the mask of a file to the one in force, after keeping the one before in the history.
    fn put_in_force(&self, from: &Path, size: (u32, u32)) -> Result<Mask, Error> {
        let flyable = mask::read(from, size)?;
        let target = behind_links(self.in_force()).map_err(failed("reading link", self.in_force()))?;
        let history = History::new(self.history_folder());
        let kept = match file::read_bytes(&target) {
            Ok(before) => Some(history.keep(&before)?),
            Err(FileError::Read { source, .. }) if source.kind() == ErrorKind::NotFound => None,
            Err(error) => return Err(error.into()),
        };
        file::write_bytes(&target, &flyable.bytes).inspect_err(|_| {
            // It is still in force, so it is no history yet.
            let _ = kept.as_deref().map(remove);
        })?;
        if target != self.in_force() {
            let (link, target) = (self.in_force().display(), target.display());
            tracing::info!("{link} is a link: the file behind it was replaced, {target}");
        }
        if let Some(kept) = kept {
            history.forget_oldest(&kept);
        }
        Ok(flyable.mask)
    }
}

/// The file that a path leads to over symbolic links, whether it is there or not.
fn behind_links(path: &Path) -> io::Result<PathBuf> {
    let mut path = path.to_path_buf();
    // As many as the kernel follows, MAXSYMLINKS.
    for _ in 0..40 {
        match fs::read_link(&path) {
            Ok(target) => path = path.parent().unwrap_or(Path::new("")).join(target),
            // Not there, or no link.
            Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::InvalidInput) => {
                return Ok(path);
            }
            Err(error) => return Err(error),
        }
    }
    Err(io::Error::other("it leads to itself"))
}

fn remove(path: &Path) -> Result<(), Error> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != ErrorKind::NotFound => Err(failed("removing", path)(error)),
        _ => Ok(()),
    }
}

fn failed(doing: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Error {
    let path = path.to_path_buf();
    move |source| Error::System { doing, path, source }
}

#[cfg(test)]
mod tests;
