//! Shared memory of one test alone.

use std::path::Path;

use uvcam_shm_ipc::{Publisher, Settings};

/// A folder and a prefix that no other test uses; gone with this value.
pub struct SharedMemory {
    folder: tempfile::TempDir,
}

impl SharedMemory {
    /// Makes the folder.
    pub fn new() -> Self {
        SharedMemory { folder: tempfile::tempdir().unwrap() }
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// What a consumer needs to find it.
    pub fn settings(&self) -> Settings {
        let unique: String =
            self.folder.path().to_string_lossy().chars().filter(char::is_ascii_alphanumeric).collect();
        Settings { prefix: format!("{unique}_"), root_path: self.folder.path().into(), ..Settings::default() }
    }

    /// A publisher in it.
    pub fn publisher(&self, camera: &str, frame_bytes: usize, loans: usize) -> Publisher {
        Publisher::create(&self.settings(), camera, frame_bytes, loans).unwrap()
    }
}

impl Default for SharedMemory {
    fn default() -> Self {
        SharedMemory::new()
    }
}
