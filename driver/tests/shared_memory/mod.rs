//! Shared memory of a test's own.

use uvcam_shm_ipc::{Publisher, Settings};

/// A folder and a prefix that no other test uses; gone with this value.
pub struct SharedMemory {
    folder: tempfile::TempDir,
}

impl SharedMemory {
    pub fn new() -> Self {
        SharedMemory { folder: tempfile::tempdir().unwrap() }
    }

    pub fn settings(&self) -> Settings {
        let unique: String =
            self.folder.path().to_string_lossy().chars().filter(char::is_ascii_alphanumeric).collect();
        Settings { prefix: format!("{unique}_"), root_path: self.folder.path().into(), ..Settings::default() }
    }

    pub fn publisher(&self, camera: &str, frame_bytes: usize, loans: usize) -> Publisher {
        Publisher::create(&self.settings(), camera, frame_bytes, loans).unwrap()
    }
}
