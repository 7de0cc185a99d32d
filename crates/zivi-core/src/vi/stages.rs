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

use super::budget::weight;
use super::dense;
use super::descent::semismooth_newton;
use super::enumerate::enumerate;
use super::feasible::has_unsatisfiable_row;
use super::interruption::Interruption;
use super::isolation::is_isolated;
use super::iterate::{Iterate, Outcome};
use super::newton::{josephy_newton, Plan};
use super::problem::Problem;
use super::settings::Start;
use super::settings::{Report, Settings, Stage};
use super::smoothing::smoothing_newton;
use super::status::{InvalidInput, Status};
use super::validate::{require_finite, require_length, validate_bounds};
use super::workspace::Workspace;

/// Unknowns from which the active-set method is tried: for fewer, pivots cost no more, and a path
/// is less drawn to solutions at infinity.
const WORTH_ACTIVE_SET: usize = 16;
/// Proximal weight of the first iteration of S2, relative to `1 + |J|`.
const PROXIMAL: f64 = 0.1;

/// Solves the box VI `0 in F(z) + N_[l,u](z)` from the starting point in `z`.
///
/// `z` is overwritten by the solution, or by the point with the smallest residual that was
/// found; [`Workspace::map`] is `F` there.
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
    let mut run = Run { status: Status::DomainError, stage: Stage::JosephyNewton, tolerance: None };
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
struct Run {
    status: Status,
    stage: Stage,
    /// The tolerance where rounding has raised it.
    tolerance: Option<f64>,
}

impl Run {
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
    let plan = Plan {
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
            Plan { start: Start::Ray, active_set: false, proximal: PROXIMAL, memory: 1 },
        ),
        _ => josephy_newton(at, plan),
    }
}
