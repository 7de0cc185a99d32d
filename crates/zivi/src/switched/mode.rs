//! Mode of a mass, flight or rest, with its data.
//!
//! ```text
//! Step, Leave  -- impact ---->  AfterImpact         Leave  -- step ------>  Step
//! AfterImpact  -- bounces -------->  Step           Rest   -- lift-off -->  Leave
//! AfterImpact  -- accumulates ---->  Jump  -->  Rest
//! AfterImpact  -- stops, stays --->  Step in the origin  -->  Rest
//! AfterImpact  -- stops, pulled -->  Leave
//! ```

use super::flight::series::table::Linear;
use crate::numeric::bernstein::Bernstein;
use crate::numeric::coordinates::State;
use crate::numeric::stages::{Equation, StepError};
use crate::piecewise::steps::StepHistory;
use crate::record::status::Failure;
use crate::system::dynamics::{ends_at_the_wall, evaluate};
use crate::system::force::Smooth;
use crate::zeno::tail::Tail;
use crate::{Dependence, Force, Impact, Physical};

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
    /// The Zeno extrapolation, at the time at which the impacts accumulate.
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
    /// Impacts that were computed; those that a Zeno extrapolation skips are not among them.
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

// The motion of the mass as an equation that the pairs integrate, `x'' = f(t, x, x')`.

/// The last step of the mass.
pub(super) type Stages = crate::numeric::stages::Stages<f64>;

/// A force whose evaluations are counted.
pub(crate) struct Counted<'a, F> {
    force: &'a mut F,
    count: u64,
    /// It is evaluated at no times outside.
    pub(super) smooth: Smooth,
    /// Its numbers if linear: then it is not evaluated.
    linear: Option<&'a Linear>,
    /// Its value at the wall, once it is known, where that does not depend on time.
    at_wall: Option<f64>,
}

impl<'a, F> Counted<'a, F> {
    pub(crate) fn new(force: &'a mut F) -> Self {
        Self::known(force, None)
    }

    /// The same, known by its numbers if there are any.
    pub(crate) fn known(force: &'a mut F, linear: Option<&'a Linear>) -> Self {
        Self { force, count: 0, smooth: Smooth::ALWAYS, linear, at_wall: None }
    }

    pub(super) fn count(&self) -> u64 {
        self.count
    }

    /// The force itself, the time at which it is evaluated instead of `t`, and the window for that.
    pub(super) fn smooth_at(&mut self, t: f64) -> (&mut F, f64, (f64, f64)) {
        (self.force, self.smooth.nearest(t), self.smooth.ends())
    }

    pub(super) fn at<E>(&mut self, t: f64, x: f64, xdot: f64) -> Result<f64, Failure<E>>
    where
        F: Force<E>,
    {
        self.count += 1;
        let t = self.smooth.nearest(t);
        let state = Physical { x, xdot };
        match evaluate(self.force, t, state) {
            Ok(value) => Ok(value),
            Err(failure) => self.at_the_wall_instead(t, state, failure),
        }
    }

    #[cold]
    fn at_the_wall_instead<E>(
        &mut self,
        t: f64,
        state: Physical,
        failure: Failure<E>,
    ) -> Result<f64, Failure<E>>
    where
        F: Force<E>,
    {
        if !ends_at_the_wall(self.force, state, &failure) {
            return Err(failure);
        }
        self.count += 1;
        evaluate(self.force, t, Physical { x: 0.0, ..state })
    }

    /// The force on the mass at rest at the wall.
    pub(super) fn at_wall<E>(&mut self, t: f64) -> Result<f64, Failure<E>>
    where
        F: Force<E>,
    {
        if let Some(known) = self.at_wall {
            return Ok(known);
        }
        let value = self.known_at(t, 0.0, 0.0)?;
        let stays = self.linear.is_none() && self.dependence_at_rest::<E>() == Dependence::Constant;
        self.at_wall = stays.then_some(value);
        Ok(value)
    }

    /// Like [`Counted::at`], from the numbers of a linear force.
    pub(super) fn known_at<E>(&mut self, t: f64, x: f64, xdot: f64) -> Result<f64, Failure<E>>
    where
        F: Force<E>,
    {
        match self.linear {
            Some(linear) => {
                let t = self.smooth.nearest(t);
                evaluate(&mut { *linear }, t, Physical { x, xdot })
            }
            None => self.at(t, x, xdot),
        }
    }

    /// Gives the flights of a tail the accelerations of the force at the wall.
    pub(crate) fn bend<E>(&mut self, tail: &mut Tail) -> Result<(), Failure<E>>
    where
        F: Force<E>,
    {
        if self.dependence::<E>() == Dependence::Constant {
            return Ok(());
        }
        match tail.bend(|t, xdot| self.known_at(t, 0.0, xdot)) {
            Err(Failure::Status(_)) => Ok(()),
            bent => bent,
        }
    }

    pub(super) fn dependence_at_rest<E>(&self) -> Dependence
    where
        F: Force<E>,
    {
        match self.linear {
            Some(linear) => Force::<E>::dependence_at_rest(linear),
            None => self.force.dependence_at_rest(),
        }
    }

    pub(super) fn shortest_period<E>(&self) -> Option<f64>
    where
        F: Force<E>,
    {
        match self.linear {
            Some(linear) => Force::<E>::shortest_period(linear),
            None => self.force.shortest_period(),
        }
    }

    pub(super) fn dependence<E>(&self) -> Dependence
    where
        F: Force<E>,
    {
        match self.linear {
            Some(linear) => Force::<E>::dependence(linear),
            None => self.force.dependence(),
        }
    }
}

impl<E, F: Force<E>> Equation<f64, Failure<E>> for Counted<'_, F> {
    #[inline]
    fn acceleration(&mut self, at: &Point, into: &mut f64) -> Result<(), Failure<E>> {
        *into = self.at(at.t, at.x, at.xdot)?;
        Ok(())
    }

    fn is_autonomous(&self) -> bool {
        self.shortest_period::<E>() == Some(f64::INFINITY)
    }
}

impl Stages {
    /// The acceleration at the end of the step, which is also that of the next stage.
    pub(super) fn slope_at_end<E, F: Force<E>>(
        &mut self,
        force: &mut Counted<'_, F>,
    ) -> Result<f64, Failure<E>> {
        self.finish(force)?;
        Ok(self.end_slope(0))
    }

    /// The polynomials of position and velocity over the step.
    pub(super) fn polynomials<E, F: Force<E>>(
        &mut self,
        force: &mut Counted<'_, F>,
    ) -> Result<[Bernstein; 2], Failure<E>> {
        self.complete(force)?;
        Ok(self.polynomials_of(0))
    }

    /// How far the polynomials of the last step are from `x'' = f` at `theta`, as an error of the
    /// position and of the velocity at its end.
    pub(super) fn defect<E, F: Force<E>>(
        &self,
        [x, xdot]: &[Bernstein; 2],
        theta: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<StepError, Failure<E>> {
        let at = self.from.after(theta * self.h, x.at(theta), xdot.at(theta));
        let f = force.at(at.t, at.x, at.xdot)?;
        let defect = self.h * f - xdot.slope(theta);
        Ok(StepError { x: [self.h * defect, 0.0], xdot: [defect, 0.0], double: false })
    }
}
