//! Forces that need no interpreter.

use zivi::{Dependence, Force, HarmonicWall, LinearLaw, OnMovingWall};

use super::compiled::CompiledForce;

/// A force that needs no interpreter.
#[derive(Clone, Copy)]
pub(crate) enum NativeForce {
    Constant(zivi::ConstantForce),
    Linear(zivi::LinearForce),
    Compiled(CompiledForce),
    MovingConstant(OnMovingWall<zivi::ConstantForce, HarmonicWall>),
    MovingLinear(OnMovingWall<zivi::LinearForce, HarmonicWall>),
    MovingCompiled(OnMovingWall<CompiledForce, HarmonicWall>),
}

impl<E> Force<E> for NativeForce {
    fn at(&mut self, t: f64, x: f64, xdot: f64) -> Result<f64, E> {
        match self {
            Self::Constant(force) => force.at(t, x, xdot),
            Self::Linear(force) => force.at(t, x, xdot),
            Self::Compiled(force) => force.at(t, x, xdot),
            Self::MovingConstant(force) => force.at(t, x, xdot),
            Self::MovingLinear(force) => force.at(t, x, xdot),
            Self::MovingCompiled(force) => force.at(t, x, xdot),
        }
    }

    fn dependence(&self) -> Dependence {
        match self {
            Self::Constant(force) => Force::<E>::dependence(force),
            Self::Linear(force) => Force::<E>::dependence(force),
            Self::Compiled(force) => Force::<E>::dependence(force),
            Self::MovingConstant(force) => Force::<E>::dependence(force),
            Self::MovingLinear(force) => Force::<E>::dependence(force),
            Self::MovingCompiled(force) => Force::<E>::dependence(force),
        }
    }

    fn dependence_at_rest(&self) -> Dependence {
        match self {
            Self::Linear(force) => Force::<E>::dependence_at_rest(force),
            other => Force::<E>::dependence(other),
        }
    }

    fn shortest_period(&self) -> Option<f64> {
        match self {
            Self::Constant(force) => Force::<E>::shortest_period(force),
            Self::Linear(force) => Force::<E>::shortest_period(force),
            _ => None,
        }
    }

    fn linear(&self) -> Option<LinearLaw> {
        match self {
            Self::Constant(force) => Force::<E>::linear(force),
            Self::Linear(force) => Force::<E>::linear(force),
            Self::MovingConstant(force) => Force::<E>::linear(force),
            Self::MovingLinear(force) => Force::<E>::linear(force),
            Self::Compiled(_) | Self::MovingCompiled(_) => None,
        }
    }
}
