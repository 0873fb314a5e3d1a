//! What is told in Python: `uvcam.Error`, with a word for its kind and a text that says what mends it.

use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyType;
use uvcam_shm_ipc::IpcError;

/// An error of the Rust crate.
pub(crate) fn told(py: Python<'_>, error: &IpcError) -> PyErr {
    let mut text = error.to_string();
    if matches!(error, IpcError::TooManyHeld(_)) {
        text += ". A frame is held as long as itself, its array or any view of that lives: del them, or keep array.copy()";
    }
    new(py, kind(error), &text)
}

/// A subscriber that was closed.
pub(crate) fn closed(py: Python<'_>, camera: &str) -> PyErr {
    new(py, "closed", &format!("subscriber of camera \"{camera}\" is closed: open another one"))
}

/// A subscriber that another thread waits with.
pub(crate) fn in_use(py: Python<'_>, camera: &str) -> PyErr {
    let text = format!(
        "subscriber of camera \"{camera}\" waits in another thread: open a subscriber for each thread, or wait for the other one"
    );
    new(py, "in_use", &text)
}

/// An object of the process `owner`, which this one was forked from.
pub(crate) fn forked(py: Python<'_>, owner: u32) -> PyErr {
    let text = format!(
        "it belongs to process {owner}, and this is process {}, forked from it: open a subscriber here (with multiprocessing, in the function that the process runs)",
        std::process::id()
    );
    new(py, "forked", &text)
}

fn new(py: Python<'_>, kind: &str, text: &str) -> PyErr {
    static ERROR: PyOnceLock<Py<PyType>> = PyOnceLock::new();
    let error = ERROR.import(py, "uvcam.error", "Error").and_then(|class| class.call1((kind, text)));
    error.map_or_else(|failure| failure, PyErr::from_value)
}

fn kind(error: &IpcError) -> &'static str {
    match error {
        IpcError::CameraName(_) => "camera_name",
        IpcError::Setting { .. } => "setting",
        IpcError::SharedMemoryFull { .. } => "shared_memory_full",
        IpcError::NotMapped { .. } => "not_mapped",
        IpcError::AlreadyPublishing(_) => "already_publishing",
        IpcError::Incompatible { .. } => "incompatible",
        IpcError::TooManyConsumers(_) => "too_many_consumers",
        IpcError::TooManyHeld(_) => "too_many_held",
        IpcError::Permission { .. } => "permission",
        IpcError::Foreign { .. } => "foreign",
        IpcError::Unwritable { .. } => "unwritable",
        IpcError::NoRoom { .. } => "no_room",
        IpcError::TooFewFiles { .. } => "too_few_files",
        IpcError::AddressSpace { .. } => "address_space",
        IpcError::Header(_) => "header",
        IpcError::System { .. } => "system",
    }
}
