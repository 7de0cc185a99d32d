//! Forces that are Python callables.

use numpy::{PyArray1, PyArrayMethods};
use pyo3::exceptions::{PyException, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::PyFloat;
use zivi::Force;

use crate::leaving;
use crate::vectorcall::Function;

/// A Python callable; the interpreter lock is held for the whole run.
pub(crate) struct PythonForce<'py> {
    function: Function<'py>,
    /// Where the state is, if it is handed on as an array.
    state: Option<Bound<'py, PyArray1<f64>>>,
    reads_time: bool,
}

impl<'py> PythonForce<'py> {
    /// Called with time and state, or with an array of the state if `of_array`.
    pub(super) fn new(callable: Bound<'py, PyAny>, of_array: bool, reads_time: bool) -> Self {
        let state = of_array.then(|| PyArray1::zeros(callable.py(), 2, false));
        Self { function: Function::new(callable), state, reads_time }
    }

    #[inline(always)]
    fn call(&mut self, t: f64, x: f64, xdot: f64) -> PyResult<Bound<'py, PyAny>> {
        let py = self.function.py();
        let t = PyFloat::new(py, t);
        let Some(state) = &mut self.state else {
            let (x, xdot) = (PyFloat::new(py, x), PyFloat::new(py, xdot));
            return self.function.call(&t, &x, Some(&xdot));
        };
        // SAFETY: of an object that is held here
        if unsafe { pyo3::ffi::Py_REFCNT(state.as_ptr()) } > 1 {
            // the function kept it
            *state = PyArray1::zeros(state.py(), 2, false);
        }
        // SAFETY: two numbers in one piece, of which nobody else knows
        unsafe {
            *state.uget_mut(0) = x;
            *state.uget_mut(1) = xdot;
        }
        self.function.call(&t, state, None)
    }
}

/// The error of a function that returned no number.
#[cold]
fn no_number(value: &Bound<'_, PyAny>, error: PyErr) -> PyErr {
    let kind = value.get_type();
    let alone = match value.len() {
        Ok(2) => ": the acceleration alone, not [xdot, acceleration]",
        _ => "",
    };
    let message = format!("force(t, x, xdot) must return a float, got {kind}{alone}");
    let named = PyTypeError::new_err(message);
    named.set_cause(value.py(), Some(error));
    named
}

impl Force<PyErr> for PythonForce<'_> {
    #[inline]
    fn at(&mut self, t: f64, x: f64, xdot: f64) -> PyResult<f64> {
        let value = self.call(t, x, xdot)?;
        leaving::look()?;
        value.extract().map_err(|error| no_number(&value, error))
    }

    fn shortest_period(&self) -> Option<f64> {
        (!self.reads_time).then_some(f64::INFINITY)
    }

    fn is_interruption(&self, error: &PyErr) -> bool {
        !error.is_instance_of::<PyException>(self.function.py())
    }
}
