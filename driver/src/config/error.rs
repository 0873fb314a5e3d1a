//! Where a configuration is wrong, and what would be right.

use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};

use thiserror::Error;

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
    /// The text is not TOML.
    #[error("{place}: not TOML: {cause}")]
    Syntax {
        /// File and line.
        place: Place,
        /// What the parser said.
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
    fn place(&self, offset: usize) -> Place {
        let before = self.text.as_bytes().iter().take(offset);
        Place { file: self.file.to_path_buf(), line: 1 + before.filter(|byte| **byte == b'\n').count() }
    }

    pub(super) fn refuse(&self, span: Range<usize>, key: &str, found: String, allowed: &str) -> ConfigError {
        ConfigError::Value { place: self.place(span.start), key: key.into(), found, allowed: allowed.into() }
    }

    /// Turns the parser's message into the same form as our own refusals.
    pub(super) fn translate(&self, error: &toml::de::Error) -> ConfigError {
        let offset = error.span().map_or(0, |span| span.start);
        let place = self.place(offset);
        let message = error.message();
        let mut quoted = message.split('`').skip(1).step_by(2);
        let value = |key: String, found: String, allowed: String| ConfigError::Value {
            place: place.clone(),
            key,
            found,
            allowed,
        };
        if message.starts_with("unknown field") {
            let key = quoted.next().unwrap_or_default().to_owned();
            let known: Vec<&str> = quoted.collect();
            let nearest = known
                .iter()
                .max_by(|a, b| strsim::jaro_winkler(a, &key).total_cmp(&strsim::jaro_winkler(b, &key)));
            let suggestion = nearest
                .filter(|name| strsim::jaro_winkler(name, &key) > 0.7)
                .map_or(String::new(), |name| format!(" (did you mean \"{name}\"?)"));
            return value(key, format!("an unknown key{suggestion}"), known.join(", "));
        }
        if message.starts_with("missing field") {
            return value(
                quoted.next().unwrap_or_default().to_owned(),
                "nothing".into(),
                "this key must be written".into(),
            );
        }
        if let Some((found, expected)) = message
            .strip_prefix("invalid type: ")
            .or_else(|| message.strip_prefix("invalid value: "))
            .and_then(|rest| rest.split_once(", expected "))
        {
            return value(self.key_at(offset), found.replace('`', ""), in_plain_words(expected));
        }
        if let Some(key) =
            message.strip_prefix("duplicate key").and(error.span()).and_then(|span| self.text.get(span))
        {
            return value(key.to_owned(), "the key a second time".into(), "each key once".into());
        }
        ConfigError::Syntax { place, cause: message.to_owned() }
    }

    /// The key whose value begins at `offset`.
    fn key_at(&self, offset: usize) -> String {
        let before = self.text.get(..offset).unwrap_or_default();
        let statement = before.rsplit(['\n', ',', '{']).next().unwrap_or_default();
        match statement.trim().trim_end_matches('=').trim() {
            "" => "value".to_owned(),
            key => key.trim_matches(['[', ']']).to_owned(),
        }
    }
}

fn in_plain_words(expected: &str) -> String {
    match expected {
        "f64" => "a number".into(),
        "u8" | "u16" | "u32" | "u64" | "usize" => "a whole number, not negative".into(),
        "a boolean" => "true or false".into(),
        other if other.starts_with("struct ") => "a table".into(),
        other => other.into(),
    }
}
