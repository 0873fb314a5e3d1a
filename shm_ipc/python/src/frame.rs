//! A frame, and numpy's view of it.
//!
//! Laws of a view:
//! 1. The pixels stay mapped, and at their place, until the received frame is dropped.
//! 2. Nothing drops it before the Python object that owns it goes, and that goes after every array whose base it is.
//! 3. Through a shared reference, a received frame is read and not changed: iceoryx2, whose pointers keep it from being `Sync`, locks what
//!    its frames share.

use numpy::ndarray::{ArrayView2, ShapeBuilder};
use numpy::{PyArray2, PyArrayMethods};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyDict, PyType};
use uvcam_shm_ipc::{Flags, FrameHeader};

use crate::process::OfProcess;

/// One frame, in the memory that the camera wrote.
#[pyclass(frozen, module = "uvcam._uvcam")]
pub(crate) struct Frame {
    frame: OfProcess<Received>,
    header: PyOnceLock<Py<PyAny>>,
}

/// In a place of its own, as a header is aligned to a cache line and Python aligns objects to 16 bytes.
struct Received(Box<uvcam_shm_ipc::Frame>);

const _: () = assert!(align_of::<Frame>() <= 16);

// SAFETY: law 3.
unsafe impl Sync for Received {}

impl Frame {
    pub(crate) fn new(frame: uvcam_shm_ipc::Frame) -> Self {
        Frame { frame: OfProcess::new(Received(Box::new(frame))), header: PyOnceLock::new() }
    }

    fn get(&self, py: Python<'_>) -> PyResult<&uvcam_shm_ipc::Frame> {
        Ok(&self.frame.get(py)?.0)
    }
}

#[pymethods]
impl Frame {
    #[getter]
    fn header(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        let frame = self.get(py)?;
        self.header.get_or_try_init(py, || header(py, frame.header())).map(|header| header.clone_ref(py))
    }

    #[getter]
    fn array<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        view(slf.get().get(slf.py())?, slf.clone().into_any())
    }

    #[getter]
    fn lost_before(&self, py: Python<'_>) -> PyResult<u64> {
        Ok(self.get(py)?.lost_before())
    }

    #[getter]
    fn epoch_changed(&self, py: Python<'_>) -> PyResult<bool> {
        Ok(self.get(py)?.epoch_changed())
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let header = self.get(py)?.header();
        let FrameHeader { width, height, sequence, .. } = *header;
        let format = header.pixel_format().map_err(unsound)?;
        Ok(format!("<uvcam.Frame {sequence}: {width}x{height} {format}>"))
    }
}

/// The pixels of a frame that `owner` owns, read-only.
fn view<'py>(frame: &uvcam_shm_ipc::Frame, owner: Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    let FrameHeader { width, height, stride, .. } = *frame.header();
    let bytes_per_pixel = frame.header().pixel_format().map_err(unsound)?.bytes_per_pixel();
    let shape = (height as usize, width as usize * bytes_per_pixel);
    let pixels =
        ArrayView2::from_shape(shape.strides((stride as usize, 1)), frame.pixels()).map_err(unsound)?;
    // SAFETY: laws 1 and 2.
    let bytes = unsafe { PyArray2::borrow_from_array(&pixels, owner) };
    let bytes = bytes.try_readwrite()?.make_nonwriteable();
    match bytes_per_pixel {
        1 => Ok(bytes.as_any().clone()),
        // Numpy counts strides in bytes: rows may begin anywhere.
        _ => bytes.call_method1("view", ("<u2",)),
    }
}

/// The header as `uvcam.Header`.
fn header(py: Python<'_>, header: &FrameHeader) -> PyResult<Py<PyAny>> {
    static HEADER: PyOnceLock<Py<PyType>> = PyOnceLock::new();
    static FLAGS: PyOnceLock<Py<PyType>> = PyOnceLock::new();
    let fields = PyDict::new(py);
    macro_rules! copy { ($($name:ident),+ $(,)?) => { $(fields.set_item(stringify!($name), header.$name)?;)+ } }
    copy!(width, height, stride, exposure_us, gain_db, epoch, sequence, device_frame_id, counting, produced);
    copy!(frame_period_ns, device_timestamp_ns, arrival_monotonic_ns, send_monotonic_ns);
    copy!(mid_exposure_monotonic_ns, mid_exposure_realtime_ns, mid_exposure_uncertainty_ns);
    fields.set_item("pixel_format", header.pixel_format().map_err(unsound)?.name())?;
    fields.set_item("flags", FLAGS.import(py, "uvcam.contract", "Flags")?.call1((header.flags.bits(),))?)?;
    let mask_id = header.flags.contains(Flags::MASKED).then(|| hexadecimal(&header.mask_id));
    fields.set_item("mask_id", mask_id)?;
    Ok(HEADER.import(py, "uvcam.contract", "Header")?.call((), Some(&fields))?.unbind())
}

/// An identity as `uvcam` prints it.
pub(crate) fn hexadecimal(bytes: &[u8; 16]) -> String {
    format!("{:032x}", u128::from_be_bytes(*bytes))
}

/// A header was checked before its frame came here.
fn unsound(error: impl std::fmt::Display) -> PyErr {
    PyRuntimeError::new_err(format!("a checked header does not fit its frame: {error}"))
}
