//! How a camera is, as a dict.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use pyo3::prelude::*;
use pyo3::types::PyDict;
use uvcam_shm_ipc::IpcError;
use uvcam_shm_ipc::health::{Health, HealthReader, Latency};

use crate::arguments;
use crate::error;
use crate::frame::hexadecimal;

/// Longest wait without a look for signals.
const NAP: Duration = Duration::from_millis(100);
/// Time between looks for a driver.
const RETRY: Duration = Duration::from_millis(20);

/// Waits at most `timeout` seconds for a driver and its record.
#[pyfunction]
#[pyo3(signature = (camera, *, prefix=None, root_path=None, timeout=2.0))]
pub(crate) fn health<'py>(
    py: Python<'py>,
    camera: &str,
    prefix: Option<String>,
    root_path: Option<PathBuf>,
    timeout: Option<f64>,
) -> PyResult<Option<Bound<'py, PyDict>>> {
    let settings = arguments::settings(prefix, root_path);
    let deadline = arguments::deadline(timeout)?;
    let mut reader = None;
    loop {
        let left = deadline.map_or(NAP, |end| end.saturating_duration_since(Instant::now()));
        let record = py.detach(|| -> Result<Option<Health>, IpcError> {
            if reader.is_none() {
                reader = HealthReader::open(&settings, camera)?;
            }
            match &mut reader {
                Some(reader) => reader.wait(left.min(NAP)),
                None => {
                    std::thread::sleep(left.min(RETRY));
                    Ok(None)
                }
            }
        });
        match record.map_err(|error| error::told(py, &error))? {
            Some(health) => return dict(py, &health).map(Some),
            None if left.is_zero() => return Ok(None),
            None => py.check_signals()?,
        }
    }
}

fn dict<'py>(py: Python<'py>, health: &Health) -> PyResult<Bound<'py, PyDict>> {
    let fields = PyDict::new(py);
    macro_rules! copy { ($($name:ident),+ $(,)?) => { $(fields.set_item(stringify!($name), health.$name)?;)+ } }
    // The reader has let valid codes pass only.
    fields.set_item("state", health.state().map_or("unknown", |state| state.as_str()))?;
    fields.set_item("cause", health.cause().map_or("unknown", |cause| cause.as_str()))?;
    fields.set_item("last_error", health.last_error())?;
    fields.set_item("temperature_c", health.temperature_c())?;
    copy!(written_monotonic_ns, state_since_monotonic_ns, started_monotonic_ns, process_id, frame_rate);
    copy!(published, lost, incomplete, no_free_slot, epochs, failures, resident_bytes, cpu_ns);
    fields.set_item("mask_id", (health.mask_id != [0; 16]).then(|| hexadecimal(&health.mask_id)))?;
    fields.set_item("config_digest", hexadecimal(&health.config_digest))?;
    fields.set_item("arrival_to_masked", latency(py, &health.arrival_to_masked)?)?;
    fields.set_item("masked_to_sent", latency(py, &health.masked_to_sent)?)?;
    Ok(fields)
}

fn latency<'py>(py: Python<'py>, latency: &Latency) -> PyResult<Bound<'py, PyDict>> {
    let fields = PyDict::new(py);
    macro_rules! copy { ($($name:ident),+) => { $(fields.set_item(stringify!($name), latency.$name)?;)+ } }
    copy!(count, p50_ns, p90_ns, p99_ns, p999_ns, max_ns);
    Ok(fields)
}
