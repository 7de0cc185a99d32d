//! Steps of a pair under error control: the last of them, how long the next may be, how many there
//! were.

use crate::numeric::coordinates::{Coordinates, State};
use crate::numeric::stages::{
    factor, first_step, shorter, Equation, Jump, Plan, Stages, Tolerances, FACTORS,
};
use crate::numeric::tableau::Pair;
use crate::record::recorder::Recorded;
use crate::record::status::Failure;
use crate::system::force::Smooth;
use crate::Status;
use std::ops::Range;

/// A step near a Zeno point is a little longer than the flight under a constant acceleration.
const ARC: f64 = 1.1;

/// Step limits from the settings of a method.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StepLimits {
    /// Whether the lengths of steps are adapted to the tolerances; else all are `max_step` long.
    pub(crate) adaptive: bool,
    pub(crate) tolerances: Tolerances,
    /// The longest step (s).
    pub(crate) max_step: f64,
    pub(crate) max_steps: usize,
}

/// The state from which a step starts, and the accelerations there.
pub(crate) type Start<'r, Q> = (&'r State<Q>, &'r Q);

/// The steps of a run.
#[derive(Clone, Debug)]
pub(crate) struct Steps<Q: Coordinates> {
    limits: StepLimits,
    last: Stages<Q>,
    /// Step size to try next (s).
    next: Option<f64>,
    jump: Jump,
    /// Steps that were tried.
    spent: usize,
    accepted: u64,
    rejected: u64,
    /// Steps that end later than this have their polynomials computed.
    dense_from: f64,
}

impl<Q: Coordinates> Steps<Q> {
    /// Steps of a pair for a number of coordinates; `next` is the length of the first, if given.
    pub(crate) fn new(
        limits: StepLimits,
        pair: &'static Pair,
        count: usize,
        next: Option<f64>,
    ) -> Self {
        let (last, jump) = (Stages::new(pair, count), Jump::default());
        let (spent, accepted, rejected) = (0, 0, 0);
        Self { limits, last, next, jump, spent, accepted, rejected, dense_from: f64::INFINITY }
    }

    pub(crate) fn limits(&self) -> &StepLimits {
        &self.limits
    }

    /// The last step.
    #[inline(always)]
    pub(crate) fn last(&self) -> &Stages<Q> {
        &self.last
    }

    /// The same, to have its polynomials computed.
    #[inline(always)]
    pub(crate) fn last_mut(&mut self) -> &mut Stages<Q> {
        &mut self.last
    }

    /// From when on the motion between the ends of steps is requested.
    #[inline]
    pub(crate) fn dense_from(&self) -> f64 {
        self.dense_from
    }

    /// Steps that end later than this have their polynomials computed.
    #[inline]
    pub(crate) fn look_from(&mut self, t: f64) {
        self.dense_from = t;
    }

    /// How many were taken, and how many were given up for shorter ones.
    pub(crate) fn counts(&self) -> (u64, u64) {
        (self.accepted, self.rejected)
    }

    /// The proposed length of the next step (s), if any.
    #[inline]
    pub(crate) fn next(&self) -> Option<f64> {
        self.next
    }

    /// Sets the length of the next step; `None` for an estimate.
    #[inline]
    pub(crate) fn set_next(&mut self, next: Option<f64>) {
        self.next = next;
    }

    /// The next is no longer than this.
    pub(crate) fn limit_next(&mut self, longest: f64) {
        self.next = self.next.map(|next| next.min(longest));
    }

    /// Rejects the last step, the last of `rejected`, and sets the next length `h`.
    pub(crate) fn retry(&mut self, h: f64, rejected: u64) {
        (self.next, self.rejected) = (Some(h), rejected);
    }

    /// Counts from here on how many may be tried.
    pub(crate) fn start_budget(&mut self) {
        self.spent = 0;
    }

    /// How many there may be yet; an error if there are none.
    #[inline]
    pub(crate) fn left<E>(&self) -> Result<usize, Failure<E>> {
        let left = self.limits.max_steps.saturating_sub(self.spent);
        if left == 0 {
            return Err(Failure::Status(Status::StepBudget));
        }
        Ok(left)
    }

    /// Counts a step; an error when there were too many.
    #[inline]
    pub(crate) fn spend<E>(&mut self) -> Result<(), Failure<E>> {
        self.left()?;
        self.spent += 1;
        Ok(())
    }

    /// Counts steps that another method took.
    #[inline]
    pub(crate) fn count(&mut self, steps: usize) {
        self.spent += steps;
        self.accepted += steps as u64;
    }

    /// The last step, or the part of it up to an event, is taken.
    #[inline]
    pub(crate) fn accept(&mut self) {
        self.accepted += 1;
    }

    /// The next attempt is the first of a step.
    #[inline]
    pub(super) fn begin(&mut self) {
        self.jump = self.jump.next();
    }

    /// Whether the last step is one across a jump of the accelerations.
    #[inline]
    pub(crate) fn is_jump(&self) -> bool {
        self.jump.allowed
    }

    /// Whether the last step goes as far as `t_end`.
    #[inline]
    pub(crate) fn reaches(&self, t_end: f64) -> bool {
        let Stages { from, h, .. } = &self.last;
        *h >= (t_end - from.t) - from.late
    }

    /// The next step up to `t_end`: of the length that is wanted, or shorter, cut by an event
    /// short. Of a flight from a contact (the coordinates `gaps`) a little more than its whole
    /// length; not longer than `longest`. Before there was any, the accelerations and their change
    /// say what is wanted.
    #[inline(always)]
    pub(crate) fn plan<E>(
        &self,
        (now, slope): Start<'_, Q>,
        gaps: Range<usize>,
        longest: f64,
        t_end: f64,
        equation: &mut impl Equation<Q, Failure<E>>,
    ) -> Result<Plan, Failure<E>> {
        let left = (t_end - now.t) - now.late;
        let StepLimits { adaptive, tolerances, max_step, .. } = &self.limits;
        let first = match self.next {
            _ if !adaptive => *max_step,
            Some(h) => h,
            None => {
                let control = (tolerances, self.last.order_of_error());
                let harmless = |why: &Failure<E>| matches!(why, Failure::Status(_));
                let first = first_step(now, slope, left, control, equation, harmless)?;
                // where a short one would be followed by a long one, two of a length see more
                let two = equation.is_autonomous() && longest <= (1.0 + FACTORS.1) * first;
                first.max(if two { 0.5 * longest } else { 0.0 })
            }
        };
        let wanted = first.min(*max_step);
        let (x, xdot, slope) = (now.x.as_slice(), now.xdot.as_slice(), slope.as_slice());
        let mut h = wanted;
        for c in gaps {
            let (speed, pull) = (xdot[c], -slope[c]);
            if x[c] == 0.0 && speed > 0.0 && pull > 0.0 {
                h = h.min(ARC * 2.0 * speed / pull);
            }
        }
        Ok(Plan::up_to(left, h.min(longest), wanted))
    }

    /// The step of length `h` from a state, and its error relative to the tolerances: `None` if
    /// steps are not adapted to them, or if the step is reduced to a jump of the accelerations.
    #[inline(always)]
    pub(super) fn attempt<E>(
        &mut self,
        (now, slope): Start<'_, Q>,
        h: f64,
        equation: &mut impl Equation<Q, Failure<E>>,
    ) -> Result<f64, Failure<E>> {
        self.last.step(now, slope, h, equation)?;
        if !self.last.is_finite() {
            return Err(Failure::Status(Status::StateNotFinite));
        }
        if !self.limits.adaptive {
            return Ok(0.0);
        }
        let error = self.last.error(&self.limits.tolerances, equation)?;
        if self.jump.allowed && error > 1.0 && self.last.is_smooth_to_rounding() {
            self.jump.met = true;
            return Ok(0.0);
        }
        Ok(error)
    }

    /// By which factor the next step may be longer than the last, if its error was that; a factor
    /// for a shorter one if the error is too large.
    #[inline(always)]
    pub(super) fn growth(&self, error: f64) -> Result<f64, f64> {
        let factor = factor(error, self.last.order_of_error());
        if error > 1.0 || error.is_nan() {
            return Err(shorter(factor));
        }
        Ok(if self.limits.adaptive { factor.min(FACTORS.1) } else { 1.0 })
    }

    /// The length to try after a step of length `h` that is given up, shorter by a factor. Where
    /// that is shorter than the shortest the reason ends the run, unless it may be a jump of the
    /// accelerations.
    #[inline]
    pub(super) fn shorter<E>(
        &mut self,
        h: f64,
        shortest: f64,
        (factor, why): (f64, Status),
    ) -> Result<f64, Failure<E>> {
        self.rejected += 1;
        let h = h * factor;
        let may_jump = matches!(why, Status::StepSizeTooSmall | Status::ContactNotSolved);
        if h <= shortest && may_jump && self.jump.may_be_allowed() {
            self.jump.allowed = true;
            return Ok(shortest);
        }
        if h <= shortest || h < f64::MIN_POSITIVE {
            return Err(Failure::Status(why));
        }
        Ok(h)
    }
}

/// Step history since the last event, for the choice of the step length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct StepHistory {
    /// How many.
    steps: u32,
    /// The length of the last (s).
    last: f64,
}

impl StepHistory {
    pub(crate) const NONE: Self = Self { steps: 0, last: 0.0 };
    /// So many steps after an event there is none.
    const YOUNG: u32 = 1;
    /// It does not cover a step longer than the last by this factor.
    const GREW: f64 = 2.0;

    /// A step of this length was taken.
    #[inline]
    pub(crate) fn gain(&mut self, length: f64) {
        (self.steps, self.last) = (self.steps + 1, length);
    }

    /// Whether there is enough for a step of this length to be taken without another look.
    #[inline]
    pub(crate) fn is_enough(self, length: f64) -> bool {
        self.steps > Self::YOUNG && length <= Self::GREW * self.last
    }
}

// What a run asks of a method that advances piece by piece.

/// A method that advances segment by segment: a step, a jump, an event at an instant.
pub(crate) trait Piecewise {
    /// A recorded state.
    type Point: Recorded;
    /// Description of a segment.
    type Piece;

    /// Time (s).
    fn t(&self) -> f64;

    /// Writes the present state.
    fn state_to(&self, to: &mut Self::Point);

    /// Whether an event is pending before the time passes `t_end`.
    fn is_pending(&self, _t_end: f64) -> bool {
        false
    }

    /// Forgets what was learnt from the forces: from here on they are others.
    fn restart(&mut self);

    /// Steps that end later than `t` have their polynomials computed; the motion within those that
    /// end later than `drawn` is requested.
    fn look_from(&mut self, t: f64, drawn: f64);
}

/// Right-hand side of a method: a force or the equations of motion. Times at which it is not smooth
/// are declared.
pub(crate) trait Rhs {
    /// Between which of these it is.
    fn smooth(&mut self) -> &mut Smooth;
}

/// Consumer of the segments of a run; it may reject a step and request a shorter one.
pub(crate) trait Driver<M: Piecewise, S, E> {
    /// The next segment of the motion, towards `t_end`.
    fn step(&mut self, method: &mut M, t_end: f64, asked: &mut S) -> Result<M::Piece, Failure<E>>;

    /// A declared time is passed: from here on the forces may be others.
    fn enter(&mut self, _method: &mut M, _asked: &mut S) -> Result<(), Failure<E>> {
        Ok(())
    }
}

/// A method that accepts segments unchanged.
pub(crate) trait Advance<S, E>: Piecewise {
    /// The next segment of the motion, towards `t_end`.
    fn next(&mut self, t_end: f64, asked: &mut S) -> Result<Self::Piece, Failure<E>>;
}

/// Accepts segments unchanged.
pub(crate) struct NoSink;

impl<M: Advance<S, E>, S, E> Driver<M, S, E> for NoSink {
    fn step(&mut self, method: &mut M, t_end: f64, asked: &mut S) -> Result<M::Piece, Failure<E>> {
        method.next(t_end, asked)
    }
}
