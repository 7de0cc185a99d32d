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
//! A path that ends on a ray along which `s` stays the same continues: slacks that grow along the
//! ray need no cover, and with `c_i = 0` in their rows the same ray is the beginning of another path.
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

#[cfg(test)]
#[allow(clippy::indexing_slicing, clippy::unwrap_used)]
mod tests {
    extern crate std;
    use super::super::random::Random;
    use super::super::workspace::{workspace_len, Workspace};
    use super::*;
    use std::vec;
    use std::vec::Vec;

    const INF: f64 = f64::INFINITY;

    /// The end of one path from `z`, and the residual there.
    fn path(avi: &AffineVi<'_>, start: Start, z: &mut [f64]) -> (PathEnd, f64) {
        let n = z.len();
        let (reals, indices) = workspace_len(n);
        let (mut reals, mut indices) = (vec![f64::NAN; reals], vec![usize::MAX; indices]);
        let mut work = Workspace::new(n, &mut reals, &mut indices).unwrap();
        let end = follow(avi, start, 50 * n, &mut work.pivotal, z, &mut || Ok(())).unwrap().0;
        (end, avi.residual(z, &mut vec![0.0; n]))
    }

    fn normal(random: &mut Random) -> f64 {
        (0..12).map(|_| random.uniform()).sum::<f64>() - 6.0
    }

    /// On boxes of all kinds with a dominant diagonal, where the solution is unique: either path
    /// ends in it, with bounds that a variable crosses on the way.
    #[test]
    fn either_start_leads_to_the_solution() {
        let mut random = Random::new(3);
        for trial in 0..300 {
            let n = 1 + trial % 9;
            let mut matrix: Vec<f64> = (0..n * n).map(|_| normal(&mut random)).collect();
            for i in 0..n {
                matrix[i * n + i] = 0.1 + (0..n).map(|j| matrix[i * n + j].abs()).sum::<f64>();
            }
            let q: Vec<f64> = (0..n).map(|_| 4.0 * normal(&mut random)).collect();
            let (mut lower, mut upper) = (vec![-INF; n], vec![INF; n]);
            for i in 0..n {
                let (kind, place) = (4.0 * random.uniform(), normal(&mut random));
                if kind < 2.0 {
                    lower[i] = place;
                }
                if (1.0..3.0).contains(&kind) {
                    upper[i] = place + random.uniform();
                }
            }
            let avi = AffineVi { matrix: &matrix, shift: 0.0, q: &q, lower: &lower, upper: &upper };
            for start in [Start::Regular, Start::Ray] {
                let mut z: Vec<f64> =
                    lower.iter().zip(&upper).map(|(l, u)| 0.0_f64.max(*l).min(*u)).collect();
                let (end, residual) = path(&avi, start, &mut z);
                assert_eq!(end, PathEnd::Solution, "{trial} {start:?}");
                assert!(residual < 1e-11, "{trial} {start:?}: {residual}");
            }
        }
    }

    /// `z = (x, y)` with `F = (A y - 1, B' x - 1)`: where a path comes back on a ray, it is that of
    /// Lemke and Howson.
    #[test]
    fn games_are_solved_beyond_the_first_ray() {
        let mut random = Random::new(5);
        let mut solved = 0;
        for _ in 0..200 {
            let (m, n) = (4, 8);
            let mut matrix = vec![0.0; n * n];
            for i in 0..m {
                for j in m..n {
                    matrix[i * n + j] = 1.0 + random.uniform();
                    matrix[j * n + i] = 1.0 + random.uniform();
                }
            }
            let (q, lower, upper) = (vec![-1.0; n], vec![0.0; n], vec![INF; n]);
            let avi = AffineVi { matrix: &matrix, shift: 0.0, q: &q, lower: &lower, upper: &upper };
            for start in [Start::Regular, Start::Ray] {
                let mut z = vec![0.0; n];
                let (end, residual) = path(&avi, start, &mut z);
                if end == PathEnd::Solution {
                    assert!(residual < 1e-11, "{start:?}: {residual}");
                    solved += 1;
                }
            }
        }
        assert_eq!(solved, 400);
    }
}
