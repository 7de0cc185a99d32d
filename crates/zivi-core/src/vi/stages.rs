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

use crate::vi::natural::{natural_component, natural_residual, worst_component};
use crate::vi::newton::{is_isolated, josephy_newton, semismooth_newton, Plan};
use crate::vi::problem::{Interruption, Problem, Progress};
use crate::vi::settings::{
    require_finite, require_length, validate_bounds, weight, Budget, Counts, InvalidInput, Report,
    RowScale, Settings, Stage, Start, Status,
};
use crate::vi::smoothing::smoothing_newton;
use crate::vi::workspace::Workspace;
use crate::vi::{newton, workspace};

// The solver: stages of increasing patience, each checked by the recomputed residual.
//
// ```text
// S0      Josephy-Newton, nonmonotone, from z0; affine problems by the active set and proximal steps
// SM      smoothing Newton, from z0
// S1      semismooth Newton, monotone, from z0
// S2      proximal Josephy-Newton, ray start first, monotone, from z0
// R0..R7  Josephy-Newton from random points around z0 and around zero, ever wider
// E       n <= 6: every pattern of active bounds, from z0 and two of the random points
// ```

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
    workspace::copy(work.start, z);
    workspace::project(z, lower, upper);
    let projected = z.iter().zip(work.start.iter()).any(|(a, b)| a != b);
    workspace::copy(work.start, z);
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
        size: workspace::norm(at.z),
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
    workspace::copy(at.work.trial, at.work.start);
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

// The iterate of the outer methods: where it is, what it costs to move, the best point so far.

/// What stops a stage: nothing but the caller does so from within.
pub(super) type Outcome<T> = Result<T, Interruption>;

/// Half-widths by which a start is pushed off its bounds while `F` is not finite there.
const PUSHES: [f64; 5] = [0.0, 1e-6, 1e-3, 1e-1, 1.0];

/// A point `z` in the box with `F(z)`, its merit and, once linearised, its Jacobian.
pub(super) struct Iterate<'a, 'w> {
    pub(super) problem: &'a mut dyn Problem,
    pub(super) settings: &'a Settings<'a>,
    pub(super) lower: &'a [f64],
    pub(super) upper: &'a [f64],
    pub(super) work: &'a mut Workspace<'w>,
    pub(super) z: &'a mut [f64],
    pub(super) merit: f64,
    pub(super) residual: f64,
    pub(super) convergence_ratio: f64,
    pub(super) best_residual: f64,
    /// Largest residual of a solution: `tol`, or `rtol` times the residual of the start.
    pub(super) tol: f64,
    pub(super) stage: Stage,
    /// `work.jacobian` was filled in this stage, or is that of an affine `F`.
    pub(super) jacobian_is_known: bool,
    /// `work.jacobian` is regular on the rows that the active set holds inside, by the pivots there.
    pub(super) inside_is_regular: bool,
    /// The proximal point method was tried before the paths.
    pub(super) was_proximal: bool,
    /// The smoothing Newton method was tried before the paths.
    pub(super) was_smoothed: bool,
    /// It was tried to prove that there is no solution.
    pub(super) proof_was_sought: bool,
    rows_await_scaling: bool,
    tolerance_awaits_start: bool,
    pub(super) budget: Budget,
    pub(super) counts: Counts,
}

impl<'a, 'w> Iterate<'a, 'w> {
    pub(super) fn new(
        problem: &'a mut dyn Problem,
        settings: &'a Settings<'a>,
        (lower, upper): (&'a [f64], &'a [f64]),
        work: &'a mut Workspace<'w>,
        z: &'a mut [f64],
    ) -> Self {
        let n = z.len();
        work.scale.fill(1.0);
        if let RowScale::Given(scale) = settings.row_scale {
            workspace::copy(work.scale, scale);
        }
        work.f.fill(f64::NAN);
        workspace::copy(work.best, z);
        Self {
            problem,
            settings,
            lower,
            upper,
            work,
            z,
            merit: f64::NAN,
            residual: f64::NAN,
            convergence_ratio: f64::NAN,
            best_residual: f64::INFINITY,
            tol: settings.tol,
            stage: Stage::JosephyNewton,
            jacobian_is_known: false,
            inside_is_regular: false,
            was_proximal: false,
            was_smoothed: false,
            proof_was_sought: false,
            rows_await_scaling: settings.row_scale == RowScale::Jacobian,
            tolerance_awaits_start: settings.rtol > 0.0,
            budget: Budget::new(settings.total_pivot_limit(n)),
            counts: Counts::default(),
        }
    }

    pub(super) fn n(&self) -> usize {
        self.z.len()
    }

    /// True when the iterate solves the problem: by its residual, nothing else.
    pub(super) fn is_solved(&self) -> bool {
        self.residual <= self.tol
    }

    pub(super) fn out_of_iterations(&self) -> bool {
        self.counts.iterations >= self.settings.max_iterations
    }

    /// What is left of the pivots for one affine solve.
    pub(super) fn pivots_left(&self) -> usize {
        self.budget.left().min(self.settings.pivot_limit(self.n(), self.counts.iterations <= 1))
    }

    /// True where the stage makes no progress, or can make none for the rounding of `F`.
    pub(super) fn has_stalled(&self, progress: &mut Stagnation) -> bool {
        let stalled = progress.has_stalled(self.merit);
        let at_rounding = || progress.is_slow() && self.is_within_rounding().is_some();
        !self.is_solved() && (stalled || at_rounding())
    }

    /// Why no step could be made: there was none, or its budget is spent.
    pub(super) fn why_stuck(&self) -> Status {
        if self.budget.is_spent() {
            Status::PivotLimit
        } else {
            Status::Stationary
        }
    }

    /// Tells the caller's monitor about the evaluated point at which an iteration has ended:
    /// `work.trial` in all stages.
    pub(super) fn report(&mut self) -> Outcome<()> {
        let (z, f) = (&*self.work.trial, &*self.work.trial_f);
        self.problem.monitor(&Progress {
            iteration: self.counts.iterations,
            residual: natural_residual(z, f, self.lower, self.upper),
            worst: worst_component(z, f, self.lower, self.upper),
            stage: self.stage,
        })
    }

    /// `F` at `work.trial`, scaled, into `work.trial_f`. False where it is not finite.
    pub(super) fn evaluate_trial(&mut self) -> Outcome<bool> {
        self.problem.poll()?;
        self.counts.f += 1;
        self.problem.map(self.work.trial, self.work.trial_f)?;
        workspace::scale(self.work.trial_f, self.work.scale);
        Ok(workspace::is_finite(self.work.trial_f))
    }

    /// The merit at `work.trial`; infinite where `F` is not finite.
    pub(super) fn merit_of_trial(&mut self) -> Outcome<f64> {
        let finite = self.evaluate_trial()?;
        let merit = newton::merit(self.work.trial, self.work.trial_f, self.lower, self.upper);
        // squares may overflow where F does not
        Ok(if finite { merit.min(f64::MAX) } else { f64::INFINITY })
    }

    /// Moves to `work.trial`, which has been evaluated.
    pub(super) fn accept(&mut self, merit: f64) {
        workspace::copy(self.z, self.work.trial);
        workspace::copy(self.work.f, self.work.trial_f);
        let before = self.residual;
        self.merit = merit;
        self.residual = natural_residual(self.z, self.work.f, self.lower, self.upper);
        self.convergence_ratio = self.residual / before;
        if self.residual < self.best_residual {
            self.best_residual = self.residual;
            workspace::copy(self.work.best, self.z);
        }
    }

    /// Begins a stage at `work.trial`, pushed off its bounds as far as `F` and its Jacobian need.
    /// False where they are finite nowhere tried.
    pub(super) fn begin(&mut self) -> Outcome<bool> {
        workspace::copy(self.work.point, self.work.trial);
        self.jacobian_is_known &= self.problem.is_affine();
        for push in PUSHES {
            self.push_from_bounds(push);
            self.residual = f64::NAN;
            let merit = self.merit_of_trial()?;
            if !merit.is_finite() {
                continue;
            }
            self.accept(merit);
            if self.tolerance_awaits_start && !self.rows_await_scaling {
                self.set_relative_tolerance();
            }
            if self.is_solved() && !self.rows_await_scaling {
                return Ok(true);
            }
            if self.linearise()? {
                if self.rows_await_scaling {
                    self.scale_rows_by_jacobian()?;
                }
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// `trial <- P(c + 10^(k/2 - 1) max(1, |c|) r)`, `r` uniform on `[-1, 1]^n` from a fixed seed;
    /// the centre `c` is `z0` and, for odd `k`, the point of the box nearest to zero (`F` may be
    /// hopeless around `z0`).
    pub(super) fn scatter(&mut self, k: u8) {
        workspace::copy(self.work.trial, self.work.start);
        let spread = libm::pow(10.0, 0.5 * f64::from(k) - 1.0);
        let mut random = Random::new(u64::from(k) + 1);
        if k % 2 == 1 {
            self.work.trial.fill(0.0);
            workspace::project(self.work.trial, self.lower, self.upper);
        }
        for z in self.work.trial.iter_mut() {
            *z += spread * f64::max(1.0, z.abs()) * (2.0 * random.uniform() - 1.0);
        }
        workspace::project(self.work.trial, self.lower, self.upper);
    }

    /// `trial <- point`, at least `push` times the width (at most 1) away from finite bounds.
    fn push_from_bounds(&mut self, push: f64) {
        let bounds = self.lower.iter().zip(self.upper);
        let points = self.work.trial.iter_mut().zip(self.work.point.iter());
        for ((trial, &point), (&lower, &upper)) in points.zip(bounds) {
            let distance = f64::min(push * f64::min(upper - lower, 1.0), 0.5 * (upper - lower));
            *trial = point.max(lower + distance).min(upper - distance).max(lower).min(upper);
        }
    }

    /// Sets `sigma_i = 1/max_j |J_ij|` from the Jacobian at the iterate and re-evaluates there.
    fn scale_rows_by_jacobian(&mut self) -> Outcome<()> {
        for (scale, row) in
            self.work.scale.iter_mut().zip(workspace::rows(self.work.jacobian, self.z.len()))
        {
            let size = workspace::norm(row);
            *scale = if size > 0.0 && size.is_finite() { 1.0 / size } else { 1.0 };
        }
        self.rows_await_scaling = false;
        self.jacobian_is_known = false;
        self.best_residual = f64::INFINITY;
        workspace::copy(self.work.trial, self.z);
        let merit = self.merit_of_trial()?;
        self.accept(merit);
        self.linearise()?;
        if self.tolerance_awaits_start {
            self.set_relative_tolerance();
        }
        Ok(())
    }

    /// `max(tol, rtol r)` with the residual `r` of the start.
    fn set_relative_tolerance(&mut self) {
        self.tol = f64::max(self.settings.tol, self.settings.rtol * self.residual);
        self.tolerance_awaits_start = false;
    }

    /// Makes the best point of all stages the iterate.
    pub(super) fn return_to_best(&mut self) -> Outcome<()> {
        workspace::copy(self.work.trial, self.work.best);
        let (merit, ratio) = (self.merit_of_trial()?, self.convergence_ratio);
        self.accept(merit);
        self.convergence_ratio = ratio;
        Ok(())
    }

    /// `F` at the best point of an interrupted solve, whatever the monitor says.
    pub(super) fn evaluate_best(&mut self) -> Outcome<()> {
        workspace::copy(self.z, self.work.best);
        self.work.f.fill(f64::NAN);
        if self.best_residual.is_finite() {
            self.counts.f += 1;
            self.problem.map(self.z, self.work.f)?;
            workspace::scale(self.work.f, self.work.scale);
        }
        self.residual = natural_residual(self.z, self.work.f, self.lower, self.upper);
        Ok(())
    }

    /// The tolerance raised to rounding, if with it the iterate is a solution: where a component
    /// of the natural map exceeds `tol`, `F_i` is within ten roundings of its row of zero,
    /// `|F_i| <= 10 eps sum_j |J_ij z_j|`, `eps` the rounding of `F`. A given Jacobian is believed:
    /// see [`Iterate::rows_are_as_steep`].
    pub(super) fn is_within_rounding(&self) -> Option<f64> {
        let (mut reached, rounding) = (self.tol, 10.0 * self.problem.rounding());
        for (i, row) in workspace::rows(self.work.jacobian, self.n()).enumerate() {
            let (z, f) = (workspace::at(self.z, i), workspace::at(self.work.f, i));
            let (lower, upper) = (workspace::at(self.lower, i), workspace::at(self.upper, i));
            if natural_component(z, f, lower, upper).abs() <= self.tol {
                continue;
            }
            let size: f64 = row.iter().zip(self.z.iter()).map(|(a, z)| (a * z).abs()).sum();
            let floor = rounding * size;
            if f.is_nan() || f.abs() > floor || !floor.is_finite() {
                return None;
            }
            reached = reached.max(floor);
        }
        Some(reached)
    }

    /// The residual of the caller's `F`, unscaled, which is left in `work.trial_f`.
    pub(super) fn raw_residual(&mut self) -> f64 {
        for ((f, scale), scaled) in
            self.work.trial_f.iter_mut().zip(self.work.scale.iter()).zip(self.work.f.iter())
        {
            *f = scaled / scale;
        }
        natural_residual(self.z, self.work.trial_f, self.lower, self.upper)
    }

    /// The best point, without another evaluation: `F` there is no longer known.
    pub(super) fn give_up(&mut self) {
        workspace::copy(self.z, self.work.best);
        self.work.f.fill(f64::NAN);
        self.residual = f64::NAN;
    }
}

/// `trial <- z + t d`, exactly on a bound where the full step ends there.
pub(super) fn advance(at: &mut Iterate<'_, '_>, t: f64) {
    let work = &mut *at.work;
    for i in 0..work.step.len() {
        let (lower, upper) = (workspace::at(at.lower, i), workspace::at(at.upper, i));
        let (z, d) = (workspace::at(at.z, i), workspace::at(work.step, i));
        let reached = if t < 1.0 {
            z + t * d
        } else if d == workspace::at(work.lower, i) {
            lower
        } else if d == workspace::at(work.upper, i) {
            upper
        } else {
            z + d
        };
        workspace::put(work.trial, i, reached.max(lower).min(upper));
    }
}

// When a stage no longer makes progress.

/// Watches for a merit that has not fallen by a tenth over twenty iterations.
#[derive(Debug)]
pub(super) struct Stagnation {
    best: f64,
    since: usize,
}

impl Stagnation {
    pub(super) fn new(merit: f64) -> Self {
        Self { best: merit, since: 0 }
    }

    pub(super) fn has_stalled(&mut self, merit: f64) -> bool {
        if merit < 0.9 * self.best {
            (self.best, self.since) = (merit, 0);
        } else {
            self.since += 1;
        }
        self.since >= 20
    }

    /// True where the merit has not fallen over the last iterations: a time to ask whether
    /// rounding forbids it.
    pub(super) fn is_slow(&self) -> bool {
        self.since >= 3
    }
}

// Numbers for restarts: the same in every run.

/// SplitMix64 (Steele, Lea & Flood, *OOPSLA* 2014, 453-472).
#[derive(Debug)]
pub(super) struct Random(u64);

impl Random {
    pub(super) fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x2545_F491_4F6C_DD1D))
    }

    /// Uniform on `[0, 1)`.
    pub(super) fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        bits ^= bits >> 31;
        (bits >> 11) as f64 / (1_u64 << 53) as f64
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
        let above = workspace::at(at.upper, i) == f64::INFINITY && stays_below_zero(at, i, 1.0);
        above || workspace::at(at.lower, i) == f64::NEG_INFINITY && stays_below_zero(at, i, -1.0)
    })
}

/// True when `sup (sign F_i)` over the box is below zero by more than the tolerance; false where it
/// is infinite, or undefined.
fn stays_below_zero(at: &Iterate<'_, '_>, i: usize, sign: f64) -> bool {
    let row = workspace::row(at.work.jacobian, at.n(), i);
    let mut most = sign * workspace::at(at.work.f, i);
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
enum Place {
    Inside,
    Lower,
    Upper,
}

/// Tries all patterns from the starting point and from two of the restarts; true when the iterate
/// is a solution.
pub(super) fn enumerate(at: &mut Iterate<'_, '_>) -> Outcome<bool> {
    for scattered in [None, Some(3), Some(4)] {
        workspace::copy(at.work.trial, at.work.start);
        if let Some(k) = scattered {
            at.scatter(k);
        }
        workspace::copy(at.work.centre, at.work.trial);
        if all_patterns(at)? {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Tries all patterns from `work.centre`.
fn all_patterns(at: &mut Iterate<'_, '_>) -> Outcome<bool> {
    let mut pattern = [Place::Inside; MOST];
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
fn next_pattern(pattern: &mut [Place; MOST], n: usize) -> bool {
    for place in pattern.iter_mut().take(n) {
        *place = match *place {
            Place::Inside => Place::Lower,
            Place::Lower => Place::Upper,
            Place::Upper => Place::Inside,
        };
        if *place != Place::Inside {
            return true;
        }
    }
    false
}

/// No component at an infinite bound; a fixed one at its bound, once.
fn is_admissible(at: &Iterate<'_, '_>, pattern: &[Place; MOST]) -> bool {
    at.lower.iter().zip(at.upper).zip(pattern).all(|((&lower, &upper), place)| match place {
        Place::Inside => lower < upper,
        Place::Lower => lower.is_finite(),
        Place::Upper => upper.is_finite() && lower < upper,
    })
}

/// Damped Newton on the rows inside; true when its end solves the whole problem.
fn newton_on_pattern(at: &mut Iterate<'_, '_>, pattern: &[Place; MOST]) -> Outcome<bool> {
    workspace::copy(at.work.trial, at.work.centre);
    for (i, place) in pattern.iter().enumerate().take(at.n()) {
        match place {
            Place::Lower => workspace::put(at.work.trial, i, workspace::at(at.lower, i)),
            Place::Upper => workspace::put(at.work.trial, i, workspace::at(at.upper, i)),
            Place::Inside => {}
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
        if workspace::norm(at.work.trial) > FAR {
            return Ok(false);
        }
    }
    trial_is_solution(at)
}

/// True, and the iterate moved there, when the evaluated trial solves the problem.
fn trial_is_solution(at: &mut Iterate<'_, '_>) -> Outcome<bool> {
    let work = &*at.work;
    let residual = crate::vi::natural_residual(work.trial, work.trial_f, at.lower, at.upper);
    if residual.is_nan() || residual > at.tol || workspace::norm(work.trial) > FAR {
        return Ok(false);
    }
    workspace::project(at.work.trial, at.lower, at.upper);
    let merit = at.merit_of_trial()?;
    if !merit.is_finite() {
        return Ok(false);
    }
    at.accept(merit);
    Ok(at.is_solved())
}

/// `max |F_i|` over the rows inside.
fn inside_norm(at: &Iterate<'_, '_>, pattern: &[Place; MOST]) -> f64 {
    at.work.trial_f.iter().zip(pattern).fold(0.0, |size, (f, place)| match place {
        Place::Inside => f64::max(size, f.abs()),
        _ => size,
    })
}

/// `work.step <- -J_II^-1 F_I`, zero on the rows held; false where `J_II` is singular.
fn inside_direction(at: &mut Iterate<'_, '_>, pattern: &[Place; MOST]) -> Outcome<bool> {
    let n = at.n();
    if !at.jacobian_at_trial()? {
        return Ok(false);
    }
    let work = &mut *at.work;
    for (i, row) in work.pivotal.inverse.chunks_exact_mut(n).enumerate() {
        let inside = pattern.get(i) == Some(&Place::Inside);
        row.fill(0.0);
        if inside {
            workspace::copy(row, workspace::row(work.jacobian, n, i));
            row.iter_mut().zip(pattern).for_each(|(entry, place)| {
                if *place != Place::Inside {
                    *entry = 0.0;
                }
            });
        } else {
            workspace::put(row, i, 1.0);
        }
        workspace::put(work.step, i, if inside { -workspace::at(work.trial_f, i) } else { 0.0 });
    }
    let regular = at.problem.factor(work.pivotal.inverse, n, work.pivotal.members)? > 0.0;
    if regular {
        workspace::solve(work.pivotal.inverse, n, work.pivotal.members, work.step);
    }
    Ok(regular && workspace::is_finite(work.step))
}

/// Halves the step until the rows inside shrink; `None`, and back where it was, if they do not.
fn damped_step(
    at: &mut Iterate<'_, '_>,
    pattern: &[Place; MOST],
    size: f64,
) -> Outcome<Option<f64>> {
    workspace::copy(at.work.point, at.work.trial);
    let mut t = 1.0;
    for _ in 0..HALVINGS {
        workspace::copy(at.work.trial, at.work.point);
        workspace::axpy(at.work.trial, t, at.work.step);
        if at.evaluate_trial()? {
            let smaller = inside_norm(at, pattern);
            if smaller < size {
                return Ok(Some(smaller));
            }
        }
        t *= 0.5;
    }
    workspace::copy(at.work.trial, at.work.point);
    at.evaluate_trial()?;
    Ok(None)
}

#[cfg(test)]
mod stagnation_tests {
    use super::*;

    #[test]
    fn slow_after_three_and_stalled_after_twenty_that_do_not_fall_by_a_tenth() {
        let mut progress = Stagnation::new(1.0);
        let mut told = |merit: f64| (progress.has_stalled(merit), progress.is_slow());
        for merit in [0.95, 0.91] {
            assert_eq!(told(merit), (false, false));
        }
        assert_eq!(told(0.9), (false, true));
        assert_eq!(told(0.89), (false, false));
        for iteration in 1..20 {
            assert_eq!(told(0.85), (false, iteration >= 3));
        }
        assert_eq!(told(0.85), (true, true));
    }
}

#[cfg(test)]
mod random_tests {
    use super::*;

    /// The first numbers of the published generator from the state 0.
    #[test]
    fn it_is_the_published_generator() {
        let mut random = Random::new(0);
        for bits in [0xE220_A839_7B1D_CDAF_u64, 0x6E78_9E6A_A1B9_65F4, 0x06C4_5D18_8009_454F] {
            assert_eq!(random.uniform(), (bits >> 11) as f64 / (1_u64 << 53) as f64);
        }
    }
}

#[cfg(test)]
#[allow(clippy::indexing_slicing)]
mod enumerate_tests {
    use super::*;

    #[test]
    fn all_patterns_come_once() {
        for n in 0..=4 {
            let (mut pattern, mut seen) = ([Place::Inside; MOST], [0; 81]);
            loop {
                let number = pattern.iter().take(n).fold(0, |number, place| {
                    let digit = match place {
                        Place::Inside => 0,
                        Place::Lower => 1,
                        Place::Upper => 2,
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
