//! Newton methods: Josephy-Newton, semismooth descent, test of isolation.
//!
//! Josephy-Newton: at each iterate the affine VI of the linearised map is solved by pivoting.
//!
//! ```text
//! find z_N in [l, u]:   0 in F(z) + (J(z) + mu I)(z_N - z) + N_[l,u](z_N)
//! theta(z + t d) <= (1 - 2e-4 t) max of the last theta,     d = z_N - z,   theta = |Phi|^2 / 2
//! ```
//!
//! Josephy (MRC report 1965, Wisconsin 1979) for the step; the nonmonotone search is that of
//! Grippo, Lampariello & Lucidi, *SIAM J. Numer. Anal.* 23 (1986) 707-716, on the
//! Fischer-Burmeister merit as in Ferris, Kanzow & Munson, *Math. Program.* 86 (1999) 475-497.

use super::infeasible::{is_infeasible, two_rows_exclude_each_other};
use super::iterate::{advance, Iterate, Outcome, Stagnation};
use super::natural::natural_component;
use super::pivotal::{follow, AffineVi, PathEnd};
use super::problem::steps_into;
use super::settings::{Stage, Start, Status, MEMORY};
use super::smoothing::{proximal_newton, smoothing_newton, ProximalEnd};
use super::{active_set, dense, natural};

/// Number of unknowns from which a proof of infeasibility precedes the first path; for fewer it
/// follows.
const WORTH_A_PROOF: usize = 16;
/// Iterations of the smoothing Newton method before the first path.
const SMOOTHING_ITERATIONS: usize = 40;
/// Pivots of the descent on a symmetric problem, for each unknown.
const DESCENT_PIVOTS: usize = 5;
/// Pivots that it may take, for each unknown.
const PROOF_PIVOTS: usize = 12;

/// How one stage of Josephy-Newton goes about it.
#[derive(Clone, Copy, Debug)]
pub(super) struct StagePlan {
    pub(super) start: Start,
    /// Try the active-set method before pivoting.
    pub(super) active_set: bool,
    /// Proximal weight of the first iteration relative to `1 + |J|`; a tenth at each further one.
    pub(super) proximal: f64,
    /// Merit values the search looks back on.
    pub(super) memory: usize,
}

/// Sufficient decrease of the merit.
const NEWTON_ARMIJO: f64 = 2e-4;
/// Shortest step along a Josephy-Newton direction.
const SHORTEST: f64 = 1e-3;
/// Largest residual of an affine solution that is trusted, relative to `1 + |F|`.
const TRUSTED: f64 = 1e-6;
/// Weights `mu/(1 + |J|)` that regularise an affine VI without a solution.
const REGULARISED: [f64; 2] = [1e-6, 1e-2];

/// One stage from the point where [`Iterate::begin`] has left the iterate.
pub(super) fn josephy_newton(at: &mut Iterate<'_, '_>, plan: StagePlan) -> Outcome<Status> {
    let mut history = History::new(plan.memory);
    let mut progress = Stagnation::new(at.merit);
    let mut proximal = plan.proximal;
    for iteration in 0..at.settings.stage_iterations {
        if at.is_solved() {
            return Ok(Status::Solved);
        }
        if at.out_of_iterations() {
            return Ok(Status::IterationLimit);
        }
        if at.budget.is_spent() {
            return Ok(Status::PivotLimit);
        }
        at.counts.iterations += 1;
        history.push(at.merit);
        if iteration > 0 && !at.linearise()? {
            return Ok(Status::DomainError);
        }
        let found = newton_point(at, plan, proximal)?;
        match found {
            PathEnd::Infeasible => return Ok(Status::Infeasible),
            PathEnd::Solved => return Ok(Status::Solved),
            _ => {}
        }
        let moved = (found == PathEnd::Solution && search(at, &history)?)
            || (at.settings.descent_steps && step(at)?);
        if !moved {
            return Ok(match found {
                PathEnd::PivotLimit => Status::PivotLimit,
                _ => at.why_stuck(),
            });
        }
        at.report()?;
        if at.has_stalled(&mut progress) {
            return Ok(Status::Stalled);
        }
        proximal *= 0.1;
    }
    Ok(if at.is_solved() { Status::Solved } else { Status::IterationLimit })
}

/// `work.step <- z_N - z`, from the first method and regularisation whose affine solution holds.
fn newton_point(at: &mut Iterate<'_, '_>, plan: StagePlan, proximal: f64) -> Outcome<PathEnd> {
    let first = AffineMethod::Path(plan.start);
    let second = AffineMethod::Path(match plan.start {
        Start::Regular => Start::Ray,
        Start::Ray => Start::Regular,
    });
    let [slight, strong] = REGULARISED;
    let attempts = [
        (AffineMethod::ActiveSet, 0.0),
        (first, 0.0),
        (second, 0.0),
        (first, slight),
        (first, strong),
    ];
    let (mut end, mut has_failed) = (PathEnd::Singular, false);
    for (method, weight) in attempts.into_iter().skip(usize::from(!plan.active_set)) {
        if at.budget.is_spent() {
            return Ok(PathEnd::PivotLimit);
        }
        let is_path = matches!(method, AffineMethod::Path(_));
        if is_path {
            let proof_is_worth_it = at.n() >= WORTH_A_PROOF || has_failed;
            match before_paths(at, plan, proof_is_worth_it)? {
                PathEnd::Singular => {}
                end => return Ok(end),
            }
        }
        has_failed |= is_path;
        end = affine_step(at, method, shift_by(at, proximal, weight))?;
        if end == PathEnd::Solution {
            break;
        }
    }
    Ok(end)
}

/// The weights relative to `1 + |J|`.
fn shift_by(at: &Iterate<'_, '_>, proximal: f64, weight: f64) -> f64 {
    if proximal == 0.0 && weight == 0.0 {
        return 0.0;
    }
    let scale = 1.0 + dense::norm(at.work.jacobian);
    proximal * scale + weight * scale
}

/// Attempt on an affine problem before its first path, once per solve: it is solved, proved
/// infeasible, or [`PathEnd::Singular`].
fn before_paths(at: &mut Iterate<'_, '_>, plan: StagePlan, proof: bool) -> Outcome<PathEnd> {
    if !at.problem.is_affine() {
        return Ok(PathEnd::Singular);
    }
    let proof = proof && !at.proof_was_sought;
    at.proof_was_sought |= proof;
    if proof && two_rows_exclude_each_other(at)? {
        return Ok(PathEnd::Infeasible);
    }
    let drifts = match plan.active_set {
        true => match proximal_end(at)? {
            ProximalEnd::Solved => return Ok(PathEnd::Solved),
            end => end == ProximalEnd::Drifts,
        },
        false => false,
    };
    // the search for a proof costs more than solving most solvable problems
    if proof && drifts && proves_infeasible(at)? {
        return Ok(PathEnd::Infeasible);
    }
    if plan.active_set && smoothing_solves(at)? {
        return Ok(PathEnd::Solved);
    }
    if proof && !drifts && proves_infeasible(at)? {
        return Ok(PathEnd::Infeasible);
    }
    Ok(PathEnd::Singular)
}

/// Looks for a proof that there is no solution.
fn proves_infeasible(at: &mut Iterate<'_, '_>) -> Outcome<bool> {
    let limit = (PROOF_PIVOTS * at.n() + 50).min(at.budget.left_to_all());
    is_infeasible(at, limit)
}

/// Before the first path of an affine problem: the smoothing Newton method, which takes a few
/// factorisations where it succeeds. Otherwise the iterate is unchanged.
fn smoothing_solves(at: &mut Iterate<'_, '_>) -> Outcome<bool> {
    if !at.settings.smoothing || at.was_smoothed {
        return Ok(false);
    }
    at.was_smoothed = true;
    dense::copy(at.work.neighbour, at.z);
    let stage = core::mem::replace(&mut at.stage, Stage::Smoothing);
    if smoothing_newton(at, SMOOTHING_ITERATIONS)? == Status::Solved {
        return Ok(true);
    }
    at.stage = stage;
    return_to_neighbour(at)?;
    Ok(false)
}

/// Before it the proximal point method, which takes a few factorisations of the rows inside where
/// the problem is monotone, whatever its rank. Unless it is solved, the iterate is unchanged.
fn proximal_end(at: &mut Iterate<'_, '_>) -> Outcome<ProximalEnd> {
    if !at.settings.proximal || at.was_proximal {
        return Ok(ProximalEnd::GivenUp);
    }
    at.was_proximal = true;
    dense::copy(at.work.neighbour, at.z);
    let end = proximal_newton(at)?;
    if end != ProximalEnd::Solved {
        return_to_neighbour(at)?;
    }
    Ok(end)
}

/// Makes the point that was kept the iterate again.
fn return_to_neighbour(at: &mut Iterate<'_, '_>) -> Outcome<()> {
    dense::copy(at.work.trial, at.work.neighbour);
    let merit = at.merit_of_trial()?;
    at.accept(merit);
    at.linearise()?;
    Ok(())
}

/// How an affine VI is solved.
#[derive(Clone, Copy, Debug)]
enum AffineMethod {
    ActiveSet,
    Path(Start),
}

/// Solves one affine VI in `d = z_N - z` and checks its residual.
fn affine_step(at: &mut Iterate<'_, '_>, method: AffineMethod, shift: f64) -> Outcome<PathEnd> {
    active_set::reach(at);
    let end = match method {
        AffineMethod::Path(start) => follow_path(at, start, shift)?,
        AffineMethod::ActiveSet => {
            let found = active_set::solve(at, 0.0, at.pivots_left())?
                || (at.problem.is_affine() && active_set::descend(at, DESCENT_PIVOTS * at.n())?);
            if found {
                PathEnd::Solution
            } else {
                PathEnd::Singular
            }
        }
    };
    if end != PathEnd::Solution {
        return Ok(end);
    }
    let residual = match method {
        AffineMethod::ActiveSet => active_set::residual(at),
        AffineMethod::Path(_) => {
            let work = &mut *at.work;
            let (lower, upper) = (&*work.lower, &*work.upper);
            let avi = AffineVi { matrix: work.jacobian, shift, q: work.f, lower, upper };
            avi.residual(work.step, work.trial_f)
        }
    };
    let trusted = TRUSTED * (1.0 + dense::norm(at.work.f));
    Ok(if residual <= trusted { PathEnd::Solution } else { PathEnd::Singular })
}

/// Pivots from `d = 0`.
fn follow_path(at: &mut Iterate<'_, '_>, start: Start, shift: f64) -> Outcome<PathEnd> {
    let limit = at.pivots_left();
    at.inside_is_regular = false;
    let work = &mut *at.work;
    let avi =
        AffineVi { matrix: work.jacobian, shift, q: work.f, lower: work.lower, upper: work.upper };
    work.step.fill(0.0);
    let (end, effort) =
        follow(&avi, start, limit, &mut work.pivotal, work.step, &mut || at.problem.poll())?;
    at.counts.pivots += effort.pivots;
    at.budget.spend(effort.columns);
    Ok(end)
}

/// Searches along `work.step`; false where no step of useful length was accepted.
fn search(at: &mut Iterate<'_, '_>, history: &History) -> Outcome<bool> {
    let descends = dense::dot(at.work.gradient, at.work.step) < 0.0;
    let shortest = if descends { SHORTEST } else { 0.5 };
    let mut t = 1.0;
    while t >= shortest {
        advance(at, t);
        let merit = at.merit_of_trial()?;
        let undamped = !at.settings.line_search && merit.is_finite();
        if undamped || merit <= (1.0 - NEWTON_ARMIJO * t) * history.worst() {
            at.accept(merit);
            return Ok(true);
        }
        t *= 0.5;
    }
    Ok(false)
}

/// The last few values of the merit.
#[derive(Debug)]
struct History {
    values: [f64; MEMORY],
    next: usize,
    length: usize,
}

impl History {
    fn new(memory: usize) -> Self {
        Self { values: [0.0; MEMORY], next: 0, length: memory.clamp(1, MEMORY) }
    }

    fn push(&mut self, merit: f64) {
        dense::put(&mut self.values, self.next % self.length, merit);
        self.next += 1;
    }

    fn worst(&self) -> f64 {
        self.values.iter().take(self.next.min(self.length)).fold(0.0, |a, &b| f64::max(a, b))
    }
}

// Semismooth Newton on the Fischer-Burmeister function, with the projected gradient as fall-back.
//
// ```text
// (H'H + lambda |H|^2 I) d = -H' Phi     H an element of the generalised Jacobian of Phi
// z <- P(z + t d),   theta falling
// ```
//
// De Luca, Facchinei & Kanzow, *Math. Program.* 75 (1996) 407-439, on the box.

/// Levenberg-Marquardt weights, tried in turn; 0 is the Newton step itself.
const WEIGHTS: [f64; 4] = [0.0, 1e-8, 1e-4, 1e-1];
/// Sufficient decrease of the merit.
const DESCENT_ARMIJO: f64 = 1e-4;
/// Halvings of a semismooth step and of a gradient step.
const HALVINGS: usize = 12;
const GRADIENT_HALVINGS: usize = 40;

/// Stage S1: monotone semismooth Newton from where [`Iterate::begin`] has left the iterate.
pub(super) fn semismooth_newton(at: &mut Iterate<'_, '_>) -> Outcome<Status> {
    let mut progress = Stagnation::new(at.merit);
    for iteration in 0..at.settings.stage_iterations {
        if at.is_solved() {
            return Ok(Status::Solved);
        }
        if at.out_of_iterations() {
            return Ok(Status::IterationLimit);
        }
        if at.budget.is_spent() {
            return Ok(Status::PivotLimit);
        }
        at.counts.iterations += 1;
        if iteration > 0 && !at.linearise()? {
            return Ok(Status::DomainError);
        }
        if !step(at)? {
            return Ok(at.why_stuck());
        }
        at.report()?;
        if at.has_stalled(&mut progress) {
            return Ok(Status::Stalled);
        }
    }
    Ok(if at.is_solved() { Status::Solved } else { Status::IterationLimit })
}

/// One step that lowers the merit; false where none was found.
pub(super) fn step(at: &mut Iterate<'_, '_>) -> Outcome<bool> {
    for weight in WEIGHTS {
        if at.budget.is_spent() {
            return Ok(false);
        }
        if direction(at, weight)? && projected_search(at, HALVINGS)? {
            at.counts.semismooth_steps += 1;
            return Ok(true);
        }
    }
    let slope = dense::dot(at.work.gradient, at.work.gradient);
    if slope <= 0.0 || !slope.is_finite() {
        return Ok(false);
    }
    // the length at which the linear model of theta reaches zero
    let length = 2.0 * at.merit / slope;
    for (d, g) in at.work.step.iter_mut().zip(at.work.gradient.iter()) {
        *d = -length * g;
    }
    let moved = projected_search(at, GRADIENT_HALVINGS)?;
    at.counts.gradient_steps += usize::from(moved);
    Ok(moved)
}

/// `work.step <- d` for one weight; false where the matrix is singular.
fn direction(at: &mut Iterate<'_, '_>, weight: f64) -> Outcome<bool> {
    let n = at.n();
    at.budget.spend_on_factors(n);
    at.problem.poll()?;
    let work = &mut *at.work;
    let matrix = &mut *work.pivotal.inverse;
    if weight == 0.0 {
        for (i, row) in matrix.chunks_exact_mut(n).enumerate() {
            row.fill(0.0);
            dense::put(row, i, dense::at(work.slope_z, i));
            dense::axpy(row, dense::at(work.slope_f, i), dense::row(work.jacobian, n, i));
        }
        work.step.iter_mut().zip(work.phi.iter()).for_each(|(d, phi)| *d = -phi);
    } else {
        let slopes = (&*work.slope_z, &*work.slope_f);
        let poll = &mut || at.problem.poll();
        normal_matrix(matrix, work.jacobian, slopes, work.pivotal.column, poll)?;
        let largest = (0..n).fold(0.0, |size, i| f64::max(size, dense::at(matrix, i * n + i)));
        for i in 0..n {
            let damped = dense::at(matrix, i * n + i) + weight * largest;
            dense::put(matrix, i * n + i, damped);
        }
        work.step.iter_mut().zip(work.gradient.iter()).for_each(|(d, g)| *d = -g);
    }
    if at.problem.factor(matrix, n, work.pivotal.members)? <= 0.0 {
        return Ok(false);
    }
    dense::solve(matrix, n, work.pivotal.members, work.step);
    Ok(dense::is_finite(work.step))
}

/// `H'H`, summed over the rows of `H = diag(slope_z) + diag(slope_f) J`.
fn normal_matrix(
    out: &mut [f64],
    jacobian: &[f64],
    (slope_z, slope_f): (&[f64], &[f64]),
    row: &mut [f64],
    poll: &mut dyn FnMut() -> Outcome<()>,
) -> Outcome<()> {
    let n = row.len();
    out.fill(0.0);
    for (i, entries) in dense::rows(jacobian, n).enumerate() {
        if dense::is_time_to_poll(i, n) {
            poll()?;
        }
        row.fill(0.0);
        dense::put(row, i, dense::at(slope_z, i));
        dense::axpy(row, dense::at(slope_f, i), entries);
        for (out, &h) in out.chunks_exact_mut(n).zip(row.iter()) {
            if h != 0.0 {
                dense::axpy(out, h, row);
            }
        }
    }
    Ok(())
}

/// Halves the step until the merit falls by its share of the slope to the projected point.
fn projected_search(at: &mut Iterate<'_, '_>, halvings: usize) -> Outcome<bool> {
    let mut t = 1.0;
    for _ in 0..halvings {
        let work = &mut *at.work;
        for ((trial, z), d) in work.trial.iter_mut().zip(at.z.iter()).zip(work.step.iter()) {
            *trial = z + t * d;
        }
        dense::project(work.trial, at.lower, at.upper);
        let moves = work.trial.iter().zip(at.z.iter()).map(|(trial, z)| trial - z);
        let slope: f64 = work.gradient.iter().zip(moves).map(|(g, d)| g * d).sum();
        if slope < 0.0 {
            let merit = at.merit_of_trial()?;
            if merit <= at.merit + DESCENT_ARMIJO * slope {
                at.accept(merit);
                return Ok(true);
            }
        }
        t *= 0.5;
    }
    Ok(false)
}

// Whether a solution is isolated: the Jacobian on the rows inside the box is regular there.

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
        let inside = projects_inside(dense::at(at.z, i), dense::at(at.work.f, i), bounds, at.tol);
        inside == active_set::is_inside(held, i)
    })
}

/// Whether a component is inside the box or at a bound with `F_i = 0`.
fn projects_inside(z: f64, f: f64, (lower, upper): (f64, f64), tol: f64) -> bool {
    let target = z - f;
    lower < upper && lower - tol <= target && target <= upper + tol
}

/// `min/max` of the pivots of the Jacobian on the rows and columns inside the box (those at a
/// bound with `F_i = 0` included), its rows scaled to 1; 0 when singular.
fn pivot_ratio_inside(at: &mut Iterate<'_, '_>) -> Outcome<f64> {
    let (n, tol) = (at.n(), at.tol);
    let work = &mut *at.work;
    let projects_inside = |i: usize| {
        let bounds = (dense::at(at.lower, i), dense::at(at.upper, i));
        projects_inside(dense::at(at.z, i), dense::at(work.f, i), bounds, tol)
    };
    let pivotal = &mut work.pivotal;
    let size = dense::list(n, projects_inside, pivotal.members);
    let members = pivotal.members.get(..size).unwrap_or(&[]);
    for (&i, inner) in members.iter().zip(pivotal.inverse.chunks_exact_mut(size.max(1))) {
        dense::pick(inner, dense::row(work.jacobian, n, i), members);
        let scale = dense::norm(inner);
        inner.iter_mut().for_each(|entry| *entry = if scale > 0.0 { *entry / scale } else { 0.0 });
    }
    let leading = pivotal.inverse.get_mut(..size * size).unwrap_or(&mut []);
    at.problem.factor(leading, size, pivotal.members)
}

// The Jacobian at the iterate and derived quantities.

impl Iterate<'_, '_> {
    /// The Jacobian at the iterate, `Phi`, its slopes and the gradient of the merit
    /// `H' Phi`, `H = diag(slope_z) + diag(slope_f) J`. False where the Jacobian is not finite.
    pub(super) fn linearise(&mut self) -> Outcome<bool> {
        let n = self.n();
        dense::copy(self.work.trial, self.z);
        dense::copy(self.work.trial_f, self.work.f);
        let finite = self.jacobian_at_trial()?;
        let work = &mut *self.work;
        for i in 0..n {
            let (z, f) = (dense::at(self.z, i), dense::at(work.f, i));
            let (lower, upper) = (dense::at(self.lower, i), dense::at(self.upper, i));
            let (slope_z, slope_f) = natural::fischer_slopes(z, f, lower, upper);
            dense::put(work.phi, i, natural::fischer_component(z, f, lower, upper));
            dense::put(work.slope_z, i, slope_z);
            dense::put(work.slope_f, i, slope_f);
        }
        for ((g, phi), slope) in work.gradient.iter_mut().zip(&*work.phi).zip(&*work.slope_z) {
            *g = phi * slope;
        }
        for (i, row) in dense::rows(work.jacobian, n).enumerate() {
            let weight = dense::at(work.phi, i) * dense::at(work.slope_f, i);
            if weight != 0.0 {
                dense::axpy(work.gradient, weight, row);
            }
        }
        Ok(finite)
    }

    /// The scaled Jacobian at `work.trial`, where `F` is `work.trial_f`; entries that are not
    /// finite by differences. False where these are not finite either. That of an affine `F` is
    /// evaluated once.
    pub(super) fn jacobian_at_trial(&mut self) -> Outcome<bool> {
        let n = self.n();
        self.problem.poll()?;
        if self.jacobian_is_known && self.problem.is_affine() {
            return Ok(true);
        }
        let work = &mut *self.work;
        self.counts.jacobian += 1;
        self.inside_is_regular = false;
        self.problem.jacobian(work.trial, work.jacobian)?;
        let rows = work.jacobian.chunks_exact_mut(n).zip(work.scale.iter());
        for (row, scale) in rows.filter(|(_, scale)| **scale != 1.0) {
            row.iter_mut().for_each(|entry| *entry *= scale);
        }
        self.jacobian_is_known = dense::is_finite(work.jacobian) || self.mend_jacobian()?;
        Ok(self.jacobian_is_known)
    }

    /// `J_ij <- (F_i(z + h e_j) - F_i(z)) / h` for the entries that are not finite, towards the
    /// farther bound, or else the nearer one.
    fn mend_jacobian(&mut self) -> Outcome<bool> {
        let n = self.n();
        for j in 0..n {
            let is_whole =
                self.work.jacobian.iter().skip(j).step_by(n).all(|entry| entry.is_finite());
            if is_whole {
                continue;
            }
            let z = dense::at(self.work.trial, j);
            let room = [dense::at(self.upper, j) - z, dense::at(self.lower, j) - z];
            let mut mended = room == [0.0; 2] && self.clear_column(j);
            for step in steps_into(z, room, self.problem.rounding()) {
                mended = mended || self.difference_column(j, step)?;
            }
            if !mended {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// A fixed component does not move: what `F` would do with it does not matter.
    fn clear_column(&mut self, j: usize) -> bool {
        let n = self.n();
        let column = self.work.jacobian.iter_mut().skip(j).step_by(n);
        column.filter(|entry| !entry.is_finite()).for_each(|entry| *entry = 0.0);
        true
    }

    /// The entries of column `j` that are not finite, by the quotient over `step`.
    fn difference_column(&mut self, j: usize, step: f64) -> Outcome<bool> {
        let n = self.n();
        let work = &mut *self.work;
        let z = dense::at(work.trial, j);
        let moved = z + step;
        if moved == z {
            return Ok(false);
        }
        self.problem.poll()?;
        self.counts.f += 1;
        dense::put(work.trial, j, moved);
        let done = self.problem.map(work.trial, work.neighbour);
        dense::put(work.trial, j, z);
        done?;
        dense::scale(work.neighbour, work.scale);
        let values = work.neighbour.iter().zip(work.trial_f.iter());
        let column = work.jacobian.iter_mut().skip(j).step_by(n);
        for (entry, (there, here)) in column.zip(values).filter(|(entry, _)| !entry.is_finite()) {
            *entry = (there - here) / (moved - z);
        }
        Ok(self.work.jacobian.iter().skip(j).step_by(n).all(|entry| entry.is_finite()))
    }
}

/// Share of a row's terms that the differences of `F` must show.
const STEEP_ENOUGH: f64 = 0.1;

impl Iterate<'_, '_> {
    /// Whether the rows whose rounding is taken for their tolerance are as steep as the Jacobian
    /// says. Each component moves by `d_j = +-h |z_j|`, `h` the cube root of the rounding, in the
    /// direction in which all terms of the row grow, or backwards where a bound is in the way:
    ///
    /// ```text
    /// F_i(z + d forwards) - F_i(z + d backwards) = h sum_j |J_ij z_j| + O(h^2)
    /// ```
    pub(super) fn rows_are_as_steep(&mut self) -> Outcome<bool> {
        if self.problem.is_affine() || self.problem.is_differenced() {
            return Ok(true); // the Jacobian is made of F
        }
        for i in 0..self.n() {
            let (z, f) = (dense::at(self.z, i), dense::at(self.work.f, i));
            let (lower, upper) = (dense::at(self.lower, i), dense::at(self.upper, i));
            let at_tolerance = natural_component(z, f, lower, upper).abs() <= self.tol;
            if !at_tolerance && !self.row_is_as_steep(i)? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    fn row_is_as_steep(&mut self, i: usize) -> Outcome<bool> {
        let mut ends = [0.0; 2];
        let mut expected = 0.0;
        for (end, backwards) in ends.iter_mut().zip([false, true]) {
            expected += self.move_along_row(i, backwards);
            if !self.evaluate_trial()? {
                return Ok(false);
            }
            *end = dense::at(self.work.trial_f, i);
        }
        let [forth, back] = ends;
        Ok(forth - back >= STEEP_ENOUGH * expected)
    }

    /// `trial <- z + d` for the components that can move forwards, or for the others; returns the
    /// predicted change of row `i`.
    fn move_along_row(&mut self, i: usize, backwards: bool) -> f64 {
        let relative = libm::cbrt(self.problem.rounding());
        let n = self.n();
        let mut change = 0.0;
        for j in 0..n {
            let z = dense::at(self.z, j);
            let (lower, upper) = (dense::at(self.lower, j), dense::at(self.upper, j));
            let slope = dense::at(self.work.jacobian, i * n + j);
            let step = relative * z.abs() * slope.signum();
            let is_inside = |z: f64| lower <= z && z <= upper;
            let moved = match (is_inside(z + step), backwards) {
                (true, false) => z + step,
                (false, true) if is_inside(z - step) => z - step,
                _ => z,
            };
            dense::put(self.work.trial, j, moved);
            change += (slope * (moved - z)).abs();
        }
        change
    }
}
