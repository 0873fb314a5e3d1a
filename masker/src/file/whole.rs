//! Files read whole, so that the bytes that were checked are the bytes that are used.

use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::os::unix::fs::FileTypeExt;
use std::path::Path;

use rustix::fs::{Mode, OFlags, open};

use super::{FileError, MAX_BYTES};

/// Reads a file, where it is one: opening a pipe or a device never waits for its other end.
///
/// # Errors
/// [`FileError::Read`] where it cannot be opened or read, or is no file; [`FileError::TooLong`] beyond [`MAX_BYTES`].
pub fn read_bytes(path: &Path) -> Result<Vec<u8>, FileError> {
    let read = || -> io::Result<(Vec<u8>, u64)> {
        let flags = OFlags::RDONLY | OFlags::NONBLOCK | OFlags::NOCTTY | OFlags::CLOEXEC;
        let file = File::from(open(path, flags, Mode::empty())?);
        let metadata = file.metadata()?;
        let found = metadata.file_type();
        if !found.is_file() {
            let kind = match found {
                kind if kind.is_dir() => "a folder",
                kind if kind.is_fifo() => "a named pipe",
                _ => "a device",
            };
            return Err(io::Error::new(ErrorKind::InvalidInput, format!("it is {kind}, not a file")));
        }
        if metadata.len() > MAX_BYTES {
            return Ok((Vec::new(), metadata.len()));
        }
        let mut bytes = Vec::with_capacity(metadata.len() as usize);
        // It may grow meanwhile.
        file.take(MAX_BYTES + 1).read_to_end(&mut bytes)?;
        let length = bytes.len() as u64;
        Ok((bytes, length))
    };
    match read() {
        Err(source) => Err(FileError::Read { path: path.to_owned(), source }),
        Ok((_, length)) if length > MAX_BYTES => Err(FileError::TooLong { path: path.to_owned(), length }),
        Ok((bytes, _)) => Ok(bytes),
    }
}
