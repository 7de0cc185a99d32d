//! The force at the end of a step that itself depends on the force.
//!
//! With the force frozen at a trial value the step has a closed form; what is left is one scalar
//! equation for that value, `mismatch(f) = f(t, x(f), x'(f)) - f = 0`. Within one sign pattern
//! `x` and `x'` are affine in the trial, so for a linear force one secant step is exact. The slope is carried from
//! step to step, and a bracket is kept wherever the mismatch has changed sign.

use zivi_core::step::{Pattern, PATTERNS};
use zivi_core::transform::project;
use zivi_core::{Physical, StepSolution, ThetaGammaStep};

use crate::fixed_step::{finite_force, Failure, Start};
use crate::{Force, Status};

/// The mismatch that is accepted, relative to the largest force met in the run.
pub(crate) const TOLERANCE: f64 = 1e-12;
/// Trial forces along one sequence of solutions (the selected ones, or those of one pattern).
pub(crate) const MAX_TRIALS: usize = 100;
/// Slope of the mismatch where the end of the step does not depend on the force (`h -> 0`).
const DEFAULT_SLOPE: f64 = -1.0;

/// Solver state carried over the steps of a run.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ImplicitForce {
    /// The force of the last step: the first trial of the next.
    last: Option<f64>,
    /// Slope of the mismatch, about -1 for small steps.
    slope: f64,
    /// Largest force met so far.
    magnitude: f64,
    pub(crate) nfev: u64,
}

impl Default for ImplicitForce {
    fn default() -> Self {
        Self { last: None, slope: DEFAULT_SLOPE, magnitude: 0.0, nfev: 0 }
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
        start: Start,
        force: &mut impl Force<E>,
    ) -> Result<(f64, StepSolution), Failure<E>> {
        let first = match self.last {
            Some(last) => last,
            None => self.evaluate(force, start.t, project(start.z, step.wall()))?,
        };
        let selected = |trial: f64| step.solve(start.z, trial, start.side).map_err(Failure::from);
        let found = match self.follow(step, start, force, first, selected) {
            Err(Failure::Status(Status::ForceNotConverged)) => {
                self.on_any_pattern(step, start, force, first)
            }
            other => other,
        };
        self.last = found.as_ref().ok().map(|(f, _)| *f);
        found
    }

    /// Solves `mismatch = 0` along the ends of step that `end` gives for each trial force.
    #[inline]
    fn follow<E>(
        &mut self,
        step: &ThetaGammaStep,
        start: Start,
        force: &mut impl Force<E>,
        first: f64,
        end: impl Fn(f64) -> Result<StepSolution, Failure<E>>,
    ) -> Result<(f64, StepSolution), Failure<E>> {
        let t = start.t + step.theta() * step.h();
        let mut trial = first;
        let mut bracket = Bracket::default();
        let mut previous: Option<(f64, f64)> = None;
        for _ in 0..MAX_TRIALS {
            let reached = end(trial)?;
            let value = self.evaluate(force, t, state_at_theta(step, start, &reached))?;
            let mismatch = value - trial;
            if mismatch.abs() <= TOLERANCE * self.magnitude {
                return Ok((trial, reached));
            }
            if bracket.is_exhausted() {
                break; // the mismatch jumps over zero
            }
            bracket.narrow(trial, mismatch);
            if let Some((other, its_mismatch)) = previous {
                self.update_slope((mismatch - its_mismatch) / (trial - other));
            }
            previous = Some((trial, mismatch));
            trial = bracket.inside(trial - mismatch / self.slope);
        }
        Err(Failure::Status(Status::ForceNotConverged))
    }

    /// Solves `mismatch = 0` on every pattern and takes the solution nearest to the exact motion
    /// under its own force (the first, where that presses to the wall).
    #[cold]
    fn on_any_pattern<E>(
        &mut self,
        step: &ThetaGammaStep,
        start: Start,
        force: &mut impl Force<E>,
        first: f64,
    ) -> Result<(f64, StepSolution), Failure<E>> {
        let Start { z, side, .. } = start;
        let mut best = Err(Failure::Status(Status::ForceNotConverged));
        let mut least = f64::INFINITY;
        for pattern in PATTERNS {
            let firsts = match pattern {
                Pattern::Wall(lambda_v) => step.wall_forces(lambda_v, z, side),
                _ => [first, f64::NAN],
            };
            for first in firsts.into_iter().filter(|first| first.is_finite()) {
                self.slope = DEFAULT_SLOPE;
                let continued = |trial: f64| {
                    let missing = Failure::Status(Status::ForceNotConverged);
                    step.continued(pattern, z, trial, side).ok_or(missing)
                };
                let f = match self.follow(step, start, force, first, continued) {
                    Ok((f, _)) => f,
                    Err(Failure::Raised(error)) => return Err(Failure::Raised(error)),
                    Err(Failure::Status(_)) => continue,
                };
                let Some(end) = step.accepted(pattern, z, f, side) else { continue };
                let away = step.inconsistency(&end, z, f, side);
                if away < least {
                    (best, least) = (Ok((f, end)), away);
                }
            }
        }
        self.slope = DEFAULT_SLOPE;
        best
    }

    fn evaluate<E>(
        &mut self,
        force: &mut impl Force<E>,
        t: f64,
        state: Physical,
    ) -> Result<f64, Failure<E>> {
        self.nfev += 1;
        let value = finite_force(force, t, state)?;
        self.magnitude = self.magnitude.max(value.abs());
        Ok(value)
    }

    /// A secant slope is believed when it descends; otherwise the default of a small step.
    fn update_slope(&mut self, secant: f64) {
        let descends = secant < -1e-3 && secant.is_finite();
        self.slope = if descends { secant } else { DEFAULT_SLOPE };
    }
}

/// `(x, x')` at `t + theta h`.
#[inline]
fn state_at_theta(step: &ThetaGammaStep, start: Start, end: &StepSolution) -> Physical {
    let mean = |new: f64, old: f64| step.theta() * new + (1.0 - step.theta()) * old;
    let r = step.wall().r(end.lambda_s, end.lambda_v);
    Physical { x: mean(end.s, start.z.s).abs(), xdot: r * end.lambda_s * mean(end.v, start.z.v) }
}

/// Trials with a positive and with a negative mismatch, as near to each other as known.
#[derive(Clone, Copy, Debug, Default)]
struct Bracket {
    positive: Option<f64>,
    negative: Option<f64>,
    trials: usize,
}

impl Bracket {
    fn narrow(&mut self, trial: f64, mismatch: f64) {
        self.trials += 1;
        let end = if mismatch > 0.0 { &mut self.positive } else { &mut self.negative };
        *end = Some(trial);
    }

    /// Whether no number is left between the ends.
    fn is_exhausted(&self) -> bool {
        let (Some(a), Some(b)) = (self.positive, self.negative) else {
            return false;
        };
        let middle = 0.5 * (a + b);
        middle == a || middle == b
    }

    /// The proposal where it lies inside, else (and at every third trial past the sixth, where the
    /// secant is slow) the middle.
    fn inside(&self, proposal: f64) -> f64 {
        let (Some(a), Some(b)) = (self.positive, self.negative) else {
            return proposal;
        };
        let (low, high) = if a < b { (a, b) } else { (b, a) };
        let slow = self.trials > 6 && self.trials.is_multiple_of(3);
        if proposal > low && proposal < high && !slow {
            proposal
        } else {
            0.5 * (low + high)
        }
    }
}
