//! The pictures of a folder, in the order in which a person counts them.

use std::cmp::Ordering;
use std::ffi::OsString;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};

/// Most pictures that are listed: over four hours at 60 frames a second.
const MOST: usize = 1_000_000;

/// A folder, and the names of its pictures; at least one.
#[derive(Debug)]
pub(super) struct Folder {
    path: PathBuf,
    names: Vec<OsString>,
}

impl Folder {
    /// Lists the files that end in `.png`. Names that begin with a dot are no pictures: other systems keep notes about files in such.
    ///
    /// Fails with what was found instead.
    pub(super) fn list(path: &Path) -> Result<Self, String> {
        let mut names = Vec::new();
        for entry in std::fs::read_dir(path).map_err(|error| error.to_string())? {
            let name = entry.map_err(|error| error.to_string())?.file_name();
            if !is_picture(&name) {
                continue;
            }
            if names.len() == MOST {
                return Err(format!("more than {MOST} pictures"));
            }
            names.push(name);
        }
        if names.is_empty() {
            return Err("no file that ends in .png".into());
        }
        names.sort_unstable_by(|one, other| by_number(one.as_bytes(), other.as_bytes()));
        Ok(Folder { path: path.to_path_buf(), names })
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// How many pictures there are.
    pub(super) fn len(&self) -> u64 {
        self.names.len() as u64
    }

    /// The picture of a frame: after the last one comes the first again.
    pub(super) fn picture(&self, frame_id: u64) -> PathBuf {
        let index = frame_id % self.len().max(1);
        // `list` refuses an empty folder, so there is always a name.
        self.names.get(index as usize).map_or_else(PathBuf::new, |name| self.path.join(name))
    }
}

fn is_picture(name: &OsString) -> bool {
    let extension = Path::new(name).extension();
    !name.as_bytes().starts_with(b".")
        && extension.is_some_and(|extension| extension.eq_ignore_ascii_case("png"))
}

/// Compares digits as numbers, so that `frame_9` comes before `frame_10`, and all else byte by byte.
fn by_number(one: &[u8], other: &[u8]) -> Ordering {
    let (mut left, mut right) = (one, other);
    while let (Some(first), Some(second)) = (left.first(), right.first()) {
        let order = if first.is_ascii_digit() && second.is_ascii_digit() {
            let (number, another) = (take_number(&mut left), take_number(&mut right));
            number.len().cmp(&another.len()).then(number.cmp(another))
        } else {
            (left, right) = (left.get(1..).unwrap_or_default(), right.get(1..).unwrap_or_default());
            first.cmp(second)
        };
        if order != Ordering::Equal {
            return order;
        }
    }
    // Names that differ in zeros in front alone still have an order.
    left.len().cmp(&right.len()).then(one.cmp(other))
}

/// The digits that `text` begins with, without zeros in front; leaves the rest.
fn take_number<'a>(text: &mut &'a [u8]) -> &'a [u8] {
    let length = text.iter().take_while(|byte| byte.is_ascii_digit()).count();
    let (digits, rest) = text.split_at(length);
    *text = rest;
    let zeros = digits.iter().take_while(|byte| **byte == b'0').count();
    digits.get(zeros..).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        Folder::list(folder).unwrap().names.into_iter().map(|name| name.into_string().unwrap()).collect()
    }

    #[test]
    fn digits_are_numbers_of_any_length() {
        let folder = tempfile::tempdir().unwrap();
        let sorted = [
            "01_00000009.png",
            "01_00000010.png",
            "02_00000001.png",
            "a.png",
            "frame.png",
            "frame_9.png",
            "frame_10.PNG",
            "frame_010.png",
            "frame_010_2.png",
            "frame_010_10.png",
            "frame_99999999999999999999999999.png",
            "frame_100000000000000000000000000.png",
        ];
        for name in sorted.iter().rev() {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        let found = names(folder.path());
        assert_eq!(found.len(), sorted.len());
        let place = |name: &str| found.iter().position(|found| found == name).unwrap();
        assert!(place("01_00000009.png") < place("01_00000010.png"));
        assert!(place("01_00000010.png") < place("02_00000001.png"));
        assert!(place("frame_9.png") < place("frame_10.PNG"));
        assert!(place("frame_10.PNG") < place("frame_99999999999999999999999999.png"));
        assert!(place("frame_010_2.png") < place("frame_010_10.png"));
        assert!(
            place("frame_99999999999999999999999999.png") < place("frame_100000000000000000000000000.png")
        );
    }

    #[test]
    fn the_order_is_one_whichever_way_it_is_asked() {
        let names =
            ["", "0", "00", "1", "01", "1a", "01a", "a1", "a01", "a", "a1b2", "a1b02", "a01b2", "9", "10"];
        for one in names {
            for other in names {
                let (order, back) = (
                    by_number(one.as_bytes(), other.as_bytes()),
                    by_number(other.as_bytes(), one.as_bytes()),
                );
                assert_eq!(order, back.reverse(), "{one} {other}");
                assert_eq!(order == Ordering::Equal, one == other, "{one} {other}");
            }
        }
    }

    #[test]
    fn names_that_begin_with_a_dot_and_other_files_are_left_out() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["._0001.png", ".png", ".hidden.png", "notes.txt", "png", "0001.png.tmp"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        assert_eq!(Folder::list(folder.path()).unwrap_err(), "no file that ends in .png");
        std::fs::write(folder.path().join("0001.png"), "").unwrap();
        assert_eq!(names(folder.path()), ["0001.png"]);
        assert!(Folder::list(&folder.path().join("nowhere")).unwrap_err().contains("No such file"));
    }

    #[test]
    fn the_first_picture_follows_the_last() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["1.png", "2.png", "10.png"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        let list = Folder::list(folder.path()).unwrap();
        let shown: Vec<PathBuf> = (0..4).map(|frame_id| list.picture(frame_id)).collect();
        assert_eq!(shown, ["1.png", "2.png", "10.png", "1.png"].map(|name| folder.path().join(name)));
    }
}
