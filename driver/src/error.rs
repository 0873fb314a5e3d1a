//! What can end a command, and the exit code that goes with it.

use std::io::ErrorKind;
use std::path::PathBuf;

use thiserror::Error;
use uvcam_masker::apply::ApplyError;
use uvcam_masker::file::FileError;
use uvcam_masker::generate::GenerateError;
use uvcam_masker::image::ImageError;
use uvcam_shm_ipc::{HeaderError, IpcError, IpcErrorKind, LoanError};

use crate::camera::CameraError;
pub use crate::causes::{panic_text, with_causes};
use crate::config::ConfigError;
use crate::exit::Exit;
use crate::generate::RequestError;

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
    /// A mask was requested that cannot be.
    #[error(transparent)]
    Request(#[from] RequestError),
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
    /// A part of the program panicked.
    #[error("{part} ended by a panic: {cause}; please report it")]
    Panicked {
        /// Which.
        part: &'static str,
        /// What it said.
        cause: String,
    },
    /// What was asked has to wait for something else.
    #[error("{0}")]
    Busy(String),
    /// A signal ended the command.
    #[error("stopped; nothing was stored")]
    Stopped,
}

impl Error {
    /// The exit code of a command that ends with this error. A service manager does not start the driver again after [`Exit::Usage`]: it
    /// is for what stays wrong until a person changes the command line or the configuration, and for nothing that happens in flight.
    pub fn exit(&self) -> Exit {
        match self {
            Error::Config(ConfigError::Unreadable { source, .. })
            | Error::Frame(FileError::Read { source, .. })
                if may_pass(source) =>
            {
                Exit::System
            }
            Error::Config(_) | Error::Usage(_) | Error::Request(_) | Error::Generate(_) => Exit::Usage,
            Error::Ipc(error) if matches!(error.kind(), IpcErrorKind::CameraName | IpcErrorKind::Setting) => {
                Exit::Usage
            }
            Error::Frame(FileError::NotAFrame { .. })
            | Error::Mask(_)
            | Error::MaskFile(_)
            | Error::Apply(_)
            | Error::Image(_)
            | Error::NotRestored(_) => Exit::Refused,
            Error::Camera(error) if error.is_refusal() => Exit::Refused,
            Error::Camera(_) => Exit::Camera,
            Error::Frame(_) => Exit::Usage,
            Error::Driver { exit, .. } => Exit::from_code(*exit),
            Error::Ipc(_) | Error::Header(_) | Error::Loan(_) => Exit::SharedMemory,
            Error::Picture(_)
            | Error::System { .. }
            | Error::Panicked { .. }
            | Error::Busy(_)
            | Error::Stopped => Exit::System,
        }
    }

    /// Whether trying again cannot help until someone changes the mask. A camera that refuses a setting may take it after its next reset.
    pub fn is_final(&self) -> bool {
        self.exit() == Exit::Refused && !matches!(self, Error::Camera(_))
    }
}

/// Whether a file that could not be read may be read the next time, by nobody's doing: its disk or the system's memory failed, rather than
/// its name, rights or content.
fn may_pass(error: &std::io::Error) -> bool {
    !matches!(
        error.kind(),
        ErrorKind::NotFound
            | ErrorKind::PermissionDenied
            | ErrorKind::NotADirectory
            | ErrorKind::IsADirectory
            | ErrorKind::InvalidData
    )
}

#[cfg(test)]
mod tests {
    use std::io;
    use std::path::Path;

    use uvcam_masker::{GrayImage, ImageViewMut, Mask, file};
    use uvcam_shm_ipc::Subscriber;
    use uvcam_shm_ipc::health::HealthPublisher;

    use super::*;
    use crate::camera::CameraError;
    use crate::frame_path::tests::Place;

    fn unreadable(source: impl Into<io::Error>) -> Error {
        ConfigError::Unreadable { file: "uvcam.toml".into(), source: source.into() }.into()
    }

    fn refused_by_the_system(kind: ErrorKind) -> Error {
        Error::System { doing: "starting thread", path: "left".into(), source: kind.into() }
    }

    #[test]
    fn what_a_restart_may_mend_is_never_called_a_wrong_configuration() {
        let picture = || FileError::Write { path: "left.png".into(), source: ErrorKind::StorageFull.into() };
        let panicked = || Error::Panicked { part: "the camera's thread", cause: "index".into() };
        // From linux/errno: input/output error, too many open files.
        for error in [
            refused_by_the_system(ErrorKind::WouldBlock),
            picture().into(),
            panicked(),
            Error::Busy("later".into()),
            Error::Stopped,
            unreadable(io::Error::from_raw_os_error(5)),
            unreadable(io::Error::from_raw_os_error(24)),
        ] {
            assert_eq!(error.exit(), Exit::System, "{error}");
            assert!(!error.is_final(), "{error}");
        }
    }

    #[test]
    fn what_a_person_must_mend_keeps_its_codes() {
        let absent = CameraError::Absent { kind: "replay", wanted: "frames".into(), found: "nothing".into() };
        let place = Place::new();
        let _first = HealthPublisher::create(&place.settings, "left").unwrap();
        let second = HealthPublisher::create_at_once(&place.settings, "left");
        for (error, exit) in [
            (Error::Usage("no such camera".into()), Exit::Usage),
            (unreadable(ErrorKind::NotFound), Exit::Usage),
            (unreadable(ErrorKind::PermissionDenied), Exit::Usage),
            (Subscriber::open(&place.settings, "a/b").unwrap_err().into(), Exit::Usage),
            (Error::Mask("grey".into()), Exit::Refused),
            (Error::NotRestored("gain".into()), Exit::Refused),
            (absent.into(), Exit::Camera),
            (second.map(drop).unwrap_err().into(), Exit::SharedMemory),
        ] {
            assert_eq!(error.exit(), exit, "{error}");
        }
    }

    #[test]
    fn messages_name_what_the_part_and_the_cause() {
        let message = |error: &Error| with_causes(error);
        let said = message(&refused_by_the_system(ErrorKind::WouldBlock));
        assert!(said.starts_with("starting thread left: "), "{said}");
        let said = message(&Error::Panicked { part: "reading the mask", cause: "index 7".into() });
        assert_eq!(said, "reading the mask ended by a panic: index 7; please report it");
        assert_eq!(message(&Error::Busy("wait for it".into())), "wait for it");
        assert_eq!(message(&Error::Stopped), "stopped; nothing was stored");
    }

    #[test]
    fn errors_of_other_rooms_keep_their_words() {
        let nowhere = Path::new("/nowhere/left.png");
        let picture = file::write_gray(nowhere, &GrayImage::new(2, 2), &[]).unwrap_err();
        let mask = Mask::from_fn(2, 2, |_, _| true);
        let mut row = [255; 2];
        let applied = mask.apply(&mut ImageViewMut::new(&mut row, 2, 1, 2, 1).unwrap()).unwrap_err();
        for (error, expected) in [
            (picture.into(), "/nowhere/left.png"),
            (
                Error::MaskFile(Mask::load(nowhere).unwrap_err()),
                "mask refused: cannot read `/nowhere/left.png`",
            ),
            (applied.into(), "frame not masked, so not published: "),
            (LoanError::AllOnLoan(3).into(), "all 3 slots are on loan: publish or drop one"),
        ] {
            let said = with_causes(&error);
            assert!(said.contains(expected), "{said}");
        }
    }

    #[test]
    fn every_code_means_what_it_says_and_an_unknown_one_a_failure() {
        for code in [0, 2, 3, 4, 5, 6, 7] {
            assert_eq!(Exit::from_code(code) as u8, code);
        }
        assert_eq!(Exit::from_code(101), Exit::System);
    }
}
