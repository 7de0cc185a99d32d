//! What a problem is: a map and its Jacobian, supplied by the caller.

use core::fmt;

use super::dense;

/// The caller could not evaluate `F` or its Jacobian and wants the solver to stop.
///
/// A point where `F` is merely undefined is reported by a value that is not finite instead: the
/// solver then backs off and goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EvaluationError;

impl fmt::Display for EvaluationError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str("the map or its Jacobian could not be evaluated")
    }
}

impl core::error::Error for EvaluationError {}

/// The map `F` of a box VI and its Jacobian.
pub trait Problem {
    /// Writes `F(z)` into `f`.
    ///
    /// # Errors
    /// [`EvaluationError`] stops the solver at once; its best point so far is kept.
    fn map(&mut self, z: &[f64], f: &mut [f64]) -> Result<(), EvaluationError>;

    /// Writes `dF_i/dz_j` into `jacobian[i n + j]`.
    ///
    /// # Errors
    /// [`EvaluationError`] stops the solver at once; its best point so far is kept.
    fn jacobian(&mut self, z: &[f64], jacobian: &mut [f64]) -> Result<(), EvaluationError>;

    /// Called every few dozen pivots and before every factorisation of a descent step, so that
    /// long work between two evaluations can be interrupted.
    ///
    /// # Errors
    /// [`EvaluationError`] stops the solver at once; its best point so far is kept.
    fn poll(&mut self) -> Result<(), EvaluationError> {
        Ok(())
    }
}

/// The affine map `F(z) = M z + q`, `M` row by row.
#[derive(Clone, Copy, Debug)]
pub struct Affine<'a> {
    /// The matrix, `n^2` entries row by row.
    pub matrix: &'a [f64],
    /// The constant term.
    pub q: &'a [f64],
}

impl Problem for Affine<'_> {
    fn map(&mut self, z: &[f64], f: &mut [f64]) -> Result<(), EvaluationError> {
        for ((f, row), q) in f.iter_mut().zip(dense::rows(self.matrix, z.len())).zip(self.q) {
            *f = dense::dot(row, z) + q;
        }
        Ok(())
    }

    fn jacobian(&mut self, _z: &[f64], jacobian: &mut [f64]) -> Result<(), EvaluationError> {
        dense::copy(jacobian, self.matrix);
        Ok(())
    }
}
