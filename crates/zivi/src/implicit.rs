//! The force at the end of a step that itself depends on the force.
//!
//! With the force frozen at a trial value the step has a closed form; what is left is one scalar
//! equation for that value, `mismatch(f) = f(t, x(f), x'(f)) - f = 0`. Within one sign pattern
//! `x` and `x'` are affine in the trial, so for a linear force one secant step is exact. The slope is carried from
//! step to step, and a bracket is kept wherever the mismatch has changed sign.

use zivi_core::{Physical, StepSolution, ThetaGammaStep};

use crate::fixed_step::{finite_force, Failure, Start};
use crate::{Force, Status};

/// The mismatch that is accepted, relative to the largest force met in the run.
pub(crate) const TOLERANCE: f64 = 1e-12;
/// Trial forces in one step.
pub(crate) const MAX_TRIALS: usize = 100;

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
        Self { last: None, slope: -1.0, magnitude: 0.0, nfev: 0 }
    }
}

impl ImplicitForce {
    /// The step from `start` and its force, consistent to [`TOLERANCE`].
    pub(crate) fn solve<E>(
        &mut self,
        step: &ThetaGammaStep,
        start: Start,
        force: &mut impl Force<E>,
    ) -> Result<(f64, StepSolution), Failure<E>> {
        let t = start.t + step.theta() * step.h();
        let mut trial = match self.last {
            Some(last) => last,
            None => self.evaluate(force, t, state_at_theta(step, start, None))?,
        };
        let mut bracket = Bracket::default();
        let mut previous: Option<(f64, f64)> = None;
        for _ in 0..MAX_TRIALS {
            let end = step.solve(start.z, trial, start.side)?;
            let value = self.evaluate(force, t, state_at_theta(step, start, Some(&end)))?;
            let mismatch = value - trial;
            if mismatch.abs() <= TOLERANCE * self.magnitude {
                self.last = Some(trial);
                return Ok((trial, end));
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
        self.slope = if secant < -1e-3 && secant.is_finite() { secant } else { -1.0 };
    }
}

/// `(x, x')` at `t + theta h`; at the start of the step while there is no end.
fn state_at_theta(step: &ThetaGammaStep, start: Start, end: Option<&StepSolution>) -> Physical {
    let Some(end) = end else {
        return zivi_core::transform::project(start.z, step.wall());
    };
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
