//! What the fuzz targets share: bounded memory, files in memory, and records from bytes.
//!
//! Everything here panics where it cannot do its work: a target that cannot run has failed.
#![allow(clippy::unwrap_used)]

use std::alloc::System;
use std::error::Error;
use std::os::fd::{AsRawFd, OwnedFd};
use std::path::{Path, PathBuf};

use cap::Cap;
use rustix::fs::{MemfdFlags, ftruncate, memfd_create};
use rustix::io::pwrite;
use uvcam_shm_ipc::FrameHeader;
use uvcam_shm_ipc::health::Health;

pub mod chunks;

/// Memory that a target may take, bytes. Beyond it the allocator gives none, which ends the process: also where the memory would never
/// have been touched, and however short it would have lived.
const MEMORY: usize = 512 << 20;

#[global_allocator]
static ALLOCATOR: Cap<System> = Cap::new(System, MEMORY);

/// A file in memory, for code that takes a path.
#[derive(Debug)]
pub struct MemoryFile {
    file: OwnedFd,
    path: PathBuf,
}

impl MemoryFile {
    /// An empty one.
    pub fn new() -> Self {
        let file = memfd_create("input", MemfdFlags::CLOEXEC).unwrap();
        let path = format!("/proc/self/fd/{}", file.as_raw_fd()).into();
        MemoryFile { file, path }
    }

    /// Its path, after giving it this content.
    pub fn fill(&self, content: &[u8]) -> &Path {
        ftruncate(&self.file, 0).unwrap();
        assert_eq!(pwrite(&self.file, content, 0), Ok(content.len()));
        &self.path
    }
}

impl Default for MemoryFile {
    fn default() -> Self {
        MemoryFile::new()
    }
}

/// The error's message with those of its causes, as the commands print it.
pub fn message(error: &dyn Error) -> String {
    let message = uvcam::error::with_causes(error);
    assert!(!message.is_empty());
    message
}

/// The next header of a frame, and the length of its payload; `None` where too few bytes are left.
pub fn header(bytes: &mut &[u8]) -> Option<(FrameHeader, usize)> {
    // SAFETY: law of `FrameHeader`: any bytes are a valid one.
    let header = unsafe { take(bytes) }?;
    // SAFETY: a number.
    let payload_len = unsafe { take(bytes) }?;
    Some((header, payload_len))
}

/// A record of health; `None` where there are too few bytes.
pub fn health(mut bytes: &[u8]) -> Option<Health> {
    // SAFETY: law of `Health`: any bytes are a valid one.
    unsafe { take(&mut bytes) }
}

/// # Safety
/// Any bytes must be a valid `T`.
unsafe fn take<T: Copy>(bytes: &mut &[u8]) -> Option<T> {
    let (taken, rest) = bytes.split_at_checked(size_of::<T>())?;
    *bytes = rest;
    // SAFETY: `taken` has the size of a `T`, and need not be aligned.
    Some(unsafe { taken.as_ptr().cast::<T>().read_unaligned() })
}
