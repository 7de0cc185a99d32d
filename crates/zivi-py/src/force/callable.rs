//! Forces that are Python callables.

use pyo3::exceptions::{PyException, PyTypeError};
use pyo3::prelude::*;
use zivi::Force;

use crate::leaving;

/// A Python callable; the interpreter lock is held for the whole run.
pub(crate) struct PythonForce<'py> {
    callable: Bound<'py, PyAny>,
}

impl<'py> PythonForce<'py> {
    pub(super) fn new(callable: &Bound<'py, PyAny>) -> Self {
        Self { callable: callable.clone() }
    }
}

impl Force<PyErr> for PythonForce<'_> {
    fn at(&mut self, t: f64, x: f64, xdot: f64) -> PyResult<f64> {
        let value = self.callable.call1((t, x, xdot))?;
        leaving::look()?;
        value.extract().map_err(|error| {
            let kind = value.get_type();
            let alone = match value.len() {
                Ok(2) => ": the acceleration alone, not [xdot, acceleration]",
                _ => "",
            };
            let message = format!("force(t, x, xdot) must return a float, got {kind}{alone}");
            let named = PyTypeError::new_err(message);
            named.set_cause(value.py(), Some(error));
            named
        })
    }

    fn is_interruption(&self, error: &PyErr) -> bool {
        !error.is_instance_of::<PyException>(self.callable.py())
    }
}
