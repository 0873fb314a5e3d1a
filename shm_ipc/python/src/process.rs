//! What a fork must not share.
//!
//! A forked process has the parent's objects and not its place among iceoryx2's programs: to use or drop them there would give back slots
//! and remove files that are the parent's.

use std::mem::ManuallyDrop;
use std::process;

use pyo3::prelude::*;

use crate::error;

/// A value of the process that made it. In one that was forked from it, it cannot be had, and is left as it is.
pub(crate) struct OfProcess<T> {
    value: ManuallyDrop<T>,
    id: u32,
}

impl<T> OfProcess<T> {
    pub(crate) fn new(value: T) -> Self {
        OfProcess { value: ManuallyDrop::new(value), id: process::id() }
    }

    /// The value.
    ///
    /// # Errors
    /// `uvcam.Error` of kind "forked" in another process.
    pub(crate) fn get(&self, py: Python<'_>) -> PyResult<&T> {
        if self.is_here() { Ok(&self.value) } else { Err(error::forked(py, self.id)) }
    }

    fn is_here(&self) -> bool {
        process::id() == self.id
    }
}

impl<T> Drop for OfProcess<T> {
    fn drop(&mut self) {
        if self.is_here() {
            // SAFETY: nobody uses the value after this, its only drop.
            unsafe { ManuallyDrop::drop(&mut self.value) }
        }
    }
}
