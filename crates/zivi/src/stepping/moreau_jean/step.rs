//! One step of Moreau's scheme, and the scalar equation of a force that is evaluated at its end.

use zivi_core::Physical;

use crate::record::failure::Failure;
use crate::stepping::implicit::opening::{Opening, Shown};
use crate::stepping::implicit::search::{Search, DEFAULT_SLOPE};
use crate::system::evaluation::finite_force;
use crate::{Dependence, Force, Status};

/// One step of (1).
#[derive(Clone, Copy, Debug)]
pub(super) struct Step {
    pub(super) end: Physical,
    /// `P`, and the change of velocity that the force alone gives.
    pub(super) impulse: f64,
    pub(super) pull: f64,
}

/// The scheme with what it carries from step to step.
pub(crate) struct Stepper {
    theta: f64,
    e: f64,
    /// The force at the start of the step.
    pub(crate) here: Option<f64>,
    /// The value of a force that depends on nothing, once it is known.
    pub(super) fixed: Option<f64>,
    /// Slope of the mismatch at the last solution.
    pub(crate) slope: f64,
    /// The largest force so far.
    pub(crate) largest: f64,
    pub(crate) nfev: u64,
}

/// The mismatch of the force at the end of a step that is accepted, relative to the force.
pub(crate) const TOLERANCE: f64 = 1e-12;
/// Trial forces in a step.
const TRIALS: usize = 60;
/// From this trial on a mismatch at the rounding of the force is accepted too.
const SLOW: usize = 3;
/// Change of the force within the rounding of the state, relative to the largest so far.
const JUMP: f64 = 1e-6;

impl Stepper {
    pub(super) fn new(theta: f64, e: f64) -> Self {
        Self { theta, e, here: None, fixed: None, slope: DEFAULT_SLOPE, largest: 0.0, nfev: 0 }
    }

    pub(super) fn step<E>(
        &mut self,
        start: Physical,
        (t, t_end): (f64, f64),
        h: f64,
        force: &mut impl Force<E>,
    ) -> Result<Step, Failure<E>> {
        if let Some(f) = self.fixed {
            return Ok(self.under(f, start, h));
        }
        let dependence = force.dependence();
        let first = match self.here {
            Some(f) => f,
            None => self.evaluate(force, t, start)?,
        };
        if dependence == Dependence::Constant {
            self.fixed = Some(first);
            return Ok(self.under(first, start, h));
        }
        let theta = self.theta;
        if dependence == Dependence::State && theta > 0.0 {
            return self.implicit(start, first, t_end, h, force);
        }
        let known = if theta > 0.0 { Some(self.evaluate(force, t_end, start)?) } else { None };
        let f = (1.0 - theta) * first + theta * known.unwrap_or(0.0);
        let step = self.under(f, start, h);
        self.here = match known {
            Some(last) => Some(last),
            None => Some(self.evaluate(force, t_end, step.end)?),
        };
        Ok(step)
    }

    /// The step whose force at the end is that of the state at the end: one scalar equation.
    fn implicit<E>(
        &mut self,
        start: Physical,
        first: f64,
        t_end: f64,
        h: f64,
        force: &mut impl Force<E>,
    ) -> Result<Step, Failure<E>> {
        let mut opening = Opening::from(first, self.slope);
        let found = opening.root(|last| -> Result<_, Failure<E>> {
            let (step, value) = self.tried((first, last), start, t_end, h, force)?;
            if !is_consistent(value, last, first) {
                return Ok(Shown::Mismatch(value - last));
            }
            self.here = Some(last);
            Ok(Shown::Root(step))
        });
        match found? {
            Some(step) => Ok(step),
            None => self.follow(opening.search(TRIALS), (start, first), t_end, h, force),
        }
    }

    /// The same where the first two trials are not it.
    #[inline(never)]
    fn follow<E>(
        &mut self,
        mut search: Search,
        (start, first): (Physical, f64),
        t_end: f64,
        h: f64,
        force: &mut impl Force<E>,
    ) -> Result<Step, Failure<E>> {
        while let Some(last) = search.trial() {
            let (step, value) = self.tried((first, last), start, t_end, h, force)?;
            let mismatch = value - last;
            if is_consistent(value, last, first)
                || (search.trials() > SLOW
                    && mismatch.abs() <= self.rounding(step.end, value, t_end, force)?)
            {
                (self.slope, self.here) = (search.slope(), Some(last));
                return Ok(step);
            }
            search.learn(mismatch);
        }
        Err(Failure::Status(Status::ForceNotConverged))
    }

    /// The step under the forces `first` at its start and `last` at its end, and the force there.
    #[inline(always)]
    fn tried<E>(
        &mut self,
        (first, last): (f64, f64),
        start: Physical,
        t_end: f64,
        h: f64,
        force: &mut impl Force<E>,
    ) -> Result<(Step, f64), Failure<E>> {
        let step = self.under((1.0 - self.theta) * first + self.theta * last, start, h);
        let value = self.evaluate(force, t_end, step.end)?;
        Ok((step, value))
    }

    /// How much the force changes when the state changes by its rounding: no trial can do better.
    #[cold]
    fn rounding<E>(
        &mut self,
        Physical { x, xdot }: Physical,
        value: f64,
        t: f64,
        force: &mut impl Force<E>,
    ) -> Result<f64, Failure<E>> {
        let beside = |z: f64| z * (1.0 + 8.0 * f64::EPSILON);
        let by_x = self.evaluate(force, t, Physical { x: beside(x), xdot })? - value;
        let by_xdot = self.evaluate(force, t, Physical { x, xdot: beside(xdot) })? - value;
        let rounding = by_x.abs() + by_xdot.abs() + 8.0 * f64::EPSILON * value.abs();
        // more than that is no rounding but a jump of the force
        Ok(if rounding <= JUMP * self.largest { rounding } else { 0.0 })
    }

    /// The step under the force `f_theta`.
    #[inline(always)]
    pub(super) fn under(&self, f: f64, start: Physical, h: f64) -> Step {
        let Physical { x, xdot: v } = start;
        let free = v + h * f;
        let closed = x + 0.5 * h * v <= 0.0;
        let xdot = if closed { free.max(-self.e * v) } else { free };
        let end = Physical { x: x + h * (self.theta * xdot + (1.0 - self.theta) * v), xdot };
        Step { end, impulse: xdot - free, pull: h * f }
    }

    fn evaluate<E>(
        &mut self,
        force: &mut impl Force<E>,
        t: f64,
        state: Physical,
    ) -> Result<f64, Failure<E>> {
        self.nfev += 1;
        let f = finite_force(force, t, state)?;
        self.largest = self.largest.max(f.abs());
        Ok(f)
    }
}

/// Whether the trial `last` is the force at the end of the step that it gives.
#[inline(always)]
fn is_consistent(value: f64, last: f64, first: f64) -> bool {
    (value - last).abs() <= TOLERANCE * value.abs().max(first.abs())
}
