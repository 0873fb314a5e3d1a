//! What can go wrong between a driver and its consumers.

use std::error::Error;
use std::path::PathBuf;

use thiserror::Error;

use crate::header::HeaderError;

/// Why shared memory could not be used.
#[derive(Debug, Error)]
pub enum IpcError {
    /// A camera name that cannot be part of a service name.
    #[error("camera name \"{0}\": use 1 to 64 letters, digits, \"_\" or \"-\"")]
    CameraName(String),
    /// A setting outside its limits.
    #[error("{key} = {found}: use {allowed}")]
    Setting {
        /// Name of the setting.
        key: &'static str,
        /// What was given.
        found: String,
        /// What can be given.
        allowed: &'static str,
    },
    /// The memory of one camera does not fit. To write to shared memory that is not there ends a process with SIGBUS.
    #[error(
        "/dev/shm has {} MB free, camera \"{camera}\" needs {} MB ({slots} slots): enlarge /dev/shm, or lower max_subscribers, buffer or borrowed",
        free_bytes / 1_000_000,
        need_bytes.div_ceil(1_000_000)
    )]
    SharedMemoryFull {
        /// The camera.
        camera: String,
        /// Frames that the memory must hold.
        slots: usize,
        /// Bytes needed.
        need_bytes: u64,
        /// Bytes free.
        free_bytes: u64,
    },
    /// The system does not map the memory of one camera.
    #[error(
        "camera \"{camera}\" needs {} MB of shared memory that cannot be mapped ({source}): where memory is locked, raise its limit (LimitMEMLOCK, ulimit -l)",
        need_bytes.div_ceil(1_000_000)
    )]
    NotMapped {
        /// The camera.
        camera: String,
        /// Bytes needed.
        need_bytes: u64,
        /// What iceoryx2 reported.
        source: Box<dyn Error + Send + Sync>,
    },
    /// Another live process publishes this camera.
    #[error(
        "camera \"{0}\" is published by another running driver: stop that one, or use another camera name or prefix"
    )]
    AlreadyPublishing(String),
    /// The service exists, but was made with other settings or by another version, and somebody holds it.
    #[error(
        "service \"{service}\" is held by running programs and does not fit ({source}): stop its consumers, or use the same settings and version"
    )]
    Incompatible {
        /// Name of the service.
        service: String,
        /// What iceoryx2 reported.
        source: Box<dyn Error + Send + Sync>,
    },
    /// No place for another consumer.
    #[error(
        "service \"{0}\" has as many consumers as it can: stop one, or raise max_subscribers of the driver"
    )]
    TooManyConsumers(String),
    /// A consumer wants a frame more than it may hold.
    #[error(
        "consumer of camera \"{0}\" holds as many frames as it may: drop one, or raise borrowed of the driver"
    )]
    TooManyHeld(String),
    /// The files belong to somebody else.
    #[error("no access to {} or to its shared memory: run driver and consumers as the user who owns it", root_path.display())]
    Permission {
        /// Folder of the service files.
        root_path: PathBuf,
        /// What iceoryx2 reported.
        source: Box<dyn Error + Send + Sync>,
    },
    /// A frame was to be published with a header that does not describe it.
    #[error("frame not published: {0}")]
    Header(#[from] HeaderError),
    /// Anything else that iceoryx2 or the system reports.
    #[error("{doing} {on}: {source}")]
    System {
        /// What was tried.
        doing: &'static str,
        /// On which service or path.
        on: String,
        /// What was reported.
        source: Box<dyn Error + Send + Sync>,
    },
}

/// Why a publisher has no slot to give.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum LoanError {
    /// As many slots are on loan as the publisher was created for.
    #[error("all {0} slots are on loan: publish or drop one")]
    AllOnLoan(usize),
    /// iceoryx2 failed.
    #[error("no slot of shared memory: {0}")]
    Failed(#[source] iceoryx2::port::LoanError),
}
