//! Masks that were in force before, each a copy in a folder.
//!
//! A file's name begins with a number that is larger than all in the folder, so that the order is that in which they flew: a computer
//! without a battery clock starts in the past, and satellites set its clock. The time comes behind it, for people. Files of earlier
//! versions have the time alone; they are older than all that have a number.

use std::fs::{self, DirBuilder, File};
use std::io::{self, ErrorKind};
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};

use uvcam_masker::file;

use super::{failed, remove};
use crate::error::{Error, with_causes};

/// How many are kept.
const KEPT: usize = 5;

/// Longest number that is read as one: what is longer was not counted here.
const MOST_DIGITS: usize = 12;

pub(super) struct History {
    folder: PathBuf,
}

impl History {
    pub(super) fn new(folder: PathBuf) -> Self {
        History { folder }
    }

    /// Its files, the newest first.
    pub(super) fn files(&self) -> Result<Vec<PathBuf>, Error> {
        let entries = match fs::read_dir(&self.folder) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
            entries => entries.map_err(failed("reading", &self.folder))?,
        };
        let mut files: Vec<PathBuf> =
            entries.filter_map(|entry| entry.ok().map(|entry| entry.path())).collect();
        files.retain(|path| path.extension().is_some_and(|extension| extension == "png"));
        files.sort_by_cached_key(|path| (number(path), path.clone()));
        files.reverse();
        Ok(files)
    }

    /// Adds a file with this content.
    pub(super) fn keep(&self, content: &[u8]) -> Result<PathBuf, Error> {
        self.make_folder().map_err(failed("making folder", &self.folder))?;
        let number = self.files()?.first().map_or(0, |newest| number(newest)) + 1;
        let time = jiff::Timestamp::now().strftime("%Y-%m-%dT%H-%M-%S%.9fZ");
        let path = self.folder.join(format!("{number:06}_{time}.png"));
        file::write_bytes(&path, content)?;
        Ok(path)
    }

    /// Removes what is more than is kept, never the one `just_kept`.
    pub(super) fn forget_oldest(&self, just_kept: &Path) {
        let forget = || {
            let files = self.files()?;
            files.iter().skip(KEPT).filter(|path| *path != just_kept).try_for_each(|path| remove(path))
        };
        // One too many does no harm.
        forget().unwrap_or_else(|error: Error| tracing::warn!("{}", with_causes(&error)));
    }

    fn make_folder(&self) -> io::Result<()> {
        let parent = match self.folder.parent() {
            Some(parent) if parent != Path::new("") => parent,
            _ => Path::new("."),
        };
        match DirBuilder::new().mode(0o777).create(&self.folder) {
            Err(error) if error.kind() == ErrorKind::AlreadyExists => Ok(()),
            Err(error) => Err(error),
            Ok(()) => {
                file::give(&File::open(&self.folder)?, &fs::metadata(parent)?)?;
                File::open(parent)?.sync_all()
            }
        }
    }
}

/// The number that a name begins with; 0 where it has none.
fn number(path: &Path) -> u64 {
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    let digits = name.split_once('_').map_or("", |(digits, _)| digits);
    let is_number = digits.len() <= MOST_DIGITS && digits.bytes().all(|byte| byte.is_ascii_digit());
    digits.parse().ok().filter(|_| is_number).unwrap_or(0)
}
