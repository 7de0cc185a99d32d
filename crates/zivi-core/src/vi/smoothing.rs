//! Smoothing Newton: the projection onto the box is rounded off, less and less.
//!
//! ```text
//! H(z) = z - p_mu(w) = 0,  w = z - F(z)/c,  c_i = max_j |J_ij|
//! p_mu(w) = (l + u)/2 + (h(w - l) - h(w - u))/2,  h(a) = sqrt(a^2 + 4 mu^2),   l, u finite
//! p_mu(w) = (w + l + h(w - l))/2,  (w + u - h(w - u))/2,  w                    one or no bound
//! ((1 - D) + D J/c) d = -H,  D = p_mu'(w) in [0, 1]
//! ```
//!
//! Chen & Harker, *SIAM J. Matrix Anal. Appl.* 14 (1993) 1168-1190, Kanzow, *SIAM J. Matrix Anal.
//! Appl.* 17 (1996) 851-868; on the box after Gabriel & Moré (1997). It ends by Newton's method on
//! the active set, from the set that the rounded solution tells.

use super::active_set;
use super::dense;
use super::fischer;
use super::iterate::{Iterate, Outcome};
use super::natural::natural_component;
use super::status::Status;

/// Sufficient decrease of `|H|`, and the shortest step.
const ARMIJO: f64 = 1e-4;
const SHORTEST: f64 = 1e-6;
/// `|H|` over `mu sqrt n` from which on `mu` falls.
const NEAR: f64 = 0.5;
/// Steps of the active-set method at each crossing over.
const CROSSING: usize = 3;
/// `mu` below this, relative to the start, has no effect any more.
const NO_MORE: f64 = 1e-16;

/// One stage from where [`Iterate::begin`] has left the iterate.
pub(super) fn smoothing_newton(at: &mut Iterate<'_, '_>, limit: usize) -> Outcome<Status> {
    let root = libm::sqrt(at.n() as f64);
    let mut mu = first_mu(at);
    let least = NO_MORE * mu;
    let mut cross_at = f64::INFINITY;
    for iteration in 0..limit.min(at.settings.stage_iterations) {
        if at.is_solved() {
            return Ok(Status::Solved);
        }
        if at.out_of_iterations() {
            return Ok(Status::IterationLimit);
        }
        if at.budget.is_spent() {
            return Ok(Status::PivotLimit);
        }
        if mu <= least {
            return Ok(Status::Stalled);
        }
        at.counts.iterations += 1;
        if iteration > 0 && !at.linearise()? {
            return Ok(Status::DomainError);
        }
        scale_rows(at);
        let Some((length, size)) = newton_step(at, mu)? else {
            return Ok(at.why_stuck());
        };
        at.counts.smoothing_steps += 1;
        at.report()?;
        if size <= NEAR * mu * root {
            mu *= match length {
                1.0 => 0.1,
                t if t >= 0.25 => 0.3,
                _ => 0.6,
            };
            if mu < cross_at.min(1e-2 * f64::max(typical_size(at), mu)) || at.problem.is_affine() {
                cross_at = mu;
                if cross_over(at)? {
                    return Ok(Status::Solved);
                }
            }
        }
    }
    Ok(if at.is_solved() { Status::Solved } else { Status::IterationLimit })
}

/// `work.gradient <- c`.
fn scale_rows(at: &mut Iterate<'_, '_>) {
    let n = at.n();
    let work = &mut *at.work;
    for (c, row) in work.gradient.iter_mut().zip(dense::rows(work.jacobian, n)) {
        let size = dense::norm(row);
        *c = if size > 0.0 { size } else { 1.0 };
    }
}

/// The median of the natural map of `F/c`, or a tenth of its largest component.
fn first_mu(at: &mut Iterate<'_, '_>) -> f64 {
    scale_rows(at);
    let n = at.n();
    for i in 0..n {
        let f = dense::at(at.work.f, i) / dense::at(at.work.gradient, i);
        let bounds = (dense::at(at.lower, i), dense::at(at.upper, i));
        let size = natural_component(dense::at(at.z, i), f, bounds.0, bounds.1).abs();
        dense::put(at.work.step, i, size);
    }
    let largest = dense::norm(at.work.step);
    f64::max(median(at.work.step), 0.1 * largest)
}

/// The median of the sizes of the components.
fn typical_size(at: &mut Iterate<'_, '_>) -> f64 {
    for (size, z) in at.work.step.iter_mut().zip(at.z.iter()) {
        *size = z.abs();
    }
    median(at.work.step)
}

fn median(v: &mut [f64]) -> f64 {
    let n = v.len();
    // Shell's sort: that of the library has a panic for orders that are none
    let mut gap = n / 2;
    while gap > 0 {
        for i in gap..n {
            let (mut j, taken) = (i, dense::at(v, i));
            while j >= gap && dense::at(v, j - gap) > taken {
                let moved = dense::at(v, j - gap);
                dense::put(v, j, moved);
                j -= gap;
            }
            dense::put(v, j, taken);
        }
        gap /= 2;
    }
    dense::at(v, n / 2)
}

/// `sqrt(a^2 + 4 mu^2)` and its slope.
fn rounded(a: f64, mu: f64) -> (f64, f64) {
    let h = libm::hypot(a, 2.0 * mu);
    (h, if h > 0.0 { a / h } else { 0.0 })
}

/// `p_mu(w)` and its slope.
fn projection(w: f64, lower: f64, upper: f64, mu: f64) -> (f64, f64) {
    let (from_lower, slope_lower) = rounded(w - lower, mu);
    let (from_upper, slope_upper) = rounded(w - upper, mu);
    match (lower.is_finite(), upper.is_finite()) {
        (true, true) => {
            (0.5 * (lower + upper + from_lower - from_upper), 0.5 * (slope_lower - slope_upper))
        }
        (true, false) => (0.5 * (w + lower + from_lower), 0.5 * (1.0 + slope_lower)),
        (false, true) => (0.5 * (w + upper - from_upper), 0.5 * (1.0 - slope_upper)),
        (false, false) => (w, 1.0),
    }
}

/// `(z - p_mu(z - f/c), p_mu')`.
fn component(at: &Iterate<'_, '_>, i: usize, z: f64, f: f64, mu: f64) -> (f64, f64) {
    let w = z - f / dense::at(at.work.gradient, i);
    let (p, slope) = projection(w, dense::at(at.lower, i), dense::at(at.upper, i), mu);
    (z - p, slope)
}

/// `|H|` at the trial, which has been evaluated.
fn size_at_trial(at: &Iterate<'_, '_>, mu: f64) -> f64 {
    let squares = (0..at.n()).map(|i| {
        let (z, f) = (dense::at(at.work.trial, i), dense::at(at.work.trial_f, i));
        let (h, _) = component(at, i, z, f, mu);
        h * h
    });
    libm::sqrt(squares.sum())
}

/// One damped step; its length and `|H|` after it, `None` where there is none.
fn newton_step(at: &mut Iterate<'_, '_>, mu: f64) -> Outcome<Option<(f64, f64)>> {
    let n = at.n();
    let mut square = 0.0;
    for i in 0..n {
        let (h, slope) = component(at, i, dense::at(at.z, i), dense::at(at.work.f, i), mu);
        square += h * h;
        let work = &mut *at.work;
        dense::put(work.step, i, -h);
        if let Some(row) = work.pivotal.inverse.get_mut(i * n..(i + 1) * n) {
            let weight = slope / dense::at(work.gradient, i);
            for (entry, slope) in row.iter_mut().zip(dense::row(work.jacobian, n, i)) {
                *entry = weight * slope;
            }
            let diagonal = dense::at(row, i) + (1.0 - slope);
            dense::put(row, i, diagonal);
        }
    }
    at.budget.spend_on_factors(n);
    let work = &mut *at.work;
    if at.problem.factor(work.pivotal.inverse, n, work.pivotal.members)? <= 0.0 {
        return Ok(None);
    }
    dense::solve(work.pivotal.inverse, n, work.pivotal.members, work.step);
    if !dense::is_finite(work.step) {
        return Ok(None);
    }
    search(at, mu, libm::sqrt(square))
}

/// Halves the step until `|H|` falls.
fn search(at: &mut Iterate<'_, '_>, mu: f64, size: f64) -> Outcome<Option<(f64, f64)>> {
    let mut t = 1.0;
    while t >= SHORTEST {
        let work = &mut *at.work;
        for ((trial, z), d) in work.trial.iter_mut().zip(at.z.iter()).zip(work.step.iter()) {
            *trial = z + t * d;
        }
        dense::project(work.trial, at.lower, at.upper);
        if at.evaluate_trial()? {
            let smaller = size_at_trial(at, mu);
            if smaller <= (1.0 - ARMIJO * t) * size {
                accept(at);
                return Ok(Some((t, smaller)));
            }
        }
        t *= 0.5;
    }
    Ok(None)
}

/// Moves to the trial, which has been evaluated.
fn accept(at: &mut Iterate<'_, '_>) {
    let merit = fischer::merit(at.work.trial, at.work.trial_f, at.lower, at.upper);
    at.accept(merit.min(f64::MAX));
}

/// From the bounds that the iterate tells, a few steps with the active set by Newton's method; true
/// where they end in a solution, else the iterate is what it was.
fn cross_over(at: &mut Iterate<'_, '_>) -> Outcome<bool> {
    dense::copy(at.work.centre, at.z);
    dense::copy(at.work.trial, at.z);
    for i in 0..at.n() {
        let (lower, upper) = (dense::at(at.lower, i), dense::at(at.upper, i));
        let w = dense::at(at.z, i) - dense::at(at.work.f, i) / dense::at(at.work.gradient, i);
        if w <= lower {
            dense::put(at.work.trial, i, lower);
        } else if w >= upper {
            dense::put(at.work.trial, i, upper);
        }
    }
    for _ in 0..CROSSING {
        if !at.evaluate_trial()? {
            break;
        }
        accept(at);
        if at.is_solved() {
            return Ok(true);
        }
        if !at.linearise()? || !active_set::advance(at, 0.0)? {
            break;
        }
    }
    dense::copy(at.work.trial, at.work.centre);
    at.evaluate_trial()?;
    accept(at);
    Ok(false)
}
