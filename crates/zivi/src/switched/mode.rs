//! Mode of a mass, flight or rest, with its data.
//!
//! ```text
//! Step, Leave  -- impact ---->  AfterImpact         Leave  -- step ------>  Step
//! AfterImpact  -- bounces -------->  Step           Rest   -- lift-off -->  Leave
//! AfterImpact  -- accumulates ---->  Jump  -->  Rest
//! AfterImpact  -- stops, stays --->  Step in the origin  -->  Rest
//! AfterImpact  -- stops, pulled -->  Leave
//! ```

use crate::numeric::coordinates::State;
use crate::piecewise::steps::StepHistory;
use crate::{Impact, Physical};

/// Present mode of the mass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Mode {
    /// `x'' = f`.
    Flight(NextInFlight),
    /// `x = x' = 0` while `f(t, 0, 0) <= 0`.
    Rest(Rest),
}

/// Next operation in flight. The tag is separate from its data, so one instruction writes it.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(u32)]
pub(super) enum NextInFlight {
    /// The last impact has not been evaluated yet.
    AfterImpact,
    /// A step, or the part of it up to an impact.
    Step {
        experience: StepHistory,
        /// Whether the state is that at the end of the last step of the pair, under the same force.
        continues: bool,
    },
    /// The first step off the wall from rest. The distance starts with a root of this order, and
    /// the wall is not looked out for.
    Leave { order: usize },
    /// The jump to rest, at the time at which the impacts accumulate.
    Jump { zeno: f64 },
}

/// Rest at the wall.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Rest {
    /// How far ahead its end was when it began, at most (s).
    pub(super) horizon: f64,
}

impl Mode {
    /// Rest from now on.
    pub(super) const REST: Self = Self::Rest(Rest { horizon: 0.0 });

    /// Flight whose first step is yet to come.
    pub(super) const FLIGHT: Self =
        Self::Flight(NextInFlight::Step { experience: StepHistory::NONE, continues: false });
    /// The lift-off at a jump of the force to a positive value.
    pub(super) const LIFT_OFF: Self = Self::Flight(NextInFlight::Leave { order: 2 });
    /// The lift-off where the force grows from zero.
    pub(super) const SMOOTH_LIFT_OFF: Self = Self::Flight(NextInFlight::Leave { order: 3 });

    /// The same under another force. A mass that was about to lift off asks again.
    #[inline]
    pub(super) fn forget_force(&mut self) {
        match self {
            Self::Flight(NextInFlight::Step { continues, .. }) => *continues = false,
            Self::Flight(NextInFlight::Leave { .. } | NextInFlight::Jump { .. }) => {
                *self = Self::FLIGHT;
            }
            Self::Flight(NextInFlight::AfterImpact) | Self::Rest(_) => (),
        }
    }

    /// Data of the rest that continues or begins.
    #[inline]
    pub(super) fn rest(&self) -> Rest {
        match *self {
            Self::Rest(rest) => rest,
            Self::Flight(_) => Rest::default(),
        }
    }

    /// Step history for the length of the next step.
    #[inline]
    pub(super) fn experience(&self) -> StepHistory {
        match *self {
            Self::Flight(NextInFlight::Step { experience, .. }) => experience,
            _ => StepHistory::NONE,
        }
    }

    /// Whether the state is that at the end of the last step of the pair.
    #[inline]
    pub(super) fn continues(&self) -> bool {
        matches!(self, Self::Flight(NextInFlight::Step { continues: true, .. }))
    }

    /// Whether the first step off the wall from rest comes next.
    #[inline]
    pub(super) fn leaves(&self) -> bool {
        matches!(self, Self::Flight(NextInFlight::Leave { .. }))
    }

    /// A step of length `h` was taken.
    #[inline]
    pub(super) fn step(&mut self, h: f64) {
        let mut experience = self.experience();
        experience.gain(h);
        *self = Self::Flight(NextInFlight::Step { experience, continues: true });
    }
}

// Result of one integrator step, and its cost.

/// How much work was done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Evaluations of the force.
    pub nfev: u64,
    /// Steps that were taken in flight.
    pub accepted: u64,
    /// Steps that were tried and given up for smaller ones.
    pub rejected: u64,
    /// Impacts that were computed; those that a jump to rest skips are not among them.
    pub impacts: u64,
}

/// A part of the motion that one step of the integrator covers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Piece {
    /// Free flight from a state, up to an impact if any.
    Flight { from: Point, sigma: f64, impact: Option<Impact> },
    /// Infinitely many impacts, of which the integrator knows more.
    Tail,
    /// Rest since a time, up to a lift-off or the end of the examined force.
    Rest { from: f64, lifted: bool },
}

// Where the mass is.

/// The state of the mass at a time.
pub(crate) type Point = State<f64>;

impl Point {
    /// Without the time.
    #[inline(always)]
    pub(super) fn physical(self) -> Physical {
        Physical { x: self.x, xdot: self.xdot }
    }
}
