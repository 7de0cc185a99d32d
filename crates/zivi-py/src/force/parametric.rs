//! Forces of Python callables with parameters.

use pyo3::exceptions::{PyException, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use zivi::system::slopes::{DifferentiableForce, Parametrised, Place, Slopes};
use zivi::Force as Evaluated;

/// `f(t, x, xdot, *values)` in the interpreter.
pub(crate) struct ParametricForce<'py> {
    pub(super) callable: Bound<'py, PyAny>,
    pub(super) values: Vec<f64>,
}

impl ParametricForce<'_> {
    fn call(&self, function: &Bound<'_, PyAny>, at: Place) -> PyResult<Py<PyAny>> {
        let all: Vec<f64> = [at.t, at.x, at.xdot].iter().chain(&self.values).copied().collect();
        let arguments = PyTuple::new(function.py(), all)?;
        let value = function.call1(arguments)?;
        crate::leaving::look()?;
        Ok(value.unbind())
    }
}

impl Parametrised for ParametricForce<'_> {
    fn values(&mut self) -> &mut [f64] {
        &mut self.values
    }
}

impl Evaluated<PyErr> for ParametricForce<'_> {
    fn at(&mut self, t: f64, x: f64, xdot: f64) -> PyResult<f64> {
        let value = self.call(&self.callable, Place::new(t, x, xdot))?;
        value.bind(self.callable.py()).extract()
    }

    fn is_interruption(&self, error: &PyErr) -> bool {
        !error.is_instance_of::<PyException>(self.callable.py())
    }
}

/// The same with a function that gives `(f_t, f_x, f_xdot, f_q, ...)`.
pub(crate) struct WithJacobian<'py> {
    pub(super) force: ParametricForce<'py>,
    pub(super) jacobian: Bound<'py, PyAny>,
}

impl Evaluated<PyErr> for WithJacobian<'_> {
    fn at(&mut self, t: f64, x: f64, xdot: f64) -> PyResult<f64> {
        self.force.at(t, x, xdot)
    }

    fn is_interruption(&self, error: &PyErr) -> bool {
        self.force.is_interruption(error)
    }
}

impl DifferentiableForce<PyErr> for WithJacobian<'_> {
    fn parameters(&self) -> usize {
        self.force.values.len()
    }

    fn slopes(&mut self, at: Place, _: bool, by: &[usize], out: &mut [f64]) -> PyResult<Slopes> {
        let result = self.force.call(&self.jacobian, at)?;
        let all: Vec<f64> = result.bind(self.jacobian.py()).extract()?;
        let n = 3 + self.force.values.len();
        if all.len() != n {
            return Err(PyTypeError::new_err(format!(
                "jacobian must return {n} numbers (f_t, f_x, f_xdot and one for each parameter), \
                 got {}",
                all.len()
            )));
        }
        for (out, &index) in out.iter_mut().zip(by) {
            *out = all[3 + index];
        }
        Ok(Slopes { t: all[0], x: all[1], xdot: all[2] })
    }
}
