//! What is told in Python: `uvcam.Error`, with a word for its kind and a text that says what mends it.

use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyType;
use uvcam_shm_ipc::{IpcError, IpcErrorKind};

/// An error of the Rust crate.
pub(crate) fn told(py: Python<'_>, error: &IpcError) -> PyErr {
    let mut remedy = error.remedy();
    // What Rust drops by itself is held by arrays here.
    if error.kind() == IpcErrorKind::TooManyHeld {
        let arrays = "one is held as long as itself, its array or a view of that lives: del them, or keep array.copy()";
        remedy = remedy.map(|remedy| format!("{remedy}; {arrays}"));
    }
    new(py, kind(error.kind()), &error.message(), remedy.as_deref())
}

/// A subscriber that was closed.
pub(crate) fn closed(py: Python<'_>, camera: &str) -> PyErr {
    new(py, "closed", &format!("subscriber of camera \"{camera}\" is closed"), Some("open another one"))
}

/// A subscriber that another thread uses.
pub(crate) fn in_use(py: Python<'_>, camera: &str) -> PyErr {
    let text = format!("subscriber of camera \"{camera}\" is waiting in another thread");
    new(py, "in_use", &text, Some("open a subscriber for each thread"))
}

/// An object of the process `owner`, which this one was forked from.
pub(crate) fn forked(py: Python<'_>, owner: u32) -> PyErr {
    let here = std::process::id();
    let text = format!("what process {owner} opened cannot be used in {here}, which was forked from it");
    new(py, "forked", &text, Some("open a subscriber in each process, after the fork"))
}

fn new(py: Python<'_>, kind: &str, message: &str, remedy: Option<&str>) -> PyErr {
    static ERROR: PyOnceLock<Py<PyType>> = PyOnceLock::new();
    let error =
        ERROR.import(py, "uvcam.error", "Error").and_then(|class| class.call1((kind, message, remedy)));
    error.map_or_else(|failure| failure, PyErr::from_value)
}

fn kind(kind: IpcErrorKind) -> &'static str {
    match kind {
        IpcErrorKind::CameraName => "camera_name",
        IpcErrorKind::Setting => "setting",
        IpcErrorKind::SharedMemoryFull => "shared_memory_full",
        IpcErrorKind::NotMapped => "not_mapped",
        IpcErrorKind::AlreadyPublishing => "already_publishing",
        IpcErrorKind::Incompatible => "incompatible",
        IpcErrorKind::OtherVersion => "other_version",
        IpcErrorKind::TooManyConsumers => "too_many_consumers",
        IpcErrorKind::TooManyHeld => "too_many_held",
        IpcErrorKind::MaskPending => "mask_pending",
        IpcErrorKind::Permission => "permission",
        IpcErrorKind::Foreign => "foreign",
        IpcErrorKind::Unwritable => "unwritable",
        IpcErrorKind::NoRoom => "no_room",
        IpcErrorKind::TooFewFiles => "too_few_files",
        IpcErrorKind::AddressSpace => "address_space",
        IpcErrorKind::Header => "header",
        // And what the crate learns to tell apart before this list does.
        _ => "system",
    }
}
