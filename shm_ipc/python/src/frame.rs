//! A frame.

use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyDict, PyType};
use uvcam_shm_ipc::FrameHeader;

use crate::process::OfProcess;
use crate::view::{unsound, view};

/// One frame, in the memory that the camera wrote.
#[pyclass(frozen, module = "uvcam._uvcam")]
pub(crate) struct Frame {
    /// In a place of its own: a header is aligned to a cache line, and Python aligns objects to 16 bytes.
    frame: OfProcess<Box<uvcam_shm_ipc::Frame>>,
    header: PyOnceLock<Py<PyAny>>,
}

const _: () = assert!(align_of::<Frame>() <= 16);

impl Frame {
    pub(crate) fn new(frame: uvcam_shm_ipc::Frame) -> Self {
        Frame { frame: OfProcess::new(Box::new(frame)), header: PyOnceLock::new() }
    }

    pub(crate) fn get(&self, py: Python<'_>) -> PyResult<&uvcam_shm_ipc::Frame> {
        self.frame.get(py).map(|frame| &**frame)
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
        let frame = slf.get().get(slf.py())?;
        let FrameHeader { width, height, stride, .. } = *frame.header();
        let bytes_per_pixel = frame.header().pixel_format().map_err(unsound)?.bytes_per_pixel();
        let (height, row_bytes) = (height as usize, width as usize * bytes_per_pixel);
        let owner = slf.clone().into_any();
        // SAFETY: view's law: the frame holds its slot until it is dropped, which this object alone does, at its end.
        let bytes = unsafe { view(owner, frame.pixels(), (height, row_bytes), stride as usize) }?;
        match bytes_per_pixel {
            1 => Ok(bytes.into_any()),
            // Numpy counts strides in bytes: rows may begin anywhere.
            _ => bytes.call_method1("view", ("<u2",)),
        }
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
    let mask_id = header.has_mask().then(|| hexadecimal(&header.mask_id));
    fields.set_item("mask_id", mask_id)?;
    Ok(HEADER.import(py, "uvcam.contract", "Header")?.call((), Some(&fields))?.unbind())
}

/// An identity as `uvcam` prints it.
pub(crate) fn hexadecimal(bytes: &[u8; 16]) -> String {
    format!("{:032x}", u128::from_be_bytes(*bytes))
}
