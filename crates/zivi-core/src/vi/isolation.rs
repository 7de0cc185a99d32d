//! Whether a solution is isolated: the Jacobian on the rows inside the box is regular there.

use super::active_set;
use super::dense;
use super::iterate::{Iterate, Outcome};

/// Pivot ratio below which the Jacobian on the rows inside counts as singular.
const SINGULAR: f64 = 1e-12;
/// The same for a Jacobian by differences, which are no better than this.
const SINGULAR_TO_DIFFERENCES: f64 = 1e-9;

/// True unless the Jacobian at the solution is singular on the rows inside. One that is made of
/// many evaluations of `F` is taken from the last iterate, where there was one; the factors of an
/// affine `F` are those of the active set, where it has found the solution.
pub(super) fn is_isolated(at: &mut Iterate<'_, '_>) -> Outcome<bool> {
    if at.inside_is_regular && at.problem.is_affine() && is_active_set(at) {
        return Ok(true);
    }
    let differenced = at.problem.is_differenced();
    let known = differenced && at.jacobian_is_known;
    if !known && !at.linearise()? {
        return Ok(true);
    }
    let limit = if differenced { SINGULAR_TO_DIFFERENCES } else { SINGULAR };
    Ok(pivot_ratio_inside(at)? >= limit)
}

/// Whether the components inside are those that the active set holds there.
fn is_active_set(at: &Iterate<'_, '_>) -> bool {
    let held = &*at.work.pivotal.held;
    (0..at.n()).all(|i| {
        let bounds = (dense::at(at.lower, i), dense::at(at.upper, i));
        let inside = is_inside(dense::at(at.z, i), dense::at(at.work.f, i), bounds, at.tol);
        inside == active_set::is_inside(held, i)
    })
}

/// Whether a component is inside the box, or at a bound with `F_i = 0`.
fn is_inside(z: f64, f: f64, (lower, upper): (f64, f64), tol: f64) -> bool {
    let target = z - f;
    lower < upper && lower - tol <= target && target <= upper + tol
}

/// `min/max` of the pivots of the Jacobian on the rows and columns inside the box (those at a
/// bound with `F_i = 0` included), its rows scaled to 1; 0 when singular.
fn pivot_ratio_inside(at: &mut Iterate<'_, '_>) -> Outcome<f64> {
    let (n, tol) = (at.n(), at.tol);
    let work = &mut *at.work;
    let is_inside = |i: usize| {
        let bounds = (dense::at(at.lower, i), dense::at(at.upper, i));
        is_inside(dense::at(at.z, i), dense::at(work.f, i), bounds, tol)
    };
    let pivotal = &mut work.pivotal;
    let size = dense::list(n, is_inside, pivotal.members);
    let members = pivotal.members.get(..size).unwrap_or(&[]);
    for (&i, inner) in members.iter().zip(pivotal.inverse.chunks_exact_mut(size.max(1))) {
        dense::pick(inner, dense::row(work.jacobian, n, i), members);
        let scale = dense::norm(inner);
        inner.iter_mut().for_each(|entry| *entry = if scale > 0.0 { *entry / scale } else { 0.0 });
    }
    let leading = pivotal.inverse.get_mut(..size * size).unwrap_or(&mut []);
    at.problem.factor(leading, size, pivotal.members)
}
