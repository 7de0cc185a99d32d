//! Forces from Python with their partial derivatives.

use pyo3::exceptions::{PyException, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use zivi::system::slopes::{Differenced, DifferentiableForce, Parametrised, Place, Slopes};
use zivi::{Force as Evaluated, HarmonicWall, OnMovingWall};

use super::any::AnyForce;
use super::compiled::CompiledForce;
use super::wall::AnyWall;
use super::{Force, Kind};

/// `f(t, x, xdot, *values)` in the interpreter.
pub(crate) struct ParametricForce<'py> {
    callable: Bound<'py, PyAny>,
    values: Vec<f64>,
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
    force: ParametricForce<'py>,
    jacobian: Bound<'py, PyAny>,
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

/// A force whose partial derivatives are known, or taken by differences.
pub(crate) enum AnySlopes<'py> {
    Constant(zivi::ConstantForce),
    Linear(zivi::LinearForce),
    Compiled(Differenced<CompiledForce>),
    MovingConstant(OnMovingWall<zivi::ConstantForce, HarmonicWall>),
    MovingLinear(OnMovingWall<zivi::LinearForce, HarmonicWall>),
    MovingCompiled(OnMovingWall<Differenced<CompiledForce>, HarmonicWall>),
    Parametric(Differenced<ParametricForce<'py>>),
    Jacobian(WithJacobian<'py>),
    MovingParametric(OnMovingWall<Differenced<ParametricForce<'py>>, HarmonicWall>),
    MovingJacobian(OnMovingWall<WithJacobian<'py>, HarmonicWall>),
    MovingCallable(OnMovingWall<Differenced<AnyForce<'py>>, HarmonicWall>),
    /// A force without parameters of its own.
    Other(Differenced<AnyForce<'py>>),
}

impl<'py> AnySlopes<'py> {
    /// For a span that is so long.
    pub(crate) fn of(py: Python<'py>, force: &Force, duration: f64) -> PyResult<Self> {
        Ok(match &force.kind {
            Kind::Constant(value) => Self::Constant(zivi::ConstantForce(*value)),
            Kind::Linear(force) => Self::Linear(*force),
            Kind::Compiled(force, _) => {
                Self::Compiled(Differenced::new(force.listening(), duration))
            }
            Kind::Callable(_) => Self::Other(Differenced::new(AnyForce::of(py, force), duration)),
            Kind::Parametric(it) => match (&it.plain.get().kind, &it.jacobian) {
                (Kind::Compiled(..), None) => Self::of(py, it.plain.get(), duration)?,
                (_, jacobian) => {
                    let callable = it.function.bind(py).clone();
                    let force = ParametricForce { callable, values: it.values.clone() };
                    match jacobian {
                        None => Self::Parametric(Differenced::new(force, duration)),
                        Some(jacobian) => {
                            let jacobian = jacobian.bind(py).clone();
                            Self::Jacobian(WithJacobian { force, jacobian })
                        }
                    }
                }
            },
            Kind::Moving(inner, wall) => {
                let AnyWall::Harmonic(wall) = AnyWall::of(py, wall.get()) else {
                    let force = AnyForce::of(py, force);
                    return Ok(Self::Other(Differenced::new(force, duration)));
                };
                Self::of(py, inner.get(), duration)?.above(wall)?
            }
        })
    }

    fn above(self, wall: HarmonicWall) -> PyResult<Self> {
        Ok(match self {
            Self::Constant(force) => Self::MovingConstant(OnMovingWall { force, wall }),
            Self::Linear(force) => Self::MovingLinear(OnMovingWall { force, wall }),
            Self::Compiled(force) => Self::MovingCompiled(OnMovingWall { force, wall }),
            Self::Parametric(force) => Self::MovingParametric(OnMovingWall { force, wall }),
            Self::Jacobian(force) => Self::MovingJacobian(OnMovingWall { force, wall }),
            Self::Other(force) => Self::MovingCallable(OnMovingWall { force, wall }),
            _ => return Err(PyValueError::new_err("a moving wall above a moving wall")),
        })
    }
}

/// One call for every kind of force; the lock is released where no interpreter is needed.
macro_rules! with_slopes {
    ($py:expr, $given:expr, $duration:expr, |$force:ident| $run:expr) => {{
        use $crate::force::slopes::AnySlopes as Spec;
        macro_rules! native {
            ($one:ident) => {{
                let $force = &mut $one;
                $py.detach(|| $run)
            }};
        }
        macro_rules! interpreted {
            ($one:ident) => {{
                let $force = &mut $one;
                $run
            }};
        }
        match Spec::of($py, $given, $duration)? {
            Spec::Constant(mut given) => native!(given),
            Spec::Linear(mut given) => native!(given),
            Spec::Compiled(mut given) => native!(given),
            Spec::MovingConstant(mut given) => native!(given),
            Spec::MovingLinear(mut given) => native!(given),
            Spec::MovingCompiled(mut given) => native!(given),
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
