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
        SharedMemory::settings_in(self.folder.path())
    }

    /// The same, for another process that knows the folder.
    pub fn settings_in(folder: &Path) -> Settings {
        let unique: String = folder.to_string_lossy().chars().filter(char::is_ascii_alphanumeric).collect();
        Settings::new(format!("{unique}_"), folder)
    }

    /// A publisher in it.
    pub fn publisher(&self, camera: &str, frame_bytes: usize, loans: usize) -> Publisher {
        Publisher::create(&self.settings(), camera, frame_bytes, loans).unwrap()
    }
}

impl Drop for SharedMemory {
    /// Takes away what killed processes left behind.
    fn drop(&mut self) {
        let prefix = self.settings().prefix;
        let files = std::fs::read_dir("/dev/shm").into_iter().flatten().flatten();
        for file in files.filter(|file| file.file_name().to_string_lossy().starts_with(&prefix)) {
            let _ = std::fs::remove_file(file.path());
        }
    }
}

impl Default for SharedMemory {
    fn default() -> Self {
        SharedMemory::new()
    }
}
