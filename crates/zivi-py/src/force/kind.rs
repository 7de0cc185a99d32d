//! What is requested of a force as it was given, whatever its kind.

use pyo3::gc::{PyTraverseError, PyVisit};
use pyo3::prelude::*;
use zivi::system::slopes::Differenced;

use super::any::AnyForce;
use super::callable::PythonForce;
use super::native::AnyNative;
use super::slopes::AnySlopes;

/// A kind of force.
pub(super) trait Kind: Send + Sync {
    /// Ready to be evaluated.
    fn on<'py>(&self, py: Python<'py>) -> AnyForce<'py>;

    /// With its partial derivatives, for a span that is so long (s).
    fn slopes<'py>(&self, py: Python<'py>, duration: f64) -> PyResult<AnySlopes<'py>>;

    /// Whether runs do without the interpreter.
    fn is_native(&self) -> bool;

    /// Whether it is one number, whatever time and state are.
    fn is_constant(&self) -> bool {
        false
    }

    /// Where the compiled function is, if there is one.
    fn address(&self) -> Option<usize> {
        None
    }

    /// Whether it can be differentiated by parameters without the interpreter.
    fn takes_parameters(&self) -> bool {
        false
    }

    /// Whether it is seen from a wall that moves.
    fn moves(&self) -> bool {
        false
    }

    /// Shows the objects that it holds.
    fn traverse(&self, visit: &PyVisit<'_>) -> Result<(), PyTraverseError>;
}

/// One that needs no interpreter, and what owns its code, if any.
pub(super) struct Native {
    pub(super) force: AnyNative,
    pub(super) owner: Option<Py<PyAny>>,
}

impl Kind for Native {
    fn on<'py>(&self, _: Python<'py>) -> AnyForce<'py> {
        AnyForce::Native(self.force.listening())
    }

    fn slopes<'py>(&self, _: Python<'py>, duration: f64) -> PyResult<AnySlopes<'py>> {
        Ok(AnySlopes::Native(self.force.listening().slopes(duration)))
    }

    fn is_native(&self) -> bool {
        true
    }

    fn is_constant(&self) -> bool {
        matches!(self.force, AnyNative::Constant(_))
    }

    fn address(&self) -> Option<usize> {
        self.force.address()
    }

    fn takes_parameters(&self) -> bool {
        self.force.address().is_some()
    }

    fn traverse(&self, visit: &PyVisit<'_>) -> Result<(), PyTraverseError> {
        visit.call(&self.owner)
    }
}

/// A function in the interpreter, as it was given.
pub(super) struct Callable {
    pub(super) function: Py<PyAny>,
    /// Whether it is `f(t, y)` with `y = [x, xdot]`, else `f(t, x, xdot)`.
    pub(super) of_array: bool,
    /// Whether it may depend on the time.
    pub(super) reads_time: bool,
}

impl Kind for Callable {
    fn on<'py>(&self, py: Python<'py>) -> AnyForce<'py> {
        let function = self.function.bind(py).clone();
        AnyForce::Callable(PythonForce::new(function, self.of_array, self.reads_time))
    }

    fn slopes<'py>(&self, py: Python<'py>, duration: f64) -> PyResult<AnySlopes<'py>> {
        Ok(AnySlopes::Other(Differenced::new(self.on(py), duration)))
    }

    fn is_native(&self) -> bool {
        false
    }

    fn traverse(&self, visit: &PyVisit<'_>) -> Result<(), PyTraverseError> {
        visit.call(&self.function)
    }
}
