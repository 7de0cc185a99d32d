//! The solver: stages of increasing patience, each checked by the recomputed residual.
//!
//! ```text
//! S0      Josephy-Newton, nonmonotone, from z0; affine problems by the active set and proximal steps
//! SM      smoothing Newton, from z0
//! S1      semismooth Newton, monotone, from z0
//! S2      proximal Josephy-Newton, ray start first, monotone, from z0
//! R0..R7  Josephy-Newton from random points around z0 and around zero, ever wider
//! E       n <= 6: every pattern of active bounds, from z0 and two of the random points
//! ```

use super::dense;
use super::iterate::Workspace;
use super::iterate::{Iterate, Outcome};
use super::newton::{is_isolated, josephy_newton, semismooth_newton, StagePlan};
use super::problem::{Interruption, Problem};
use super::settings::{
    require_finite, require_length, validate_bounds, weight, InvalidInput, Report, Settings, Stage,
    Start, Status,
};
use super::smoothing::smoothing_newton;

/// Unknowns from which the active-set method is tried: for fewer, pivots cost no more, and a path
/// is less drawn to solutions at infinity.
const WORTH_ACTIVE_SET: usize = 16;
/// Proximal weight of the first iteration of S2, relative to `1 + |J|`.
const PROXIMAL: f64 = 0.1;

/// Solves the box VI `0 in F(z) + N_[l,u](z)` from the starting point in `z`.
///
/// `z` is overwritten by the solution or the point with the smallest residual found;
/// [`Workspace::map`] is `F` there.
///
/// ```
/// use zivi_core::vi::{self, EvaluationError, Problem, Settings, Status, Workspace};
///
/// struct Parabola; // F(z) = z^2 - 2 for z >= 0
/// impl Problem for Parabola {
///     fn map(&mut self, z: &[f64], f: &mut [f64]) -> Result<(), EvaluationError> {
///         f[0] = z[0] * z[0] - 2.0;
///         Ok(())
///     }
///     fn jacobian(&mut self, z: &[f64], j: &mut [f64]) -> Result<(), EvaluationError> {
///         j[0] = 2.0 * z[0];
///         Ok(())
///     }
/// }
///
/// let (reals, indices) = vi::workspace_len(1);
/// let (mut reals, mut indices) = (vec![0.0; reals], vec![0; indices]);
/// let mut work = Workspace::new(1, &mut reals, &mut indices).unwrap();
/// let mut z = [1.0];
/// let bounds = (&[0.0][..], &[f64::INFINITY][..]);
/// let report = vi::solve(&mut Parabola, bounds, &mut z, &Settings::default(), &mut work)?;
/// assert_eq!(report.status, Status::Solved);
/// assert!((z[0] - 2f64.sqrt()).abs() < 1e-9);
/// # Ok::<(), zivi_core::vi::InvalidInput>(())
/// ```
///
/// # Errors
/// [`InvalidInput`], before `F` is called, names what is wrong and where.
pub fn solve(
    problem: &mut dyn Problem,
    (lower, upper): (&[f64], &[f64]),
    z: &mut [f64],
    settings: &Settings<'_>,
    work: &mut Workspace<'_>,
) -> Result<Report, InvalidInput> {
    let n = z.len();
    validate_bounds(n, lower, upper)?;
    require_finite("x0", z)?;
    settings.validate(n)?;
    require_length("workspace", work.f, n).map_err(|_| InvalidInput::Workspace)?;
    dense::copy(work.start, z);
    dense::project(z, lower, upper);
    let projected = z.iter().zip(work.start.iter()).any(|(a, b)| a != b);
    dense::copy(work.start, z);
    let mut at = Iterate::new(problem, settings, (lower, upper), work, z);
    let mut run =
        StageProgress { status: Status::DomainError, stage: Stage::JosephyNewton, tolerance: None };
    if let Err(interruption) = run.through_all_stages(&mut at) {
        run.interrupted(&mut at, interruption);
    }
    Ok(Report {
        status: run.status,
        residual: at.raw_residual(),
        scaled_residual: at.residual,
        tolerance: run.tolerance.unwrap_or(at.tol),
        stage: run.stage,
        counts: at.counts,
        size: dense::norm(at.z),
        convergence_ratio: at.convergence_ratio,
        projected,
    })
}

/// How far the stages have come.
struct StageProgress {
    status: Status,
    stage: Stage,
    /// The tolerance where rounding has raised it.
    tolerance: Option<f64>,
}

impl StageProgress {
    fn through_all_stages(&mut self, at: &mut Iterate<'_, '_>) -> Outcome<()> {
        let mut weights: usize = stages(at.settings).map(weight).sum();
        for stage in stages(at.settings) {
            let best_before = at.best_residual;
            at.budget.open_stage(weight(stage), weights);
            weights -= weight(stage);
            at.stage = stage;
            let status = run_stage(at)?;
            if status == Status::Infeasible {
                (self.status, self.stage) = (status, stage);
                return Ok(());
            }
            if at.best_residual < best_before || status == Status::IterationLimit {
                (self.status, self.stage) = (status, at.stage);
            }
            if status == Status::Solved || self.is_solved_to_rounding(at, best_before)? {
                return self.test_isolation(at);
            }
            if at.out_of_iterations() || at.budget.is_spent_by_all() {
                break;
            }
        }
        if at.n() <= at.settings.enumerate_up_to && !at.out_of_iterations() {
            at.stage = Stage::Enumeration;
            if enumerate(at)? {
                (self.status, self.stage) = (Status::Solved, Stage::Enumeration);
                return self.test_isolation(at);
            }
        }
        if at.best_residual.is_finite() {
            at.return_to_best()?;
        }
        Ok(())
    }

    /// A stage that cannot go on may have reached what rounding allows.
    fn is_solved_to_rounding(&mut self, at: &mut Iterate<'_, '_>, before: f64) -> Outcome<bool> {
        if at.best_residual >= before {
            return Ok(false);
        }
        at.return_to_best()?;
        if !at.linearise()? {
            return Ok(false);
        }
        self.tolerance = at.is_within_rounding();
        if self.tolerance.is_some() && !at.rows_are_as_steep()? {
            self.tolerance = None;
        }
        if self.tolerance.is_some() {
            self.status = Status::Solved;
        }
        Ok(self.tolerance.is_some())
    }

    fn test_isolation(&mut self, at: &mut Iterate<'_, '_>) -> Outcome<()> {
        if at.settings.test_isolation && !is_isolated(at)? {
            self.status = Status::SolvedNotIsolated;
        }
        Ok(())
    }

    /// Whatever interrupted the solve, the best point is kept; a solution remains one.
    fn interrupted(&mut self, at: &mut Iterate<'_, '_>, why: Interruption) {
        if why == Interruption::Stopped {
            if self.status.is_success() {
                return;
            }
            self.status = Status::Stopped;
            if at.evaluate_best().is_ok() {
                return;
            }
        }
        self.status = Status::EvaluationError;
        at.give_up();
    }
}

/// The stages that are switched on, in their order.
fn stages<'a>(settings: &'a Settings<'_>) -> impl Iterator<Item = Stage> + use<'a> {
    let fixed = [
        (settings.josephy_newton, Stage::JosephyNewton),
        (settings.smoothing, Stage::Smoothing),
        (settings.semismooth, Stage::Semismooth),
        (settings.proximal, Stage::Proximal),
    ];
    let restarts = (0..settings.restarts).map(|k| Stage::Restart(k as u8));
    fixed.into_iter().filter_map(|(on, stage)| on.then_some(stage)).chain(restarts)
}

fn run_stage(at: &mut Iterate<'_, '_>) -> Outcome<Status> {
    dense::copy(at.work.trial, at.work.start);
    if let Stage::Restart(k) = at.stage {
        at.counts.restarts += 1;
        at.scatter(k);
    }
    if !at.begin()? {
        return Ok(Status::DomainError);
    }
    let is_first = at.counts.iterations == 0;
    if is_first && at.problem.is_affine() && !at.is_solved() && has_unsatisfiable_row(at) {
        return Ok(Status::Infeasible);
    }
    let settings = at.settings;
    let plan = StagePlan {
        start: settings.first_start,
        active_set: settings.active_set && at.n() >= WORTH_ACTIVE_SET,
        proximal: 0.0,
        memory: settings.memory,
    };
    match at.stage {
        Stage::Smoothing if at.was_smoothed => Ok(Status::Stalled),
        Stage::Smoothing => smoothing_newton(at, usize::MAX),
        Stage::Semismooth => semismooth_newton(at),
        Stage::Proximal => josephy_newton(
            at,
            StagePlan { start: Start::Ray, active_set: false, proximal: PROXIMAL, memory: 1 },
        ),
        _ => josephy_newton(at, plan),
    }
}

// Rows of an affine map that no point of the box satisfies.
//
// ```text
// sup F_i = F_i(z) + sum_j max(J_ij (l_j - z_j), J_ij (u_j - z_j))
// sup F_i < 0 and u_i = +inf:   F_i >= 0 is needed wherever z_i is, and impossible
// inf F_i > 0 and l_i = -inf:   the same with the signs turned
// ```

/// True when some row violates the tolerance everywhere in the box: a proof, by more than the
/// rounding of the sums, that there is no solution. The iterate must be linearised, `F` affine.
pub(super) fn has_unsatisfiable_row(at: &Iterate<'_, '_>) -> bool {
    let n = at.n();
    (0..n).any(|i| {
        let above = dense::at(at.upper, i) == f64::INFINITY && stays_below_zero(at, i, 1.0);
        above || dense::at(at.lower, i) == f64::NEG_INFINITY && stays_below_zero(at, i, -1.0)
    })
}

/// True when `sup (sign F_i)` over the box is below zero by more than the tolerance; false if
/// infinite or undefined.
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

// Small problems by brute force: every pattern of active bounds, Newton on the rows between.
//
// A pattern holds each component at its lower bound, at its upper bound, or inside; inside,
// `F_i = 0`. Whatever Newton finds must pass the natural residual of the whole problem.

/// Most unknowns for which patterns are enumerated: `3^6 = 729` of them.
pub(super) const MOST: usize = 6;
/// Newton iterations for one pattern.
const ITERATIONS: usize = 40;
/// Halvings of one Newton step.
const HALVINGS: usize = 10;
/// Beyond this an iterate is on its way to infinity.
const FAR: f64 = 1e15;

/// Where a component is held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum HeldAt {
    Inside,
    Lower,
    Upper,
}

/// Tries all patterns from the starting point and from two of the restarts; true when the iterate
/// is a solution.
pub(super) fn enumerate(at: &mut Iterate<'_, '_>) -> Outcome<bool> {
    for scattered in [None, Some(3), Some(4)] {
        dense::copy(at.work.trial, at.work.start);
        if let Some(k) = scattered {
            at.scatter(k);
        }
        dense::copy(at.work.centre, at.work.trial);
        if all_patterns(at)? {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Tries all patterns from `work.centre`.
fn all_patterns(at: &mut Iterate<'_, '_>) -> Outcome<bool> {
    let mut pattern = [HeldAt::Inside; MOST];
    loop {
        if is_admissible(at, &pattern) && newton_on_pattern(at, &pattern)? {
            return Ok(true);
        }
        if at.out_of_iterations() || !next_pattern(&mut pattern, at.n()) {
            return Ok(false);
        }
    }
}

/// The next pattern, counting in base three; false after the last.
fn next_pattern(pattern: &mut [HeldAt; MOST], n: usize) -> bool {
    for place in pattern.iter_mut().take(n) {
        *place = match *place {
            HeldAt::Inside => HeldAt::Lower,
            HeldAt::Lower => HeldAt::Upper,
            HeldAt::Upper => HeldAt::Inside,
        };
        if *place != HeldAt::Inside {
            return true;
        }
    }
    false
}

/// No component at an infinite bound; a fixed one at its bound, once.
fn is_admissible(at: &Iterate<'_, '_>, pattern: &[HeldAt; MOST]) -> bool {
    at.lower.iter().zip(at.upper).zip(pattern).all(|((&lower, &upper), place)| match place {
        HeldAt::Inside => lower < upper,
        HeldAt::Lower => lower.is_finite(),
        HeldAt::Upper => upper.is_finite() && lower < upper,
    })
}

/// Damped Newton on the rows inside; true when its end solves the whole problem.
fn newton_on_pattern(at: &mut Iterate<'_, '_>, pattern: &[HeldAt; MOST]) -> Outcome<bool> {
    dense::copy(at.work.trial, at.work.centre);
    for (i, place) in pattern.iter().enumerate().take(at.n()) {
        match place {
            HeldAt::Lower => dense::put(at.work.trial, i, dense::at(at.lower, i)),
            HeldAt::Upper => dense::put(at.work.trial, i, dense::at(at.upper, i)),
            HeldAt::Inside => {}
        }
    }
    if !at.evaluate_trial()? {
        return Ok(false);
    }
    let mut size = inside_norm(at, pattern);
    for _ in 0..ITERATIONS {
        if trial_is_solution(at)? {
            return Ok(true);
        }
        if at.out_of_iterations() {
            return Ok(false);
        }
        at.counts.iterations += 1;
        if !inside_direction(at, pattern)? {
            return Ok(false);
        }
        match damped_step(at, pattern, size)? {
            Some(smaller) => size = smaller,
            None => return trial_is_solution(at),
        }
        at.report()?;
        if dense::norm(at.work.trial) > FAR {
            return Ok(false);
        }
    }
    trial_is_solution(at)
}

/// True, and the iterate moved there, when the evaluated trial solves the problem.
fn trial_is_solution(at: &mut Iterate<'_, '_>) -> Outcome<bool> {
    let work = &*at.work;
    let residual = super::natural_residual(work.trial, work.trial_f, at.lower, at.upper);
    if residual.is_nan() || residual > at.tol || dense::norm(work.trial) > FAR {
        return Ok(false);
    }
    dense::project(at.work.trial, at.lower, at.upper);
    let merit = at.merit_of_trial()?;
    if !merit.is_finite() {
        return Ok(false);
    }
    at.accept(merit);
    Ok(at.is_solved())
}

/// `max |F_i|` over the rows inside.
fn inside_norm(at: &Iterate<'_, '_>, pattern: &[HeldAt; MOST]) -> f64 {
    at.work.trial_f.iter().zip(pattern).fold(0.0, |size, (f, place)| match place {
        HeldAt::Inside => f64::max(size, f.abs()),
        _ => size,
    })
}

/// `work.step <- -J_II^-1 F_I`, zero on the rows held; false where `J_II` is singular.
fn inside_direction(at: &mut Iterate<'_, '_>, pattern: &[HeldAt; MOST]) -> Outcome<bool> {
    let n = at.n();
    if !at.jacobian_at_trial()? {
        return Ok(false);
    }
    let work = &mut *at.work;
    for (i, row) in work.pivotal.inverse.chunks_exact_mut(n).enumerate() {
        let inside = pattern.get(i) == Some(&HeldAt::Inside);
        row.fill(0.0);
        if inside {
            dense::copy(row, dense::row(work.jacobian, n, i));
            row.iter_mut().zip(pattern).for_each(|(entry, place)| {
                if *place != HeldAt::Inside {
                    *entry = 0.0;
                }
            });
        } else {
            dense::put(row, i, 1.0);
        }
        dense::put(work.step, i, if inside { -dense::at(work.trial_f, i) } else { 0.0 });
    }
    let regular = at.problem.factor(work.pivotal.inverse, n, work.pivotal.members)? > 0.0;
    if regular {
        dense::solve(work.pivotal.inverse, n, work.pivotal.members, work.step);
    }
    Ok(regular && dense::is_finite(work.step))
}

/// Halves the step until the rows inside shrink; `None` with the iterate restored if they do not.
fn damped_step(
    at: &mut Iterate<'_, '_>,
    pattern: &[HeldAt; MOST],
    size: f64,
) -> Outcome<Option<f64>> {
    dense::copy(at.work.point, at.work.trial);
    let mut t = 1.0;
    for _ in 0..HALVINGS {
        dense::copy(at.work.trial, at.work.point);
        dense::axpy(at.work.trial, t, at.work.step);
        if at.evaluate_trial()? {
            let smaller = inside_norm(at, pattern);
            if smaller < size {
                return Ok(Some(smaller));
            }
        }
        t *= 0.5;
    }
    dense::copy(at.work.trial, at.work.point);
    at.evaluate_trial()?;
    Ok(None)
}

#[cfg(test)]
#[allow(clippy::indexing_slicing)]
mod enumerate_tests {
    use super::*;

    #[test]
    fn all_patterns_come_once() {
        for n in 0..=4 {
            let (mut pattern, mut seen) = ([HeldAt::Inside; MOST], [0; 81]);
            loop {
                let number = pattern.iter().take(n).fold(0, |number, place| {
                    let digit = match place {
                        HeldAt::Inside => 0,
                        HeldAt::Lower => 1,
                        HeldAt::Upper => 2,
                    };
                    3 * number + digit
                });
                seen[number] += 1;
                if !next_pattern(&mut pattern, n) {
                    break;
                }
            }
            let all = 3_usize.pow(n as u32);
            assert!(seen[..all].iter().all(|&count| count == 1), "{n} {seen:?}");
        }
    }
}
