//! What a mass does, flight or rest, and what is known in each of them.
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
use crate::record::recorder::Trajectory;
use crate::record::user_events::{LocatedEvent, UserEvent};
use crate::switched::path::DensePath;
use crate::switched::samples::Samples;
use crate::zeno::tail::Tail;
use crate::{Impact, Physical};

// What a mass does, flight or rest, and what is known in each of them.
//
// ```text
// Step, Leave  -- impact ---->  AfterImpact         Leave  -- step ------>  Step
// AfterImpact  -- bounces -------->  Step           Rest   -- lift-off -->  Leave
// AfterImpact  -- accumulates ---->  Jump  -->  Rest
// AfterImpact  -- stops, stays --->  Step in the origin  -->  Rest
// AfterImpact  -- stops, pulled -->  Leave
// ```

/// What the mass does now.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Mode {
    /// `x'' = f`.
    Flight(Flight),
    /// `x = x' = 0` while `f(t, 0, 0) <= 0`.
    Rest(Rest),
}

/// What comes next in flight. A tag apart from what it holds is written in one instruction, as once
/// an impact.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(u32)]
pub(super) enum Flight {
    /// The last impact has yet to be thought about.
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
        Self::Flight(Flight::Step { experience: StepHistory::NONE, continues: false });
    /// The lift-off where the force is positive all at once.
    pub(super) const LIFT_OFF: Self = Self::Flight(Flight::Leave { order: 2 });
    /// The lift-off where the force grows from zero.
    pub(super) const SMOOTH_LIFT_OFF: Self = Self::Flight(Flight::Leave { order: 3 });

    /// The same under another force. A mass that was about to lift off asks again.
    #[inline]
    pub(super) fn forget_force(&mut self) {
        match self {
            Self::Flight(Flight::Step { continues, .. }) => *continues = false,
            Self::Flight(Flight::Leave { .. } | Flight::Jump { .. }) => {
                *self = Self::FLIGHT;
            }
            Self::Flight(Flight::AfterImpact) | Self::Rest(_) => (),
        }
    }

    /// What is known of the rest that continues, or begins.
    #[inline]
    pub(super) fn rest(&self) -> Rest {
        match *self {
            Self::Rest(rest) => rest,
            Self::Flight(_) => Rest::default(),
        }
    }

    /// What speaks for the length of the next step.
    #[inline]
    pub(super) fn experience(&self) -> StepHistory {
        match *self {
            Self::Flight(Flight::Step { experience, .. }) => experience,
            _ => StepHistory::NONE,
        }
    }

    /// Whether the state is that at the end of the last step of the pair.
    #[inline]
    pub(super) fn continues(&self) -> bool {
        matches!(self, Self::Flight(Flight::Step { continues: true, .. }))
    }

    /// Whether the first step off the wall from rest comes next.
    #[inline]
    pub(super) fn leaves(&self) -> bool {
        matches!(self, Self::Flight(Flight::Leave { .. }))
    }

    /// A step of length `h` was taken.
    #[inline]
    pub(super) fn step(&mut self, h: f64) {
        let mut experience = self.experience();
        experience.gain(h);
        *self = Self::Flight(Flight::Step { experience, continues: true });
    }
}

// What one step of the integrator covers, and how much work it was.

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
    /// Free flight from a state, up to an impact if there is one.
    Flight { from: Point, sigma: f64, impact: Option<Impact> },
    /// Infinitely many impacts, of which the integrator knows more.
    Tail,
    /// Rest since a time, up to a lift-off or as far as the force was looked at.
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

// What is requested of a run, and what it leaves.

/// What a run shall give, besides its impacts, Zeno points and lift-offs.
pub struct Output<'a, E> {
    /// Times of the samples, increasing and within the span. `None`: a sample at the start, at
    /// the end of each step, at each impact (the state after it, with `x = 0`), Zeno point and
    /// lift-off, and at the end.
    pub t_eval: Option<&'a [f64]>,
    /// Times at which the force is not smooth (s), increasing: steps end there, the force is
    /// evaluated on either side but never across, chains of impacts and the look ahead at rest begin
    /// anew.
    pub tstops: &'a [f64],
    /// Whether to keep the motion as a function of time.
    pub dense: bool,
    /// Whether, where that is kept and no times are given, there are samples between the steps,
    /// before impacts and at apexes too, so that lines through them draw the motion.
    pub drawn: bool,
    /// Whether the samples stay as they were recorded, [`SwitchedRun::rows`]: a long run that is
    /// stopped returns at once, its columns are made when they are wanted.
    pub in_rows: bool,
    /// The user's events.
    pub events: Vec<UserEvent<'a, E>>,
}

impl<E> Default for Output<'_, E> {
    fn default() -> Self {
        let (dense, drawn, in_rows) = (false, false, false);
        Self { t_eval: None, tstops: &[], dense, drawn, in_rows, events: Vec::new() }
    }
}

/// A run of the switched method.
#[derive(Clone, Debug, PartialEq)]
pub struct SwitchedRun<E> {
    /// Samples, impacts, Zeno points, lift-offs, status.
    pub trajectory: Trajectory,
    /// The error that the force, an event or the monitor raised (the status is
    /// [`crate::Status::Raised`] then).
    pub raised: Option<E>,
    /// The samples, instead of the columns of the trajectory, if [`Output::in_rows`] asked for them.
    pub rows: Option<Samples>,
    /// The motion as a function of time, if [`Output::dense`] asked for it.
    pub path: Option<DensePath>,
    /// The arcs that jumps to rest skipped, in order.
    pub tails: Vec<Tail>,
    /// For each event of the user what happened, in order.
    pub hits: Vec<Vec<LocatedEvent>>,
    /// How much work was done.
    pub counts: Counts,
    /// The time and the state up to which the motion is known, whatever is sampled.
    pub end: (f64, Physical),
}

impl<E> SwitchedRun<E> {
    /// All impacts with a speed of at least `speed` (m/s) after them, those included that a jump
    /// to rest skipped, in order; at most `at_most` of each tail.
    ///
    /// ```
    /// use zivi::{
    ///     simulate_switched_rk, ConstantForce, Output, Physical, Restitution, Silent, SwitchedRk,
    /// };
    ///
    /// let (ball, restitution) = (Physical { x: 1.0, xdot: 0.0 }, Restitution::from_e(0.5)?);
    /// let run = simulate_switched_rk(
    ///     SwitchedRk::default(), restitution, &mut ConstantForce(-2.0), (0.0, 4.0), ball,
    ///     Output::default(), &mut Silent,
    /// )?;
    /// assert_eq!(run.trajectory.events.impacts.len(), 3);
    /// // 2 m/s at the first impact, 2^-20 m/s after the 21st
    /// assert_eq!(run.impacts_down_to(0.99 * 0.5f64.powi(20), 1000).len(), 21);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn impacts_down_to(&self, speed: f64, at_most: usize) -> Vec<Impact> {
        let fast = |impact: &Impact| impact.xdot_after >= speed;
        let mut all = Vec::new();
        let mut tails = self.tails.iter().peekable();
        for impact in &self.trajectory.events.impacts {
            while let Some(tail) = tails.next_if(|tail| tail.start() < impact.t) {
                all.extend(tail.impacts_down_to(speed, at_most));
            }
            all.extend(Some(*impact).filter(fast));
        }
        all.extend(tails.flat_map(|tail| tail.impacts_down_to(speed, at_most)));
        all
    }
}
