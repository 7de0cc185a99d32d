//! The switched method: its parts, and which of them comes next: flight, the jump through a Zeno
//! point, rest.

use super::accumulation::LastImpacts;
use super::flight::{Arrival, FreeFlight};
use super::mode::{Counted, Counts, Mode, NextInFlight, Piece, Point, Rest};
use super::path::DensePath;
use super::settings::SwitchedRk;
use crate::numeric::bernstein::{evaluate, Bernstein};
use crate::numeric::grid::{Probes, PulseProbes};
use crate::numeric::root;
use crate::record::columns::Reserve;
use crate::record::events::Occurrence;
use crate::record::status::Failure;
use crate::system::dynamics::check_initial;
use crate::zeno::arc::{unless_underflowing, Bounce};
use crate::zeno::chain::Chain;
use crate::zeno::tail::Tail;
use crate::{AnyImpactLaw, Dependence, Force, Impact, PathPoint, Physical, SetupError, Status};

/// The switched Runge-Kutta method as an object that advances segment by segment.
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
        self.flight.restart_probes();
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

    /// As [`SwitchedIntegrator::observe_to`]; `absorb` gets each segment of the motion.
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

    /// One more segment of the motion, of a positive length or up to an event at the same time.
    pub(super) fn step<E, F: Force<E>>(
        &mut self,
        t_end: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Piece, Failure<E>> {
        self.settle(t_end, force)?;
        self.proceed(t_end, force)
    }

    /// Decides what follows from the last impact, if that has not been done: flight, rest, or the
    /// end of an impact sequence.
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

    /// The same after an impact that is in no geometric impact sequence, whose slow ones leave the part `e`.
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
            let rests = rest_under_pull(bounce, sum, (&self.settings, t_end), force)?;
            if let Some(zeno) = rests {
                self.accumulation.end_alone(bounce, zeno)?;
                return Ok(Some(zeno));
            }
        }
        Ok(None)
    }

    /// The next segment of the motion once that is done.
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

    /// Through the rest of the impact sequence, to rest at `zeno`.
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

    /// Sets whether rest is probed between the nodes of its windows, and flights of a run of this length (s)
    /// for pulses.
    pub(super) fn probe(&mut self, probing: bool, span: f64) {
        self.lookout.set_probing(probing);
        let pulses = if probing { PulseProbes::of(span) } else { PulseProbes::default() };
        self.flight.probe_pulses(pulses);
    }

    /// Cancels the extrapolation: the end of the impact sequence is not known accurately enough.
    pub(super) fn cancel_jump(&mut self) {
        self.accumulation.note_cancelled();
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
    /// Reports the event at the wall in a segment.
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

// Rest of a mass, and the time of lift-off.
//
// When the mass at rest leaves the wall: the first `t` with `phi(t) = f(t, 0, 0) > 0`.
//
// Over a window the polynomial of degree 5 through `phi` at Chebyshev's points stands for it.
// Its coefficients in Bernstein form bound it, and two more evaluations measure its error; an
// undecided window is halved, and each accepted one is probed between its nodes ([`Probes`]).

/// `(1 - cos(pi i/5))/2`.
const NODES: [f64; 6] =
    [0.0, 0.09549150281252629, 0.3454915028125263, 0.6545084971874737, 0.9045084971874737, 1.0];

/// Bernstein coefficients from the values at [`NODES`]: the inverse of the matrix of the Bernstein
/// polynomials there.
const FROM_VALUES: [[f64; 6]; 6] = [
    [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [-2.4, 4.188854381999832, -1.1577708763999663, 0.6111456180001682, -0.44222912360003364, 0.2],
    [2.52, -5.294427190999916, 5.8499689437998486, -3.505572809000084, 2.6300310562001514, -1.2],
    [-1.2, 2.6300310562001514, -3.505572809000084, 5.8499689437998486, -5.294427190999916, 2.52],
    [0.2, -0.44222912360003364, 0.6111456180001682, -1.1577708763999663, 4.188854381999832, -2.4],
    [0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
];

/// Where the fit is checked.
const CHECKS: [f64; 2] = [0.2, 0.55];

/// Largest distance between two of all these places.
const APART: f64 = 0.25;

/// Misfit, relative to the values, above which a window is halved, and below which the next one
/// is twice as long.
const MISFIT: (f64, f64) = (1e-4, 1e-6);

/// Misfit that is rounding, relative to the largest force at the wall so far.
const ROUNDING: f64 = 4e-16;

/// Shortest window, relative to the longest so far: where the force jumps.
const SHORTEST: f64 = 1e-6;

/// Result of a window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Window {
    /// Rest up to this time.
    RestUntil(f64),
    /// The mass lifts off at this time, just after which the force is positive.
    LiftOff(f64),
    /// The force is not finite here or immediately after.
    NotFinite,
}

/// The force at rest over one window.
struct ForceFit {
    values: [f64; 6],
    p: Bernstein,
    scale: f64,
    misfit: f64,
    /// Misfit that is rounding.
    noise: f64,
}

impl ForceFit {
    fn new<E>(
        t: f64,
        first: f64,
        h: f64,
        phi: &mut impl FnMut(f64) -> Result<f64, E>,
    ) -> Result<Self, E> {
        let mut values = [first; 6];
        for (value, node) in values.iter_mut().zip(NODES).skip(1) {
            *value = phi(t + node * h)?;
        }
        let c: [f64; 6] = std::array::from_fn(|i| {
            FROM_VALUES[i].iter().zip(values).map(|(m, value)| m * value).sum()
        });
        let scale = values.iter().fold(0.0_f64, |scale, value| scale.max(value.abs()));
        let mut misfit = 0.0_f64;
        for check in CHECKS {
            let difference = (evaluate(&c, check) - phi(t + check * h)?).abs();
            // f64::max would drop NaN
            misfit = if difference > misfit || difference.is_nan() { difference } else { misfit };
        }
        Ok(Self { values, p: Bernstein::new(&c), scale, misfit, noise: 0.0 })
    }

    fn is_finite(&self) -> bool {
        self.misfit.is_finite() && self.values.iter().all(|value| value.is_finite())
    }

    fn is_poor(&self) -> bool {
        self.misfit > MISFIT.0 * self.scale + self.noise
    }

    /// Whether the misfit leaves open if the force becomes positive.
    fn is_undecided(&self) -> bool {
        let clearly_positive = self.values.iter().any(|&value| value > 5.0 * self.misfit);
        let highest = self.p.coefficients().iter().fold(f64::NEG_INFINITY, |a, &b| a.max(b));
        !clearly_positive && highest > -5.0 * self.misfit && self.misfit > self.noise
    }

    fn is_very_good(&self) -> bool {
        self.misfit <= MISFIT.1 * self.scale + self.noise
    }

    /// Whether a value at `theta` agrees with the polynomial.
    fn conforms(&self, value: f64, theta: f64) -> bool {
        (value - self.p.at(theta)).abs() <= 5.0 * MISFIT.0 * self.scale + self.noise
    }
}

/// The search for lift-offs, with its information about the force from window to window.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct ForceMonitor {
    /// Length of the next window (s).
    length: Option<f64>,
    /// The longest that was decided (s).
    longest: f64,
    /// The largest force at the wall (m/s^2).
    largest: f64,
    /// Whether windows are probed between their nodes: not if a controller restarts the search in
    /// each of its periods.
    probing: bool,
    probes: Probes,
}

impl ForceMonitor {
    /// The search at the start of a run, with a window of this length first.
    pub(super) fn starting(length: Option<f64>) -> Self {
        Self { length, ..Self::default() }
    }

    /// Forgets what the force was.
    pub(super) fn restart(&mut self) {
        let Self { length, probing, .. } = *self;
        *self = Self { length, probing, ..Self::default() };
    }

    /// Whether there are looks between the nodes of a window.
    pub(super) fn set_probing(&mut self, probing: bool) {
        self.probing = probing;
    }

    /// Length of the next window (s).
    pub(super) fn length(&self) -> Option<f64> {
        self.length
    }

    /// The next window has this length, if one is given.
    pub(super) fn look_as_far_as(&mut self, length: Option<f64>) {
        self.length = length.or(self.length);
    }

    /// Looks at a window from `t` that is at most `longest` long and ends at most at `until`, and
    /// is shorter than that where `phi` demands it. A `phi` that is not finite is NaN or infinite.
    pub(super) fn look<E>(
        &mut self,
        rest: &mut Rest,
        (t, until): (f64, f64),
        longest: f64,
        mut phi: impl FnMut(f64) -> Result<f64, E>,
    ) -> Result<Window, E> {
        let first = phi(t)?;
        if !first.is_finite() {
            return Ok(Window::NotFinite);
        }
        if first > 0.0 {
            return Ok(Window::LiftOff(t));
        }
        rest.horizon = rest.horizon.max(until - t);
        let until = self.probes.end(t, until);
        let mut length = self.length.unwrap_or(until - t).min(longest).min(until - t);
        // at t = 0 there is no rounding of the time yet that ends the search for a jump
        let shortest = (SHORTEST * self.longest)
            .max(32.0 * f64::EPSILON * t.abs())
            .max(f64::EPSILON * rest.horizon);
        let fit = loop {
            let mut fit = ForceFit::new(t, first, length, &mut phi)?;
            if fit.is_finite() {
                self.largest = self.largest.max(fit.scale);
                fit.noise = ROUNDING * self.largest;
                if length <= shortest {
                    break fit;
                }
                if !(fit.is_poor() || fit.is_undecided()) {
                    match self.probe(rest.horizon, (t, length), &fit, &mut phi)? {
                        Some(shorter) => length = shorter,
                        None => break fit,
                    }
                    continue;
                }
            } else if length <= shortest {
                return Ok(Window::NotFinite);
            }
            length *= 0.5;
        };
        self.longest = self.longest.max(length);
        let wanted = self.length.filter(|&wanted| wanted >= length && length >= until - t);
        self.length = Some(if fit.is_very_good() {
            wanted.unwrap_or(length).max(2.0 * length)
        } else {
            length
        });
        let end = if length >= until - t { until } else { t + length };
        if fit.is_poor() {
            return unresolved(t, length, &fit.values, end, &mut phi);
        }
        match fit.p.negated().first_negative() {
            Some(theta) => polish(t, length, theta, end, &mut phi),
            None => Ok(Window::RestUntil(end)),
        }
    }

    /// Looks between the nodes of a window. `None` if the force agrees with them, otherwise the
    /// length of a window that ends at or before the deviation.
    fn probe<E>(
        &mut self,
        horizon: f64,
        (t, length): (f64, f64),
        fit: &ForceFit,
        phi: &mut impl FnMut(f64) -> Result<f64, E>,
    ) -> Result<Option<f64>, E> {
        if !self.probing {
            return Ok(None);
        }
        self.probes.deviation(horizon, (t, length), APART * length, |at| {
            Ok(fit.conforms(phi(t + at)?, at / length))
        })
    }
}

/// The sign change of `phi` near `t + theta length`.
fn polish<E>(
    t: f64,
    length: f64,
    theta: f64,
    end: f64,
    phi: &mut impl FnMut(f64) -> Result<f64, E>,
) -> Result<Window, E> {
    let mut width = 1e-6;
    loop {
        let (a, b) = (t + (theta - width).max(0.0) * length, t + (theta + width) * length);
        let b = b.min(end);
        let (phi_a, phi_b) = (phi(a)?, phi(b)?);
        if phi_a <= 0.0 && phi_b > 0.0 {
            let root = root::becomes_positive((a, phi_a), (b, phi_b), phi)?;
            return Ok(Window::LiftOff(root.beyond));
        }
        if width > 0.5 {
            // a touch: the polynomial crosses zero by its misfit, the force does not
            return Ok(Window::RestUntil(b));
        }
        width *= 8.0;
    }
}

/// When impacts end whose speeds have this sum, if that is known to the tolerance and by then: a flight
/// lasts `2 u/g`, so that half of `g` adds up to the sum. By Simpson's rule over the whole and the halves.
fn rest_under_pull<E, F: Force<E>>(
    Bounce { t, g, .. }: Bounce,
    sum: f64,
    (settings, t_end): (&SwitchedRk, f64),
    force: &mut Counted<'_, F>,
) -> Result<Option<f64>, Failure<E>> {
    const ROUNDS: usize = 8;
    let mut left = 2.0 * sum / g;
    if force.dependence::<E>() == Dependence::Constant {
        return Ok(Some(t + left).filter(|&zeno| zeno <= t_end));
    }
    for _ in 0..ROUNDS {
        if !(left > 0.0 && t + left <= t_end) {
            return Ok(None);
        }
        let mut pulls = [g; 5];
        for (pull, part) in pulls[1..].iter_mut().zip([0.25, 0.5, 0.75, 1.0]) {
            *pull = -force.at_wall(t + part * left)?;
        }
        let [a, b, c, d, e] = pulls;
        if pulls.iter().any(|pull| *pull <= 0.0) {
            return Ok(None);
        }
        let whole = left / 12.0 * (a + 4.0 * c + e);
        let halves = left / 24.0 * (a + 4.0 * b + 2.0 * c + 4.0 * d + e);
        let change = 2.0 * (sum - halves) / e;
        let tolerance = settings.atol[1] / g + settings.rtol * left;
        if change.abs() <= 1e-2 * tolerance {
            let known = 2.0 * (halves - whole).abs() / e <= tolerance;
            return Ok(known.then_some(t + left));
        }
        left += change;
    }
    Ok(None)
}

/// The first sign change that the nodes show of a force that no polynomial fits: it jumps.
fn unresolved<E>(
    t: f64,
    length: f64,
    values: &[f64; 6],
    end: f64,
    phi: &mut impl FnMut(f64) -> Result<f64, E>,
) -> Result<Window, E> {
    let Some(i) = values.iter().position(|&value| value > 0.0).filter(|&i| i > 0) else {
        return Ok(Window::RestUntil(end));
    };
    let node = |i: usize| (t + NODES[i] * length, values[i]);
    Ok(Window::LiftOff(root::becomes_positive(node(i - 1), node(i), phi)?.beyond))
}

// Rest at the wall, up to the lift-off.

/// The first step off the wall where the force grows from zero, relative to the last window.
const PART: f64 = 1e-2;

/// Rest up to the first lift-off, within one window of the force; returns whether it reached the
/// lift-off. It goes up to `t_end` and, where the force is sampled, is at most `longest` long.
pub(super) fn wait<E, F: Force<E>>(
    (now, mode): (&mut Point, &mut Mode),
    lookout: &mut ForceMonitor,
    flight: &mut FreeFlight,
    (t_end, longest): (f64, f64),
    force: &mut Counted<'_, F>,
) -> Result<bool, Failure<E>> {
    let from = now.t;
    let mut rest = mode.rest();
    let window = window(*now, &mut rest, lookout, flight, (t_end, longest), force)?;
    *mode = Mode::Rest(rest);
    match window {
        Window::NotFinite => Err(Failure::Status(Status::ForceNotFinite)),
        Window::RestUntil(t) => {
            now.t = t;
            Ok(false)
        }
        Window::LiftOff(t) => {
            (now.t, now.late) = (t, 0.0);
            *mode = Mode::LIFT_OFF;
            if t > from {
                // the force grows from zero, on the scale of the window
                *mode = Mode::SMOOTH_LIFT_OFF;
                let length = lookout.length();
                flight.steps_mut().set_next(length.map(|length| PART * length));
            }
            Ok(true)
        }
    }
}

/// How the force on the mass at rest continues: a window of it.
fn window<E, F: Force<E>>(
    now: Point,
    rest: &mut Rest,
    lookout: &mut ForceMonitor,
    flight: &mut FreeFlight,
    (t_end, longest): (f64, f64),
    force: &mut Counted<'_, F>,
) -> Result<Window, Failure<E>> {
    if force.dependence_at_rest::<E>() == Dependence::Constant {
        let lifts = force.at_wall(now.t)? > 0.0;
        return Ok(if lifts { Window::LiftOff(now.t) } else { Window::RestUntil(t_end) });
    }
    if let Some(next) = flight.lift_off(now, t_end) {
        return Ok(next.map_or(Window::RestUntil(t_end), Window::LiftOff));
    }
    lookout.look(rest, (now.t, t_end), longest, |t| match force.at_wall(t) {
        Err(Failure::Status(_)) => Ok(f64::NAN),
        phi => phi,
    })
}

#[cfg(test)]
mod lift_off_tests {
    use super::*;
    use std::convert::Infallible;

    /// The first lift-off up to `until`, and the number of evaluations.
    fn search(h: f64, until: f64, phi: impl Fn(f64) -> f64) -> (Option<f64>, usize) {
        let (mut t, mut n) = (0.0, 0);
        let mut lookout =
            ForceMonitor { length: Some(h), probing: true, ..ForceMonitor::default() };
        let mut rest = Rest::default();
        while t < until {
            let window = lookout.look(&mut rest, (t, until), f64::INFINITY, |t| {
                n += 1;
                Ok::<f64, Infallible>(phi(t))
            });
            match window {
                Ok(Window::LiftOff(at)) => return (Some(at), n),
                Ok(Window::RestUntil(end)) => t = end,
                Ok(Window::NotFinite) => panic!("not finite"),
            }
        }
        (None, n)
    }

    #[test]
    fn nodes_and_matrix_fit_together() {
        for degree in 0..=5 {
            let values = NODES.map(|c| c.powi(degree));
            let c: [f64; 6] = std::array::from_fn(|i| {
                FROM_VALUES[i].iter().zip(values).map(|(m, value)| m * value).sum()
            });
            assert!((evaluate(&c, 0.37) - 0.37f64.powi(degree)).abs() < 1e-15);
        }
    }

    #[test]
    fn the_largest_distance_between_looks_is_known() {
        let mut all: Vec<f64> = NODES.into_iter().chain(CHECKS).collect();
        all.sort_by(f64::total_cmp);
        let apart = all.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
        assert!(apart <= APART && apart > 0.99 * APART, "{apart}");
    }

    #[test]
    fn weak_lift_off_is_found_down_to_rounding_of_the_certificate() {
        for decade in 1..=12 {
            let excess = 10f64.powi(-decade);
            let (found, n) = search(1.0, 10.0, |t| -1.0 + (1.0 + excess) * (t - 2.0).cos());
            let exact = 2.0 - (1.0 / (1.0 + excess)).acos();
            // the root of a maximum of height `excess` is known to rounding over its slope
            let tol = 1e-15 / excess.sqrt() * 10.0;
            assert!((found.unwrap() - exact).abs() < tol, "1e-{decade}: {found:?} {exact}");
            assert!(n < 200, "{n}");
        }
    }

    #[test]
    fn no_lift_off_where_there_is_none() {
        for excess in [-1e-3, -1e-6, -1e-9, 0.0] {
            let (found, n) = search(1.0, 10.0, |t| -1.0 + (1.0 + excess) * (t - 2.0).cos());
            // at a touch rounding decides
            assert!(found.is_none() || excess == 0.0, "{excess}: {found:?}");
            assert!(n < 5000, "{n}");
        }
        let (found, n) = search(1.0, 1e6, |_| -9.81);
        assert!(found.is_none() && n < 300, "{found:?} {n}");
    }

    #[test]
    fn pulses_are_seen_if_they_are_not_too_short_for_the_look() {
        // of 10 s: a pulse longer than 1/39 always, whatever ripple the force has
        for ripple in [0.0, 1e-5, 1e-4, 3e-4, 1e-3] {
            for phase in 0..20 {
                let start = 0.5 + 0.431 * f64::from(phase);
                let (found, _) = search(10.0, 10.0, |t| {
                    let push = if t > start && t < start + 10.0 / 39.0 { 15.0 } else { 0.0 };
                    push - 9.81 + ripple * (37.0 * t).sin()
                });
                assert!(found.is_some_and(|t| (t - start).abs() < 1e-9), "{start}: {found:?}");
            }
        }
        // one of them is enough to look closer for the first: periodic ones of 0.1 s each second
        let first = |phase: f64| {
            let pulses = |t: f64| if t > phase && (t - phase).fract() < 0.1 { 5.0 } else { -9.81 };
            search(100.0, 100.0, pulses).0.is_some_and(|t| (t - phase).abs() < 1e-9)
        };
        let seen = (1..40).filter(|&i| first(f64::from(i) / 40.0)).count();
        assert!(seen >= 37, "{seen} of 39");
    }

    #[test]
    fn forces_that_start_at_zero_or_jump() {
        let (rising, _) = search(1.0, 10.0, |t| t.sin());
        assert!(rising.unwrap() < 1e-6, "{rising:?}");
        let (falling, _) = search(1.0, 10.0, |t| -t.sin());
        assert!((falling.unwrap() - std::f64::consts::PI).abs() < 1e-14);
        assert_eq!(search(1.0, 10.0, |_| 0.0).0, None);
        let (step, n) = search(1.0, 10.0, |t| if t < 4.7 { -1.0 } else { 2.0 });
        assert!((step.unwrap() - 4.7).abs() < 1e-11 && n < 600, "{step:?} {n}");
        let (at_once, n) = search(1.0, 10.0, |t| if t <= 0.0 { -1.0 } else { 2.0 });
        assert!(at_once.is_some_and(|t| t > 0.0 && t < 1e-15) && n < 600, "{at_once:?} {n}");
    }
}
