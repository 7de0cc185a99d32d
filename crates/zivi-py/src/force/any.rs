//! A force of any kind, ready to be evaluated.

use pyo3::exceptions::PyException;
use pyo3::prelude::*;
use zivi::system::slopes::Parametrised;
use zivi::{Dependence, Force as Evaluated, LinearLaw, OnMovingWall};

use super::callable::PythonForce;
use super::native::AnyNative;
use super::wall::AnyWall;

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

/// One call for every kind of force without the interpreter, for which the lock is released, and one
/// for all others, which take longer to evaluate than to tell apart.
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
