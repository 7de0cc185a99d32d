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
mod work;

use super::interruption::Interruption;
use super::settings::Start;
use tableau::Tableau;
pub(super) use work::{AffineVi, PivotalWorkspace, Poll, WorkCounts};

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

/// Follows the path from `z`; at [`PathEnd::Solution`] `z` is the end of it, in the box, for the
/// caller to check. Returns the end and what it cost; `poll` may stop it.
pub(super) fn follow(
    avi: &AffineVi<'_>,
    start: Start,
    limit: usize,
    work: &mut PivotalWorkspace<'_>,
    z: &mut [f64],
    poll: &mut Poll<'_>,
) -> Result<(PathEnd, WorkCounts), Interruption> {
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
