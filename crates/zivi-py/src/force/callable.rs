//! Forces that are Python callables.

use crate::force::native::AnyNative;
use crate::force::wall::AnyWall;
use crate::interface;
use crate::interface::Function;
use numpy::{PyArray1, PyArrayMethods};
use pyo3::exceptions::{PyException, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::{PyFloat, PyTuple};
use zivi::system::slopes::{DifferentiableForce, Parametrised, Place, Slopes};
use zivi::{Dependence, Force, Force as Evaluated, LinearLaw, OnMovingWall};

/// A Python callable; the interpreter lock is held for the whole run.
pub(crate) struct PythonForce<'py> {
    function: Function<'py>,
    /// The state as an array, if it is passed that way.
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
        interface::look()?;
        value.extract().map_err(|error| no_number(&value, error))
    }

    fn shortest_period(&self) -> Option<f64> {
        (!self.reads_time).then_some(f64::INFINITY)
    }

    fn is_interruption(&self, error: &PyErr) -> bool {
        !error.is_instance_of::<PyException>(self.function.py())
    }
}

// A force of any kind, ready to be evaluated.

/// A force of any kind.
pub(crate) enum AnyForce<'py> {
    Native(AnyNative),
    Callable(PythonForce<'py>),
    /// Any of these above a moving wall, seen from the wall.
    Moving(Box<OnMovingWall<AnyForce<'py>, AnyWall<'py>>>),
}

impl AnyForce<'_> {
    /// The same without the interpreter, unless it is a Python callable.
    pub(crate) fn native(&self) -> Option<AnyNative> {
        match self {
            Self::Native(force) => Some(*force),
            Self::Callable(_) => None,
            Self::Moving(moving) => {
                let AnyWall::Harmonic(wall) = moving.wall else { return None };
                moving.force.native()?.above(wall)
            }
        }
    }
}

impl Parametrised for AnyForce<'_> {}

impl Evaluated<PyErr> for AnyForce<'_> {
    fn at(&mut self, t: f64, x: f64, xdot: f64) -> PyResult<f64> {
        match self {
            Self::Native(force) => force.at(t, x, xdot),
            Self::Callable(force) => force.at(t, x, xdot),
            Self::Moving(force) => force.at(t, x, xdot),
        }
    }

    fn dependence(&self) -> Dependence {
        match self {
            Self::Native(force) => Evaluated::<PyErr>::dependence(force),
            Self::Callable(force) => force.dependence(),
            Self::Moving(force) => force.dependence(),
        }
    }

    fn dependence_at_rest(&self) -> Dependence {
        match self {
            Self::Native(force) => Evaluated::<PyErr>::dependence_at_rest(force),
            Self::Callable(force) => force.dependence_at_rest(),
            Self::Moving(force) => force.dependence_at_rest(),
        }
    }

    fn shortest_period(&self) -> Option<f64> {
        if let Self::Callable(force) = self {
            return force.shortest_period();
        }
        self.native().and_then(|force| Evaluated::<PyErr>::shortest_period(&force))
    }

    fn linear(&self) -> Option<LinearLaw> {
        self.native().and_then(|force| Evaluated::<PyErr>::linear(&force))
    }

    fn is_interruption(&self, error: &PyErr) -> bool {
        // KeyboardInterrupt and SystemExit are no Exceptions
        Python::attach(|py| !error.is_instance_of::<PyException>(py))
    }
}

/// One call for every kind of force without the interpreter, for which the lock is released, and
/// one for all others, whose evaluation costs more than the dispatch.
macro_rules! with_force {
    ($py:expr, $given:expr, |$force:ident| $run:expr) => {{
        let mut any = $given.on($py);
        match any.native() {
            Some(native) => {
                $crate::force::with_native!(native, |$force| $py.detach(|| $run))
            }
            None => {
                let $force = &mut any;
                $run
            }
        }
    }};
}

pub(crate) use with_force;

// Forces of Python callables with parameters.

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
        crate::interface::look()?;
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
