//! Errors of a set-up, as Python raises them.

use pyo3::exceptions::{PyMemoryError, PyValueError};
use pyo3::prelude::*;
use zivi::SetupError;

pub(crate) fn setup_error(error: SetupError) -> PyErr {
    match error {
        SetupError::Memory(_) | SetupError::BatchMemory { .. } | SetupError::Threads(_) => {
            PyMemoryError::new_err(error.to_string())
        }
        _ => PyValueError::new_err(error.to_string()),
    }
}
