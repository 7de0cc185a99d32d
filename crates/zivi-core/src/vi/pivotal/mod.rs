//! A pivotal solver for the affine VI on a box.
//!
//! ```text
//! find l <= z <= u, w >= 0, v >= 0 with   M z + q = w - v,   w _|_ z - l,   v _|_ u - z
//! ```
//!
//! Of the three variables of an index at most one is basic (`z_i` strictly inside, `w_i` with
//! `z_i = l_i`, `v_i` with `z_i = u_i`), and an artificial `s` times a covering vector `c` joins
//! `q`. The path from a known solution at `s = s0` is followed, one complementary pivot after
//! another, until `s = 0`: Lemke's method, in the form of Cao & Ferris, *Mathematics of
//! Operations Research* 21 (1996) 44-60, on the box itself, so the basis stays `n x n`. Ties are
//! broken lexicographically (Cottle, Pang & Stone, *The Linear Complementarity Problem*, 4.9), so
//! no basis comes twice.
//!
//! A path that ends on a ray along which `s` stays the same goes on: slacks that grow along the ray
//! need no cover, and with `c_i = 0` in their rows the same ray is the beginning of another path.
//! For bimatrix games that second path is Lemke and Howson's (*J. SIAM* 12 (1964) 413-423).

mod basis;
mod path;
mod start;
mod tableau;

use super::dense;
use super::natural::natural_residual;
use super::problem::Interruption;
use basis::Basis;
use tableau::Tableau;

/// Where the path begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// At the given point, which solves the problem for a covering vector built from it.
    Regular,
    /// On the ray `s -> inf` from the vertex of the box nearest to the given point.
    Ray,
}

/// How a path ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PathEnd {
    /// At `s = 0`.
    Solution,
    /// On a ray: no solution lies on this path.
    Ray,
    /// The basis became, or was from the outset, numerically singular.
    Singular,
    /// At the limit of pivots.
    PivotLimit,
    /// Nowhere: it is proved that there is no solution.
    Infeasible,
    /// At a solution of the whole problem, without pivots.
    Solved,
}

/// What a path has cost.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Effort {
    /// Pivots along the path, bound flips included.
    pub(super) pivots: usize,
    /// These and the columns entered into fresh bases, of about the same cost.
    pub(super) columns: usize,
}

/// Asks whether to go on.
pub(super) type Poll<'a> = dyn FnMut() -> Result<(), Interruption> + 'a;

/// An affine VI on a box, with the matrix `M + shift I`, `M` row by row.
#[derive(Clone, Copy, Debug)]
pub(super) struct AffineVi<'a> {
    /// The matrix `M`, `n^2` entries.
    pub(super) matrix: &'a [f64],
    /// A multiple of the identity added to it.
    pub(super) shift: f64,
    /// The constant term.
    pub(super) q: &'a [f64],
    /// Lower bounds.
    pub(super) lower: &'a [f64],
    /// Upper bounds.
    pub(super) upper: &'a [f64],
}

impl AffineVi<'_> {
    fn n(&self) -> usize {
        self.q.len()
    }

    pub(super) fn bounds(&self, i: usize) -> (f64, f64) {
        (dense::at(self.lower, i), dense::at(self.upper, i))
    }

    fn is_fixed(&self, i: usize) -> bool {
        let (lower, upper) = self.bounds(i);
        lower == upper
    }

    /// Column `j` of `M + shift I`.
    fn column(&self, j: usize, out: &mut [f64]) {
        for (out, row) in out.iter_mut().zip(dense::rows(self.matrix, self.n())) {
            *out = dense::at(row, j);
        }
        dense::put(out, j, dense::at(out, j) + self.shift);
    }

    /// `F = (M + shift I) z + q`.
    pub(super) fn map(&self, z: &[f64], f: &mut [f64]) {
        dense::multiply(self.matrix, z, f);
        for (f, (z, q)) in f.iter_mut().zip(z.iter().zip(self.q)) {
            *f += self.shift * z + q;
        }
    }

    /// The natural residual at `z`, with `F` left in `f`.
    pub(super) fn residual(&self, z: &[f64], f: &mut [f64]) -> f64 {
        self.map(z, f);
        natural_residual(z, f, self.lower, self.upper)
    }
}

/// What the pivotal solver works in: `n^2 + 7 n` reals and `2 n` indices.
#[derive(Debug)]
pub(super) struct PivotalWorkspace<'a> {
    pub(super) inverse: &'a mut [f64],
    pub(super) values: &'a mut [f64],
    pub(super) direction: &'a mut [f64],
    pub(super) covering: &'a mut [f64],
    pub(super) resting: &'a mut [f64],
    pub(super) column: &'a mut [f64],
    pub(super) pivot_row: &'a mut [f64],
    pub(super) residual: &'a mut [f64],
    pub(super) members: &'a mut [usize],
    pub(super) held: &'a mut [usize],
}

/// Follows the path from `z`; at [`PathEnd::Solution`] `z` is the end of it, in the box, for the
/// caller to check. Returns the end and what it cost; `poll` may stop it.
pub(super) fn follow(
    avi: &AffineVi<'_>,
    start: Start,
    limit: usize,
    work: &mut PivotalWorkspace<'_>,
    z: &mut [f64],
    poll: &mut Poll<'_>,
) -> Result<(PathEnd, Effort), Interruption> {
    let mut tableau = Tableau::new(avi, work);
    let begun = match start {
        Start::Regular => tableau.start_at(z, poll)?,
        Start::Ray => tableau.start_on_ray(z, poll)?,
    };
    if !begun {
        return Ok((PathEnd::Singular, tableau.effort));
    }
    let end = tableau.follow_path(limit, poll)?;
    if end == PathEnd::Solution {
        tableau.refine(poll)?;
        tableau.extract(z);
    }
    Ok((end, tableau.effort))
}
