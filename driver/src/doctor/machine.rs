//! A machine's files below one root.

use std::fs;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// The files of `/proc`, `/sys`, `/dev` and `/etc` below one root, which are read and never written.
pub(super) struct Machine {
    root: PathBuf,
}

impl Machine {
    pub(super) fn new(root: &Path) -> Self {
        Machine { root: root.to_path_buf() }
    }

    /// Where this absolute path lies.
    pub(super) fn path(&self, absolute: &str) -> PathBuf {
        self.root.join(absolute.trim_start_matches('/'))
    }

    /// The absolute path of what this one leads to, links followed; nothing where there is nothing.
    pub(super) fn behind(&self, absolute: &Path) -> Option<String> {
        let root = fs::canonicalize(&self.root).ok()?;
        let path = fs::canonicalize(self.path(&absolute.to_string_lossy())).ok()?;
        Some(format!("/{}", path.strip_prefix(root).ok()?.display()))
    }

    /// A file's text without white space around it; nothing where it cannot be read.
    pub(super) fn text(&self, absolute: &str) -> Option<String> {
        Some(String::from_utf8_lossy(&fs::read(self.path(absolute)).ok()?).trim().to_owned())
    }

    /// A file that holds one value; nothing where it cannot be read or holds something else.
    pub(super) fn value<T: FromStr>(&self, absolute: &str) -> Option<T> {
        self.text(absolute)?.parse().ok()
    }

    /// The names in a folder, sorted; none where it cannot be read.
    pub(super) fn names(&self, absolute: &str) -> Vec<String> {
        let entries = fs::read_dir(self.path(absolute)).into_iter().flatten().flatten();
        let mut names: Vec<String> =
            entries.filter_map(|entry| entry.file_name().into_string().ok()).collect();
        names.sort();
        names
    }

    /// The name that `/etc/passwd` or `/etc/group` (passwd(5), group(5)) gives to a number, else the number.
    pub(super) fn name_of(&self, database: &str, id: u32) -> String {
        let number = id.to_string();
        let text = self.text(database).unwrap_or_default();
        let mut lines = text.lines().map(|line| line.split(':').collect::<Vec<_>>());
        let line = lines.find(|fields| fields.get(2) == Some(&number.as_str()));
        line.and_then(|fields| fields.first().map(|name| (*name).to_owned())).unwrap_or(number)
    }
}
