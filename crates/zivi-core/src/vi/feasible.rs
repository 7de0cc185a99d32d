//! Rows of an affine map that no point of the box satisfies.
//!
//! ```text
//! sup F_i = F_i(z) + sum_j max(J_ij (l_j - z_j), J_ij (u_j - z_j))
//! sup F_i < 0 and u_i = +inf:   F_i >= 0 is needed wherever z_i is, and impossible
//! inf F_i > 0 and l_i = -inf:   the same with the signs turned
//! ```

use super::dense;
use super::iterate::Iterate;

/// True when some row violates the tolerance everywhere in the box: a proof, by more than the
/// rounding of the sums, that there is no solution. The iterate must be linearised, `F` affine.
pub(super) fn has_unsatisfiable_row(at: &Iterate<'_, '_>) -> bool {
    let n = at.n();
    (0..n).any(|i| {
        let above = dense::at(at.upper, i) == f64::INFINITY && stays_below_zero(at, i, 1.0);
        above || dense::at(at.lower, i) == f64::NEG_INFINITY && stays_below_zero(at, i, -1.0)
    })
}

/// True when `sup (sign F_i)` over the box is below zero by more than the tolerance; false where it
/// is infinite, or undefined.
fn stays_below_zero(at: &Iterate<'_, '_>, i: usize, sign: f64) -> bool {
    let row = dense::row(at.work.jacobian, at.n(), i);
    let mut most = sign * dense::at(at.work.f, i);
    let mut size = most.abs();
    let bounds = at.lower.iter().zip(at.upper);
    for ((&entry, &z), (&lower, &upper)) in row.iter().zip(at.z.iter()).zip(bounds) {
        let slope = sign * entry;
        if slope != 0.0 {
            let rise = slope * if slope > 0.0 { upper - z } else { lower - z };
            most += rise;
            if most == f64::INFINITY {
                return false;
            }
            size += rise.abs() + (entry * z).abs();
        }
    }
    let rounding = at.n() as f64 * f64::EPSILON * size;
    most < -(at.tol + rounding)
}
