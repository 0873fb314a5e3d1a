//! The files of one camera's mask: the one in force, a candidate beside it, and those that were in force before.
//!
//! ```text
//! left.png                    in force
//! left.candidate.png          generated, not yet accepted
//! left.candidate.input.png    the picture it was made from
//! left.candidate.overlay.png  that picture with the mask over it
//! left.history/<time>.png     in force before, the last five
//! ```
//!
//! Every step is one rename or one new name, so that a process that is killed at any point leaves a whole mask in force.

use std::fs::{self, File};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use uvcam_masker::{GrayImage, Mask, file};

use crate::error::Error;

/// How many masks are kept that were in force before.
const KEPT: usize = 5;

/// The files around the mask in force.
#[derive(Debug, Clone)]
pub struct MaskStore {
    in_force: PathBuf,
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
    /// The store around the mask file that the configuration names.
    pub fn new(in_force: &Path) -> Self {
        MaskStore { in_force: in_force.into() }
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

    /// Puts the candidate in force, and the mask before it into the history.
    ///
    /// # Errors
    /// [`Error::Usage`] where there is no candidate; [`Error::System`] where a file cannot be moved.
    pub fn accept(&self) -> Result<(), Error> {
        if !self.candidate().exists() {
            let path = self.candidate();
            return Err(Error::Usage(format!("{} does not exist: generate a mask first", path.display())));
        }
        self.put_in_force(&self.candidate())?;
        self.remove(&self.pictures())
    }

    /// Removes the candidate, where there is one.
    ///
    /// # Errors
    /// [`Error::System`] where a file cannot be removed.
    pub fn discard(&self) -> Result<(), Error> {
        let [input, overlay] = self.pictures();
        self.remove(&[self.candidate(), input, overlay])
    }

    /// The masks that were in force before, the newest first.
    ///
    /// # Errors
    /// [`Error::System`] where the folder cannot be read.
    pub fn history(&self) -> Result<Vec<PathBuf>, Error> {
        let folder = self.history_folder();
        let entries = match fs::read_dir(&folder) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
            entries => entries.map_err(failed("reading", &folder))?,
        };
        let mut files: Vec<PathBuf> =
            entries.filter_map(|entry| entry.ok().map(|entry| entry.path())).collect();
        files.retain(|path| path.extension().is_some_and(|extension| extension == "png"));
        // Their names are times.
        files.sort();
        files.reverse();
        Ok(files)
    }

    /// Puts a mask of the history in force again: 1 is the newest.
    ///
    /// # Errors
    /// [`Error::Usage`] where the history has no such mask; [`Error::System`] where a file cannot be moved.
    pub fn restore(&self, number: usize) -> Result<(), Error> {
        let history = self.history()?;
        let Some(chosen) = number.checked_sub(1).and_then(|index| history.get(index)) else {
            let found = history.len();
            return Err(Error::Usage(format!(
                "the history holds {found} masks: there is no number {number}"
            )));
        };
        let copy = self.beside("restored.png");
        self.remove(std::slice::from_ref(&copy))?;
        same_content(chosen, &copy).map_err(failed("copying", chosen))?;
        self.put_in_force(&copy)
    }

    /// Renames `file` to the mask in force, after giving the one before a name in the history.
    fn put_in_force(&self, file: &Path) -> Result<(), Error> {
        if self.in_force.exists() {
            let folder = self.history_folder();
            fs::create_dir_all(&folder).map_err(failed("making folder", &folder))?;
            let time = jiff::Timestamp::now().strftime("%Y-%m-%dT%H-%M-%S%.9fZ.png").to_string();
            let kept = folder.join(time);
            same_content(&self.in_force, &kept).map_err(failed("keeping", &kept))?;
            synchronise(&folder)?;
        }
        fs::rename(file, &self.in_force).map_err(failed("putting in force", file))?;
        synchronise(self.folder())?;
        for old in self.history()?.iter().skip(KEPT) {
            self.remove(std::slice::from_ref(old))?;
        }
        Ok(())
    }

    fn remove(&self, files: &[PathBuf]) -> Result<(), Error> {
        for path in files {
            match fs::remove_file(path) {
                Err(error) if error.kind() != ErrorKind::NotFound => {
                    return Err(failed("removing", path)(error));
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn beside(&self, extension: &str) -> PathBuf {
        self.in_force.with_extension(extension)
    }

    /// The folder of the masks that were in force before.
    pub fn history_folder(&self) -> PathBuf {
        self.beside("history")
    }

    fn folder(&self) -> &Path {
        match self.in_force.parent() {
            Some(folder) if folder != Path::new("") => folder,
            _ => Path::new("."),
        }
    }
}

/// Gives the content a second name, or copies it where the file system knows no links.
fn same_content(from: &Path, to: &Path) -> io::Result<()> {
    fs::hard_link(from, to).or_else(|_| {
        fs::copy(from, to)?;
        File::open(to)?.sync_all()
    })
}

/// Makes the names in the folder outlast a loss of power.
fn synchronise(folder: &Path) -> Result<(), Error> {
    File::open(folder).and_then(|folder| folder.sync_all()).map_err(failed("writing", folder))
}

fn failed(doing: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Error {
    let path = path.to_path_buf();
    move |source| Error::System { doing, path, source }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Folder(tempfile::TempDir);

    impl Folder {
        fn new() -> Self {
            Folder(tempfile::tempdir().unwrap())
        }

        fn store(&self) -> MaskStore {
            MaskStore::new(&self.0.path().join("left.png"))
        }

        fn names(&self) -> Vec<String> {
            let entries = fs::read_dir(self.0.path()).unwrap();
            let mut names: Vec<_> =
                entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
            names.sort();
            names
        }
    }

    /// A mask with `rows` rows blanked.
    fn mask(rows: u32) -> Mask {
        Mask::from_fn(16, 16, |_, y| y < rows)
    }

    fn store(store: &MaskStore, rows: u32) {
        let (input, overlay) = (GrayImage::new(16, 16), image::RgbImage::new(16, 16));
        let provenance = [("Method", "test".to_owned())];
        let mask = mask(rows);
        let candidate = Candidate { mask: &mask, provenance: &provenance, input: &input, overlay: &overlay };
        store.store(&candidate).unwrap();
    }

    fn rows_in_force(store: &MaskStore) -> u64 {
        Mask::load(store.in_force()).unwrap().masked_px() / 16
    }

    #[test]
    fn a_candidate_does_not_touch_the_mask_in_force() {
        let folder = Folder::new();
        mask(1).save(folder.store().in_force(), &[]).unwrap();
        store(&folder.store(), 2);
        assert_eq!(rows_in_force(&folder.store()), 1);
        assert_eq!(
            folder.names(),
            ["left.candidate.input.png", "left.candidate.overlay.png", "left.candidate.png", "left.png"]
        );
        folder.store().discard().unwrap();
        assert_eq!(folder.names(), ["left.png"]);
    }

    #[test]
    fn accepting_keeps_the_last_five_and_they_can_be_restored() {
        let folder = Folder::new();
        for rows in 1..=8 {
            store(&folder.store(), rows);
            folder.store().accept().unwrap();
        }
        assert_eq!(folder.names(), ["left.history", "left.png"]);
        let rows = |path: &PathBuf| Mask::load(path).unwrap().masked_px() / 16;
        assert_eq!(folder.store().history().unwrap().iter().map(rows).collect::<Vec<_>>(), [7, 6, 5, 4, 3]);

        folder.store().restore(2).unwrap();
        assert_eq!(rows_in_force(&folder.store()), 6);
        assert_eq!(folder.store().history().unwrap().iter().map(rows).collect::<Vec<_>>(), [8, 7, 6, 5, 4]);
        assert!(
            file::read_texts(folder.store().in_force()).unwrap().contains(&("Method".into(), "test".into()))
        );
    }

    #[test]
    fn what_is_not_there_is_refused() {
        let folder = Folder::new();
        assert!(matches!(folder.store().accept(), Err(Error::Usage(_))));
        assert!(matches!(folder.store().restore(1), Err(Error::Usage(_))));
        assert!(matches!(folder.store().restore(0), Err(Error::Usage(_))));
        folder.store().discard().unwrap();
    }
}
