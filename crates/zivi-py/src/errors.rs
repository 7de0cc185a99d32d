//! Errors of a set-up, as Python raises them, and what a run raised.

use std::convert::Infallible;
use std::sync::Mutex;

use pyo3::exceptions::{PyMemoryError, PyValueError};
use pyo3::prelude::*;
use zivi::SetupError;

/// The exception that ended a run; the first read takes it. Its traceback knows the frames that know
/// the record: a record that kept it would keep itself.
pub(crate) struct Raised(Mutex<Option<PyErr>>);

impl Raised {
    pub(crate) fn new(error: Option<PyErr>) -> Self {
        Self(Mutex::new(error))
    }
}

impl<'py> IntoPyObject<'py> for &Raised {
    type Target = PyAny;
    type Output = Bound<'py, PyAny>;
    type Error = Infallible;

    fn into_pyobject(self, py: Python<'py>) -> Result<Self::Output, Self::Error> {
        let taken = self.0.lock().ok().and_then(|mut held| held.take());
        Ok(match taken {
            Some(error) => error.into_value(py).into_bound(py).into_any(),
            None => py.None().into_bound(py),
        })
    }
}

pub(crate) fn setup_error(error: SetupError) -> PyErr {
    match error {
        SetupError::Memory(_) | SetupError::BatchMemory { .. } | SetupError::Threads(_) => {
            PyMemoryError::new_err(error.to_string())
        }
        _ => PyValueError::new_err(error.to_string()),
    }
}
