//! What a problem is: a map and its Jacobian, supplied by the caller.

use super::dense;
use super::interruption::{EvaluationError, Interruption};
use super::settings::Stage;

/// Where a solve is after one of its iterations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// Iterations so far, of all stages.
    pub iteration: usize,
    /// The scaled natural residual of the iterate.
    pub residual: f64,
    /// The component whose natural map is this large.
    pub worst: usize,
    /// The stage.
    pub stage: Stage,
}

/// The map `F` of a box VI and its Jacobian.
pub trait Problem {
    /// Writes `F(z)` into `f`.
    ///
    /// # Errors
    /// [`EvaluationError`] stops the solver at once; its best point so far is kept.
    fn map(&mut self, z: &[f64], f: &mut [f64]) -> Result<(), EvaluationError>;

    /// Writes `dF_i/dz_j` into `jacobian[i n + j]`. Entries that are not finite (an infinite slope
    /// at a bound) are replaced by difference quotients of `F`.
    ///
    /// # Errors
    /// [`EvaluationError`] stops the solver at once; its best point so far is kept.
    fn jacobian(&mut self, z: &[f64], jacobian: &mut [f64]) -> Result<(), EvaluationError>;

    /// Called before every evaluation, every few dozen pivots and columns of a factorisation, so
    /// that long work can be interrupted.
    ///
    /// # Errors
    /// [`Interruption`] stops the solver at once; its best point so far is kept.
    fn poll(&mut self) -> Result<(), Interruption> {
        Ok(())
    }

    /// Overwrites a `k x k` matrix by its factors, as [`super::factor`] does: for those who are faster
    /// at large ones.
    ///
    /// # Errors
    /// [`Interruption`], as of [`Problem::poll`].
    fn factor(
        &mut self,
        matrix: &mut [f64],
        k: usize,
        permutation: &mut [usize],
    ) -> Result<f64, Interruption> {
        dense::factor(matrix, k, permutation, &mut || self.poll())
    }

    /// Called after every iteration.
    ///
    /// # Errors
    /// [`Interruption`] stops the solver at once; its best point so far is kept.
    fn monitor(&mut self, _progress: &Progress) -> Result<(), Interruption> {
        Ok(())
    }

    /// True when `F` is affine: its values at one point then tell whether a row can be satisfied
    /// anywhere in the box.
    fn is_affine(&self) -> bool {
        false
    }

    /// True when the Jacobian is made of differences of `F`: it costs many evaluations, and is
    /// not exact.
    fn is_differenced(&self) -> bool {
        false
    }

    /// Relative rounding error of `F`: that of the type it is computed in.
    fn rounding(&self) -> f64 {
        f64::EPSILON
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
        if z.iter().all(|z| *z == 0.0) {
            dense::copy(f, self.q); // most starts
            return Ok(());
        }
        for ((f, row), q) in f.iter_mut().zip(dense::rows(self.matrix, z.len())).zip(self.q) {
            *f = dense::dot(row, z) + q;
        }
        Ok(())
    }

    fn jacobian(&mut self, _z: &[f64], jacobian: &mut [f64]) -> Result<(), EvaluationError> {
        dense::copy(jacobian, self.matrix);
        Ok(())
    }

    fn is_affine(&self) -> bool {
        true
    }
}
