//! The keys of each table, and which one was meant.

use serde::de::value::Error;
use serde::de::{Deserialize, Deserializer, Error as _, Visitor};

/// Where no heading has come yet.
pub(super) const TOP: &str = "the top of the file";

/// A heading, or `source`, and the keys that are read there.
pub(super) type Table = (&'static str, &'static [&'static str]);

/// The keys that are read into `T`.
pub(super) fn keys_of<'de, T: Deserialize<'de>>() -> &'static [&'static str] {
    let mut keys = Keys(&[]);
    // There is nothing to be read.
    let _ = T::deserialize(&mut keys);
    keys.0
}

/// Keeps what a structure asks for.
struct Keys(&'static [&'static str]);

impl<'de> Deserializer<'de> for &mut Keys {
    type Error = Error;

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        name: &'static str,
        keys: &'static [&'static str],
        _: V,
    ) -> Result<V::Value, Error> {
        self.0 = keys;
        Err(Error::custom(name))
    }

    fn deserialize_any<V: Visitor<'de>>(self, _: V) -> Result<V::Value, Error> {
        Err(Error::custom("no structure"))
    }

    serde::forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf option unit unit_struct newtype_struct
        seq tuple tuple_struct map enum identifier ignored_any
    }
}

/// Words that other programs use, and ours.
const ALSO_CALLED: [(&str, &str); 20] = [
    ("device", "path"),
    ("dev", "path"),
    ("node", "path"),
    ("file", "path"),
    ("folder", "path"),
    ("directory", "path"),
    ("type", "kind"),
    ("driver", "kind"),
    ("id", "serial"),
    ("address", "serial"),
    ("ip", "serial"),
    ("rate", "fps"),
    ("frame_rate", "fps"),
    ("framerate", "fps"),
    ("format", "pixel_format"),
    ("encoding", "pixel_format"),
    ("uvc", "v4l2"),
    ("gige", "aravis"),
    ("grey", "Mono8"),
    ("y8", "Mono8"),
];

/// The name among `known` that was likely meant by `word`.
pub(super) fn nearest<'a>(word: &str, known: &[&'a str]) -> Option<&'a str> {
    let word = word.to_lowercase();
    let also_called = ALSO_CALLED.iter().find(|(other, _)| *other == word).map(|(_, ours)| *ours);
    if let Some(name) = known.iter().find(|name| also_called == Some(**name)) {
        return Some(name);
    }
    let likeness = |name: &str| strsim::jaro_winkler(&name.to_lowercase(), &word);
    let best = known.iter().max_by(|one, other| likeness(one).total_cmp(&likeness(other)));
    best.copied().filter(|name| likeness(name) > 0.7)
}

/// ` (did you mean "..."?)`, or nothing.
pub(super) fn suggestion(word: &str, known: &[&str]) -> String {
    nearest(word, known).map_or(String::new(), |name| format!(" (did you mean \"{name}\"?)"))
}

/// The table that has the key, besides the one whose keys are `known`.
pub(super) fn home_of(tables: &[Table], key: &str, known: &[&str]) -> Option<&'static str> {
    let has_it = |(_, keys): &&Table| *keys != known && keys.contains(&key);
    tables.iter().find(has_it).map(|(table, _)| *table)
}

/// The table whose keys are `known`.
pub(super) fn table_of(tables: &[Table], known: &[&str]) -> Option<&'static str> {
    tables.iter().find(|(_, keys)| *keys == known).map(|(table, _)| *table)
}
