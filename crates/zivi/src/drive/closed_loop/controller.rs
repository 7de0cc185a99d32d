//! Interface of controllers for the sampled loop, with the controllers of `zivi_core`.

use zivi_core::control::inclusion::{AsProblem, Inclusion};
use zivi_core::control::regulation::RegulationStep;
use zivi_core::control::{
    DelayLine, ExplicitTwisting, ReferencePeriod as PlannedPeriod, TickStatus, TwistingRegulator,
    TwistingTracker, Waypoint,
};
use zivi_core::{Branch, Physical, Restitution, SettingError};

use crate::stepping::ballistic;
use crate::stepping::step_solver::SignSolver;
use crate::stepping::theta_gamma::Solver;
use crate::Events;

/// Number of signs that are recorded: `ls, lv, lsr, lvr, les, lev`.
pub const SIGNS: usize = 6;

/// Input of a controller at a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tick {
    /// The time of the sample (s).
    pub t: f64,
    /// The measured state.
    pub measured: Physical,
    /// The force on the mass in the controller's model (m/s^2).
    pub force: f64,
    /// The force on its reference (m/s^2).
    pub force_ref: f64,
}

/// Why an update gave no control.
#[derive(Clone, Debug, PartialEq)]
pub enum TickError<E> {
    /// The sample was rejected; the last control stays and the run continues.
    Refused(SettingError),
    /// The controller raised an error; the run ends.
    Raised(E),
}

impl<E> From<SettingError> for TickError<E> {
    fn from(error: SettingError) -> Self {
        TickError::Refused(error)
    }
}

/// A sampled controller.
pub trait Controller<E> {
    /// The control (m/s^2) for the period that starts now; a reference inside advances by one
    /// period.
    ///
    /// # Errors
    /// [`TickError`]: the sample was refused, or the controller raised an error.
    fn tick(&mut self, tick: Tick) -> Result<f64, TickError<E>>;

    /// The control for the period that starts now, for a reference that is given.
    ///
    /// # Errors
    /// As [`Controller::tick`]; and if the controller cannot follow a given reference.
    fn tick_to(&mut self, _: Tick, _: ReferencePeriod) -> Result<f64, TickError<E>> {
        let text = "a controller that follows one";
        Err(TickError::Refused(SettingError { name: "reference", value: f64::NAN, range: text }))
    }

    /// The present reference, if any.
    fn reference(&self) -> Option<Physical> {
        None
    }

    /// Periods after which it knows its controls to act.
    fn delay(&self) -> usize {
        0
    }

    /// The reference then, which is that many periods ahead of [`Controller::reference`].
    fn reference_ahead(&self) -> Option<Physical> {
        self.reference()
    }

    /// Periods by which its own reference is not that far ahead yet, before the first update.
    fn due(&self) -> usize {
        0
    }

    /// Brings the reference ahead by one of them, under this force (m/s^2).
    ///
    /// # Errors
    /// [`SettingError`] for a force that is not finite or too large.
    fn bring_ahead(&mut self, _: f64) -> Result<(), SettingError> {
        Ok(())
    }

    /// Whether its updates require the force on the reference.
    fn takes_force_ref(&self) -> bool {
        true
    }

    /// The signs of the last update (NaN where it has none).
    fn signs(&self) -> [f64; SIGNS] {
        [f64::NAN; SIGNS]
    }

    /// Status of the last update.
    fn status(&self) -> TickStatus {
        TickStatus::default()
    }

    /// The implicit step of the closed system, (12)-(13), whose signs its control is made of, if
    /// the plant takes it as well in the paper's loop.
    fn closed_step(&self) -> Option<RegulationStep> {
        None
    }
}

impl<E> Controller<E> for Solved<TwistingRegulator> {
    fn tick(&mut self, tick: Tick) -> Result<f64, TickError<E>> {
        Ok(Solved::<TwistingRegulator>::tick(self, tick.measured, tick.force)?)
    }

    fn signs(&self) -> [f64; SIGNS] {
        Controller::<E>::signs(&self.controller)
    }

    fn status(&self) -> TickStatus {
        self.controller.state().status
    }

    fn closed_step(&self) -> Option<RegulationStep> {
        Controller::<E>::closed_step(&self.controller)
    }
}

impl<E> Controller<E> for TwistingRegulator {
    fn tick(&mut self, tick: Tick) -> Result<f64, TickError<E>> {
        Ok(TwistingRegulator::tick(self, tick.measured, tick.force)?)
    }

    fn signs(&self) -> [f64; SIGNS] {
        let [lambda_s, lambda_v] = self.state().signs;
        let none = f64::NAN;
        [lambda_s, lambda_v, none, none, none, none]
    }

    fn status(&self) -> TickStatus {
        self.state().status
    }

    fn closed_step(&self) -> Option<RegulationStep> {
        self.landing().is_none().then(|| *self.step())
    }
}

/// The controllers with a reference have one interface.
macro_rules! controller_with_reference {
    ($controller:ty, $it:ident, $inner:expr $(, $tick_to:item)?) => {
        impl<E> Controller<E> for $controller {
            fn tick(&mut self, tick: Tick) -> Result<f64, TickError<E>> {
                Ok(<$controller>::tick(self, tick.measured, tick.force, tick.force_ref)?)
            }

            $($tick_to)?

            fn reference(&self) -> Option<Physical> {
                let $it = self;
                Some($inner.reference())
            }

            fn signs(&self) -> [f64; SIGNS] {
                let $it = self;
                $inner.state().signs
            }

            fn status(&self) -> TickStatus {
                let $it = self;
                $inner.state().status
            }
        }
    };
}

controller_with_reference!(
    TwistingTracker,
    it,
    it,
    fn tick_to(&mut self, tick: Tick, course: ReferencePeriod) -> Result<f64, TickError<E>> {
        let (Tick { measured, force, .. }, ReferencePeriod { now, next, acceleration }) =
            (tick, course);
        Ok(TwistingTracker::tick_to(self, measured, force, now, next, acceleration)?)
    }
);
controller_with_reference!(ExplicitTwisting, it, it);
controller_with_reference!(
    Solved<TwistingTracker>,
    it,
    it.controller,
    fn tick_to(&mut self, tick: Tick, course: ReferencePeriod) -> Result<f64, TickError<E>> {
        let (Tick { measured, force, .. }, ReferencePeriod { now, next, acceleration }) =
            (tick, course);
        Ok(Solved::<TwistingTracker>::tick_to(self, measured, force, [now, next], acceleration)?)
    }
);
controller_with_reference!(Solved<ExplicitTwisting>, it, it.controller);

impl<E> Controller<E> for Predicting<Solved<TwistingRegulator>> {
    fn tick(&mut self, tick: Tick) -> Result<f64, TickError<E>> {
        self.late(tick.measured, tick.force, |it, measured| {
            Controller::<E>::tick(it, Tick { measured, ..tick })
        })
    }

    fn signs(&self) -> [f64; SIGNS] {
        Controller::<E>::signs(&self.controller)
    }

    fn status(&self) -> TickStatus {
        Controller::<E>::status(&self.controller)
    }

    fn delay(&self) -> usize {
        self.under_way.controls.periods()
    }
}

impl<E> Controller<E> for Predicting<Solved<TwistingTracker>> {
    fn tick(&mut self, tick: Tick) -> Result<f64, TickError<E>> {
        let ready = Self::bring_ahead(self, tick.force_ref);
        let here = self.controller.controller.reference();
        let done = self.late(tick.measured, tick.force, |it, measured| {
            ready?;
            Controller::<E>::tick(it, Tick { measured, ..tick })
        });
        if done.is_ok() {
            self.under_way.references.push(here);
        }
        done
    }

    fn tick_to(&mut self, tick: Tick, course: ReferencePeriod) -> Result<f64, TickError<E>> {
        self.under_way.due = 0;
        self.late(tick.measured, tick.force, |it, measured| {
            Controller::<E>::tick_to(it, Tick { measured, ..tick }, course)
        })
    }

    fn reference(&self) -> Option<Physical> {
        match self.under_way.due {
            0 => self.under_way.references.oldest(),
            _ => Some(self.controller.controller.reference()),
        }
    }

    fn reference_ahead(&self) -> Option<Physical> {
        Some(self.controller.controller.reference())
    }

    fn signs(&self) -> [f64; SIGNS] {
        Controller::<E>::signs(&self.controller)
    }

    fn status(&self) -> TickStatus {
        Controller::<E>::status(&self.controller)
    }

    fn delay(&self) -> usize {
        self.under_way.controls.periods()
    }

    fn due(&self) -> usize {
        self.under_way.due
    }

    fn bring_ahead(&mut self, force_ref: f64) -> Result<(), SettingError> {
        self.one_ahead(force_ref)
    }
}

/// All controllers: of each its meaning, the name of its variant, its type and its sampling period.
macro_rules! controllers {
    ($($meaning:literal $name:ident($kind:ty), |$it:ident| $h:expr;)*) => {
        /// One of the controllers of `zivi_core`.
        #[derive(Clone, Debug, PartialEq)]
        pub enum AnyController {
            $(#[doc = $meaning] $name($kind),)*
        }

        impl AnyController {
            /// Sampling period (s).
            #[must_use]
            pub fn h(&self) -> f64 {
                match self {
                    $(AnyController::$name($it) => $h,)*
                }
            }

            /// The controller itself, for frequent calls.
            pub fn dynamic<E>(&mut self) -> &mut (dyn Controller<E> + Send) {
                match self {
                    $(AnyController::$name(it) => it,)*
                }
            }

            fn inner<E>(&self) -> &dyn Controller<E> {
                match self {
                    $(AnyController::$name(it) => it,)*
                }
            }
        }

        impl<E> Controller<E> for AnyController {
            fn tick(&mut self, tick: Tick) -> Result<f64, TickError<E>> {
                match self {
                    $(AnyController::$name(it) => Controller::<E>::tick(it, tick),)*
                }
            }

            fn tick_to(&mut self, tick: Tick, course: ReferencePeriod) -> Result<f64, TickError<E>> {
                match self {
                    $(AnyController::$name(it) => Controller::<E>::tick_to(it, tick, course),)*
                }
            }

            fn reference(&self) -> Option<Physical> {
                self.inner::<E>().reference()
            }

            fn signs(&self) -> [f64; SIGNS] {
                self.inner::<E>().signs()
            }

            fn status(&self) -> TickStatus {
                self.inner::<E>().status()
            }

            fn delay(&self) -> usize {
                self.inner::<E>().delay()
            }

            fn reference_ahead(&self) -> Option<Physical> {
                self.inner::<E>().reference_ahead()
            }

            fn due(&self) -> usize {
                self.inner::<E>().due()
            }

            fn bring_ahead(&mut self, force_ref: f64) -> Result<(), SettingError> {
                match self {
                    $(AnyController::$name(it) => Controller::<E>::bring_ahead(it, force_ref),)*
                }
            }

            fn closed_step(&self) -> Option<RegulationStep> {
                self.inner::<E>().closed_step()
            }
        }
    };
}

controllers! {
    "The regulator." Regulator(TwistingRegulator), |it| it.step().h;
    "The implicit tracker." Tracker(TwistingTracker), |it| it.h();
    "The explicit baseline." Explicit(ExplicitTwisting), |it| it.h();
    "The regulator with a general solver." SolvedRegulator(Solved<TwistingRegulator>),
        |it| it.controller.step().h;
    "The tracker with a general solver." SolvedTracker(Solved<TwistingTracker>),
        |it| it.controller.h();
    "The regulator whose controls act late." LateRegulator(Predicting<Solved<TwistingRegulator>>),
        |it| it.controller.h();
    "The tracker whose controls act late." LateTracker(Predicting<Solved<TwistingTracker>>),
        |it| it.controller.h();
}

// Given references, and their branch at each sample.

/// A given reference at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReferencePoint {
    /// Distance from the wall (m) and velocity (m/s).
    pub state: Physical,
    /// The side of the wall on which it is followed, where that is known.
    pub branch: Option<Branch>,
    /// Its acceleration from then on, where that is known (m/s^2).
    pub acceleration: Option<f64>,
}

/// A given reference of a loop.
pub trait Reference<E> {
    /// The reference at the `k`-th sample, the time `t`.
    ///
    /// # Errors
    /// What the function of the user raises.
    fn at(&mut self, k: usize, t: f64) -> Result<ReferencePoint, E>;
}

/// A reference that is known at all samples.
#[derive(Clone, Copy, Debug)]
pub struct Samples<'a>(pub &'a [ReferencePoint]);

impl<E> Reference<E> for Samples<'_> {
    fn at(&mut self, k: usize, _: f64) -> Result<ReferencePoint, E> {
        let missing = Physical { x: f64::NAN, xdot: f64::NAN };
        let unknown = ReferencePoint { state: missing, branch: None, acceleration: None };
        Ok(self.0.get(k).copied().unwrap_or(unknown))
    }
}

/// Input of an update from a reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReferencePeriod {
    /// Where it is at the sample.
    pub now: Waypoint,
    /// Where it is at the next one.
    pub next: Waypoint,
    /// Its acceleration over the period (m/s^2), if known.
    pub acceleration: Option<f64>,
}

/// A reference and the wall above which it moves.
pub struct ReferenceWithWall<'a, E> {
    /// The reference.
    pub reference: &'a mut dyn Reference<E>,
    /// Its wall.
    pub restitution: Restitution,
}

/// Follows a given reference from sample to sample.
pub(super) struct ReferenceTracker<'a, E> {
    followed: ReferenceWithWall<'a, E>,
    branch: Branch,
    /// Its acceleration over the last period without an impact (m/s^2).
    pull: f64,
}

impl<'a, E> ReferenceTracker<'a, E> {
    pub(super) fn new(followed: ReferenceWithWall<'a, E>) -> Self {
        Self { followed, branch: Branch::Positive, pull: 0.0 }
    }

    /// The reference at a sample.
    pub(super) fn state(&mut self, k: usize, t: f64) -> Result<Physical, E> {
        Ok(self.followed.reference.at(k, t)?.state)
    }

    /// The reference over the period from the `k`-th sample on.
    pub(super) fn period(
        &mut self,
        k: usize,
        (t, t_next): (f64, f64),
    ) -> Result<ReferencePeriod, E> {
        let from = self.followed.reference.at(k, t)?;
        let to = self.followed.reference.at(k + 1, t_next)?;
        let now = from.branch.unwrap_or(self.branch);
        let pull = from.acceleration.unwrap_or(self.pull);
        let next = to.branch.unwrap_or_else(|| {
            if bounces(from.state, to.state, pull, self.followed.restitution, t_next - t) {
                other(now)
            } else {
                now
            }
        });
        if next == now {
            self.pull = (to.state.xdot - from.state.xdot) / (t_next - t);
        }
        self.branch = next;
        Ok(ReferencePeriod {
            now: Waypoint { state: from.state, branch: now },
            next: Waypoint { state: to.state, branch: next },
            acceleration: from.acceleration,
        })
    }
}

fn other(branch: Branch) -> Branch {
    match branch {
        Branch::Positive => Branch::Negative,
        Branch::Negative => Branch::Positive,
    }
}

/// Whether a reference has an odd number of impacts between two samples: whether its last
/// acceleration explains the second better with the impacts that it makes than without.
fn bounces(from: Physical, to: Physical, pull: f64, restitution: Restitution, h: f64) -> bool {
    let mut events = Events::default();
    let bounced = ballistic::advance(from, pull, restitution, (0.0, h), &mut events);
    if events.impacts.len() % 2 == 0 {
        return false;
    }
    let free =
        Physical { x: from.x + h * (from.xdot + 0.5 * pull * h), xdot: from.xdot + pull * h };
    let off = |it: Physical| (it.x - to.x).abs() + h * (it.xdot - to.xdot).abs();
    off(bounced) < off(free)
}

// The controllers with the signs of their steps found by a general solver: as the VI (23) of two signs
// and (24) of six.
//
// Each solve starts from the signs of the last update. Where the step has one solution the control is
// that of the exact one; where it has several, this is the one near the last signs.

/// A controller and how its steps are solved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solved<C> {
    /// The controller.
    pub controller: C,
    /// The solver.
    pub solver: Solver,
}

/// The general solver, `None` for the exact solution.
fn general<const N: usize>(solver: Solver, signs: [f64; N]) -> Option<SignSolver<N>> {
    let mut found = match solver {
        Solver::Exact => return None,
        Solver::Newton => SignSolver::newton(),
        Solver::Outer { linearisations } => SignSolver::outer(linearisations),
    };
    found.start_from(signs);
    Some(found)
}

impl Solved<TwistingRegulator> {
    /// [`TwistingRegulator::tick`].
    ///
    /// # Errors
    /// The same.
    pub fn tick(&mut self, measured: Physical, force: f64) -> Result<f64, SettingError> {
        let it = &mut self.controller;
        let Some(mut solver) = general(self.solver, it.state().signs) else {
            return it.tick(measured, force);
        };
        it.tick_by(measured, force, |inclusion| {
            let scales = inclusion.scales([1.0; 2]);
            solver.solve(&mut AsProblem(*inclusion), scales).then(|| solver.signs())
        })
    }
}

impl Solved<ExplicitTwisting> {
    /// [`ExplicitTwisting::tick`], whose signs are those of the sample.
    ///
    /// # Errors
    /// The same.
    pub fn tick(
        &mut self,
        measured: Physical,
        force: f64,
        force_ref: f64,
    ) -> Result<f64, SettingError> {
        self.controller.tick(measured, force, force_ref)
    }
}

impl Solved<TwistingTracker> {
    /// [`TwistingTracker::tick`].
    ///
    /// # Errors
    /// The same.
    pub fn tick(
        &mut self,
        measured: Physical,
        force: f64,
        force_ref: f64,
    ) -> Result<f64, SettingError> {
        if self.solver == Solver::Exact {
            return self.controller.tick(measured, force, force_ref);
        }
        self.ticked(measured, force, |it| Ok(it.own_period(force_ref)))
    }

    /// [`TwistingTracker::tick_to`].
    ///
    /// # Errors
    /// The same.
    pub fn tick_to(
        &mut self,
        measured: Physical,
        force: f64,
        [now, next]: [Waypoint; 2],
        acceleration: Option<f64>,
    ) -> Result<f64, SettingError> {
        if self.solver == Solver::Exact {
            return self.controller.tick_to(measured, force, now, next, acceleration);
        }
        self.ticked(measured, force, |it| {
            let of = (it.reference_step().restitution(), it.h());
            let course = PlannedPeriod::between(of, force, [now, next], acceleration)?;
            Ok(it.given_period(course))
        })
    }

    fn ticked(
        &mut self,
        measured: Physical,
        force: f64,
        course: impl FnOnce(&TwistingTracker) -> Result<PlannedPeriod, SettingError>,
    ) -> Result<f64, SettingError> {
        let it = &mut self.controller;
        let planned = it.plan(measured, force, course)?;
        let Some(mut solver) = general(self.solver, it.state().signs) else {
            return it.follow(&planned);
        };
        it.follow_by(&planned, |inclusion| {
            let scales = inclusion.scales([1.0; 6]);
            solver.solve(&mut AsProblem(*inclusion), scales).then(|| solver.signs())
        })
    }
}

// Controllers that know that their controls act late: each update is one for the state of then.

/// Delayed controls between their sample and the time at which they act.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UnderWay {
    /// The controls that do not act yet.
    pub controls: DelayLine<f64>,
    /// A reference of its own, from the sample until then.
    pub references: DelayLine<Physical>,
    /// Periods by which that is not ahead yet.
    pub due: usize,
}

impl UnderWay {
    /// An empty delay line of a length in periods.
    ///
    /// # Errors
    /// [`SettingError`] for a delay out of range.
    pub fn nothing(delay: usize) -> Result<Self, SettingError> {
        let references = DelayLine::new(delay, Physical::default())?;
        Ok(Self { controls: DelayLine::new(delay, 0.0)?, references, due: delay })
    }

    /// As before the first update.
    pub fn forget(&mut self) {
        self.due = self.controls.periods();
        for _ in 0..self.due {
            self.controls.push(0.0);
            self.references.push(Physical::default());
        }
    }
}

/// A controller whose controls act late.
#[derive(Clone, Debug, PartialEq)]
pub struct Predicting<C> {
    /// The controller.
    pub controller: C,
    /// The delay line.
    pub under_way: Box<UnderWay>,
}

/// Interface of controllers for the prediction.
pub trait Predictable {
    /// Sampling period (s).
    fn h(&self) -> f64;
    /// The plant's wall.
    fn wall(&self) -> Restitution;
    /// The state of a measurement; true if clamped to the wall.
    ///
    /// # Errors
    /// [`SettingError`] for a sample that is refused.
    fn sense(&self, measured: Physical) -> Result<(Physical, bool), SettingError>;
    /// The last control.
    fn u(&self) -> f64;
    /// Records that the measurement was clamped to the wall.
    fn clamp(&mut self);
}

macro_rules! predictable {
    ($kind:ty, |$it:ident| $h:expr, $wall:expr) => {
        impl Predictable for Solved<$kind> {
            fn h(&self) -> f64 {
                let $it = &self.controller;
                $h
            }

            fn wall(&self) -> Restitution {
                let $it = &self.controller;
                $wall
            }

            fn sense(&self, measured: Physical) -> Result<(Physical, bool), SettingError> {
                self.controller.sense(measured)
            }

            fn u(&self) -> f64 {
                self.controller.state().u
            }

            fn clamp(&mut self) {
                let mut state = self.controller.state();
                state.status = TickStatus { clamped: true, ..state.status };
                self.controller.set_state(state);
            }
        }
    };
}

predictable!(TwistingRegulator, |it| it.step().h, it.step().restitution);
predictable!(TwistingTracker, |it| it.h(), it.restitution());

impl<C: Predictable> Predicting<C> {
    /// An update for the state in which its control will act. Controls that were sent, including
    /// repeated ones after a rejected sample, are then in the delay line.
    pub(super) fn late<E: From<SettingError>>(
        &mut self,
        measured: Physical,
        force: f64,
        then: impl FnOnce(&mut C, Physical) -> Result<f64, E>,
    ) -> Result<f64, E> {
        let h = self.controller.h();
        let it = &mut self.controller;
        let done = match it.sense(measured) {
            Ok((state, clamped)) => {
                let state = self.under_way.controls.ahead(state, it.wall(), force, h);
                let done = then(it, state);
                if clamped && done.is_ok() {
                    it.clamp();
                }
                done
            }
            Err(error) => Err(error.into()),
        };
        self.under_way.controls.push(self.controller.u());
        done
    }
}

impl Predicting<Solved<TwistingRegulator>> {
    /// A period without a sample: the control is held.
    pub fn miss(&mut self) -> f64 {
        let u = self.controller.controller.miss();
        self.under_way.controls.push(u);
        u
    }
}

impl Predicting<Solved<TwistingTracker>> {
    /// Advances the reference under this force (m/s^2), if necessary.
    pub(super) fn bring_ahead(&mut self, force_ref: f64) -> Result<(), SettingError> {
        while self.under_way.due > 0 {
            self.one_ahead(force_ref)?;
        }
        Ok(())
    }

    /// Brings it ahead by one period.
    pub(super) fn one_ahead(&mut self, force_ref: f64) -> Result<(), SettingError> {
        let here = self.controller.controller.reference();
        self.controller.controller.miss(force_ref)?;
        self.under_way.references.push(here);
        self.under_way.due -= 1;
        Ok(())
    }

    /// A period without a sample: the control is held, the reference moves on.
    ///
    /// # Errors
    /// [`SettingError`] for a force that is not finite or too large.
    pub fn miss(&mut self, force_ref: f64) -> Result<f64, SettingError> {
        self.bring_ahead(force_ref)?;
        let here = self.controller.controller.reference();
        let u = self.controller.controller.miss(force_ref)?;
        self.under_way.references.push(here);
        self.under_way.controls.push(u);
        Ok(u)
    }

    /// The same of a reference that is given.
    ///
    /// # Errors
    /// [`SettingError`] for a waypoint that is not finite or has x < 0.
    pub fn miss_to(&mut self, next: Waypoint) -> Result<f64, SettingError> {
        let u = self.controller.controller.miss_to(next)?;
        self.under_way.due = 0;
        self.under_way.controls.push(u);
        Ok(u)
    }
}
