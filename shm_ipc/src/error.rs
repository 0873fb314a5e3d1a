//! What can go wrong between a driver and its consumers.

use std::error::Error;
use std::fmt;

use thiserror::Error;

use crate::header::HeaderError;

mod fault;

pub(crate) use fault::Fault;

/// Why shared memory could not be used: what is wrong, where, and what mends it.
///
/// Displayed, it is [`IpcError::message`] with [`IpcError::remedy`]. Programs match on [`IpcError::kind`]; texts are for people and may
/// change. [`Error::source`] is what the system or the library underneath reported, where either did.
#[derive(Debug)]
pub struct IpcError(Box<Fault>);

/// What sort of thing an [`IpcError`] is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum IpcErrorKind {
    /// A camera name that cannot be part of a service name.
    CameraName,
    /// A setting outside its limits: [`SettingError`].
    Setting,
    /// The memory of one camera does not fit in `/dev/shm`.
    SharedMemoryFull,
    /// The system does not map the memory of one camera.
    NotMapped,
    /// Another live process publishes this camera.
    AlreadyPublishing,
    /// The service exists, but was made with other settings, and somebody holds it.
    Incompatible,
    /// The running driver has another version of the contract.
    OtherVersion,
    /// No place for another consumer.
    TooManyConsumers,
    /// A consumer wants a frame or a mask more than it may hold.
    TooManyHeld,
    /// The mask of a frame has not come yet: it does within a second, or with a later frame's.
    MaskPending,
    /// `root_path` belongs to another user.
    Permission,
    /// A file that others find by its name belongs to another user.
    Foreign,
    /// A folder that is needed is absent, read-only, or closed to this user.
    Unwritable,
    /// Nobody can sign in: the small files that it takes do not fit in `/dev/shm`.
    NoRoom,
    /// A limit of open files leaves too few.
    TooFewFiles,
    /// A limit of address space leaves too little.
    AddressSpace,
    /// A frame was to be published with a header that does not describe it: [`HeaderError`].
    Header,
    /// Anything else that the library underneath or the system reports.
    System,
}

/// A setting outside its limits.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{key} = {found}: use {allowed}")]
#[non_exhaustive]
pub struct SettingError {
    /// Name of the setting.
    pub key: &'static str,
    /// What was given.
    pub found: String,
    /// What can be given.
    pub allowed: &'static str,
}

impl SettingError {
    pub(crate) fn new(key: &'static str, found: impl fmt::Display, allowed: &'static str) -> Self {
        SettingError { key, found: found.to_string(), allowed }
    }
}

impl IpcError {
    /// What sort of thing it is, for programs that must tell.
    pub fn kind(&self) -> IpcErrorKind {
        self.0.kind()
    }

    /// What is wrong, and where, without the remedy.
    pub fn message(&self) -> String {
        self.0.to_string()
    }

    /// What mends it; `None` where that is not known.
    pub fn remedy(&self) -> Option<String> {
        self.0.remedy()
    }

    /// Whether it may pass by itself: files that others just make or remove come and go, space and limits are given back.
    pub(crate) fn may_pass(&self) -> bool {
        matches!(
            self.kind(),
            IpcErrorKind::System
                | IpcErrorKind::NoRoom
                | IpcErrorKind::Unwritable
                | IpcErrorKind::TooFewFiles
                | IpcErrorKind::AddressSpace
        )
    }

    /// Whether it may end when other programs do: a predecessor stops, consumers let go, files are half made or half removed.
    pub(crate) fn ends_with_others(&self) -> bool {
        matches!(
            self.kind(),
            IpcErrorKind::AlreadyPublishing
                | IpcErrorKind::Incompatible
                | IpcErrorKind::TooManyConsumers
                | IpcErrorKind::System
        )
    }
}

impl fmt::Display for IpcError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(formatter)?;
        match self.remedy() {
            Some(remedy) => write!(formatter, ": {remedy}"),
            None => Ok(()),
        }
    }
}

impl Error for IpcError {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        self.0.source()
    }
}

impl From<Fault> for IpcError {
    #[cold]
    fn from(fault: Fault) -> Self {
        IpcError(Box::new(fault))
    }
}

impl From<SettingError> for IpcError {
    fn from(error: SettingError) -> Self {
        Fault::Setting(error).into()
    }
}

impl From<HeaderError> for IpcError {
    fn from(error: HeaderError) -> Self {
        Fault::Header(error).into()
    }
}

/// Why a publisher has no slot to give.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum LoanError {
    /// As many slots are on loan as the publisher was created for.
    #[error("all {0} slots are on loan: publish or drop one")]
    AllOnLoan(usize),
    /// The library underneath failed.
    #[error("no slot of shared memory: {0}")]
    Failed(#[source] LoanFailure),
}

/// What the library underneath reported.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error(transparent)]
pub struct LoanFailure(pub(crate) iceoryx2::port::LoanError);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_loan_that_fails_in_the_library_underneath_says_so() {
        // A segment has a slot for each that can be held, so that iceoryx2 has nothing to fail by.
        let text = LoanError::Failed(LoanFailure(iceoryx2::port::LoanError::OutOfMemory)).to_string();
        for word in ["no slot of shared memory", "OutOfMemory"] {
            assert!(text.contains(word), "{word}: {text}");
        }
    }

    #[test]
    fn an_error_is_its_message_and_its_remedy() {
        let error = IpcError::from(Fault::TooFewFiles { limit: 8, open: 5, need: 16 });
        assert_eq!(error.message(), "at most 8 files may be open, 5 are, 16 more are needed");
        assert_eq!(error.remedy().as_deref(), Some("raise the limit (ulimit -n 1024, LimitNOFILE=1024)"));
        assert_eq!(error.to_string(), format!("{}: {}", error.message(), error.remedy().unwrap()));
        assert!(error.source().is_none());
        let source = std::io::Error::from(std::io::ErrorKind::StorageFull);
        let error = IpcError::from(Fault::System { doing: "writing", on: "x".into(), source: source.into() });
        assert_eq!(error.remedy(), None);
        assert_eq!(error.to_string(), format!("writing x: {}", error.source().unwrap()));
        let error = SettingError::new("buffer", 0, "1 to 256 frames");
        assert_eq!(IpcError::from(error.clone()).to_string(), error.to_string());
    }
}
