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
        "/dev/shm has {} MB free, camera \"{camera}\" needs {} MB ({slots} slots): enlarge /dev/shm (sudo mount -o remount,size=... /dev/shm; a container: --shm-size or --ipc=host), or lower max_subscribers, buffer or borrowed",
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
        "camera \"{camera}\" needs {} MB of shared memory that cannot be mapped ({source}): raise the limit of address space (ulimit -v, LimitAS) and, where memory is locked, of locked memory (ulimit -l, LimitMEMLOCK)",
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
        "service \"{0}\" has as many consumers as it can: stop one, or, for frames, raise max_subscribers of the driver"
    )]
    TooManyConsumers(String),
    /// A consumer wants a frame more than it may hold.
    #[error(
        "consumer of camera \"{0}\" holds as many frames as it may: drop one, or raise borrowed of the driver"
    )]
    TooManyHeld(String),
    /// `root_path` belongs to another user.
    #[error(
        "{place} belongs to user {owner}, this program runs as {user}: run driver and consumers as one user (sudo -u {owner} ...), or remove it where nobody uses it (sudo rm -r {place})",
        place = root_path.display()
    )]
    Permission {
        /// Folder of the service files.
        root_path: PathBuf,
        /// Whose it is: a name, or a number without one.
        owner: String,
        /// As whom this program runs.
        user: String,
    },
    /// A file that others find by its name belongs to another user, who could change it at any time.
    #[error("{} belongs to user {owner} and is not used: have it removed (sudo rm {}), or use another prefix", file.display(), file.display())]
    Foreign {
        /// The file.
        file: PathBuf,
        /// Whose it is: a name, or a number without one.
        owner: String,
    },
    /// A folder that is needed is absent, read-only, or closed to this user.
    #[error("{} cannot be written ({source}): {remedy}", place.display())]
    Unwritable {
        /// The folder.
        place: PathBuf,
        /// What mends it.
        remedy: String,
        /// What the system says.
        source: std::io::Error,
    },
    /// Nobody can sign in: the small files that it takes do not fit. To write to shared memory that is not there ends a process with
    /// SIGBUS.
    #[error(
        "/dev/shm is full: {} kB and {free_files} files free, {} kB needed: remove what fills it (ls -lS /dev/shm), or enlarge it (sudo mount -o remount,size=... /dev/shm; a container: --shm-size or --ipc=host)",
        free_bytes / 1000,
        need_bytes.div_ceil(1000)
    )]
    NoRoom {
        /// Bytes needed.
        need_bytes: u64,
        /// Bytes free.
        free_bytes: u64,
        /// Files that can still be made.
        free_files: u64,
    },
    /// A limit of open files leaves too few.
    #[error(
        "at most {limit} files may be open, {open} are, {need} more are needed: raise the limit (ulimit -n {enough}, LimitNOFILE={enough})",
        enough = limit.saturating_add(*need).max(1024)
    )]
    TooFewFiles {
        /// The limit.
        limit: u64,
        /// How many are open.
        open: u64,
        /// How many more are needed.
        need: u64,
    },
    /// A limit of address space leaves too little.
    #[error(
        "{} MB more may be mapped, {} MB are needed: raise the limit of address space (ulimit -v unlimited, LimitAS=infinity)",
        left_bytes / 1_000_000,
        need_bytes.div_ceil(1_000_000)
    )]
    AddressSpace {
        /// Bytes that may still be mapped.
        left_bytes: u64,
        /// Bytes needed.
        need_bytes: u64,
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

impl IpcError {
    /// Whether it may pass by itself: files that others just make or remove come and go, space and limits are given back.
    pub(crate) fn may_pass(&self) -> bool {
        matches!(
            self,
            IpcError::System { .. }
                | IpcError::NoRoom { .. }
                | IpcError::Unwritable { .. }
                | IpcError::TooFewFiles { .. }
                | IpcError::AddressSpace { .. }
        )
    }

    /// Whether it may end when other programs do: a predecessor stops, consumers let go, files are half made or half removed.
    pub(crate) fn ends_with_others(&self) -> bool {
        matches!(
            self,
            IpcError::AlreadyPublishing(_)
                | IpcError::Incompatible { .. }
                | IpcError::TooManyConsumers(_)
                | IpcError::System { .. }
        )
    }
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
