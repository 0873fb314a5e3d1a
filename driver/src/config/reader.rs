//! Takes one value after another, or refuses it with its line.

use std::fmt::Display;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use toml::Spanned;
use uvcam_shm_ipc::control::Bounds;

use super::ConfigError;
use super::error::{Text, shortened};

pub(super) struct Reader<'a>(pub(super) Text<'a>);

impl Reader<'_> {
    /// The value, or a refusal where `valid` says no.
    pub(super) fn value<T: Display>(
        &self,
        key: &str,
        value: Spanned<T>,
        allowed: &str,
        valid: impl FnOnce(&T) -> bool,
    ) -> Result<T, ConfigError> {
        if valid(value.get_ref()) {
            return Ok(value.into_inner());
        }
        let found = shortened(&value.get_ref().to_string());
        let found = if found.is_empty() { "an empty text".into() } else { found };
        Err(self.0.refuse(value.span(), key, found, allowed))
    }

    /// The value where it is written, the default where not, or a refusal.
    pub(super) fn value_or<T: Display>(
        &self,
        key: &str,
        value: Option<Spanned<T>>,
        default: T,
        allowed: &str,
        valid: impl FnOnce(&T) -> bool,
    ) -> Result<T, ConfigError> {
        value.map_or(Ok(default), |value| self.value(key, value, allowed, valid))
    }

    /// The value within its bounds, or a refusal.
    pub(super) fn within<T: Display + PartialOrd>(
        &self,
        key: &str,
        value: Spanned<T>,
        bounds: &Bounds<T>,
    ) -> Result<T, ConfigError> {
        self.value(key, value, &bounds.to_string(), |value| bounds.contains(value))
    }

    /// A whole number within its range, or a refusal.
    pub(super) fn whole<T: TryFrom<u64>>(
        &self,
        key: &str,
        value: Spanned<u64>,
        allowed: &str,
        range: RangeInclusive<u64>,
    ) -> Result<T, ConfigError> {
        let span = value.span();
        let number = self.value(key, value, allowed, |number| range.contains(number))?;
        T::try_from(number).map_err(|_| self.0.refuse(span, key, number.to_string(), allowed))
    }

    /// A path as it is written. Nothing in it is expanded, so what a shell would expand is refused.
    pub(super) fn path(
        &self,
        key: &str,
        value: Spanned<String>,
        allowed: &str,
    ) -> Result<String, ConfigError> {
        let span = value.span();
        let path = self.value(key, value, allowed, |path| !path.is_empty())?;
        let shown = || format!("{path:?}");
        let unexpanded = match path.chars().next() {
            Some('~') => Some("~ is not expanded"),
            Some('$') => Some("variables are not expanded"),
            _ => None,
        };
        if let Some(cause) = unexpanded {
            let write = format!("{cause}: write the folders out, from / on");
            return Err(self.0.mistyped(span.start, key, shown(), write));
        }
        if path.contains(char::is_control) {
            return Err(self.0.refuse(span, key, shown(), "a path without control characters"));
        }
        Ok(path)
    }

    /// A relative path starts at the configuration's folder.
    pub(super) fn resolve(&self, path: &Path) -> PathBuf {
        self.0.file.parent().map_or_else(|| path.to_path_buf(), |folder| folder.join(path))
    }
}

/// These words as a choice.
pub(super) fn either<T: AsRef<str>>(words: &[T]) -> String {
    let words: Vec<&str> = words.iter().map(AsRef::as_ref).collect();
    match words.split_last() {
        Some((last, others)) if !others.is_empty() => format!("{} or {last}", others.join(", ")),
        _ => words.concat(),
    }
}
