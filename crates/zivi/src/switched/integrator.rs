//! The switched method: its parts, and which of them comes next: flight, the jump through a Zeno
//! point, rest.

use crate::record::columns::Reserve;
use crate::record::events::Occurrence;
use crate::record::status::Failure;
use crate::switched::accumulation::LastImpacts;
use crate::switched::flight::{Arrival, FreeFlight};
use crate::switched::lift_off::{wait, ForceMonitor};
use crate::switched::mode::{Counts, Mode, NextInFlight, Piece, Point};
use crate::switched::path::DensePath;
use crate::switched::settings::SwitchedRk;
use crate::switched::stages::Counted;
use crate::system::dynamics::check_initial;
use crate::zeno::arc::{unless_underflowing, Bounce};
use crate::zeno::chain::Chain;
use crate::zeno::tail::Tail;
use crate::{AnyImpactLaw, Force, Impact, PathPoint, Physical, SetupError, Status};

/// The switched Runge-Kutta method as an object that is driven piece by piece.
///
/// ```text
/// flight   x'' = f(t, x, x')      impact  x'+ = -e x'-, or another law      rest  x = 0 while f(t, 0, 0) <= 0
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
    settings: SwitchedRk,
    law: AnyImpactLaw,
    now: Point,
    sigma: f64,
    mode: Mode,
    flight: FreeFlight,
    accumulation: LastImpacts,
    lookout: ForceMonitor,
    /// The last impacts that were jumped over.
    tail: Option<Tail>,
    nfev: u64,
    impacts: u64,
}

impl SwitchedIntegrator {
    /// An integrator at rest at `t = 0`.
    ///
    /// # Errors
    /// [`SetupError::Setting`] for a setting out of its range.
    pub fn new(settings: SwitchedRk, law: impl Into<AnyImpactLaw>) -> Result<Self, SetupError> {
        let (settings, law) = (settings.validated()?, law.into());
        let slow = (law.limit().unwrap_or(1.0), law.is_newton_when_slow());
        Ok(Self {
            settings,
            law,
            now: Point::default(),
            sigma: 1.0,
            mode: Mode::REST,
            flight: FreeFlight::new(&settings),
            accumulation: LastImpacts::new(slow),
            lookout: ForceMonitor::default(),
            tail: None,
            nfev: 0,
            impacts: 0,
        })
    }

    /// Starts from a state at time `t`, on the branch `+1`. The next step has the size
    /// `first_step`, or the size proposed by the last step if there was one.
    ///
    /// # Errors
    /// [`SetupError::Setting`] for x < 0, or a time or a state that is not finite.
    pub fn start(&mut self, t: f64, state: Physical) -> Result<(), SetupError> {
        if !t.is_finite() {
            return Err(SetupError::Setting("t", t, "a finite time"));
        }
        check_initial(state)?;
        let Physical { x, xdot } = state;
        if t != self.now.t {
            self.flight.start();
        }
        self.now = Point { t, x, xdot, late: 0.0 };
        self.accumulation.start(t);
        self.sigma = 1.0;
        self.mode = if state.is_at_origin() { Mode::REST } else { Mode::FLIGHT };
        let steps = self.flight.steps_mut();
        if self.settings.first_step.is_some() {
            steps.set_next(self.settings.first_step);
        }
        self.lookout = ForceMonitor::starting(steps.next());
        self.forget_force();
        Ok(())
    }

    /// As [`SwitchedIntegrator::start`], on the branch on which it is.
    pub(crate) fn start_again(&mut self, t: f64, state: Physical) -> Result<(), SetupError> {
        let sigma = self.sigma;
        self.start(t, state)?;
        self.sigma = sigma;
        Ok(())
    }

    /// Forgets what was learnt from the force: from here on it is another one.
    pub fn forget_force(&mut self) {
        self.mode.forget_force();
        self.accumulation.forget_force();
    }

    /// Forgets what was learnt from the force, and how it varied at rest.
    pub(super) fn restart(&mut self) {
        self.forget_force();
        self.lookout.restart();
        if let Mode::Rest(_) = self.mode {
            self.mode = Mode::REST;
        }
    }

    /// Advances to `t_end` (finite; nothing is done up to now or before) under a force that may be
    /// another one than before.
    ///
    /// # Errors
    /// [`Failure`] when the force raised an error or the motion could not be continued; the state
    /// is the last valid one.
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

    /// Like [`SwitchedIntegrator::resume_to`], and returns the events at the wall in order. Before
    /// it continues under another force, call [`SwitchedIntegrator::forget_force`].
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
        let linear = self.flight.linear().copied();
        let mut force = Counted::known(force, linear.as_ref());
        self.flight.steps_mut().start_budget();
        let mut ended = Ok(());
        while self.now.t < t_end && ended.is_ok() {
            let resting = self.is_at_rest();
            ended = self.step(t_end, &mut force).and_then(|piece| {
                absorb(self, &piece, &mut force)?;
                self.tell(&piece, resting, &mut observe);
                Ok(())
            });
        }
        self.nfev += force.count();
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
        let ((accepted, rejected), impacts) = (self.flight.steps().counts(), self.impacts);
        Counts { nfev: self.nfev, accepted, rejected, impacts }
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

    /// Decides what follows from the last impact, if that has not been done: flight, rest, or the
    /// end of a chain.
    pub(super) fn settle<E, F: Force<E>>(
        &mut self,
        t_end: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        let Mode::Flight(NextInFlight::AfterImpact) = self.mode else { return Ok(()) };
        let Point { t, xdot: u, .. } = self.now;
        if u == 0.0 {
            // the impact stops the mass, which stays at the origin or lifts off immediately
            let stays = self.flight.at_wall(self.now, force)? <= 0.0;
            self.mode = if stays { Mode::FLIGHT } else { Mode::LIFT_OFF };
            self.accumulation.clear();
            return Ok(());
        }
        let mut zeno = None;
        let e = self.law.limit().unwrap_or(1.0);
        // the speed before this impact was `u/e` if the law had reached its limit
        if e < 1.0 && u <= e * self.law.geometric_up_to() {
            let bounce = Bounce { t, u, g: -self.flight.at_wall(self.now, force)? };
            let until = (self.sigma, t_end);
            zeno = self.accumulation.note(bounce, until, &self.settings, force)?;
        } else if self.law.constant().is_none() {
            zeno = self.settle_alone(e, t_end, force)?;
        } else {
            self.accumulation.note_elastic();
        }
        self.mode = zeno.map_or(Mode::FLIGHT, |zeno| Mode::Flight(NextInFlight::Jump { zeno }));
        Ok(())
    }

    /// The same after an impact that is in no geometric chain, whose slow ones leave the part `e`.
    fn settle_alone<E, F: Force<E>>(
        &mut self,
        e: f64,
        t_end: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Option<f64>, Failure<E>> {
        let Point { t, xdot: u, .. } = self.now;
        if !u.is_finite() {
            return Err(Failure::Status(Status::StateNotFinite));
        }
        let bounce = Bounce { t, u, g: -self.flight.at_wall(self.now, force)? };
        let next = e.max(self.law.after(u) / u);
        if self.accumulation.note_alone(bounce, next, &self.settings)? {
            self.now.xdot = 0.0;
        } else if bounce.g > 0.0 && u <= self.settings.atol[1] {
            // what is left is below the tolerance of the speed: its time alone is not
            let Some(sum) = self.law.sum_of_speeds(u) else { return Ok(None) };
            let zeno = t + 2.0 * sum / bounce.g;
            if zeno <= t_end {
                self.accumulation.end_alone(bounce, zeno)?;
                return Ok(Some(zeno));
            }
        }
        Ok(None)
    }

    /// The next piece of the motion once that is done.
    pub(super) fn proceed<E, F: Force<E>>(
        &mut self,
        t_end: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Piece, Failure<E>> {
        match self.mode {
            Mode::Rest(_) => return self.wait(t_end, force),
            Mode::Flight(NextInFlight::Jump { zeno }) => return Ok(self.jump(zeno)),
            Mode::Flight(_) => self.accumulation.check_budget(self.settings.max_impacts)?,
        }
        match self.mode {
            Mode::Flight(NextInFlight::AfterImpact | NextInFlight::Step { .. })
                if self.state().is_at_origin() =>
            {
                self.wait(t_end, force)
            }
            _ => self.fly(t_end, force),
        }
    }

    /// Free flight, up to an impact if any.
    fn fly<E, F: Force<E>>(
        &mut self,
        t_end: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Piece, Failure<E>> {
        if self.state().arrives() {
            return Ok(self.strike(self.now, self.now));
        }
        let obstacle = self.accumulation.obstacle();
        let Arrival { from, end, lands, .. } =
            self.flight.next(self.now, &mut self.mode, obstacle, t_end, force)?;
        if lands {
            return Ok(self.strike(from, end));
        }
        self.now = end;
        Ok(Piece::Flight { from, sigma: self.sigma, impact: None })
    }

    /// The impact with the velocity `xdot < 0`: `x'+ = after(-x'-)` of the impact law.
    pub(super) fn strike(&mut self, from: Point, contact: Point) -> Piece {
        let Point { t, xdot, .. } = contact;
        let after = unless_underflowing(self.law.after(xdot.abs()));
        let impact = Impact { t, xdot_before: xdot, xdot_after: after };
        let sigma = self.sigma;
        self.impacts += 1;
        self.now = Point { x: 0.0, xdot: after, ..contact };
        self.sigma = -sigma;
        self.mode = Mode::Flight(NextInFlight::AfterImpact);
        Piece::Flight { from, sigma, impact: Some(impact) }
    }

    /// Through the rest of the chain, to rest at `zeno`.
    fn jump(&mut self, zeno: f64) -> Piece {
        self.tail = Some(self.accumulation.tail(zeno, self.sigma));
        self.now = Point { t: zeno, ..Point::default() };
        self.mode = Mode::REST;
        self.accumulation.clear();
        let steps = self.flight.steps_mut();
        self.lookout.look_as_far_as(steps.next());
        steps.set_next(None);
        Piece::Tail
    }

    /// Rest up to the first lift-off, within one window of the force.
    fn wait<E, F: Force<E>>(
        &mut self,
        t_end: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Piece, Failure<E>> {
        self.flight.steps_mut().spend()?;
        self.accumulation.clear();
        let (from, longest) = (self.now.t, self.settings.max_step);
        let Self { now, mode, lookout, flight, .. } = self;
        let lifted = wait((now, mode), lookout, flight, (t_end, longest), force)?;
        Ok(Piece::Rest { from, lifted })
    }

    /// Chooses the flight integrator for the settings and the force.
    pub(super) fn adopt<E, F: Force<E>>(&mut self, force: &F) {
        self.flight.adopt(&self.settings, force);
    }

    /// The flights.
    pub(super) fn flight(&mut self) -> &mut FreeFlight {
        &mut self.flight
    }

    /// Sets whether rest is probed between the nodes of its windows.
    pub(super) fn probe_rest(&mut self, probing: bool) {
        self.lookout.set_probing(probing);
    }

    /// Cancels the extrapolation: the end of the chain is not known accurately enough.
    pub(super) fn cancel_jump(&mut self) {
        self.mode = Mode::FLIGHT;
    }

    /// Gives up the last step: back to before it, for one of length `h`.
    pub(super) fn give_up_step(&mut self, before: &Self, h: f64) {
        let rejected = self.flight.steps().counts().1 + 1;
        self.clone_from(before);
        self.flight.steps_mut().retry(h, rejected);
    }

    pub(super) fn settings(&self) -> &SwitchedRk {
        &self.settings
    }

    pub(super) fn law(&self) -> &AnyImpactLaw {
        &self.law
    }

    /// Where the mass is.
    #[inline]
    pub(super) fn now(&self) -> Point {
        self.now
    }

    pub(super) fn mode(&self) -> Mode {
        self.mode
    }

    /// The infinitely many impacts that were jumped over last.
    pub(super) fn tail(&self) -> Option<&Tail> {
        self.tail.as_ref()
    }

    /// The last impacts.
    pub(super) fn chain(&self) -> &Chain<f64> {
        self.accumulation.chain()
    }
}

// The motion of an integrator that is driven from outside, kept as a path.

/// The segments of successive integrations as one motion.
#[derive(Debug, Default)]
pub(crate) struct Trace {
    path: DensePath,
    reserve: Reserve,
}

impl Trace {
    /// The motion so far.
    pub(crate) fn path(&self) -> &DensePath {
        &self.path
    }

    /// Forgets it.
    pub(crate) fn clear(&mut self) {
        self.path.clear();
    }

    pub(crate) fn into_path(self) -> DensePath {
        self.path
    }
}

impl SwitchedIntegrator {
    /// Tells what happened at the wall in a piece.
    pub(super) fn tell(&self, piece: &Piece, resting: bool, observe: &mut impl FnMut(Occurrence)) {
        match *piece {
            Piece::Flight { impact, .. } => {
                let number = self.counts().impacts;
                impact.into_iter().for_each(|it| observe(Occurrence::of_mass(it, number)));
            }
            Piece::Tail => observe(Occurrence::rest_of_mass(self.t())),
            Piece::Rest { from, lifted } => {
                if !resting {
                    observe(Occurrence::rest_of_mass(from));
                }
                if lifted {
                    observe(Occurrence::lift_off_of_mass(self.t()));
                }
            }
        }
    }

    /// As [`SwitchedIntegrator::observe_to`], and adds the motion to a trace.
    pub(crate) fn trace_to<E, F: Force<E>>(
        &mut self,
        t_end: f64,
        force: &mut F,
        trace: &mut Trace,
        observe: impl FnMut(Occurrence),
    ) -> Result<(), Failure<E>> {
        self.flight().steps_mut().look_from(f64::NEG_INFINITY);
        let Trace { path, reserve } = trace;
        let absorb = |integrator: &mut Self, piece: &Piece, force: &mut Counted<'_, F>| {
            path.make_room(reserve)?;
            match piece {
                Piece::Flight { from, sigma, .. } if integrator.t() > from.t => {
                    for k in 0..integrator.flight().curves() {
                        if k > 0 {
                            // one of many steps at once
                            integrator.flight().steps_mut().spend()?;
                        }
                        path.make_room(reserve)?;
                        if !integrator.flight().keep(k, *sigma, path) {
                            path.push_flight(&integrator.flight().curve(k, *sigma, force)?);
                        }
                    }
                }
                Piece::Flight { .. } => {}
                Piece::Tail => {
                    if let Some(mut tail) = integrator.tail().cloned() {
                        force.bend(&mut tail)?;
                        path.push_tail(&tail);
                    }
                }
                Piece::Rest { from, .. } => path.push_rest(*from, integrator.sigma()),
            }
            Ok(())
        };
        let ended = self.go_to(t_end, force, absorb, observe);
        let Physical { x, xdot } = self.state();
        trace.path.finish(self.t(), PathPoint { x, xdot, sigma: self.sigma() });
        ended
    }
}
