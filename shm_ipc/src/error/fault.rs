//! Each thing that can go wrong, with its values, its words and its remedy.

use std::error::Error;
use std::path::PathBuf;

use thiserror::Error;

use super::{IpcErrorKind, SettingError};
use crate::header::{CONTRACT_VERSION, HeaderError};

/// What an [`IpcError`] holds. Its message ends where [`Fault::remedy`] goes on.
#[derive(Debug, Error)]
pub(crate) enum Fault {
    /// A camera name that cannot be part of a service name.
    #[error("camera name \"{0}\"")]
    CameraName(String),
    /// A setting outside its limits.
    #[error("{} = {}", .0.key, .0.found)]
    Setting(SettingError),
    /// The memory of one camera does not fit. To write to shared memory that is not there ends a process with SIGBUS.
    #[error(
        "/dev/shm has {} MB free, camera \"{camera}\" needs {} MB ({slots} slots)",
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
        "camera \"{camera}\" needs {} MB of shared memory that cannot be mapped ({source})",
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
    #[error("camera \"{0}\" is published by another running driver")]
    AlreadyPublishing(String),
    /// The service exists, but was made with other settings or by another version, and somebody holds it.
    #[error("service \"{service}\" is held by running programs and does not fit ({source})")]
    Incompatible {
        /// Name of the service.
        service: String,
        /// What iceoryx2 reported.
        source: Box<dyn Error + Send + Sync>,
    },
    /// The running driver has another version of the contract.
    #[error(
        "camera \"{camera}\" is published under version {found} of the contract, this program has version {CONTRACT_VERSION}"
    )]
    OtherVersion {
        /// The camera.
        camera: String,
        /// The driver's version.
        found: u32,
    },
    /// No place for another consumer.
    #[error("service \"{0}\" has as many consumers as it can")]
    TooManyConsumers(String),
    /// A consumer wants a frame more than it may hold.
    #[error("consumer of camera \"{0}\" holds as many frames as it may")]
    TooManyHeld(String),
    /// A consumer wants a mask more than it may hold.
    #[error("consumer of camera \"{0}\" holds as many masks as it may")]
    TooManyMasks(String),
    /// A consumer asks for a mask that it has not got.
    #[error("mask {} of a frame of camera \"{camera}\" has not come yet", hexadecimal(mask_id))]
    MaskPending {
        /// The camera.
        camera: String,
        /// Identity of the mask.
        mask_id: [u8; 16],
    },
    /// `root_path` belongs to another user.
    #[error("{} belongs to user {owner}, this program runs as {user}", root_path.display())]
    Permission {
        /// Folder of the service files.
        root_path: PathBuf,
        /// Whose it is: a name, or a number without one.
        owner: String,
        /// As whom this program runs.
        user: String,
    },
    /// A file that others find by its name belongs to another user, who could change it at any time.
    #[error("{} belongs to user {owner} and is not used", file.display())]
    Foreign {
        /// The file.
        file: PathBuf,
        /// Whose it is: a name, or a number without one.
        owner: String,
    },
    /// A folder that is needed is absent, read-only, or closed to this user.
    #[error("{} cannot be written ({source})", place.display())]
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
        "/dev/shm is full: {} kB and {free_files} files free, {} kB needed",
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
    #[error("at most {limit} files may be open, {open} are, {need} more are needed")]
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
        "{} MB more may be mapped, {} MB are needed",
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
    Header(#[source] HeaderError),
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

impl Fault {
    /// What mends it.
    pub(super) fn remedy(&self) -> Option<String> {
        let text = match self {
            Fault::CameraName(_) => "use 1 to 64 letters, digits, \"_\" or \"-\"",
            Fault::Setting(error) => return Some(format!("use {}", error.allowed)),
            Fault::SharedMemoryFull { .. } => {
                "enlarge /dev/shm (sudo mount -o remount,size=... /dev/shm; a container: --shm-size or --ipc=host), or lower max_subscribers, buffer or borrowed"
            }
            Fault::NotMapped { .. } => {
                "raise the limit of address space (ulimit -v, LimitAS) and, where memory is locked, of locked memory (ulimit -l, LimitMEMLOCK)"
            }
            Fault::AlreadyPublishing(_) => "stop that one, or use another camera name or prefix",
            Fault::Incompatible { .. } => "stop its consumers, or use the same settings and version",
            Fault::OtherVersion { .. } => "use driver and consumer of one version",
            Fault::TooManyConsumers(_) => "stop one, or, for frames, raise max_subscribers of the driver",
            Fault::TooManyHeld(_) => "drop one, or raise borrowed of the driver",
            Fault::TooManyMasks(_) => "drop one",
            Fault::MaskPending { .. } => "ask again with the next frame",
            Fault::Permission { root_path, owner, .. } => {
                let place = root_path.display();
                return Some(format!(
                    "run driver and consumers as one user (sudo -u {owner} ...), or remove it where nobody uses it (sudo rm -r {place})"
                ));
            }
            Fault::Foreign { file, .. } => {
                return Some(format!("have it removed (sudo rm {}), or use another prefix", file.display()));
            }
            Fault::Unwritable { remedy, .. } => remedy,
            Fault::NoRoom { .. } => {
                "remove what fills it (ls -lS /dev/shm), or enlarge it (sudo mount -o remount,size=... /dev/shm; a container: --shm-size or --ipc=host)"
            }
            Fault::TooFewFiles { limit, need, .. } => {
                let enough = limit.saturating_add(*need).max(1024);
                return Some(format!("raise the limit (ulimit -n {enough}, LimitNOFILE={enough})"));
            }
            Fault::AddressSpace { .. } => {
                "raise the limit of address space (ulimit -v unlimited, LimitAS=infinity)"
            }
            Fault::Header(_) | Fault::System { .. } => return None,
        };
        Some(text.to_owned())
    }

    pub(super) fn kind(&self) -> IpcErrorKind {
        match self {
            Fault::CameraName(_) => IpcErrorKind::CameraName,
            Fault::Setting(_) => IpcErrorKind::Setting,
            Fault::SharedMemoryFull { .. } => IpcErrorKind::SharedMemoryFull,
            Fault::NotMapped { .. } => IpcErrorKind::NotMapped,
            Fault::AlreadyPublishing(_) => IpcErrorKind::AlreadyPublishing,
            Fault::Incompatible { .. } => IpcErrorKind::Incompatible,
            Fault::OtherVersion { .. } => IpcErrorKind::OtherVersion,
            Fault::TooManyConsumers(_) => IpcErrorKind::TooManyConsumers,
            Fault::TooManyHeld(_) | Fault::TooManyMasks(_) => IpcErrorKind::TooManyHeld,
            Fault::MaskPending { .. } => IpcErrorKind::MaskPending,
            Fault::Permission { .. } => IpcErrorKind::Permission,
            Fault::Foreign { .. } => IpcErrorKind::Foreign,
            Fault::Unwritable { .. } => IpcErrorKind::Unwritable,
            Fault::NoRoom { .. } => IpcErrorKind::NoRoom,
            Fault::TooFewFiles { .. } => IpcErrorKind::TooFewFiles,
            Fault::AddressSpace { .. } => IpcErrorKind::AddressSpace,
            Fault::Header(_) => IpcErrorKind::Header,
            Fault::System { .. } => IpcErrorKind::System,
        }
    }
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
