//! The lengths of steps from one to the next, and how many there may be.

use std::ops::Range;

use super::lookahead::Obstacle;
use super::settings::SwitchedRk;
use crate::numeric::coordinates::{Coordinates, State};
use crate::numeric::stages::{Equation, Stages};
use crate::numeric::step_error::Tolerances;
use crate::numeric::step_size::{Jump, Plan};
use crate::record::failure::Failure;
use crate::Status;

/// A step near a Zeno point is a little longer than the arc under a constant pull.
const ARC: f64 = 1.1;

/// How long steps are and how many there were.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct StepControl {
    /// Step size to try next (s).
    pub(crate) h: Option<f64>,
    pub(crate) jump: Jump,
    /// Steps that were tried.
    pub(crate) spent: usize,
}

impl StepControl {
    /// Counts a step; an error when there were too many.
    pub(crate) fn spend<E>(&mut self, settings: &SwitchedRk) -> Result<(), Failure<E>> {
        self.left(settings)?;
        self.spent += 1;
        Ok(())
    }

    /// The next step: of the length that is wanted, `first` before there was any, or of one that
    /// something cuts short. Of an arc from a contact (the coordinates `gaps`) a little more than
    /// its whole length; not across an obstacle; up to the end, `left` away.
    #[inline(always)]
    pub(crate) fn plan<Q: Coordinates>(
        (settings, first): (&SwitchedRk, f64),
        (now, slope): (&State<Q>, &Q),
        gaps: Range<usize>,
        obstacle: Option<Obstacle>,
        left: f64,
    ) -> Plan {
        let wanted = first.min(settings.max_step);
        let (x, xdot, slope) = (now.x.as_slice(), now.xdot.as_slice(), slope.as_slice());
        let mut h = wanted;
        for c in gaps {
            let (speed, pull) = (xdot[c], -slope[c]);
            if x[c] == 0.0 && speed > 0.0 && pull > 0.0 {
                h = h.min(ARC * 2.0 * speed / pull);
            }
        }
        if let Some(obstacle) = obstacle {
            h = h.min(obstacle.longest_step(now.t));
        }
        Plan::up_to(left, h, wanted)
    }

    /// The error of the last step relative to the tolerances: none where steps are not adapted to
    /// them, or where all that is left of a step is a jump of the accelerations.
    #[inline(always)]
    pub(crate) fn error<Q: Coordinates, X>(
        &mut self,
        stages: &mut Stages<Q>,
        (settings, tolerances): (&SwitchedRk, &Tolerances),
        equation: &mut impl Equation<Q, X>,
    ) -> Result<f64, X> {
        if !settings.adaptive {
            return Ok(0.0);
        }
        let error = stages.error(tolerances, equation)?;
        if self.jump.allowed && error > 1.0 && stages.is_smooth_to_rounding() {
            self.jump.met = true;
            return Ok(0.0);
        }
        Ok(error)
    }

    /// The length to try after a step of length `h` that was given up, shorter by a factor. Where
    /// that is shorter than the shortest the reason ends the run, unless it may be a jump of the
    /// accelerations.
    #[inline]
    pub(crate) fn shorter<E>(
        &mut self,
        h: f64,
        shortest: f64,
        (factor, why): (f64, Status),
        may_jump: bool,
    ) -> Result<f64, Failure<E>> {
        let h = h * factor;
        if h <= shortest && may_jump && self.jump.may_be_allowed() {
            self.jump.allowed = true;
            return Ok(shortest);
        }
        if h <= shortest || h < f64::MIN_POSITIVE {
            return Err(Failure::Status(why));
        }
        Ok(h)
    }

    /// How many steps there may be yet; an error if there are none.
    pub(crate) fn left<E>(&self, settings: &SwitchedRk) -> Result<usize, Failure<E>> {
        let left = settings.max_steps.saturating_sub(self.spent);
        if left == 0 {
            return Err(Failure::Status(Status::StepBudget));
        }
        Ok(left)
    }
}

/// What speaks for the length of a step: those before it since the last event.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Experience {
    /// How many.
    steps: u32,
    /// The length of the last (s).
    last: f64,
}

impl Experience {
    pub(crate) const NONE: Self = Self { steps: 0, last: 0.0 };
    /// So many steps after an event there is none.
    const YOUNG: u32 = 1;
    /// Nor is there any for a step that is so many times longer than the last.
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

/// Who looks at the ends of steps and at the motion between them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Looks {
    /// Steps that end later than this have their polynomials computed.
    pub(crate) dense_from: f64,
    /// Whether all ends of steps are looked at.
    pub(crate) by_steps: bool,
}

impl Looks {
    /// Nobody.
    pub(crate) const NONE: Self = Self { dense_from: f64::INFINITY, by_steps: false };
}
