//! The force at the end of a step that itself depends on the force.
//!
//! With the force frozen at a trial value the step has a closed form; what is left is one scalar
//! equation for that value, `mismatch(f) = f(t, x(f), x'(f)) - f = 0`. Within one sign pattern `x`
//! and `x'` are affine in the trial, so for a linear force one secant step is exact. The slope is
//! carried from step to step, and a bracket is kept wherever the mismatch has changed sign.

pub(crate) mod opening;
pub(crate) mod search;

use zivi_core::step::PATTERNS;
use zivi_core::transform::project;
use zivi_core::{Physical, StepSolution, ThetaGammaStep};

use crate::record::failure::Failure;
use crate::stepping::fixed_step::Start;
use crate::stepping::step_solver::StepSolver;
use crate::system::evaluation::finite_force;
use crate::{Force, Status};
use opening::{Opening, Shown};
use search::{Search, DEFAULT_SLOPE};

/// The mismatch that is accepted, relative to the force of the step or of the one before.
const TOLERANCE: f64 = 1e-12;
/// Trial forces along the selected solutions.
const SELECTED_TRIALS: usize = 20;
/// Trial forces along one sign pattern.
const PATTERN_TRIALS: usize = 60;
/// From this trial on a mismatch at the rounding of the force is accepted too.
const SLOW: usize = 3;

/// Solver state carried over the steps of a run.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ImplicitForce {
    /// The force of the last step: the first trial of the next.
    last: Option<f64>,
    /// Slope of the mismatch at the last solution, about -1 for small steps.
    slope: f64,
    pub(crate) nfev: u64,
}

/// A step whose force is sought.
struct ImplicitStep<'a> {
    step: &'a ThetaGammaStep,
    start: Start,
    t: f64,
}

type Found<E> = Result<(f64, StepSolution), Failure<E>>;

const NOT_CONVERGED: Status = Status::ForceNotConverged;

impl Default for ImplicitForce {
    fn default() -> Self {
        Self { last: None, slope: DEFAULT_SLOPE, nfev: 0 }
    }
}

impl ImplicitForce {
    /// The step from `start` and its force, consistent to [`TOLERANCE`].
    ///
    /// The equation is solved along the solution that the selection rule takes for each trial.
    /// Where that solution jumps (`f > 0`), the root may lie on a pattern that the rule leaves
    /// before it is reached; then every pattern is followed by itself.
    #[inline]
    pub(crate) fn solve<E>(
        &mut self,
        step: &ThetaGammaStep,
        solver: &mut impl StepSolver,
        start: Start,
        force: &mut impl Force<E>,
    ) -> Found<E> {
        let sought = ImplicitStep { step, start, t: start.t + step.theta() * step.h() };
        let first = match self.last {
            Some(last) => last,
            None => self.evaluate(force, start.t, project(start.z, step.restitution()))?,
        };
        self.last = Some(first);
        let mut opening = Opening::from(first, self.slope);
        let found = match self.at_once(&sought, solver, force, &mut opening) {
            Ok(Some(found)) => return Ok(found),
            Ok(None) => self.follow(&sought, force, opening.search(SELECTED_TRIALS), |f| {
                solver.solve(step, start.z, f, start.sigma).map_err(Failure::from)
            }),
            Err(failed) => Err(failed),
        };
        let found = match found {
            Err(Failure::Status(why)) => {
                solver.replaced();
                self.on_any_pattern(&sought, force, first, why)?
            }
            found => found?,
        };
        self.last = Some(found.0);
        Ok(found)
    }

    /// The same where the first trial or the second one is it, as in nearly every step.
    #[inline(always)]
    fn at_once<E>(
        &mut self,
        sought: &ImplicitStep<'_>,
        solver: &impl StepSolver,
        force: &mut impl Force<E>,
        opening: &mut Opening,
    ) -> Result<Option<(f64, StepSolution)>, Failure<E>> {
        opening.root(|trial| {
            let Some(end) = solver.everyday(sought.step, sought.start.z, trial) else {
                return Ok(Shown::Nothing);
            };
            let value = self.evaluate(force, sought.t, sought.state_at_theta(&end))?;
            if !self.is_consistent(value, trial) {
                return Ok(Shown::Mismatch(value - trial));
            }
            self.last = Some(trial);
            Ok(Shown::Root((trial, end)))
        })
    }

    /// Whether a trial is the force that it leads to.
    #[inline(always)]
    fn is_consistent(&self, value: f64, trial: f64) -> bool {
        let scale = value.abs().min(trial.abs()).max(self.last.map_or(0.0, f64::abs));
        (value - trial).abs() <= TOLERANCE * scale
    }

    /// Solves `mismatch = 0` along the ends of step that `end` gives for each trial force.
    #[inline]
    fn follow<E>(
        &mut self,
        sought: &ImplicitStep<'_>,
        force: &mut impl Force<E>,
        mut search: Search,
        mut end: impl FnMut(f64) -> Result<StepSolution, Failure<E>>,
    ) -> Found<E> {
        while let Some(trial) = search.trial() {
            let reached = end(trial)?;
            let value = self.evaluate(force, sought.t, sought.state_at_theta(&reached))?;
            let mismatch = value - trial;
            if self.is_consistent(value, trial)
                || (search.trials() > SLOW
                    && mismatch.abs() <= self.rounding(sought, force, (trial, &reached), value)?)
            {
                self.slope = search.slope();
                return Ok((trial, reached));
            }
            search.learn(mismatch);
        }
        Err(Failure::Status(NOT_CONVERGED))
    }

    /// Solves `mismatch = 0` on every pattern and takes the solution nearest to the exact motion
    /// under its own force (the first, where that presses to the wall). `why` the selected
    /// solutions did not do is reported if no pattern does either.
    #[cold]
    fn on_any_pattern<E>(
        &mut self,
        sought: &ImplicitStep<'_>,
        force: &mut impl Force<E>,
        first: f64,
        why: Status,
    ) -> Found<E> {
        let ImplicitStep { step, start: Start { z, sigma, .. }, .. } = *sought;
        let mut failure = Failure::Status(why);
        let mut best = None;
        let mut least = f64::INFINITY;
        for pattern in PATTERNS {
            for range in step.force_ranges(pattern, z, sigma).into_iter().flatten() {
                let search = Search::within(range, first, PATTERN_TRIALS);
                let f = match self.follow(sought, force, search, |f| {
                    let end = step.continued(pattern, z, f, sigma);
                    end.ok_or(Failure::Status(NOT_CONVERGED))
                }) {
                    Ok((f, _)) => f,
                    Err(Failure::Status(NOT_CONVERGED)) => continue,
                    Err(raised @ Failure::Raised(_)) => return Err(raised),
                    Err(status) => {
                        failure = status;
                        continue;
                    }
                };
                let Some(end) = step.accepted(pattern, z, f, sigma) else { continue };
                let away = step.inconsistency(&end, z, f, sigma);
                if away < least {
                    (best, least) = (Some((f, end)), away);
                }
            }
        }
        self.slope = DEFAULT_SLOPE;
        best.ok_or(failure)
    }

    /// One counted evaluation; NaN and infinity are failures.
    #[inline]
    pub(crate) fn evaluate<E>(
        &mut self,
        force: &mut impl Force<E>,
        t: f64,
        state: Physical,
    ) -> Result<f64, Failure<E>> {
        self.nfev += 1;
        finite_force(force, t, state)
    }

    /// How much the force changes when the state at which it is taken changes by its rounding:
    /// no trial can do better.
    #[cold]
    fn rounding<E>(
        &mut self,
        sought: &ImplicitStep<'_>,
        force: &mut impl Force<E>,
        (trial, end): (f64, &StepSolution),
        value: f64,
    ) -> Result<f64, Failure<E>> {
        let state = sought.state_at_theta(end);
        let Physical { x, xdot } = sought.rounding_at_theta(trial, end);
        let by_x = Physical { x: state.x + x, ..state };
        let by_xdot = Physical { xdot: state.xdot + xdot, ..state };
        let change_x = (self.evaluate(force, sought.t, by_x)? - value).abs();
        let change_xdot = (self.evaluate(force, sought.t, by_xdot)? - value).abs();
        Ok(change_x + change_xdot)
    }
}

impl ImplicitStep<'_> {
    /// `(x, x')` at `t + theta h`.
    #[inline]
    fn state_at_theta(&self, end: &StepSolution) -> Physical {
        let (step, z) = (self.step, self.start.z);
        let mean = |new: f64, old: f64| step.theta() * new + (1.0 - step.theta()) * old;
        let r = step.restitution().r(end.lambda_s, end.lambda_v);
        Physical { x: mean(end.s, z.s).abs(), xdot: r * end.lambda_s * mean(end.v, z.v) }
    }

    /// Rounding of that state: a few units in the last place of the terms that it is summed from.
    fn rounding_at_theta(&self, f: f64, end: &StepSolution) -> Physical {
        let lambda = [end.lambda_s, end.lambda_v];
        let [scale_s, scale_v] = self.step.vi_scales(self.start.z, f, lambda);
        let r = self.step.restitution().r(end.lambda_s, end.lambda_v);
        Physical { x: 8.0 * f64::EPSILON * scale_s, xdot: 8.0 * f64::EPSILON * r * scale_v }
    }
}
