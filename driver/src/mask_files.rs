//! The files of one camera's mask: the one in force, a candidate beside it, and those that were in force before.
//!
//! ```text
//! left.png                            in force
//! left.candidate.png                  generated, not yet accepted
//! left.candidate.input.png            the picture it was made from
//! left.candidate.overlay.png          that picture with the mask over it
//! left.history/<number>_<time>.png    in force before, the last five
//! ```

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// Their names.
#[derive(Debug, Clone)]
pub struct MaskFiles {
    in_force: PathBuf,
}

impl MaskFiles {
    /// The files around the mask file that the configuration names.
    pub fn around(in_force: &Path) -> Self {
        MaskFiles { in_force: in_force.into() }
    }

    /// The mask in force.
    pub fn in_force(&self) -> &Path {
        &self.in_force
    }

    /// The candidate's mask.
    pub fn candidate(&self) -> PathBuf {
        self.beside("candidate.png")
    }

    /// The candidate's pictures: input and overlay.
    pub fn pictures(&self) -> [PathBuf; 2] {
        [self.beside("candidate.input.png"), self.beside("candidate.overlay.png")]
    }

    /// The folder of the masks that were in force before.
    pub fn history_folder(&self) -> PathBuf {
        self.beside("history")
    }

    /// A name made of the mask's, with `ending` for its .png, or behind what else it is called.
    fn beside(&self, ending: &str) -> PathBuf {
        let is_png = |extension: &OsStr| extension.eq_ignore_ascii_case("png");
        let stem = match self.in_force.extension().is_some_and(is_png) {
            true => self.in_force.file_stem(),
            false => self.in_force.file_name(),
        };
        let mut name = stem.unwrap_or_default().to_owned();
        name.push(".");
        name.push(ending);
        self.in_force.with_file_name(name)
    }
}
