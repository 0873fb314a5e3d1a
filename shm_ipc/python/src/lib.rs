//! The native part of the Python package `uvcam`, as `uvcam/_uvcam.pyi` describes it.

mod arguments;
mod error;
mod frame;
mod health;
mod mask;
mod process;
mod subscriber;
mod view;

use pyo3::prelude::*;

/// The module.
#[pymodule]
mod _uvcam {
    #[pymodule_export]
    use crate::frame::Frame;
    #[pymodule_export]
    use crate::health::health;
    #[pymodule_export]
    use crate::mask::Mask;
    #[pymodule_export]
    use crate::subscriber::Subscriber;
    #[pymodule_export]
    const CONTRACT_VERSION: u16 = uvcam_shm_ipc::CONTRACT_VERSION;
}
