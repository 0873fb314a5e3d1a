//! Where a configuration is wrong, and what would be right.

use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};

use thiserror::Error;

/// How much of a line a message repeats, characters.
const SHOWN: usize = 60;

/// Why a configuration was refused.
#[derive(Debug, Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("{}: cannot be read; check the path given with --config", file.display())]
    Unreadable {
        /// The file.
        file: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// What the path leads to cannot be a configuration.
    #[error("{}: found {found}; --config names a text file of at most 1 MB", file.display())]
    NotAConfiguration {
        /// The path.
        file: PathBuf,
        /// What it leads to.
        found: &'static str,
    },
    /// The file is text of another encoding, or no text.
    #[error("{place}: {found}; save it as UTF-8")]
    Encoding {
        /// File and line.
        place: Place,
        /// What shows it.
        found: String,
    },
    /// A key has a value that is not allowed, is unknown, or is missing.
    #[error("{place}: {key}: found {found}; allowed: {allowed}")]
    Value {
        /// File and line.
        place: Place,
        /// The key.
        key: String,
        /// The value found.
        found: String,
        /// What is allowed.
        allowed: String,
    },
    /// What was meant is plain, and is written in another way.
    #[error("{place}: {key}: found {found}; {write}")]
    Mistyped {
        /// File and line.
        place: Place,
        /// The key.
        key: String,
        /// What was written.
        found: String,
        /// What to write.
        write: String,
    },
    /// The driver was built without this kind of camera.
    #[error(
        "{place}: kind: found \"{kind}\", and this uvcam was built without it; install one that has it (build with the Cargo feature \
         {kind}), or write a kind that this one has: {built_in}"
    )]
    NotBuiltIn {
        /// File and line.
        place: Place,
        /// The kind.
        kind: &'static str,
        /// The kinds that there are.
        built_in: String,
    },
    /// The text is not TOML.
    #[error("{place}: not TOML: {cause}")]
    Syntax {
        /// File and line.
        place: Place,
        /// What the parser said, and of what.
        cause: String,
    },
}

/// A line of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    /// The file.
    pub file: PathBuf,
    /// The line, from 1.
    pub line: usize,
}

impl Place {
    /// The line of the byte at `offset`.
    pub(super) fn of(text: &[u8], offset: usize, file: &Path) -> Self {
        let before = text.iter().take(offset);
        Place { file: file.to_path_buf(), line: 1 + before.filter(|byte| **byte == b'\n').count() }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.file.display(), self.line)
    }
}

/// The text that is being read, to find places in it.
#[derive(Clone, Copy)]
pub(super) struct Text<'a> {
    pub(super) text: &'a str,
    pub(super) file: &'a Path,
}

impl Text<'_> {
    pub(super) fn place(&self, offset: usize) -> Place {
        Place::of(self.text.as_bytes(), offset, self.file)
    }

    pub(super) fn refuse(&self, span: Range<usize>, key: &str, found: String, allowed: &str) -> ConfigError {
        ConfigError::Value {
            place: self.place(span.start),
            key: named(key),
            found: printable(&found),
            allowed: printable(allowed),
        }
    }

    pub(super) fn mistyped(&self, offset: usize, key: &str, found: String, write: String) -> ConfigError {
        ConfigError::Mistyped {
            place: self.place(offset),
            key: named(key),
            found: printable(&found),
            write: printable(&write),
        }
    }
}

/// A key for a message. TOML knows one of no characters, between quotes.
fn named(key: &str) -> String {
    if key.is_empty() { "\"\"".into() } else { shortened(key) }
}

/// The text without what would change a terminal.
pub(super) fn printable(text: &str) -> String {
    text.chars().map(|character| if character.is_control() { '?' } else { character }).collect()
}

/// The beginning of a text on one line, for a message.
pub(super) fn shortened(text: &str) -> String {
    let mut shown: String = text.chars().take_while(|c| *c != '\n').take(SHOWN).collect();
    if shown.chars().count() < text.chars().count() {
        shown.push_str("...");
    }
    printable(&shown)
}
