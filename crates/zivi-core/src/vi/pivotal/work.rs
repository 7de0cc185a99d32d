//! What a path is followed in, and what it costs.

use super::super::dense;
use super::super::interruption::Interruption;
use super::super::natural::natural_residual;

/// What a path has cost.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::vi) struct Effort {
    /// Pivots along the path, bound flips included.
    pub(in crate::vi) pivots: usize,
    /// These and the columns entered into fresh bases, of about the same cost.
    pub(in crate::vi) columns: usize,
}

/// Asks whether to go on.
pub(in crate::vi) type Poll<'a> = dyn FnMut() -> Result<(), Interruption> + 'a;

/// An affine VI on a box, with the matrix `M + shift I`, `M` row by row.
#[derive(Clone, Copy, Debug)]
pub(in crate::vi) struct AffineVi<'a> {
    /// The matrix `M`, `n^2` entries.
    pub(in crate::vi) matrix: &'a [f64],
    /// A multiple of the identity added to it.
    pub(in crate::vi) shift: f64,
    /// The constant term.
    pub(in crate::vi) q: &'a [f64],
    /// Lower bounds.
    pub(in crate::vi) lower: &'a [f64],
    /// Upper bounds.
    pub(in crate::vi) upper: &'a [f64],
}

impl AffineVi<'_> {
    pub(in crate::vi) fn n(&self) -> usize {
        self.q.len()
    }

    pub(in crate::vi) fn bounds(&self, i: usize) -> (f64, f64) {
        (dense::at(self.lower, i), dense::at(self.upper, i))
    }

    pub(in crate::vi) fn is_fixed(&self, i: usize) -> bool {
        let (lower, upper) = self.bounds(i);
        lower == upper
    }

    /// Column `j` of `M + shift I`.
    pub(in crate::vi) fn column(&self, j: usize, out: &mut [f64]) {
        for (out, row) in out.iter_mut().zip(dense::rows(self.matrix, self.n())) {
            *out = dense::at(row, j);
        }
        dense::put(out, j, dense::at(out, j) + self.shift);
    }

    /// `F = (M + shift I) z + q`.
    pub(in crate::vi) fn map(&self, z: &[f64], f: &mut [f64]) {
        dense::multiply(self.matrix, z, f);
        for (f, (z, q)) in f.iter_mut().zip(z.iter().zip(self.q)) {
            *f += self.shift * z + q;
        }
    }

    /// The natural residual at `z`, with `F` left in `f`.
    pub(in crate::vi) fn residual(&self, z: &[f64], f: &mut [f64]) -> f64 {
        self.map(z, f);
        natural_residual(z, f, self.lower, self.upper)
    }
}

/// What the pivotal solver works in: `n^2 + 7 n` reals and `2 n` indices.
#[derive(Debug)]
pub(in crate::vi) struct PivotalWorkspace<'a> {
    pub(in crate::vi) inverse: &'a mut [f64],
    pub(in crate::vi) values: &'a mut [f64],
    pub(in crate::vi) direction: &'a mut [f64],
    pub(in crate::vi) covering: &'a mut [f64],
    pub(in crate::vi) resting: &'a mut [f64],
    pub(in crate::vi) column: &'a mut [f64],
    pub(in crate::vi) pivot_row: &'a mut [f64],
    pub(in crate::vi) residual: &'a mut [f64],
    pub(in crate::vi) members: &'a mut [usize],
    pub(in crate::vi) held: &'a mut [usize],
}
