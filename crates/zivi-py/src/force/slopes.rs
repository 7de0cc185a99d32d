//! A force of any kind with its partial derivatives.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use zivi::system::slopes::Differenced;
use zivi::{HarmonicWall, OnMovingWall};

use super::any::AnyForce;
use super::native::NativeSlopes;
use super::parametric::{ParametricForce, WithJacobian};

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
        use $crate::force::slopes::AnySlopes as Spec;
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
