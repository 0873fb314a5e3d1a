//! The mask of a frame.

use numpy::ndarray::Array2;
use numpy::{PyArray2, ToPyArray};
use pyo3::prelude::*;

use crate::frame::hexadecimal;
use crate::process::OfProcess;
use crate::view::{unsound, view};

/// A mask that frames name, in the memory that the driver wrote.
#[pyclass(frozen, module = "uvcam._uvcam")]
pub(crate) struct Mask {
    mask: OfProcess<uvcam_shm_ipc::mask::Mask>,
}

const _: () = assert!(align_of::<Mask>() <= 16);

impl Mask {
    pub(crate) fn new(mask: uvcam_shm_ipc::mask::Mask) -> Self {
        Mask { mask: OfProcess::new(mask) }
    }
}

#[pymethods]
impl Mask {
    #[getter]
    fn id(&self, py: Python<'_>) -> PyResult<String> {
        Ok(hexadecimal(&self.mask.get(py)?.id()))
    }

    #[getter]
    fn array<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<u8>>> {
        let mask = slf.get().mask.get(slf.py())?;
        let (width, height) = (mask.width() as usize, mask.height() as usize);
        // SAFETY: view's law: the mask holds its slot until it is dropped, which this object alone does, at its end.
        unsafe { view(slf.clone().into_any(), mask.pixels(), (height, width), width) }
    }

    #[getter]
    fn runs<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let runs = self.mask.get(py)?.runs();
        let numbers = runs.iter().flat_map(|run| [run.row, run.start, run.length]).collect();
        Ok(Array2::from_shape_vec((runs.len(), 3), numbers).map_err(unsound)?.to_pyarray(py))
    }

    #[getter]
    fn masked_px(&self, py: Python<'_>) -> PyResult<u64> {
        Ok(self.mask.get(py)?.masked_px())
    }

    #[getter]
    fn provenance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        py.import("json")?.call_method1("loads", (self.mask.get(py)?.provenance(),))
    }

    fn grown<'py>(&self, py: Python<'py>, pixels: u32) -> PyResult<Bound<'py, PyArray2<u8>>> {
        let mask = self.mask.get(py)?;
        let image = py.detach(|| mask.grown(pixels).to_vec());
        let shape = (mask.height() as usize, mask.width() as usize);
        Ok(Array2::from_shape_vec(shape, image).map_err(unsound)?.to_pyarray(py))
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let mask = self.mask.get(py)?;
        Ok(format!("<uvcam.Mask {}: {}x{}>", hexadecimal(&mask.id()), mask.width(), mask.height()))
    }
}
