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
//!
//! Where `M` is symmetric, [`descend`] follows: the minimum of `d'Md/2 + q'd` over the box by
//! principal pivots, one component at a time, which needs no regular `M` (Cottle, Pang & Stone,
//! *The Linear Complementarity Problem*, 4.2). Dependent contacts have such matrices.

use super::dense;
use super::infeasible::pivot;
use super::iterate::{self, Iterate, Outcome};
use super::natural::natural_residual;
use super::pivotal::AffineVi;

/// Rounds without fewer changes than ever before, after which it is given up.
const PATIENCE: usize = 4;
/// Pivot ratio from which on a matrix is regular whatever the sizes of its rows.
const REGULAR: f64 = 1e-6;
/// Multiple of `1 + |q|` by which a slack may have the wrong sign.
const ROUNDING: f64 = 1e-13;

/// A curvature below this fraction of the diagonal entry is rounding.
const FLAT: f64 = 1e-10;
/// Entries of a symmetric matrix differ from their mirror images by no more, relative to both.
const SYMMETRIC: f64 = 1e-13;
/// Steps that are equal but for rounding.
const TIE: f64 = 1e-12;

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

/// `work.step <-` the minimum of `d'Md/2 + q'd` over the box, for a symmetric positive semidefinite
/// matrix; false where there is none, or more than `limit` pivots would be needed.
pub(super) fn descend(at: &mut Iterate<'_, '_>, limit: usize) -> Outcome<bool> {
    if !is_symmetric(at) || !begin_at_bounds(at) {
        return Ok(false);
    }
    let mut pivots = 0;
    while let Some(entering) = steepest(at) {
        let mut moved = 0.0;
        loop {
            if pivots >= limit || at.budget.is_spent() {
                return Ok(false);
            }
            if dense::is_time_to_poll(pivots, at.n()) {
                at.problem.poll()?;
            }
            pivots += 1;
            at.budget.spend(1);
            at.counts.pivots += 1;
            match descend_along(at, entering, &mut moved) {
                DescentEnd::Blocked => {}
                DescentEnd::Reached => break,
                DescentEnd::Unbounded => return Ok(false),
            }
        }
    }
    // once more from the data
    let Some(ratio) = solve_inside(at, 0.0)? else { return Ok(false) };
    at.inside_is_regular = ratio >= REGULAR;
    Ok(change_active_set(at, 0.0) == 0)
}

/// How a component moves from its bound.
#[derive(Clone, Copy, Debug)]
struct FreedComponent {
    index: usize,
    sense: f64,
}

/// How far it comes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum DescentEnd {
    /// To where its slack vanishes, or to its other bound.
    Reached,
    /// To where another component reaches a bound.
    Blocked,
    Unbounded,
}

fn is_symmetric(at: &Iterate<'_, '_>) -> bool {
    let n = at.n();
    let matrix = &*at.work.jacobian;
    dense::rows(matrix, n).enumerate().all(|(i, row)| {
        let mirrored = matrix.iter().skip(i).step_by(n.max(1));
        row.iter()
            .zip(mirrored)
            .take(i)
            .all(|(a, b)| (a - b).abs() <= SYMMETRIC * (a.abs() + b.abs()))
    })
}

/// All components at a bound, the slacks in `values`; false for a component without a bound.
fn begin_at_bounds(at: &mut Iterate<'_, '_>) -> bool {
    let n = at.n();
    let work = &mut *at.work;
    for i in 0..n {
        let (lower, upper) = (dense::at(work.lower, i), dense::at(work.upper, i));
        let is_lower = lower.is_finite() && !(upper.is_finite() && upper.abs() < lower.abs());
        let bound = if is_lower { lower } else { upper };
        if !bound.is_finite() {
            return false;
        }
        dense::put(work.pivotal.held, i, if is_lower { AT_LOWER } else { AT_UPPER });
        dense::put(work.step, i, bound);
    }
    dense::copy(work.pivotal.inverse, work.jacobian);
    let (lower, upper) = (&*work.lower, &*work.upper);
    let avi = AffineVi { matrix: work.jacobian, shift: 0.0, q: work.f, lower, upper };
    avi.map(work.step, work.pivotal.values);
    true
}

/// The component at a bound whose slack has the wrong sign most.
fn steepest(at: &Iterate<'_, '_>) -> Option<FreedComponent> {
    let pivotal = &at.work.pivotal;
    let mut worst = ROUNDING * (1.0 + dense::norm(at.work.f));
    let mut entering = None;
    for (index, (&held, &slack)) in pivotal.held.iter().zip(pivotal.values.iter()).enumerate() {
        let sense = match held {
            AT_LOWER if slack < -worst => 1.0,
            AT_UPPER if slack > worst => -1.0,
            _ => continue,
        };
        if dense::at(at.work.lower, index) < dense::at(at.work.upper, index) {
            (worst, entering) = (slack.abs(), Some(FreedComponent { index, sense }));
        }
    }
    entering
}

/// Moves the entering component, with those inside, as far as `moved` and the bounds allow.
fn descend_along(
    at: &mut Iterate<'_, '_>,
    entering: FreedComponent,
    moved: &mut f64,
) -> DescentEnd {
    let n = at.n();
    let FreedComponent { index, sense } = entering;
    let work = &mut *at.work;
    let pivotal = &mut work.pivotal;
    let column = pivotal.inverse.iter().skip(index).step_by(n.max(1));
    pivotal.direction.iter_mut().zip(column).for_each(|(d, a)| *d = sense * a);
    let curvature = sense * dense::at(pivotal.direction, index);
    let flat = FLAT * dense::at(work.jacobian, index * n + index);
    if curvature < -flat {
        return DescentEnd::Unbounded;
    }
    let (lower, upper) = (dense::at(work.lower, index), dense::at(work.upper, index));
    let slack = dense::at(pivotal.values, index).abs();
    let vanishes = if curvature > flat { slack / curvature } else { f64::INFINITY };
    let across = upper - lower - *moved;
    let (mut length, mut blocking, mut fastest) = (vanishes.min(across), None, 0.0);
    let rates = pivotal.direction.iter().zip(pivotal.held.iter()).zip(pivotal.values.iter());
    for (i, ((&rate, &held), &value)) in rates.enumerate() {
        if held != INSIDE || rate == 0.0 {
            continue;
        }
        let bound = if rate < 0.0 { dense::at(work.lower, i) } else { dense::at(work.upper, i) };
        let until = f64::max((bound - value) / rate, 0.0);
        let is_tie = blocking.is_some() && (until - length).abs() <= TIE * length;
        if (is_tie && rate.abs() > fastest) || (!is_tie && until < length) {
            (length, blocking, fastest) = (until.min(length), Some((i, bound)), rate.abs());
        }
    }
    if !length.is_finite() {
        return DescentEnd::Unbounded;
    }
    dense::axpy(pivotal.values, length, pivotal.direction);
    *moved += length;
    let from = if sense > 0.0 { lower } else { upper };
    if let Some((i, bound)) = blocking {
        let held = if bound == dense::at(work.lower, i) { AT_LOWER } else { AT_UPPER };
        dense::put(pivotal.held, i, held);
        dense::put(pivotal.values, i, 0.0);
        pivot(at, i, i);
        return DescentEnd::Blocked;
    }
    if length == across {
        dense::put(pivotal.held, index, if sense > 0.0 { AT_UPPER } else { AT_LOWER });
        return DescentEnd::Reached;
    }
    dense::put(pivotal.held, index, INSIDE);
    dense::put(pivotal.values, index, from + sense * *moved);
    pivot(at, index, index);
    DescentEnd::Reached
}

#[cfg(test)]
#[allow(clippy::indexing_slicing, clippy::unwrap_used)]
mod tests {
    extern crate std;
    use super::super::iterate::Random;
    use super::super::iterate::{workspace_len, Workspace};
    use super::super::problem::Affine;
    use super::super::settings::Settings;
    use super::*;
    use std::vec;
    use std::vec::Vec;

    /// Whether [`descend`] ends from zero, and where.
    fn end(matrix: &[f64], q: &[f64], (lower, upper): (f64, f64)) -> (bool, Vec<f64>, usize) {
        let n = q.len();
        let (reals, indices) = workspace_len(n);
        let (mut reals, mut indices) = (vec![f64::NAN; reals], vec![usize::MAX; indices]);
        let mut work = Workspace::new(n, &mut reals, &mut indices).unwrap();
        let (lower, upper, mut z) = (vec![lower; n], vec![upper; n], vec![0.0; n]);
        dense::project(&mut z, &lower, &upper);
        let (settings, bounds) = (Settings::default(), (&lower[..], &upper[..]));
        let mut problem = Affine { matrix, q };
        let mut at = Iterate::new(&mut problem, &settings, bounds, &mut work, &mut z);
        dense::copy(at.work.trial, at.z);
        assert!(at.begin().unwrap());
        reach(&mut at);
        let solved = at.is_solved();
        let found = solved || descend(&mut at, 20 * n).unwrap();
        let pivots = at.counts.pivots;
        let steps = if solved { vec![0.0; n] } else { at.work.step.to_vec() };
        (found, z.iter().zip(&steps).map(|(z, d)| z + d).collect(), pivots)
    }

    /// `A A'` of rank `rank` and a constant term for which there is a solution.
    fn gram(n: usize, rank: usize, random: &mut Random) -> (Vec<f64>, Vec<f64>) {
        let a: Vec<f64> = (0..n * rank).map(|_| random.uniform() - 0.5).collect();
        let v: Vec<f64> = (0..rank).map(|_| random.uniform() - 0.5).collect();
        let row = |i: usize| &a[i * rank..][..rank];
        let matrix = (0..n * n).map(|k| dense::dot(row(k / n), row(k % n))).collect();
        let q = (0..n).map(|i| dense::dot(row(i), &v)).collect();
        (matrix, q)
    }

    #[test]
    fn dependent_rows_are_solved_to_rounding() {
        let mut random = Random::new(7);
        for trial in 0..200 {
            let n = 2 + trial % 29;
            let (matrix, q) = gram(n, 1 + trial % n, &mut random);
            let upper = if trial % 3 == 0 { 0.5 } else { f64::INFINITY };
            let lower = if trial % 6 == 0 { -0.25 } else { 0.0 };
            let (found, z, pivots) = end(&matrix, &q, (lower, upper));
            assert!(found && pivots <= 6 * n, "{trial}: {pivots}");
            for (i, &z_i) in z.iter().enumerate() {
                let f = dense::dot(dense::row(&matrix, n, i), &z) + q[i];
                let natural = f64::max(z_i - upper, f64::min(z_i - lower, f));
                assert!(natural.abs() < 1e-11, "{trial}: {natural:e}");
            }
        }
    }

    #[test]
    fn what_has_no_minimum_or_is_not_symmetric_is_left_to_others() {
        const HALF: (f64, f64) = (0.0, f64::INFINITY);
        assert!(!end(&[1.0, -1.0, -1.0, 1.0], &[-1.0, -1.0], HALF).0);
        assert!(!end(&[1.0, 0.5, 0.0, 1.0], &[-1.0, -1.0], HALF).0);
        assert!(!end(&[-1.0, 0.0, 0.0, 1.0], &[-1.0, -1.0], HALF).0);
        assert!(!end(&[1.0], &[-1.0], (f64::NEG_INFINITY, f64::INFINITY)).0);
        assert_eq!(end(&[0.0, 0.0, 0.0, 2.0], &[1.0, -1.0], HALF), (true, vec![0.0, 0.5], 1));
    }
}
