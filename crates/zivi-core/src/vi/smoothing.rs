//! Smoothing Newton and proximal Josephy-Newton methods.
//!
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

use super::iterate::{Iterate, Outcome};
use super::natural::natural_component;
use super::settings::Status;
use super::{active_set, dense, natural};

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

/// One damped step; its length and `|H|` after it, `None` without one.
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
    let merit = natural::merit(at.work.trial, at.work.trial_f, at.lower, at.upper);
    at.accept(merit.min(f64::MAX));
}

/// A few Newton steps on the active set indicated by the iterate; true if they end in a solution,
/// otherwise the iterate is unchanged.
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

// The proximal point method for affine problems whose active set cycles: singular monotone ones.
//
// ```text
// 0 in M z+ + q + mu W (z+ - z) + N_[l,u](z+),    W = diag |M_ii|,   mu = 0.1, 0.01, ...
// ```
//
// Each step is solved by Newton's method on the active set from that of the last, and is regular
// where `M` is monotone, whatever its rank; the steps then tend to a solution, wherever there is one
// (Rockafellar, *SIAM J. Control Optim.* 14 (1976) 877-898). Contacts in excess of the degrees of
// freedom, `M = G W G'`, are such problems.

/// Weight of the first step and the least.
const FIRST: f64 = 0.1;
const LEAST: f64 = 1e-8;
/// Reduction factor per step.
const FALL: f64 = 0.1;
/// Reduction factor once an active set has cycled, and growth factors in that case, before and
/// after the first step.
const SLOW_FALL: f64 = 0.5;
const FIRST_GROWTH: f64 = 10.0;
const GROWTH: f64 = 3.0;
/// Diagonal entries that are smaller, relative to their row, are replaced by its largest.
const SMALL: f64 = 1e-3;
/// Steps in a row without a residual half as large as any before, after which it is given up.
const PATIENCE: usize = 4;
/// Most steps, those whose active set cycles included.
const STEPS: usize = 100;
/// Active sets that may cycle: before the first step, and between two such residuals.
const AT_FIRST: usize = 1;
const BETWEEN: usize = 4;
/// `(z+ - z).(F(z+) - F(z))` below this, relative to its terms, is none of a monotone problem.
const NEGATIVE: f64 = -1e-9;

/// How the steps ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ProximalEnd {
    /// At a solution.
    Solved,
    /// Each succeeded, but the sequence diverges: iterates drift if a solution does not exist.
    Drifts,
    /// Nowhere: active sets cycle, or the problem is not monotone.
    GivenUp,
}

/// Steps until the problem is solved, or they are given up. The iterate must be linearised, `F` affine.
pub(super) fn proximal_newton(at: &mut Iterate<'_, '_>) -> Outcome<ProximalEnd> {
    weigh(at);
    let (mut weight, mut fall, mut best) = (FIRST, FALL, f64::INFINITY);
    let (mut cycles, mut since) = (0, 0);
    for _ in 0..STEPS {
        if at.out_of_iterations() || at.budget.is_spent() {
            return Ok(ProximalEnd::GivenUp);
        }
        if !active_set::advance(at, weight)? {
            cycles += 1;
            if cycles > if best.is_finite() { BETWEEN } else { AT_FIRST } {
                return Ok(ProximalEnd::GivenUp);
            }
            weight *= if best.is_finite() { GROWTH } else { FIRST_GROWTH };
            (fall, since) = (SLOW_FALL, 0);
            continue;
        }
        let merit = at.merit_of_trial()?;
        // later steps may be long, and tell rounding
        let is_first = !best.is_finite();
        if !merit.is_finite() || is_first && !step_is_monotone(at) {
            return Ok(ProximalEnd::GivenUp);
        }
        at.accept(merit);
        at.counts.iterations += 1;
        at.report()?;
        if at.is_solved() {
            return Ok(ProximalEnd::Solved);
        }
        since += 1;
        if at.residual < 0.5 * best {
            (best, since, cycles) = (at.residual, 0, 0);
        }
        if since >= PATIENCE {
            return Ok(ProximalEnd::Drifts);
        }
        weight = f64::max(fall * weight, LEAST);
    }
    Ok(ProximalEnd::GivenUp)
}

/// Whether `F` does not fall along the step to the trial, which has been evaluated.
fn step_is_monotone(at: &Iterate<'_, '_>) -> bool {
    let work = &*at.work;
    let moves = work.trial.iter().zip(at.z.iter()).map(|(there, here)| there - here);
    let changes = work.trial_f.iter().zip(work.f.iter()).map(|(there, here)| there - here);
    let (mut sum, mut size) = (0.0, 0.0);
    for ((d, change), scale) in moves.zip(changes).zip(work.scale.iter()) {
        let term = d * change / scale;
        sum += term;
        size += term.abs();
    }
    sum >= NEGATIVE * size
}

/// `work.weights <- W`, the largest entry of a row where its diagonal is next to nothing.
fn weigh(at: &mut Iterate<'_, '_>) {
    let n = at.n();
    let work = &mut *at.work;
    let rows = dense::rows(work.jacobian, n).enumerate();
    for (weight, (i, row)) in work.weights.iter_mut().zip(rows) {
        let (diagonal, largest) = (dense::at(row, i).abs(), dense::norm(row));
        *weight = match diagonal > SMALL * largest {
            true => diagonal,
            false if largest > 0.0 => largest,
            false => 1.0,
        };
    }
}

#[cfg(test)]
#[allow(clippy::indexing_slicing, clippy::unwrap_used)]
mod proximal_tests {
    extern crate std;
    use super::super::iterate::{workspace_len, Workspace};
    use super::super::problem::Affine;
    use super::super::settings::{RowScale, Settings};
    use super::*;
    use std::vec;
    use std::vec::Vec;

    /// How the steps from zero end, where, and how many there were.
    fn end(
        matrix: &[f64],
        q: &[f64],
        (lower, upper): (f64, f64),
        settings: Settings<'_>,
    ) -> (ProximalEnd, Vec<f64>, usize) {
        let n = q.len();
        let (reals, indices) = workspace_len(n);
        let (mut reals, mut indices) = (vec![f64::NAN; reals], vec![usize::MAX; indices]);
        let mut work = Workspace::new(n, &mut reals, &mut indices).unwrap();
        let (lower, upper, mut z) = (vec![lower; n], vec![upper; n], vec![0.0; n]);
        let mut problem = Affine { matrix, q };
        let bounds = (&lower[..], &upper[..]);
        let mut at = Iterate::new(&mut problem, &settings, bounds, &mut work, &mut z);
        dense::copy(at.work.trial, at.z);
        assert!(at.begin().unwrap());
        let end = proximal_newton(&mut at).unwrap();
        let steps = at.counts.iterations;
        (end, z, steps)
    }

    const HALF: (f64, f64) = (0.0, f64::INFINITY);

    #[test]
    fn singular_monotone_problems_are_solved_or_told_to_have_no_solution() {
        // x + y = 1: of all solutions that between the axes
        let (how, z, steps) = end(&[1.0, 1.0, 1.0, 1.0], &[-1.0, -1.0], HALF, Settings::default());
        assert_eq!(how, ProximalEnd::Solved);
        assert!(z.iter().all(|z| (z - 0.5).abs() < 1e-9), "{z:?}");
        assert!((2..8).contains(&steps), "{steps}");
        // F = +-(x - y) - 1: both grow without bound
        let (how, _, steps) =
            end(&[1.0, -1.0, -1.0, 1.0], &[-1.0, -1.0], HALF, Settings::default());
        assert_eq!((how, steps), (ProximalEnd::Drifts, 1 + PATIENCE));
        // zeros on the diagonal: a saddle, x = 2, y = 1; and a row without any slope
        let skew = [0.0, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let (how, z, _) = end(&skew, &[-1.0, 2.0, 3.0], HALF, Settings::default());
        assert_eq!(how, ProximalEnd::Solved);
        assert!((z[0] - 2.0).abs() < 1e-8 && (z[1] - 1.0).abs() < 1e-8 && z[2] == 0.0, "{z:?}");
    }

    #[test]
    fn a_first_step_along_which_f_falls_is_none_of_a_monotone_problem() {
        let (how, z, steps) = end(&[-1.0], &[0.5], (-1.0, 1.0), Settings::default());
        assert_eq!((how, z, steps), (ProximalEnd::GivenUp, vec![0.0], 0));
        // F grows along this one, whatever scales its rows: with them it would seem to fall
        let matrix = [1.0, 0.0, -1.8, 1.0];
        let scale = [1.0, 100.0];
        for row_scale in [RowScale::Unit, RowScale::Given(&scale)] {
            let settings = Settings { row_scale, ..Settings::default() };
            let (how, z, _) = end(&matrix, &[-1.0, 0.9], (-9.0, 9.0), settings);
            assert_eq!(how, ProximalEnd::Solved);
            assert!((z[0] - 1.0).abs() < 1e-8 && (z[1] - 0.9).abs() < 1e-8, "{z:?}");
        }
    }

    #[test]
    fn the_first_step_is_that_of_the_formula() {
        // weights: the diagonal, or the largest of a row that has next to none on it
        for (row, weight) in [([2.0, 5.0], 2.0), ([1e-3, 5.0], 5.0)] {
            let ([a, b], c) = (row, 3.0);
            let settings = Settings { max_iterations: 1, ..Settings::default() };
            let all = (f64::NEG_INFINITY, f64::INFINITY);
            let (how, z, steps) = end(&[a, b, -b, c], &[-1.0, -2.0], all, settings);
            assert_eq!((how, steps), (ProximalEnd::GivenUp, 1));
            // (M + mu W) z = (1, 2)
            let (a, c) = (a + FIRST * weight, c + FIRST * c);
            let determinant = a * c + b * b;
            let exact = [(c - 2.0 * b) / determinant, (b + 2.0 * a) / determinant];
            assert!(z.iter().zip(exact).all(|(z, exact)| (z - exact).abs() < 1e-14), "{z:?}");
        }
    }

    #[test]
    fn units_change_no_step() {
        let skew = [0.0, 1.0, 0.5, -1.0, 0.0, 0.25, -0.5, -0.25, 0.0];
        let q = [-1.0, 2.0, 0.125];
        let plain = end(&skew, &q, HALF, Settings::default());
        assert_eq!(plain.0, ProximalEnd::Solved);
        for unit in [1.0 / 1024.0, 1024.0] {
            let scale = [1.0 / unit; 3];
            let settings = Settings { row_scale: RowScale::Given(&scale), ..Settings::default() };
            let found = end(&skew.map(|m| m * unit), &q.map(|q| q * unit), HALF, settings);
            assert_eq!(found, plain);
        }
    }

    #[test]
    fn a_row_without_slopes_is_held_where_it_is() {
        let (how, z, _) =
            end(&[1.0, 0.0, 0.0, 0.0], &[-0.5, 0.0], (-1.0, 1.0), Settings::default());
        assert_eq!(how, ProximalEnd::Solved);
        assert!((z[0] - 0.5).abs() < 1e-8 && z[1] == 0.0, "{z:?}");
    }

    #[test]
    fn rounding_makes_no_problem_one_that_is_not_monotone() {
        // skew: (z+ - z).(F(z+) - F(z)) is zero but for rounding, of either sign
        for k in 0..60 {
            let [a, b, c] = [0.3, 0.7, 1.1].map(|m| m + 0.1 * f64::from(k));
            let skew = [0.0, a, b, c, -a, 0.0, c, -b, -b, -c, 0.0, a, -c, b, -a, 0.0];
            let q = [0.3, -0.7, 0.9, 0.1];
            let (how, z, _) = end(&skew, &q, (-99.0, 99.0), Settings::default());
            assert_eq!(how, ProximalEnd::Solved, "{k}");
            for (row, q) in dense::rows(&skew, 4).zip(q) {
                assert!((dense::dot(row, &z) + q).abs() < 1e-7);
            }
        }
    }
}
