//! Forces from Python. What kinds there are is said and read here; how each is evaluated is in the
//! files beside this one.

mod any;
mod callable;
mod compiled;
mod native;
pub(crate) mod slopes;
mod wall;

use pyo3::exceptions::PyValueError;
use pyo3::gc::{PyTraverseError, PyVisit};
use pyo3::prelude::*;
use pyo3::types::PyTuple;

pub(crate) use any::{with_force, AnyForce};
pub(crate) use compiled::{force_raised, CompiledForce, Raised};
pub(crate) use native::NativeForce;
pub(crate) use wall::Wall;

/// A force of one of its kinds.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct Force {
    kind: Kind,
}

enum Kind {
    Constant(f64),
    Linear(zivi::LinearForce),
    /// A compiled function, and what owns its code.
    Compiled(CompiledForce, Py<PyAny>),
    /// `f(t, x, xdot)` in the interpreter.
    Callable(Py<PyAny>),
    Parametric(Parametric),
    /// A force of the fixed frame, seen from a wall that moves.
    Moving(Py<Force>, Py<Wall>),
}

/// A force with parameters by which a run can be differentiated.
struct Parametric {
    /// The same for runs without derivatives.
    plain: Py<Force>,
    /// `f(t, x, xdot, *values)`.
    function: Py<PyAny>,
    values: Vec<f64>,
    /// Gives `(f_t, f_x, f_xdot, f_q, ...)`.
    jacobian: Option<Py<PyAny>>,
}

#[pymethods]
impl Force {
    #[staticmethod]
    fn constant(value: f64) -> Self {
        Self { kind: Kind::Constant(value) }
    }

    #[staticmethod]
    #[pyo3(signature = (*, stiffness, damping, gravity, amplitude, omega, phase))]
    fn linear(
        stiffness: f64,
        damping: f64,
        gravity: f64,
        amplitude: f64,
        omega: f64,
        phase: f64,
    ) -> Self {
        let force = zivi::LinearForce { stiffness, damping, gravity, amplitude, omega, phase };
        Self { kind: Kind::Linear(force) }
    }

    /// A function at an address, called with time, state and the values of its parameters. The
    /// owner of its code lives as long as this.
    #[staticmethod]
    #[pyo3(signature = (address, *, parameters=Vec::new(), owner))]
    fn compiled(address: usize, parameters: Vec<f64>, owner: Py<PyAny>) -> PyResult<Self> {
        let force = CompiledForce::new(address, None, &parameters)?;
        Ok(Self { kind: Kind::Compiled(force, owner) })
    }

    /// The function of a `scipy.LowLevelCallable`, which the error for a wrong signature names.
    #[staticmethod]
    fn low_level(callable: &Bound<'_, PyTuple>, argument: &str) -> PyResult<Self> {
        let force = CompiledForce::of_low_level(callable, argument)?;
        Ok(Self { kind: Kind::Compiled(force, callable.clone().into_any().unbind()) })
    }

    #[staticmethod]
    fn callable(function: Py<PyAny>) -> Self {
        Self { kind: Kind::Callable(function) }
    }

    #[staticmethod]
    #[pyo3(signature = (plain, function, values, jacobian=None))]
    fn parametric(
        plain: Py<Self>,
        function: Py<PyAny>,
        values: Vec<f64>,
        jacobian: Option<Py<PyAny>>,
    ) -> Self {
        Self { kind: Kind::Parametric(Parametric { plain, function, values, jacobian }) }
    }

    #[staticmethod]
    fn above(wall: Py<Wall>, force: Py<Self>) -> PyResult<Self> {
        if matches!(force.get().kind, Kind::Moving(..)) {
            return Err(PyValueError::new_err("a moving wall above a moving wall"));
        }
        Ok(Self { kind: Kind::Moving(force, wall) })
    }

    /// Whether it is one number, whatever time and state are.
    #[getter]
    fn is_constant(&self) -> bool {
        matches!(self.kind, Kind::Constant(_))
    }

    /// Whether a compiled function is called, which may raise what C cannot hand on.
    #[getter]
    fn is_compiled(&self) -> bool {
        self.address().is_some()
    }

    /// Where the compiled function is, if there is one.
    #[getter]
    fn address(&self) -> Option<usize> {
        match &self.kind {
            Kind::Compiled(force, _) => Some(force.address()),
            Kind::Parametric(it) => it.plain.get().address(),
            Kind::Moving(force, _) => force.get().address(),
            _ => None,
        }
    }

    /// Whether runs do without the interpreter.
    #[getter]
    fn is_native(&self) -> bool {
        match &self.kind {
            Kind::Constant(_) | Kind::Linear(_) | Kind::Compiled(..) => true,
            Kind::Callable(_) => false,
            Kind::Parametric(it) => it.plain.get().is_native(),
            Kind::Moving(force, wall) => force.get().is_native() && wall.get().is_native(),
        }
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        match &self.kind {
            Kind::Constant(_) | Kind::Linear(_) => Ok(()),
            Kind::Compiled(_, owner) => visit.call(owner),
            Kind::Callable(function) => visit.call(function),
            Kind::Parametric(Parametric { plain, function, jacobian, .. }) => {
                visit.call(plain)?;
                visit.call(function)?;
                visit.call(jacobian)
            }
            Kind::Moving(force, wall) => {
                visit.call(force)?;
                visit.call(wall)
            }
        }
    }
}
