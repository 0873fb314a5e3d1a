//! What can end a command, and the exit code that goes with it.

use std::path::PathBuf;

use thiserror::Error;
use uvcam_masker::apply::ApplyError;
use uvcam_masker::file::FileError;
use uvcam_masker::generate::GenerateError;
use uvcam_masker::image::ImageError;
use uvcam_shm_ipc::{HeaderError, IpcError, LoanError};

use crate::camera::CameraError;
use crate::config::ConfigError;
use crate::exit::Exit;

/// Why a command, or one camera of a running driver, did not do what was asked.
#[derive(Debug, Error)]
pub enum Error {
    /// The configuration is wrong.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The command line asks for something that cannot be.
    #[error("{0}")]
    Usage(String),
    /// A mask cannot fly.
    #[error("mask refused: {0}")]
    Mask(String),
    /// A mask cannot be read.
    #[error("mask refused")]
    MaskFile(#[source] FileError),
    /// A frame of a file cannot be used.
    #[error("frame refused")]
    Frame(#[source] FileError),
    /// A picture cannot be read or written.
    #[error(transparent)]
    Picture(#[from] FileError),
    /// A mask cannot be computed.
    #[error("no mask generated")]
    Generate(#[from] GenerateError),
    /// The running driver did not do what it was asked.
    #[error("the driver: {cause}")]
    Driver {
        /// The exit code that it gives.
        exit: u8,
        /// Why.
        cause: String,
    },
    /// The camera did not take its flight settings back.
    #[error("flight settings not restored, nothing is published: {0}")]
    NotRestored(String),
    /// A frame and its mask do not fit together.
    #[error("frame not masked, so not published: {0}")]
    Apply(#[from] ApplyError),
    /// A frame is not what its description says.
    #[error("frame not published: {0}")]
    Image(#[from] ImageError),
    /// A camera is absent, refuses a setting, or failed.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// Shared memory cannot be used.
    #[error(transparent)]
    Ipc(#[from] IpcError),
    /// A frame in shared memory is not what the contract says.
    #[error(transparent)]
    Header(#[from] HeaderError),
    /// No slot of shared memory is free.
    #[error(transparent)]
    Loan(#[from] LoanError),
    /// The system refused something.
    #[error("{doing} {}", path.display())]
    System {
        /// What was tried.
        doing: &'static str,
        /// On what.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}

impl Error {
    /// The exit code of a command that ends with this error.
    pub fn exit(&self) -> Exit {
        match self {
            Error::Config(_)
            | Error::Usage(_)
            | Error::Generate(_)
            | Error::Picture(_)
            | Error::System { .. } => Exit::Usage,
            Error::Ipc(IpcError::CameraName(_) | IpcError::Setting { .. }) => Exit::Usage,
            Error::Frame(FileError::NotAFrame { .. }) => Exit::Refused,
            Error::Frame(_) => Exit::Usage,
            Error::Mask(_)
            | Error::MaskFile(_)
            | Error::Apply(_)
            | Error::Image(_)
            | Error::NotRestored(_) => Exit::Refused,
            Error::Camera(error) if error.is_refusal() => Exit::Refused,
            Error::Camera(_) => Exit::Camera,
            Error::Driver { exit, .. } => Exit::from_code(*exit),
            Error::Ipc(_) | Error::Header(_) | Error::Loan(_) => Exit::SharedMemory,
        }
    }

    /// Whether trying again cannot help until someone changes the mask. A camera that refuses a setting may take it after its next reset.
    pub fn is_final(&self) -> bool {
        self.exit() == Exit::Refused && !matches!(self, Error::Camera(_))
    }
}

/// The error's message followed by those of its causes, where it does not already hold them.
pub fn with_causes(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let message = error.to_string();
        if !text.contains(&message) {
            text = format!("{text}: {message}");
        }
        cause = error.source();
    }
    text
}
