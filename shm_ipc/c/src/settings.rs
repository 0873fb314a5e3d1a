//! Where a driver is.

use std::ffi::c_char;

use uvcam_shm_ipc::Settings;

use crate::argument;
use crate::error::Failure;

/// Where the driver's services live: `prefix` and `root_path` of the table `[ipc]` of its configuration. A member that is NULL stands for
/// its default.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
#[allow(non_camel_case_types, reason = "its name in C")]
pub struct uvcam_settings {
    /// Start of the name of every file of shared memory: 1 to 32 letters, digits, "_" or "-". Default: "uvcam_".
    pub prefix: *const c_char,
    /// Folder of the service files; absolute. Default: "/tmp/uvcam". A driver that runs as a service has "/run/uvcam".
    pub root_path: *const c_char,
}

/// The settings of a program; NULL stands for the defaults.
///
/// # Safety
/// Law 2, and law 1 for each member.
pub(crate) unsafe fn read(settings: *const uvcam_settings) -> Result<Settings, Failure> {
    let mut read = Settings::default();
    // SAFETY: law 2.
    if let Some(given) = unsafe { settings.as_ref() } {
        // SAFETY: law 1.
        let prefix = unsafe { argument::text(given.prefix, "a prefix") }?;
        // SAFETY: law 1.
        let root_path = unsafe { argument::text(given.root_path, "a root_path") }?;
        if let Some(prefix) = prefix {
            read.prefix = prefix.to_owned();
        }
        if let Some(root_path) = root_path {
            read.root_path = root_path.into();
        }
    }
    Ok(read)
}
