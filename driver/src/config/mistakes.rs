//! The parser's messages in the form of our own refusals: line, key, what was found, and what to write instead.

use std::ops::Range;

use serde_path_to_error::{Path, Segment};

use super::ConfigError;
use super::error::{Text, printable, shortened};
use super::keys::{TOP, Table, home_of, suggestion, table_of};
use super::statement::{Statement, boolean, number};

/// Whether what stands for a key begins as one.
fn names_a_key(key: &str) -> bool {
    key.starts_with(|first: char| first.is_alphanumeric() || "_\"'".contains(first))
}

impl Text<'_> {
    /// What is wrong with a text that is not TOML.
    pub(super) fn not_toml(&self, error: &toml::de::Error) -> ConfigError {
        let span = error.span().unwrap_or_default();
        let message = error.message();
        if message.starts_with("duplicate key") {
            let key = self.text.get(span.clone()).unwrap_or_default();
            return self.twice(span.start, key);
        }
        let statement = Statement::at(self.text, span.start);
        let cause = match statement.remedy(message) {
            Some(write) if names_a_key(&statement.key) => {
                return self.mistyped(span.start, &statement.key, statement.found(), write);
            }
            Some(write) => format!("{}; {}", statement.line(), printable(&write)),
            None => format!("{}: {message}", statement.line()),
        };
        ConfigError::Syntax { place: self.place(span.start), cause }
    }

    /// What is wrong with a document that has other keys, or values of other types, than the `tables` of a configuration.
    pub(super) fn not_ours(&self, error: &toml::de::Error, path: &Path, tables: &[Table]) -> ConfigError {
        let span = error.span().unwrap_or_default();
        let message = error.message();
        let mut quoted = message.split('`').skip(1).step_by(2);
        if message.starts_with("unknown field") {
            let key = quoted.next().unwrap_or_default();
            return self.unknown(span, key, &quoted.collect::<Vec<_>>(), tables);
        }
        if message.starts_with("missing field") {
            let key = quoted.next().unwrap_or_default();
            return self.refuse(span, key, "nothing".into(), "this key must be written");
        }
        let key = &last_key(path).unwrap_or_else(|| "value".into());
        let expected = message
            .strip_prefix("invalid type: ")
            .or_else(|| message.strip_prefix("invalid value: "))
            .and_then(|rest| rest.split_once(", expected "));
        match expected {
            Some((found, expected)) => self.of_another_type(span, key, found, expected),
            None if message.contains("overflow") => {
                self.refuse(span.clone(), key, self.written(&span), "a number nearer to zero")
            }
            None => self.refuse(span.clone(), key, self.written(&span), &message.replace('`', "")),
        }
    }

    fn twice(&self, offset: usize, key: &str) -> ConfigError {
        match key {
            "camera" => {
                let write = "write [[camera]] above each camera".into();
                self.mistyped(offset, key, "the heading a second time".into(), write)
            }
            _ => self.refuse(offset..offset, key, "the key a second time".into(), "each key once"),
        }
    }

    fn unknown(&self, span: Range<usize>, key: &str, known: &[&str], tables: &[Table]) -> ConfigError {
        match (table_of(tables, known), home_of(tables, key, known)) {
            (Some(here), Some(home)) => {
                let write = match (here, home) {
                    (TOP, "[[camera]]") if ["generate", "realtime", "source"].contains(&key) => {
                        format!("write [camera.{key}], below its camera")
                    }
                    (_, "[[camera]]") if here.starts_with("[camera.") => {
                        format!("write it below [[camera]], above {here}")
                    }
                    (_, "source") => "write it in the braces of source = { ... }".into(),
                    _ => format!("write it below the line {home}"),
                };
                let preposition = if here == TOP { "at" } else { "in" };
                self.mistyped(span.start, key, format!("a key of {home} {preposition} {here}"), write)
            }
            _ => {
                let found = format!("an unknown key{}", suggestion(key, known));
                self.refuse(span, key, found, &known.join(", "))
            }
        }
    }

    fn of_another_type(&self, span: Range<usize>, key: &str, found: &str, expected: &str) -> ConfigError {
        let written = self.text.get(span.clone()).unwrap_or_default();
        let allowed = in_plain_words(expected, found);
        let is_number = matches!(expected, "f64" | "u8" | "u16" | "u32" | "u64" | "usize");
        let remedy = match expected {
            "a string" if key == "mask" && ["true", "false"].contains(&written) => {
                Some("write \"none\" to fly without a mask".into())
            }
            "a string" if is_plain(written) => Some(format!("write it in quotes: \"{written}\"")),
            "a sequence" if is_plain(written) => Some(format!("write it in brackets: [{written}]")),
            _ if key == "source" => Some("write { kind = \"aravis\", serial = \"25003774\" }".into()),
            "a boolean" => boolean(written),
            _ if is_number => number(key, written, expected != "f64"),
            _ => None,
        };
        let allowed = remedy.map_or(allowed.clone(), |remedy| format!("{allowed}; {remedy}"));
        let found = match found {
            "map" if is_plain(written) => written.to_owned(),
            "map" => "a table".into(),
            "sequence" => "a list".into(),
            other => other.replace('`', "").replace(" as i128", "").replace(" as u128", ""),
        };
        self.refuse(span, key, found, &allowed)
    }

    /// The beginning of what is written there.
    fn written(&self, span: &Range<usize>) -> String {
        shortened(self.text.get(span.clone()).unwrap_or_default())
    }
}

/// Whether it is a number, a date or a word, not a text in quotes, a list or a table.
fn is_plain(written: &str) -> bool {
    !written.is_empty() && written.chars().all(|c| c.is_ascii_alphanumeric() || "+-._:".contains(c))
}

/// The last key of the path. Those that begin like this are the parser's own, for places.
fn last_key(path: &Path) -> Option<String> {
    let mut keys = path.iter().filter_map(|segment| match segment {
        Segment::Map { key } if !key.starts_with("$__") => Some(key.clone()),
        _ => None,
    });
    keys.next_back()
}

fn in_plain_words(expected: &str, found: &str) -> String {
    match expected {
        "f64" if found.starts_with("integer") => "a number nearer to zero".into(),
        "f64" => "a number".into(),
        "u8" | "u16" | "u32" | "u64" | "usize" => match found.split_once(' ') {
            Some(("integer", number)) if !number.contains('-') => "a smaller whole number".into(),
            _ => "a whole number, not negative".into(),
        },
        "a boolean" => "true or false".into(),
        "a string" => "a text".into(),
        "a sequence" => "a list".into(),
        other if other.starts_with("struct ") => "a table".into(),
        other => other.into(),
    }
}
