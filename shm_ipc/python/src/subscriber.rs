//! A consumer's end.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use pyo3::prelude::*;

use crate::arguments;
use crate::error;
use crate::frame::Frame;
use crate::mask::Mask;
use crate::process::OfProcess;

/// Longest wait without a look for signals and for `close`.
const NAP: Duration = Duration::from_millis(100);

/// Reads the frames of one camera.
#[pyclass(frozen, subclass, module = "uvcam._uvcam")]
pub(crate) struct Subscriber {
    camera: String,
    end: OfProcess<End>,
}

const _: () = assert!(align_of::<Subscriber>() <= 16);

/// What a thread that waits holds locked, and what others may use meanwhile.
struct End {
    /// `None` once it is closed.
    subscriber: Mutex<Option<uvcam_shm_ipc::Subscriber>>,
    /// Relaxed: it carries no data, and is seen within one `NAP`.
    is_closed: AtomicBool,
    seen: Mutex<Seen>,
}

/// What the subscriber said when it was last used.
#[derive(Clone, Copy, Default)]
struct Seen {
    frames: u64,
    lost: u64,
    epochs: u64,
    rejected: u64,
    is_connected: bool,
}

#[pymethods]
impl Subscriber {
    #[new]
    #[pyo3(signature = (camera, *, prefix=None, root_path=None, wakeup="futex"))]
    fn new(
        py: Python<'_>,
        camera: String,
        prefix: Option<String>,
        root_path: Option<PathBuf>,
        wakeup: &str,
    ) -> PyResult<Self> {
        let settings = arguments::settings(prefix, root_path);
        let wakeup = arguments::wakeup(wakeup)?;
        let opened = py.detach(|| uvcam_shm_ipc::Subscriber::open(&settings, &camera));
        let mut subscriber = opened.map_err(|error| error::told(py, &error))?;
        subscriber.set_wakeup(wakeup);
        let end = End {
            seen: Mutex::new(Seen::of(&subscriber)),
            subscriber: Mutex::new(Some(subscriber)),
            is_closed: AtomicBool::new(false),
        };
        Ok(Subscriber { camera, end: OfProcess::new(end) })
    }

    fn receive(&self, py: Python<'_>) -> PyResult<Option<Frame>> {
        self.with(py, |subscriber| receive(py, subscriber))
    }

    fn receive_latest(&self, py: Python<'_>) -> PyResult<Option<Frame>> {
        self.with(py, |subscriber| {
            Ok(subscriber.receive_latest().map_err(|error| error::told(py, &error))?.map(Frame::new))
        })
    }

    fn mask_of(&self, py: Python<'_>, frame: &Frame) -> PyResult<Option<Mask>> {
        let frame = frame.get(py)?;
        self.with(py, |subscriber| {
            Ok(subscriber.mask_of(frame).map_err(|error| error::told(py, &error))?.map(Mask::new))
        })
    }

    #[pyo3(signature = (timeout=None))]
    fn wait(&self, py: Python<'_>, timeout: Option<f64>) -> PyResult<bool> {
        let deadline = arguments::deadline(timeout)?;
        self.with(py, |subscriber| self.wait_until(py, subscriber, deadline))
    }

    fn close(&self, py: Python<'_>) -> PyResult<()> {
        let end = self.end.get(py)?;
        end.is_closed.store(true, Ordering::Relaxed);
        // A thread that waits lets go of it by itself.
        if let Some(mut subscriber) = end.lock() {
            let gone = subscriber.take();
            py.detach(|| drop(gone));
        }
        Ok(())
    }

    #[getter]
    fn camera(&self) -> &str {
        &self.camera
    }

    #[getter]
    fn frames(&self, py: Python<'_>) -> PyResult<u64> {
        Ok(self.seen(py)?.frames)
    }

    #[getter]
    fn lost(&self, py: Python<'_>) -> PyResult<u64> {
        Ok(self.seen(py)?.lost)
    }

    #[getter]
    fn epochs(&self, py: Python<'_>) -> PyResult<u64> {
        Ok(self.seen(py)?.epochs)
    }

    #[getter]
    fn rejected(&self, py: Python<'_>) -> PyResult<u64> {
        Ok(self.seen(py)?.rejected)
    }

    #[getter]
    fn is_connected(&self, py: Python<'_>) -> PyResult<bool> {
        Ok(self.seen(py)?.is_connected)
    }

    #[getter]
    fn is_closed(&self, py: Python<'_>) -> PyResult<bool> {
        Ok(self.end.get(py)?.is_closed())
    }

    fn __iter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<Frame>> {
        let end = self.end.get(py)?;
        if end.is_closed() {
            return Ok(None);
        }
        self.with(py, |subscriber| {
            loop {
                match receive(py, subscriber)? {
                    None if end.is_closed() => return Ok(None),
                    None => self.wait_until(py, subscriber, None)?,
                    frame => return Ok(frame),
                };
            }
        })
    }
}

impl Subscriber {
    /// Uses the subscriber, which no other thread may use meanwhile.
    fn with<T>(
        &self,
        py: Python<'_>,
        act: impl FnOnce(&mut uvcam_shm_ipc::Subscriber) -> PyResult<T>,
    ) -> PyResult<T> {
        let end = self.end.get(py)?;
        let Some(mut held) = end.lock() else { return Err(error::in_use(py, &self.camera)) };
        let Some(subscriber) = &mut *held else { return Err(error::closed(py, &self.camera)) };
        let outcome = act(subscriber);
        *end.seen.lock().unwrap_or_else(PoisonError::into_inner) = Seen::of(subscriber);
        if end.is_closed() {
            let gone = held.take();
            py.detach(|| drop(gone));
        }
        outcome
    }

    /// Waits until a frame is there, the subscriber is closed, or it is time. Returns whether there is one.
    fn wait_until(
        &self,
        py: Python<'_>,
        subscriber: &mut uvcam_shm_ipc::Subscriber,
        deadline: Option<Instant>,
    ) -> PyResult<bool> {
        let end = self.end.get(py)?;
        loop {
            let left = deadline.map_or(NAP, |deadline| deadline.saturating_duration_since(Instant::now()));
            let is_there = py.detach(|| subscriber.wait(left.min(NAP)));
            let is_there = is_there.map_err(|error| error::told(py, &error))?;
            if is_there || left.is_zero() || end.is_closed() {
                return Ok(is_there);
            }
            py.check_signals()?;
        }
    }

    fn seen(&self, py: Python<'_>) -> PyResult<Seen> {
        Ok(*self.end.get(py)?.seen.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl End {
    /// The subscriber, where no other thread uses it.
    fn lock(&self) -> Option<MutexGuard<'_, Option<uvcam_shm_ipc::Subscriber>>> {
        self.subscriber.try_lock().ok()
    }

    fn is_closed(&self) -> bool {
        self.is_closed.load(Ordering::Relaxed)
    }
}

impl Seen {
    fn of(subscriber: &uvcam_shm_ipc::Subscriber) -> Self {
        Seen {
            frames: subscriber.frames(),
            lost: subscriber.lost(),
            epochs: subscriber.epochs(),
            rejected: subscriber.rejected(),
            is_connected: subscriber.is_connected(),
        }
    }
}

fn receive(py: Python<'_>, subscriber: &mut uvcam_shm_ipc::Subscriber) -> PyResult<Option<Frame>> {
    Ok(subscriber.receive().map_err(|error| error::told(py, &error))?.map(Frame::new))
}
