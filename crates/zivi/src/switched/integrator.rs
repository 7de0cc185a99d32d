//! The state of the switched method and its modes: flight, the jump through a Zeno point, rest.

use zivi_core::Restitution;

use super::flight::series::SeriesFlight;
use super::lift_off::Lookout;
use super::lookahead::Obstacle;
use super::mode::{Flight, Mode};
use super::point::Point;
use super::settings::SwitchedRk;
use super::stages::{Counted, LastStep};
use super::stalling::StallingImpacts;
use super::step_control::{Looks, StepControl};
use crate::record::failure::Failure;
use crate::record::occurrence::Occurrence;
use crate::system::evaluation::check_initial;
use crate::zeno::chain::Chain;
use crate::zeno::tail::Tail;
use crate::{Force, Impact, Physical, SetupError, Status};

/// Columns of the table of the Zeno time after the first. In 160 random runs with `e` up to 0.9995
/// 3 need 15 % more impacts before the jump; 5 save 8 % of them, but the error of the Zeno time is
/// twice as large in the median where `e` is near 1.
const COLUMNS: usize = 4;

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
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Piece {
    /// Free flight from a state, up to an impact if there is one.
    Flight { from: Point, sigma: f64, impact: Option<Impact> },
    /// Infinitely many impacts.
    Tail(Tail),
    /// Rest since a time, up to a lift-off or as far as the force was looked at.
    Rest { from: f64, lifted: bool },
}

/// The switched Runge-Kutta method as an object that is driven piece by piece.
///
/// ```text
/// flight   x'' = f(t, x, x')      impact  x'+ = -e x'-      rest  x = 0 while f(t, 0, 0) <= 0
/// ```
///
/// Between calls of [`SwitchedIntegrator::advance_to`] the force may change: a controller holds
/// its output over a period. Once warmed up a call allocates nothing.
///
/// ```
/// use zivi::{ConstantForce, Physical, Restitution, SwitchedIntegrator, SwitchedRk};
/// use std::convert::Infallible;
///
/// let restitution = Restitution::from_e(0.5)?;
/// let period = 0.01;
/// let settings = SwitchedRk { first_step: Some(period), ..SwitchedRk::default() };
/// let mut plant = SwitchedIntegrator::new(settings, restitution)?;
/// plant.start(0.0, Physical { x: 1.0, xdot: 0.0 })?;
/// for k in 1..=300 {
///     let u = -9.81 - 2.0 * plant.state().xdot;
///     let moved = plant.advance_to::<Infallible, _>(f64::from(k) * period, &mut ConstantForce(u));
///     assert!(moved.is_ok());
/// }
/// assert!(plant.is_at_rest());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct SwitchedIntegrator {
    pub(super) settings: SwitchedRk,
    pub(super) restitution: Restitution,
    pub(super) now: Point,
    pub(super) sigma: f64,
    pub(super) mode: Mode,
    /// The last step of the pair.
    pub(super) last: LastStep,
    /// Flights under a linear force.
    pub(super) series: Option<Box<SeriesFlight>>,
    pub(super) chain: Chain<f64>,
    /// Where the force last kept the mass from jumping to the end of it.
    pub(super) obstacle: Option<Obstacle>,
    pub(super) stalling: StallingImpacts,
    pub(super) lookout: Lookout,
    pub(super) control: StepControl,
    pub(super) looks: Looks,
    pub(super) counts: Counts,
}

impl SwitchedIntegrator {
    /// An integrator at rest at `t = 0`.
    ///
    /// # Errors
    /// [`SetupError::Setting`] for a setting out of its range.
    pub fn new(settings: SwitchedRk, restitution: Restitution) -> Result<Self, SetupError> {
        let settings = settings.validated()?;
        Ok(Self {
            settings,
            restitution,
            now: Point::default(),
            sigma: 1.0,
            mode: Mode::REST,
            last: LastStep::new(settings.order.pair()),
            series: None,
            chain: Chain::new((), restitution.e(), 0, COLUMNS),
            obstacle: None,
            stalling: StallingImpacts::default(),
            lookout: Lookout::default(),
            control: StepControl::default(),
            looks: Looks::NONE,
            counts: Counts::default(),
        })
    }

    /// Starts from a state at time `t`, on the branch `+1`. The next step has the size
    /// `first_step`, or what is tried next by its last one when there was one.
    ///
    /// # Errors
    /// [`SetupError::Setting`] for a time or a state that is not finite, or behind the wall.
    pub fn start(&mut self, t: f64, state: Physical) -> Result<(), SetupError> {
        if !t.is_finite() {
            return Err(SetupError::Setting("t", t, "a finite time"));
        }
        check_initial(state)?;
        let Physical { x, xdot } = state;
        if t != self.now.t {
            // another run: its last bits do not depend on this one
            self.series.iter_mut().for_each(|series| series.start());
        }
        self.now = Point { t, x, xdot, late: 0.0 };
        self.stalling = StallingImpacts::starting_at(t);
        self.sigma = 1.0;
        self.mode = if state.is_at_origin() { Mode::REST } else { Mode::FLIGHT };
        if self.settings.first_step.is_some() {
            self.control.h = self.settings.first_step;
        }
        self.lookout = Lookout { length: self.control.h, ..Lookout::default() };
        self.forget_force();
        Ok(())
    }

    /// Forgets what was learnt from the force: from here on it is another one.
    pub fn forget_force(&mut self) {
        self.mode.forget_force();
        self.obstacle = None;
        self.chain.clear();
    }

    /// Forgets what was learnt from the force, and how it varied at rest.
    pub(super) fn restart(&mut self) {
        self.forget_force();
        let Lookout { length, probing, .. } = self.lookout;
        self.lookout = Lookout { length, probing, ..Lookout::default() };
        if let Mode::Rest(_) = self.mode {
            self.mode = Mode::REST;
        }
    }

    /// Advances to `t_end` (finite; nothing is done up to now or before) under a force that may be
    /// another one than before.
    ///
    /// # Errors
    /// [`Failure`] when the force raised an error or the motion could not be continued; the state
    /// is that up to which it was.
    pub fn advance_to<E, F: Force<E>>(
        &mut self,
        t_end: f64,
        force: &mut F,
    ) -> Result<(), Failure<E>> {
        self.forget_force();
        self.resume_to(t_end, force)
    }

    /// Advances to `t_end` under the same force as before: its value here and the chain of impacts
    /// are kept.
    ///
    /// # Errors
    /// As [`SwitchedIntegrator::advance_to`].
    pub fn resume_to<E, F: Force<E>>(
        &mut self,
        t_end: f64,
        force: &mut F,
    ) -> Result<(), Failure<E>> {
        self.observe_to(t_end, force, |_| ())
    }

    /// As [`SwitchedIntegrator::resume_to`], and tells what happened at the wall, in order. Before
    /// it goes on under another force, call [`SwitchedIntegrator::forget_force`].
    ///
    /// # Errors
    /// As [`SwitchedIntegrator::advance_to`].
    pub fn observe_to<E, F: Force<E>>(
        &mut self,
        t_end: f64,
        force: &mut F,
        observe: impl FnMut(Occurrence),
    ) -> Result<(), Failure<E>> {
        self.go_to(t_end, force, |_, _, _| Ok(()), observe)
    }

    /// As [`SwitchedIntegrator::observe_to`]; `absorb` gets each piece of the motion.
    pub(super) fn go_to<E, F: Force<E>>(
        &mut self,
        t_end: f64,
        force: &mut F,
        mut absorb: impl FnMut(&mut Self, &Piece, &mut Counted<'_, F>) -> Result<(), Failure<E>>,
        mut observe: impl FnMut(Occurrence),
    ) -> Result<(), Failure<E>> {
        self.adopt(force);
        let linear = self.linear().copied();
        let mut force = Counted::known(force, linear.as_ref());
        self.control.spent = 0;
        let mut ended = Ok(());
        while self.now.t < t_end && ended.is_ok() {
            let resting = self.is_at_rest();
            ended = self.step(t_end, &mut force).and_then(|piece| {
                absorb(self, &piece, &mut force)?;
                self.tell(&piece, resting, &mut observe);
                Ok(())
            });
        }
        self.counts.nfev += force.count();
        ended
    }

    /// Time (s).
    #[must_use]
    pub fn t(&self) -> f64 {
        self.now.t
    }

    /// State; at an impact the one after it.
    #[must_use]
    pub fn state(&self) -> Physical {
        self.now.physical()
    }

    /// Branch, `+1` or `-1`: it changes at each impact, and `s = sigma x`.
    #[must_use]
    pub fn sigma(&self) -> f64 {
        self.sigma
    }

    /// Whether the mass rests at the wall.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        matches!(self.mode, Mode::Rest(_))
    }

    /// How much work was done so far.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// One more piece of the motion, of a positive length or up to an event at the same time.
    pub(super) fn step<E, F: Force<E>>(
        &mut self,
        t_end: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Piece, Failure<E>> {
        self.settle(t_end, force)?;
        self.proceed(t_end, force)
    }

    /// Thinks about the last impact, if that has not been done.
    pub(super) fn settle<E, F: Force<E>>(
        &mut self,
        t_end: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        match self.mode {
            Mode::Flight(Flight::Weigh) => self.weigh_impact(t_end, force),
            Mode::Flight(_) | Mode::Rest(_) => Ok(()),
        }
    }

    /// The next piece of the motion once that is done.
    pub(super) fn proceed<E, F: Force<E>>(
        &mut self,
        t_end: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Piece, Failure<E>> {
        match self.mode {
            Mode::Rest(_) => self.wait(t_end, force),
            Mode::Flight(Flight::Jump { zeno }) => Ok(self.jump(zeno)),
            Mode::Flight(_) if self.chain.bounces().len() > self.settings.max_impacts => {
                self.chain.clear();
                Err(Failure::Status(Status::ZenoBudget))
            }
            Mode::Flight(Flight::Weigh | Flight::Step { .. }) if self.state().is_at_origin() => {
                self.wait(t_end, force)
            }
            Mode::Flight(_) => self.fly(t_end, force),
        }
    }

    /// Counts a step; an error when there were too many.
    pub(super) fn spend<E>(&mut self) -> Result<(), Failure<E>> {
        self.control.spend(&self.settings)
    }
}
