//! What a path is followed in, and what it costs.

use super::super::dense;
use super::super::interruption::Interruption;
use super::super::natural::natural_residual;

/// What a path has cost.
#[derive(Clone, Copy, Debug, Default)]
pub(in super::super) struct WorkCounts {
    /// Pivots along the path, bound flips included.
    pub(in super::super) pivots: usize,
    /// These and the columns entered into fresh bases, of about the same cost.
    pub(in super::super) columns: usize,
}

/// Asks whether to go on.
pub(in super::super) type Poll<'a> = dyn FnMut() -> Result<(), Interruption> + 'a;

/// An affine VI on a box, with the matrix `M + shift I`, `M` row by row.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct AffineVi<'a> {
    /// The matrix `M`, `n^2` entries.
    pub(in super::super) matrix: &'a [f64],
    /// A multiple of the identity added to it.
    pub(in super::super) shift: f64,
    /// The constant term.
    pub(in super::super) q: &'a [f64],
    /// Lower bounds.
    pub(in super::super) lower: &'a [f64],
    /// Upper bounds.
    pub(in super::super) upper: &'a [f64],
}

impl AffineVi<'_> {
    pub(in super::super) fn n(&self) -> usize {
        self.q.len()
    }

    pub(in super::super) fn bounds(&self, i: usize) -> (f64, f64) {
        (dense::at(self.lower, i), dense::at(self.upper, i))
    }

    pub(in super::super) fn is_fixed(&self, i: usize) -> bool {
        let (lower, upper) = self.bounds(i);
        lower == upper
    }

    /// Column `j` of `M + shift I`.
    pub(in super::super) fn column(&self, j: usize, out: &mut [f64]) {
        for (out, row) in out.iter_mut().zip(dense::rows(self.matrix, self.n())) {
            *out = dense::at(row, j);
        }
        dense::put(out, j, dense::at(out, j) + self.shift);
    }

    /// `F = (M + shift I) z + q`.
    pub(in super::super) fn map(&self, z: &[f64], f: &mut [f64]) {
        self.map_where(|_| true, z, f);
    }

    /// The components of `F` that are asked for.
    pub(in super::super) fn map_where(
        &self,
        asked: impl Fn(usize) -> bool,
        z: &[f64],
        f: &mut [f64],
    ) {
        let rows = dense::rows(self.matrix, self.n()).zip(z.iter().zip(self.q));
        for ((i, f), (row, (zi, q))) in f.iter_mut().enumerate().zip(rows) {
            if asked(i) {
                *f = dense::dot(row, z) + (self.shift * zi + q);
            }
        }
    }

    /// The natural residual at `z`, with `F` left in `f`.
    pub(in super::super) fn residual(&self, z: &[f64], f: &mut [f64]) -> f64 {
        self.map(z, f);
        natural_residual(z, f, self.lower, self.upper)
    }
}

/// What the pivotal solver works in: `n^2 + 7 n` reals and `2 n` indices.
#[derive(Debug)]
pub(in super::super) struct PivotalWorkspace<'a> {
    pub(in super::super) inverse: &'a mut [f64],
    pub(in super::super) values: &'a mut [f64],
    pub(in super::super) direction: &'a mut [f64],
    pub(in super::super) covering: &'a mut [f64],
    pub(in super::super) resting: &'a mut [f64],
    pub(in super::super) column: &'a mut [f64],
    pub(in super::super) pivot_row: &'a mut [f64],
    pub(in super::super) residual: &'a mut [f64],
    pub(in super::super) members: &'a mut [usize],
    pub(in super::super) held: &'a mut [usize],
}
