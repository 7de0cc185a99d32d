//! Interface of user forces of any kind.

use crate::force::callable::{AnyForce, ParametricForce, PythonForce, WithJacobian};
use crate::force::native::{AnyNative, NativeSlopes};
use pyo3::exceptions::PyValueError;
use pyo3::gc::{PyTraverseError, PyVisit};
use pyo3::prelude::*;
use zivi::system::slopes::Differenced;
use zivi::{HarmonicWall, OnMovingWall};

/// A kind of force.
pub(super) trait Kind: Send + Sync {
    /// Ready to be evaluated.
    fn on<'py>(&self, py: Python<'py>) -> AnyForce<'py>;

    /// With its partial derivatives, for a span of a duration (s).
    fn slopes<'py>(&self, py: Python<'py>, duration: f64) -> PyResult<AnySlopes<'py>>;

    /// Whether runs do without the interpreter.
    fn is_native(&self) -> bool;

    /// Whether it is one number, whatever time and state are.
    fn is_constant(&self) -> bool {
        false
    }

    /// Address of the compiled function, if any.
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

/// A force that needs no interpreter, and the owner of its code, if any.
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

/// A Python function.
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

// A force of any kind with its partial derivatives.

/// A force whose partial derivatives are known, or taken by differences.
pub(crate) enum AnySlopes<'py> {
    Native(NativeSlopes),
    Parametric(Differenced<ParametricForce<'py>>),
    Jacobian(WithJacobian<'py>),
    MovingParametric(OnMovingWall<Differenced<ParametricForce<'py>>, HarmonicWall>),
    MovingJacobian(OnMovingWall<WithJacobian<'py>, HarmonicWall>),
    MovingCallable(OnMovingWall<Differenced<AnyForce<'py>>, HarmonicWall>),
    /// A force without parameters of its own.
    Other(Differenced<AnyForce<'py>>),
}

impl AnySlopes<'_> {
    /// The same seen from a wall that vibrates.
    pub(super) fn above(self, wall: HarmonicWall) -> PyResult<Self> {
        let above = match self {
            Self::Native(force) => force.above(wall).map(Self::Native),
            Self::Parametric(force) => Some(Self::MovingParametric(OnMovingWall { force, wall })),
            Self::Jacobian(force) => Some(Self::MovingJacobian(OnMovingWall { force, wall })),
            Self::Other(force) => Some(Self::MovingCallable(OnMovingWall { force, wall })),
            _ => None,
        };
        above.ok_or_else(|| PyValueError::new_err("a moving wall above a moving wall"))
    }
}

/// One call for every kind of force; the lock is released where no interpreter is needed.
macro_rules! with_slopes {
    ($py:expr, $given:expr, $duration:expr, |$force:ident| $run:expr) => {{
        use $crate::force::kind::AnySlopes as Spec;
        macro_rules! interpreted {
            ($one:ident) => {{
                let $force = &mut $one;
                $run
            }};
        }
        match $given.slopes($py, $duration)? {
            Spec::Native(given) => {
                $crate::force::with_native_slopes!(given, |$force| $py.detach(|| $run))
            }
            Spec::Parametric(mut given) => interpreted!(given),
            Spec::Jacobian(mut given) => interpreted!(given),
            Spec::MovingParametric(mut given) => interpreted!(given),
            Spec::MovingJacobian(mut given) => interpreted!(given),
            Spec::MovingCallable(mut given) => interpreted!(given),
            Spec::Other(mut given) => interpreted!(given),
        }
    }};
}

pub(crate) use with_slopes;
