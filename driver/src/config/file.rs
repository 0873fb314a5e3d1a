//! The file's bytes, and the text that they are.

use std::fs::{File, OpenOptions};
use std::io::Read;
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::path::Path;

use super::ConfigError;
use super::error::Place;

/// Longest configuration that is read, bytes; the commented default has a hundredth of it.
const LONGEST: u64 = 1 << 20;

/// Reads a file of at most 1 MB. Anything else that a path can lead to may block, or never end.
pub(super) fn read(file: &Path) -> Result<Vec<u8>, ConfigError> {
    let unreadable = |source| ConfigError::Unreadable { file: file.to_path_buf(), source };
    let no_configuration = |found| ConfigError::NotAConfiguration { file: file.to_path_buf(), found };
    // Asked before it is opened: to open a device can do something.
    if let Some(found) = other_than_file(std::fs::metadata(file).map_err(unreadable)?.file_type()) {
        return Err(no_configuration(found));
    }
    let opened = open(file).map_err(unreadable)?;
    if let Some(found) = other_than_file(opened.metadata().map_err(unreadable)?.file_type()) {
        return Err(no_configuration(found));
    }
    let mut bytes = Vec::new();
    opened.take(LONGEST + 1).read_to_end(&mut bytes).map_err(unreadable)?;
    match bytes.len() as u64 {
        0..=LONGEST => Ok(bytes),
        _ => Err(no_configuration("more than 1 MB")),
    }
}

/// Does not wait for the other end of a pipe that has taken the file's place.
fn open(file: &Path) -> std::io::Result<File> {
    OpenOptions::new().read(true).custom_flags(libc::O_NONBLOCK).open(file)
}

fn other_than_file(kind: std::fs::FileType) -> Option<&'static str> {
    match kind {
        kind if kind.is_file() => None,
        kind if kind.is_dir() => Some("a folder"),
        kind if kind.is_fifo() => Some("a pipe"),
        kind if kind.is_socket() => Some("a socket"),
        _ => Some("a device"),
    }
}

/// The text, where it is UTF-8.
pub(super) fn decode<'a>(bytes: &'a [u8], file: &Path) -> Result<&'a str, ConfigError> {
    let refused = |offset, found| ConfigError::Encoding { place: Place::of(bytes, offset, file), found };
    if let [first @ (0xff | 0xfe), second @ (0xff | 0xfe), ..] = bytes
        && first != second
    {
        return Err(refused(0, format!("UTF-16, as it begins with {first:02x} {second:02x}")));
    }
    // UTF-16 of plain letters without its mark is UTF-8 with zeros in between.
    if let Some(offset) = bytes.iter().position(|byte| *byte == 0) {
        return Err(refused(offset, "not UTF-8 text (byte 0x00, as in UTF-16)".into()));
    }
    std::str::from_utf8(bytes).map_err(|error| {
        let offset = error.valid_up_to();
        let byte = bytes.get(offset).copied().unwrap_or_default();
        refused(offset, format!("not UTF-8 (byte 0x{byte:02x})"))
    })
}
