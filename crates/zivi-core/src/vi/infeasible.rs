//! Affine problems without a solution, told by a certificate of Farkas.
//!
//! A solution needs `F_i >= 0` where `u_i = +inf` and `F_i <= 0` where `l_i = -inf`. The simplex
//! method minimises the sum of the violations over the box; if the minimum is positive, its
//! multipliers `y` prove that no point of the box satisfies these rows:
//!
//! ```text
//! y_i <= 0 where F_i >= 0 is needed, y_i >= 0 where F_i <= 0 is, y_i = 0 where neither is:
//! y'F <= 0 at every solution, but   min y'F over the box > 0
//! ```
//!
//! The proof is checked on the data, whatever the simplex method says, and holds whether or not the
//! problem is monotone.

use super::dense;
use super::iterate::Random;
use super::iterate::{Iterate, Outcome};

/// Slopes and rates below this, relative to the largest, are rounding.
const NEGLIGIBLE: f64 = 1e-11;
/// Where a column of the proof vanishes but for rounding, it holds for components up to this.
const FAR: f64 = 1e8;

/// True when it is proved that no point satisfies all rows, by more than the tolerance. Gives up
/// after `limit` pivots. The iterate must be linearised, `F` affine; overwrites what the pivotal
/// solver works in, `work.step` and `work.neighbour`.
pub(super) fn is_infeasible(at: &mut Iterate<'_, '_>, limit: usize) -> Outcome<bool> {
    begin(at);
    let mut random = Random::new(1);
    let mut has_moved = true;
    for pivot in 0..limit {
        if dense::is_time_to_poll(pivot, at.n()) {
            at.problem.poll()?;
        }
        at.budget.spend(1);
        if price(at) == 0.0 {
            return Ok(false);
        }
        // where nothing moves the choice is random, so that it does not cycle
        let weight = || if has_moved { 1.0 } else { random.uniform() };
        let Some(entering) = choose(at, weight) else {
            return Ok(proves(at));
        };
        match exchange(at, entering) {
            Some(length) => has_moved = length > 0.0,
            None => return Ok(false),
        }
    }
    Ok(false)
}

/// Whether two rows exclude each other: `F_i + t F_k` has the wrong sign everywhere. Most pairs are
/// refuted by a few columns with an infinite bound, which leave no `t`. As [`is_infeasible`].
pub(super) fn two_rows_exclude_each_other(at: &mut Iterate<'_, '_>) -> Outcome<bool> {
    let n = at.n();
    for i in 0..n {
        if dense::is_time_to_poll(i, at.n()) {
            at.problem.poll()?;
        }
        for k in 0..i {
            let (Some(first), Some(second)) = (needed_sign(at, i), needed_sign(at, k)) else {
                continue;
            };
            let Some((least, most)) = weights(at, (i, first), (k, second)) else { continue };
            let middle = if most.is_finite() { 0.5 * (least + most) } else { 2.0 * least + 1.0 };
            for weight in [middle, least, most] {
                if weight.is_finite() && weight > 0.0 && {
                    most_of_two(at, (i, first), (k, second * weight)) < 0.0
                } {
                    at.work.neighbour.fill(0.0);
                    dense::put(at.work.neighbour, i, -first);
                    dense::put(at.work.neighbour, k, -second * weight);
                    if least_over_box(at) > 0.0 {
                        return Ok(true);
                    }
                }
            }
        }
    }
    Ok(false)
}

/// The most of `sigma_i F_i + tau_k F_k` over the box where that is finite: a first look.
fn most_of_two(at: &Iterate<'_, '_>, (i, first): (usize, f64), (k, second): (usize, f64)) -> f64 {
    let n = at.n();
    let rows = dense::row(at.work.jacobian, n, i).iter().zip(dense::row(at.work.jacobian, n, k));
    let start = first * dense::at(at.work.f, i) + second * dense::at(at.work.f, k);
    let bounds = at.lower.iter().zip(at.upper).zip(at.z.iter());
    rows.zip(bounds).fold(start, |most, ((a, b), ((lower, upper), z))| {
        let slope = first * a + second * b;
        let room = if slope > 0.0 { upper - z } else { lower - z };
        // with the chosen weights, it is rounding if there is no bound
        if room.is_finite() {
            most + slope * room
        } else {
            most
        }
    })
}

/// The sign that `F_i` needs for every `z_i`, if unique: an equation needs both, and `None` is
/// returned.
fn needed_sign(at: &Iterate<'_, '_>, i: usize) -> Option<f64> {
    match (dense::at(at.lower, i).is_finite(), dense::at(at.upper, i).is_finite()) {
        (true, false) => Some(1.0),
        (false, true) => Some(-1.0),
        _ => None,
    }
}

/// The range of `t > 0` with which `sigma_i F_i + t sigma_k F_k` does not grow towards any infinite
/// bound; `None` if empty.
fn weights(
    at: &Iterate<'_, '_>,
    (i, first): (usize, f64),
    (k, second): (usize, f64),
) -> Option<(f64, f64)> {
    let n = at.n();
    let rows = dense::row(at.work.jacobian, n, i).iter().zip(dense::row(at.work.jacobian, n, k));
    let bounds = at.lower.iter().zip(at.upper);
    let (mut least, mut most) = (0.0, f64::INFINITY);
    for ((a, b), (lower, upper)) in rows.zip(bounds) {
        let (a, b) = (first * a, second * b);
        // a + t b <= 0 for z_j towards +inf, >= 0 towards -inf
        let towards = [(*upper == f64::INFINITY, 1.0), (*lower == f64::NEG_INFINITY, -1.0)];
        for (_, sense) in towards.into_iter().filter(|it| it.0) {
            let (a, b) = (sense * a, sense * b);
            if b > 0.0 {
                most = f64::min(most, -a / b);
            } else if b < 0.0 {
                least = f64::max(least, -a / b);
            } else if a > 0.0 {
                return None;
            }
        }
        if least > most * (1.0 + NEGLIGIBLE) {
            return None;
        }
    }
    Some((least, most))
}

/// A variable that moves, by its column, and the sign of its move.
#[derive(Clone, Copy, Debug)]
struct EnteringColumn {
    column: usize,
    sense: f64,
}

/// The range of a variable: `z_j` of the code `j`, `F_i` of the code `n + i`.
fn range(at: &Iterate<'_, '_>, code: usize) -> (f64, f64) {
    let bounds = |i| (dense::at(at.lower, i), dense::at(at.upper, i));
    match code.checked_sub(at.n()) {
        None => bounds(code),
        Some(i) => {
            let (lower, upper) = bounds(i);
            let least = if upper == f64::INFINITY { 0.0 } else { f64::NEG_INFINITY };
            let most = if lower == f64::NEG_INFINITY { 0.0 } else { f64::INFINITY };
            (least, most)
        }
    }
}

/// `F` in terms of `z`: the matrix is in `inverse`, what is basic in `members` with its `values`,
/// what is not in `held` with its values in `resting`.
fn begin(at: &mut Iterate<'_, '_>) {
    let n = at.n();
    let work = &mut *at.work;
    dense::copy(work.pivotal.inverse, work.jacobian);
    dense::copy(work.pivotal.values, work.f);
    dense::copy(work.pivotal.resting, at.z);
    for i in 0..n {
        dense::put(work.pivotal.members, i, n + i);
        dense::put(work.pivotal.held, i, i);
    }
}

/// Signed violation of the range of a basic variable.
fn excess(at: &Iterate<'_, '_>, position: usize) -> f64 {
    let code = at.work.pivotal.members.get(position).copied().unwrap_or(0);
    let (lower, upper) = range(at, code);
    let value = dense::at(at.work.pivotal.values, position);
    let slight = f64::max(at.tol, 1e-13 * value.abs());
    if value < lower - slight {
        value - lower
    } else if value > upper + slight {
        value - upper
    } else {
        0.0
    }
}

/// `step_j`: the derivative of the violation with respect to the variable of column `j`; returns
/// the violation.
fn price(at: &mut Iterate<'_, '_>) -> f64 {
    let n = at.n();
    at.work.step.fill(0.0);
    let mut missing = 0.0;
    for position in 0..n {
        let excess = excess(at, position);
        if excess != 0.0 {
            missing += excess.abs();
            let work = &mut *at.work;
            let row = dense::row(work.pivotal.inverse, n, position);
            dense::axpy(work.step, excess.signum(), row);
        }
    }
    missing
}

/// The variable along which most is gained; `None` where nothing is.
fn choose(at: &Iterate<'_, '_>, mut weight: impl FnMut() -> f64) -> Option<EnteringColumn> {
    let pivotal = &at.work.pivotal;
    let slight = NEGLIGIBLE * (1.0 + dense::norm(at.work.step));
    let mut best = (None, 0.0);
    for (column, (&slope, &code)) in at.work.step.iter().zip(pivotal.held.iter()).enumerate() {
        let (lower, upper) = range(at, code);
        let value = dense::at(pivotal.resting, column);
        let has_room = if slope > 0.0 { value > lower } else { value < upper };
        let gain = if has_room && slope.abs() > slight { slope.abs() * weight() } else { 0.0 };
        if gain > best.1 {
            best = (Some(EnteringColumn { column, sense: -slope.signum() }), gain);
        }
    }
    best.0
}

/// Moves the entering variable until something is in its way, which it replaces; returns how far,
/// `None` where nothing is.
fn exchange(at: &mut Iterate<'_, '_>, entering: EnteringColumn) -> Option<f64> {
    let n = at.n();
    let EnteringColumn { column, sense } = entering;
    for position in 0..n {
        let rate = sense * dense::at(at.work.pivotal.inverse, position * n + column);
        dense::put(at.work.pivotal.direction, position, rate);
    }
    let (blocking, length) = first_block(at, entering);
    if !length.is_finite() {
        return None;
    }
    let code = at.work.pivotal.held.get(column).copied().unwrap_or(0);
    let pivotal = &mut at.work.pivotal;
    dense::axpy(pivotal.values, length, pivotal.direction);
    let reached = dense::at(pivotal.resting, column) + sense * length;
    let Some((position, bound)) = blocking else {
        let (lower, upper) = range(at, code);
        let bound = if sense > 0.0 { upper } else { lower };
        dense::put(at.work.pivotal.resting, column, bound);
        return Some(length);
    };
    dense::put(pivotal.values, position, reached);
    dense::put(pivotal.resting, column, bound);
    let leaving = pivotal.members.get(position).copied().unwrap_or(0);
    dense::put(pivotal.members, position, code);
    dense::put(pivotal.held, column, leaving);
    pivot(at, position, column);
    Some(length)
}

/// The blocking variable with its bound (`None` for the entering variable's own other bound), and
/// the step length.
fn first_block(at: &Iterate<'_, '_>, entering: EnteringColumn) -> (Option<(usize, f64)>, f64) {
    let pivotal = &at.work.pivotal;
    let code = pivotal.held.get(entering.column).copied().unwrap_or(0);
    let (lower, upper) = range(at, code);
    let value = dense::at(pivotal.resting, entering.column);
    let own = if entering.sense > 0.0 { upper - value } else { value - lower };
    let slight = NEGLIGIBLE * dense::norm(pivotal.direction);
    let (mut first, mut shortest, mut fastest) = (None, own, 0.0);
    for (position, &rate) in pivotal.direction.iter().enumerate() {
        if rate.abs() <= slight {
            continue;
        }
        let Some(bound) = bound_ahead(at, position, rate) else { continue };
        let value = dense::at(pivotal.values, position);
        let length = f64::max((bound - value) / rate, 0.0);
        let tie = 1e-12 * (1.0 + shortest.min(length));
        let is_tie = (length - shortest).abs() <= tie;
        // among ties the fastest, for a large pivot
        if (is_tie && rate.abs() > fastest) || (!is_tie && length < shortest) {
            (first, shortest, fastest) = (Some((position, bound)), length, rate.abs());
        }
    }
    (first, shortest)
}

/// The bound at which a basic variable that moves ends the move: what is missing may come back to
/// its range, it is not kept from leaving it further.
fn bound_ahead(at: &Iterate<'_, '_>, position: usize, rate: f64) -> Option<f64> {
    let code = at.work.pivotal.members.get(position).copied().unwrap_or(0);
    let (lower, upper) = range(at, code);
    let excess = excess(at, position);
    let bound = match rate > 0.0 {
        true if excess < 0.0 => lower,
        true if excess == 0.0 => upper,
        false if excess > 0.0 => upper,
        false if excess == 0.0 => lower,
        _ => return None,
    };
    bound.is_finite().then_some(bound)
}

/// Solves the row for the variable of the column, and puts that into the other rows.
pub(super) fn pivot(at: &mut Iterate<'_, '_>, position: usize, column: usize) {
    let n = at.n();
    let pivotal = &mut at.work.pivotal;
    let by = dense::at(pivotal.inverse, position * n + column);
    dense::copy(pivotal.pivot_row, dense::row(pivotal.inverse, n, position));
    pivotal.pivot_row.iter_mut().for_each(|entry| *entry /= -by);
    dense::put(pivotal.pivot_row, column, 1.0 / by);
    for (i, row) in pivotal.inverse.chunks_exact_mut(n).enumerate() {
        if i == position {
            dense::copy(row, pivotal.pivot_row);
            continue;
        }
        let rate = dense::at(row, column);
        if rate != 0.0 {
            dense::put(row, column, 0.0);
            dense::axpy(row, rate, pivotal.pivot_row);
        }
    }
}

/// Verifies the multipliers at the minimum of the violation with the original data.
fn proves(at: &mut Iterate<'_, '_>) -> bool {
    let n = at.n();
    at.work.neighbour.fill(0.0);
    for position in 0..n {
        let excess = excess(at, position);
        let basic = at.work.pivotal.members.get(position).and_then(|code| code.checked_sub(n));
        if let (Some(i), true) = (basic, excess != 0.0) {
            dense::put(at.work.neighbour, i, excess.signum());
        }
        let other = at.work.pivotal.held.get(position).and_then(|code| code.checked_sub(n));
        if let Some(i) = other {
            dense::put(at.work.neighbour, i, -dense::at(at.work.step, position));
        }
    }
    let slight = NEGLIGIBLE * dense::norm(at.work.neighbour);
    for i in 0..n {
        let (least, most) = range(at, n + i);
        let multiplier = dense::at(at.work.neighbour, i);
        let allowed = if multiplier > 0.0 { most == 0.0 } else { least == 0.0 };
        if !allowed || multiplier.abs() <= slight {
            dense::put(at.work.neighbour, i, 0.0);
        }
    }
    least_over_box(at) > 0.0
}

/// The least of `y'F` over the box, less what the tolerance and rounding may add; `y` is in
/// `work.neighbour`.
fn least_over_box(at: &Iterate<'_, '_>) -> f64 {
    let n = at.n();
    let work = &*at.work;
    let y = &*work.neighbour;
    let mut least = dense::dot(y, work.f);
    let mut slack: f64 = y.iter().map(|y| at.tol * y.abs()).sum();
    let mut size: f64 = y.iter().zip(work.f.iter()).map(|(y, f)| (y * f).abs()).sum();
    for j in 0..n {
        let column = || work.jacobian.iter().skip(j).step_by(n).zip(y).map(|(a, y)| a * y);
        let (slope, terms) = (column().sum::<f64>(), column().map(f64::abs).sum::<f64>());
        let (z, lower, upper) =
            (dense::at(at.z, j), dense::at(at.lower, j), dense::at(at.upper, j));
        let room = if slope > 0.0 { lower - z } else { upper - z };
        size += terms * z.abs();
        if room.is_finite() {
            least += slope * room;
            size += terms * room.abs();
        } else if slope.abs() <= NEGLIGIBLE * terms {
            slack += slope.abs() * FAR;
        } else {
            return f64::NEG_INFINITY;
        }
    }
    least - slack - n as f64 * f64::EPSILON * size
}
