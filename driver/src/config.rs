//! The configuration: one TOML file, read once, valid or refused.
//!
//! `document` is the file as written, `reader` takes its values, `error` says where it is wrong, `mistakes` and `statement` what was
//! meant; this file holds what the rest of the driver sees. The commented default (`driver/default.toml`) is compiled in and is the manual.

use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};
use uvcam_masker::generate::{IgnoredRegion, Parameters};

use crate::camera::Settings;
pub use crate::camera::source::{Fault, FaultKind, Simulated, Source, V4l2, V4l2Device, V4l2Memory};
use crate::realtime::Realtime;

mod document;
mod error;
mod faults;
mod file;
mod generate;
mod keys;
mod links;
mod mistakes;
mod reader;
mod realtime;
mod shared;
mod source;
mod statement;

pub use error::ConfigError;

/// The commented default configuration.
pub const DEFAULT: &str = include_str!("../default.toml");

/// A valid configuration.
#[derive(Debug, Clone, PartialEq)]
pub struct Config {
    /// Identity of the file: the first 16 bytes of the SHA-256 of its text, so that `sha256sum uvcam.toml` shows it.
    pub digest: [u8; 16],
    /// The file's text.
    pub text: String,
    /// Whether each camera has a process of its own.
    pub process_per_camera: bool,
    /// Bytes that the process of a camera may take for itself.
    pub process_memory_bytes: u64,
    /// Shared memory.
    pub ipc: Ipc,
    /// The cameras, in the order of the file; at least one, no name, device or mask file twice.
    pub cameras: Vec<CameraConfig>,
}

/// `[ipc]`
#[derive(Debug, Clone, PartialEq)]
pub struct Ipc {
    /// What driver and consumers must agree on.
    pub settings: uvcam_shm_ipc::Settings,
    /// Slots that a camera fills in turn.
    pub slots: usize,
}

impl Ipc {
    /// Dead cameras that may hold slots while another attempt to open theirs runs.
    pub(crate) const CLOSING: usize = 1;

    /// Slots in the hands of the driver: those that the camera fills, and as many that a dead one holds until it is closed.
    pub fn loans(&self) -> usize {
        (1 + Ipc::CLOSING) * self.slots
    }
}

impl Config {
    /// The same with no other camera than this one; nothing where there is none of this name.
    pub fn with_only(mut self, camera: &str) -> Option<Config> {
        self.cameras.retain(|one| one.name == camera);
        (!self.cameras.is_empty()).then_some(self)
    }

    /// Bytes of `/dev/shm` that all cameras and their consumers need.
    pub fn shared_memory_needed(&self) -> u64 {
        let frames = self.cameras.iter().map(|camera| camera.settings.frame_bytes());
        self.ipc.settings.shared_memory_of_all(frames, self.ipc.loans())
    }
}

/// `[[camera]]`
#[derive(Debug, Clone, PartialEq)]
pub struct CameraConfig {
    /// The consumer's address of this camera.
    pub name: String,
    /// Where frames come from.
    pub source: Source,
    /// What the camera is asked for.
    pub settings: Settings,
    /// What is blanked.
    pub mask: MaskChoice,
    /// Whether it is.
    pub mask_mode: MaskMode,
    /// How its mask is generated.
    pub generate: Generate,
    /// How its threads are scheduled.
    pub realtime: Realtime,
}

/// `[camera.generate]`
#[derive(Debug, Clone, PartialEq)]
pub struct Generate {
    /// Exposure time of lit frames, microseconds.
    pub exposure_us: f64,
    /// Gain of lit frames, decibels.
    pub gain_db: f64,
    /// Where light is not the airframe's.
    pub ignored: IgnoredRegion,
    /// Parameters of the methods.
    pub parameters: Parameters,
}

impl Default for Generate {
    fn default() -> Self {
        Generate {
            exposure_us: 5000.0,
            gain_db: 0.0,
            ignored: IgnoredRegion::default(),
            parameters: Parameters::default(),
        }
    }
}

/// `mask_mode`
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum MaskMode {
    /// What is masked is black in every frame.
    #[default]
    Blank,
    /// Frames are left as they are, and the mask travels beside them.
    Attach,
}

/// `mask`
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum MaskChoice {
    /// Written out: fly without a mask.
    None,
    /// The mask's file, with the configuration's folder resolved.
    File(PathBuf),
}

impl Config {
    /// Reads the file, or the built-in default where there is none.
    ///
    /// # Errors
    /// [`ConfigError`] with file, line, key, what was found and what is allowed.
    pub fn load(file: Option<&Path>) -> Result<Config, ConfigError> {
        match file {
            Some(path) => Config::handed_over(&file::read(path)?, file),
            None => Config::handed_over(DEFAULT.as_bytes(), None),
        }
    }

    /// Reads what [`Config::load`] has read elsewhere.
    ///
    /// # Errors
    /// [`ConfigError`], as [`Config::load`].
    pub fn handed_over(bytes: &[u8], file: Option<&Path>) -> Result<Config, ConfigError> {
        Config::from_bytes(bytes, file.unwrap_or(Path::new("the built-in configuration")))
    }

    /// Reads a configuration from the bytes of its file, as [`Config::parse`] does from its text.
    ///
    /// # Errors
    /// [`ConfigError`], as [`Config::load`].
    pub fn from_bytes(bytes: &[u8], file: &Path) -> Result<Config, ConfigError> {
        Config::parse(file::decode(bytes, file)?, file)
    }

    /// Reads a configuration from its text; `file` gives the folder of relative paths and the name in messages.
    ///
    /// # Errors
    /// [`ConfigError`], as [`Config::load`].
    pub fn parse(text: &str, file: &Path) -> Result<Config, ConfigError> {
        document::parse(text, file)
    }
}

fn digest(text: &str) -> [u8; 16] {
    let mut digest = [0; 16];
    digest.iter_mut().zip(Sha256::digest(text)).for_each(|(kept, byte)| *kept = byte);
    digest
}

// Their texts name every kind of camera.
#[cfg(test)]
#[cfg(all(feature = "aravis", feature = "v4l2"))]
mod tests;
