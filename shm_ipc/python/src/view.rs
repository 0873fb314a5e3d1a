//! Numpy's view of memory that others keep.
//!
//! Law of a view: who owns the memory keeps it mapped, at its place and unchanged for as long as it lives, and lives as long as every array
//! whose base it is.

use std::fmt::Display;

use numpy::ndarray::{ArrayView2, ShapeBuilder};
use numpy::{PyArray2, PyArrayMethods};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

/// Rows of bytes, `stride` bytes apart, as a read-only array of this shape (rows, bytes of a row).
///
/// # Safety
/// `owner` owns `bytes`, under the law of this file.
pub(crate) unsafe fn view<'py>(
    owner: Bound<'py, PyAny>,
    bytes: &[u8],
    shape: (usize, usize),
    stride: usize,
) -> PyResult<Bound<'py, PyArray2<u8>>> {
    let rows = ArrayView2::from_shape(shape.strides((stride, 1)), bytes).map_err(unsound)?;
    // SAFETY: the law of this file.
    let array = unsafe { PyArray2::borrow_from_array(&rows, owner) };
    Ok((*array.try_readwrite()?.make_nonwriteable()).clone())
}

/// What was checked before it came here.
pub(crate) fn unsound(error: impl Display) -> PyErr {
    PyRuntimeError::new_err(format!("a checked header does not fit its pixels: {error}"))
}
