//! Newton's method on the active set of an affine VI: tried before any pivot.
//!
//! ```text
//! A = {i at a bound},  I = the rest
//! d_A at its bounds,  M_II d_I = -q_I - M_IA d_A,   F = M d + q
//! i in I leaves the box: i -> A;   i in A with F_i of the wrong sign: i -> I
//! ```
//!
//! The semismooth Newton method for `min(d - l, F) = 0` (Hintermüller, Ito & Kunisch, *SIAM J.
//! Optim.* 13 (2002) 865-888). Where `M` is an M-matrix (obstacles, lubrication) it ends after a
//! few rounds whatever the number of unknowns; elsewhere it may cycle, and is given up.

use super::dense;
use super::iterate::{self, Iterate, Outcome};
use super::natural::natural_residual;
use super::pivotal::AffineVi;

/// Rounds without fewer changes than ever before, after which it is given up.
const PATIENCE: usize = 4;
/// Pivot ratio from which on a matrix is regular whatever the sizes of its rows.
const REGULAR: f64 = 1e-6;
/// Multiple of `1 + |q|` by which a slack may have the wrong sign.
const ROUNDING: f64 = 1e-13;

const INSIDE: usize = 0;
const AT_LOWER: usize = 1;
const AT_UPPER: usize = 2;

/// `trial <-` the solution of the linearised problem with `weight` times `work.weights` added to the
/// diagonal; false where none was found.
pub(super) fn advance(at: &mut Iterate<'_, '_>, weight: f64) -> Outcome<bool> {
    reach(at);
    let found = solve(at, weight, at.pivots_left())?;
    if found {
        iterate::advance(at, 1.0);
    }
    Ok(found)
}

/// The box relative to the iterate.
pub(super) fn reach(at: &mut Iterate<'_, '_>) {
    let work = &mut *at.work;
    let reach = work.lower.iter_mut().zip(work.upper.iter_mut()).zip(at.z.iter());
    for (((lower, upper), z), (l, u)) in reach.zip(at.lower.iter().zip(at.upper)) {
        (*lower, *upper) = (l - z, u - z);
    }
}

/// `work.step <-` the solution of `avi` from the bounds that zero is on; false where none was
/// found within `limit` pivots' worth of work.
pub(super) fn solve(at: &mut Iterate<'_, '_>, weight: f64, limit: usize) -> Outcome<bool> {
    begin(at);
    at.inside_is_regular = false;
    let (mut fewest, mut since, before) = (usize::MAX, 0, at.budget.spent());
    while since < PATIENCE && at.budget.spent() - before < limit {
        let Some(ratio) = solve_inside(at, weight)? else {
            return Ok(false);
        };
        let changes = change_active_set(at, weight);
        if changes == 0 {
            at.inside_is_regular = weight == 0.0 && ratio >= REGULAR;
            return Ok(true);
        }
        (fewest, since) = if changes < fewest { (changes, 0) } else { (fewest, since + 1) };
    }
    Ok(false)
}

/// Whether component `i` is not at a bound.
pub(super) fn is_inside(held: &[usize], i: usize) -> bool {
    held.get(i) == Some(&INSIDE)
}

/// A component on a bound is active if `F` pushes against it.
fn begin(at: &mut Iterate<'_, '_>) {
    let work = &mut *at.work;
    for i in 0..work.f.len() {
        let (lower, upper) = (dense::at(work.lower, i), dense::at(work.upper, i));
        let f = dense::at(work.f, i);
        let place = if lower == upper || (lower == 0.0 && f > 0.0) {
            AT_LOWER
        } else if upper == 0.0 && f < 0.0 {
            AT_UPPER
        } else {
            INSIDE
        };
        dense::put(work.pivotal.held, i, place);
    }
}

/// `work.step` for the active set, and the ratio of the pivots; `None` where `M_II` is singular.
fn solve_inside(at: &mut Iterate<'_, '_>, weight: f64) -> Outcome<Option<f64>> {
    let n = at.n();
    let work = &mut *at.work;
    let pivotal = &mut work.pivotal;
    for (i, step) in work.step.iter_mut().enumerate() {
        *step = match pivotal.held.get(i) {
            Some(&AT_LOWER) => dense::at(work.lower, i),
            Some(&AT_UPPER) => dense::at(work.upper, i),
            _ => 0.0,
        };
    }
    let held = &*pivotal.held;
    let size = dense::list(n, |i| is_inside(held, i), pivotal.members);
    let is_zero = work.step.iter().all(|step| *step == 0.0);
    let members = pivotal.members.get(..size).unwrap_or(&[]);
    let rows = pivotal.inverse.chunks_exact_mut(size.max(1));
    for (k, ((&i, inner), constant)) in
        members.iter().zip(rows).zip(pivotal.values.iter_mut()).enumerate()
    {
        let row = dense::row(work.jacobian, n, i);
        let carried = if is_zero { 0.0 } else { dense::dot(row, work.step) };
        *constant = -dense::at(work.f, i) - carried;
        dense::pick(inner, row, members);
        if let (true, Some(diagonal)) = (weight > 0.0, inner.get_mut(k)) {
            *diagonal += weight * dense::at(work.weights, i);
        }
    }
    at.budget.spend_on_factors(size);
    let matrix = pivotal.inverse.get_mut(..size * size).unwrap_or(&mut []);
    let ratio = at.problem.factor(matrix, size, pivotal.members)?;
    if ratio <= 0.0 {
        return Ok(None);
    }
    let inside = pivotal.values.get_mut(..size).unwrap_or(&mut []);
    dense::solve(matrix, size, pivotal.members, inside);
    let steps = work.step.iter_mut().zip(&*pivotal.held);
    for ((step, _), value) in steps.filter(|(_, &held)| held == INSIDE).zip(inside.iter()) {
        *step = *value;
    }
    Ok(dense::is_finite(work.step).then_some(ratio))
}

/// The natural residual at the step's solution.
pub(super) fn residual(at: &mut Iterate<'_, '_>) -> f64 {
    let work = &mut *at.work;
    let (lower, upper) = (&*work.lower, &*work.upper);
    let avi = AffineVi { matrix: work.jacobian, shift: 0.0, q: work.f, lower, upper };
    // at the bounds F is known
    let held = &*work.pivotal.held;
    avi.map_where(|i| is_inside(held, i), work.step, work.pivotal.residual);
    natural_residual(work.step, work.pivotal.residual, work.lower, work.upper)
}

/// Moves what is outside the box to its bounds and frees what is pushed off them; the number of
/// components that changed.
fn change_active_set(at: &mut Iterate<'_, '_>, weight: f64) -> usize {
    let work = &mut *at.work;
    let wrong = ROUNDING * (1.0 + dense::norm(work.f));
    let mut changes = 0;
    let (lower, upper) = (&*work.lower, &*work.upper);
    let avi = AffineVi { matrix: work.jacobian, shift: 0.0, q: work.f, lower, upper };
    // inside, F was solved for
    let held = &*work.pivotal.held;
    avi.map_where(|i| !is_inside(held, i), work.step, work.pivotal.residual);
    for (i, &d) in work.step.iter().enumerate() {
        let (lower, upper) = avi.bounds(i);
        let mut f = dense::at(work.pivotal.residual, i);
        if weight > 0.0 {
            f += weight * dense::at(work.weights, i) * d;
        }
        let place = match work.pivotal.held.get(i) {
            _ if lower == upper => continue,
            Some(&AT_LOWER) if f < -wrong => INSIDE,
            Some(&AT_UPPER) if f > wrong => INSIDE,
            Some(&INSIDE) if d < lower => AT_LOWER,
            Some(&INSIDE) if d > upper => AT_UPPER,
            _ => continue,
        };
        dense::put(work.pivotal.held, i, place);
        changes += 1;
    }
    changes
}
