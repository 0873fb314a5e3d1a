//! What callers give, checked.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use uvcam_shm_ipc::{Settings, Wakeup};

/// The settings with this address. The numbers are the driver's.
pub(crate) fn settings(prefix: Option<String>, root_path: Option<PathBuf>) -> Settings {
    let mut settings = Settings::default();
    settings.prefix = prefix.unwrap_or(settings.prefix);
    settings.root_path = root_path.unwrap_or(settings.root_path);
    settings
}

/// The way to wait of this name.
pub(crate) fn wakeup(name: &str) -> PyResult<Wakeup> {
    match name {
        "futex" => Ok(Wakeup::Futex),
        "predictive" => Ok(Wakeup::Predictive),
        "event" => Ok(Wakeup::Event),
        _ => Err(PyValueError::new_err(format!(
            "wakeup = \"{name}\": use \"futex\", \"predictive\" or \"event\""
        ))),
    }
}

/// When a wait ends; `None` where it has no end.
pub(crate) fn deadline(timeout: Option<f64>) -> PyResult<Option<Instant>> {
    let Some(seconds) = timeout else { return Ok(None) };
    let timeout = Duration::try_from_secs_f64(seconds).map_err(|_| {
        PyValueError::new_err(format!(
            "timeout = {seconds}: use seconds from 0 on, or None to wait without end"
        ))
    })?;
    // Later than any clock tells is never.
    Ok(Instant::now().checked_add(timeout))
}
