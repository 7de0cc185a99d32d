//! Requirements on a force that needs no interpreter.

use pyo3::prelude::*;
use zivi::system::slopes::DifferentiableForce;
use zivi::Force;

/// A force that needs no interpreter. Its [`Force`] defines evaluation, dependencies and linearity;
/// a line in the list of this folder makes it available to runs, batches and loops, above walls at
/// rest and above vibrating walls.
pub(crate) trait NativeForce: Force<PyErr> + Copy + Send + Sync {
    /// The name of its class in Python and those of its numbers, which are all of its fields there.
    const CLASS: Option<(&'static str, &'static [&'static str])> = None;

    /// The same with its partial derivatives, which include those with respect to its numbers, in
    /// their order.
    type Differentiable: DifferentiableForce<PyErr> + Send;

    /// The force of its numbers, in the order of `CLASS`.
    fn of(_numbers: &[f64]) -> Option<Self> {
        None
    }

    /// Its parameter of this index, which may differ from run to run; otherwise the excess of the
    /// index.
    fn parameter(&mut self, index: usize) -> Result<&mut f64, usize>;

    /// For a span of a duration (s).
    fn differentiable(self, duration: f64) -> Self::Differentiable;

    /// The same for a run that begins now.
    fn listening(self) -> Self {
        self
    }

    /// Address of the compiled function, if any.
    fn address(&self) -> Option<usize> {
        None
    }
}

impl NativeForce for zivi::ConstantForce {
    type Differentiable = Self;

    fn parameter(&mut self, index: usize) -> Result<&mut f64, usize> {
        index.checked_sub(1).map_or(Ok(&mut self.0), Err)
    }

    fn differentiable(self, _: f64) -> Self {
        self
    }
}

impl NativeForce for zivi::LinearForce {
    const CLASS: Option<(&'static str, &'static [&'static str])> =
        Some(("LinearForce", &["stiffness", "damping", "gravity", "amplitude", "omega", "phase"]));

    type Differentiable = Self;

    fn of(numbers: &[f64]) -> Option<Self> {
        let &[stiffness, damping, gravity, amplitude, omega, phase] = numbers else { return None };
        Some(Self { stiffness, damping, gravity, amplitude, omega, phase })
    }

    fn parameter(&mut self, index: usize) -> Result<&mut f64, usize> {
        Ok(match index {
            0 => &mut self.stiffness,
            1 => &mut self.damping,
            2 => &mut self.gravity,
            3 => &mut self.amplitude,
            4 => &mut self.omega,
            5 => &mut self.phase,
            _ => return Err(index - 6),
        })
    }

    fn differentiable(self, _: f64) -> Self {
        self
    }
}

/// Its table is held by the `Force` of Python.
impl NativeForce for zivi::TableForce<'static> {
    type Differentiable = Self;

    fn parameter(&mut self, index: usize) -> Result<&mut f64, usize> {
        self.linear.parameter(index)
    }

    fn differentiable(self, _: f64) -> Self {
        self
    }
}
