//! A force of any kind, ready to be evaluated.

use pyo3::exceptions::PyException;
use pyo3::prelude::*;
use zivi::system::slopes::Parametrised;
use zivi::{Dependence, Force as Evaluated, LinearLaw, OnMovingWall};

use super::callable::PythonForce;
use super::compiled::CompiledForce;
use super::native::NativeForce;
use super::wall::AnyWall;
use super::{Force, Kind};

/// A force of any kind.
pub(crate) enum AnyForce<'py> {
    Constant(f64),
    Linear(zivi::LinearForce),
    Compiled(CompiledForce),
    Callable(PythonForce<'py>),
    /// Any of these above a moving wall, seen from the wall.
    Moving(Box<OnMovingWall<AnyForce<'py>, AnyWall<'py>>>),
}

impl<'py> AnyForce<'py> {
    pub(crate) fn of(py: Python<'py>, force: &Force) -> Self {
        match &force.kind {
            Kind::Constant(value) => Self::Constant(*value),
            Kind::Linear(linear) => Self::Linear(*linear),
            Kind::Compiled(compiled, _) => Self::Compiled(compiled.listening()),
            Kind::Callable(callable) => Self::Callable(PythonForce::new(callable.bind(py))),
            Kind::Parametric(it) => Self::of(py, it.plain.get()),
            Kind::Moving(force, wall) => {
                let (force, wall) = (Self::of(py, force.get()), AnyWall::of(py, wall.get()));
                Self::Moving(Box::new(OnMovingWall { force, wall }))
            }
        }
    }

    /// The same without the interpreter, unless it is a Python callable.
    pub(crate) fn native(&self) -> Option<NativeForce> {
        match self {
            Self::Constant(value) => Some(NativeForce::Constant(zivi::ConstantForce(*value))),
            Self::Linear(linear) => Some(NativeForce::Linear(*linear)),
            Self::Compiled(compiled) => Some(NativeForce::Compiled(*compiled)),
            Self::Callable(_) => None,
            Self::Moving(moving) => {
                let AnyWall::Harmonic(wall) = moving.wall else { return None };
                match moving.force.native()? {
                    NativeForce::Constant(force) => {
                        Some(NativeForce::MovingConstant(OnMovingWall { force, wall }))
                    }
                    NativeForce::Linear(force) => {
                        Some(NativeForce::MovingLinear(OnMovingWall { force, wall }))
                    }
                    NativeForce::Compiled(force) => {
                        Some(NativeForce::MovingCompiled(OnMovingWall { force, wall }))
                    }
                    _ => None,
                }
            }
        }
    }
}

impl Parametrised for AnyForce<'_> {}

impl Evaluated<PyErr> for AnyForce<'_> {
    fn at(&mut self, t: f64, x: f64, xdot: f64) -> PyResult<f64> {
        match self {
            Self::Constant(value) => Ok(*value),
            Self::Linear(force) => force.at(t, x, xdot),
            Self::Compiled(force) => force.at(t, x, xdot),
            Self::Callable(force) => force.at(t, x, xdot),
            Self::Moving(force) => force.at(t, x, xdot),
        }
    }

    fn dependence(&self) -> Dependence {
        if let Self::Moving(moving) = self {
            return moving.dependence();
        }
        self.native().map_or(Dependence::State, |force| Evaluated::<PyErr>::dependence(&force))
    }

    fn dependence_at_rest(&self) -> Dependence {
        match self {
            Self::Linear(force) => Evaluated::<PyErr>::dependence_at_rest(force),
            other => other.dependence(),
        }
    }

    fn shortest_period(&self) -> Option<f64> {
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

/// One call for every kind of force, so that each is compiled into its own loop.
macro_rules! with_force {
    ($py:expr, $given:expr, |$force:ident| $run:expr) => {
        match $crate::force::AnyForce::of($py, $given) {
            $crate::force::AnyForce::Constant(value) => {
                let $force = &mut zivi::ConstantForce(value);
                $py.detach(|| $run)
            }
            $crate::force::AnyForce::Linear(mut linear) => {
                let $force = &mut linear;
                $py.detach(|| $run)
            }
            $crate::force::AnyForce::Compiled(mut compiled) => {
                let $force = &mut compiled;
                $py.detach(|| $run)
            }
            $crate::force::AnyForce::Callable(mut callable) => {
                let $force = &mut callable;
                $run
            }
            $crate::force::AnyForce::Moving(moving) => {
                let mut moving = $crate::force::AnyForce::Moving(moving);
                match moving.native() {
                    Some(mut native) => {
                        let $force = &mut native;
                        $py.detach(|| $run)
                    }
                    None => {
                        let $force = &mut moving;
                        $run
                    }
                }
            }
        }
    };
}

pub(crate) use with_force;
