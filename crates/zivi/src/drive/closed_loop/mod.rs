//! The sampled closed loop: measure, update, hold the control while the plant moves on.
//!
//! ```text
//! y_k = measured(x(t_k), x'(t_k))      u_k = update(y_k)      x'' = f + u_{k - delay} on [t_k, t_{k+1})
//! ```
//!
//! The true force moves the plant; the controller receives the values of its force models at the
//! sample. Both are different arguments.

mod controller;
mod plant;
mod record;

use std::collections::VecDeque;

use controller::ReferenceTracker;
use plant::{BallisticPlant, SchemePlant, StoredMotion, SwitchedPlant};
use record::LoopRecord;
use zivi_core::control::regulation::RegulationStep;
use zivi_core::observer::{Estimate, ImpactObserver, Measurement};
use zivi_core::{Physical, Restitution, SettingError, ThetaGammaStep};

use super::Updates;
use crate::record::columns::Reserve;
use crate::record::status::Failure;
use crate::record::user_events::{unknown, EventLocator, SmoothPart};
use crate::stepping::fixed_step::watched;
use crate::system::dynamics::{check_initial, finite_force};
use crate::{
    Dependence, Force, Grid, Impact, Kick, LocatedEvent, Monitor, PathPoint, SetupError, Status,
    SwitchedRk, UserEvent,
};

pub use controller::{
    AnyController, Controller, Predictable, Predicting, Reference, ReferencePeriod, ReferencePoint,
    ReferenceWithWall, Samples, Solved, Tick, TickError, UnderWay, SIGNS,
};
pub use plant::{Period, Plant, Sensor};
pub use record::{LoopPath, LoopRun, SignRecord, ESTIMATES, LOOP_COLUMNS, REFUSED};

/// How the plant moves between the samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion {
    /// Exactly for a constant force, otherwise by the switched Runge-Kutta method.
    Exact(SwitchedRk),
    /// By the switched Runge-Kutta method.
    Switched(SwitchedRk),
    /// By the theta-gamma scheme on the controller's grid (the paper's own loop).
    Scheme {
        /// Weight of the new velocity, in `(0, 1]`.
        theta: f64,
        /// Where the signs are taken, in `(0, 1]`.
        gamma: f64,
    },
}

/// Environment of the controller.
#[derive(Clone, Copy, Debug)]
pub struct Loop<'a> {
    /// The plant's wall.
    pub restitution: Restitution,
    /// The samples.
    pub grid: Grid,
    /// The plant's state at the first sample.
    pub initial: Physical,
    /// How the plant moves between samples.
    pub motion: Motion,
    /// The sensor.
    pub sensor: Sensor<'a>,
    /// Observer whose estimates replace the measurement, if any.
    pub observer: Option<ImpactObserver>,
    /// Periods that pass before a control acts (`0` control acts until then).
    pub delay: usize,
}

/// The forces of a loop.
#[derive(Debug)]
pub struct Forces<'a, F> {
    /// Force on the plant.
    pub plant: &'a mut F,
    /// Force in the controller's model.
    pub model: &'a mut F,
    /// Force on the reference.
    pub reference: &'a mut F,
}

/// Runs a closed loop.
///
/// # Errors
/// [`SetupError`] before anything is computed. Whatever goes wrong later is in the run's status.
pub fn simulate_closed_loop<E, F: Force<E>>(
    controller: &mut (impl Controller<E> + ?Sized),
    surroundings: Loop<'_>,
    forces: Forces<'_, F>,
    monitor: &mut impl Monitor<E>,
) -> Result<LoopRun<E>, SetupError> {
    observe_closed_loop(controller, surroundings, forces, LoopOptions::default(), monitor)
}

/// Runs a closed loop that keeps more than its samples.
///
/// # Errors
/// As [`simulate_closed_loop`].
pub fn observe_closed_loop<E, F: Force<E>>(
    controller: &mut (impl Controller<E> + ?Sized),
    surroundings: Loop<'_>,
    forces: Forces<'_, F>,
    mut output: LoopOptions<'_, E>,
    monitor: &mut impl Monitor<E>,
) -> Result<LoopRun<E>, SetupError> {
    let Loop { restitution, grid, initial, motion, .. } = surroundings;
    check_initial(initial)?;
    let Forces { plant: force, model, reference } = forces;
    let (t0, models) =
        (grid.t(0), Models { model: Told::new(model), reference: Told::new(reference) });
    let keep = match (output.dense, output.events.is_empty()) {
        (true, _) => StoredMotion::Everything,
        (false, false) => StoredMotion::Period,
        (false, true) => StoredMotion::Nothing,
    };
    let output = &mut output;
    let kicks = output.kicks.take();
    match motion {
        Motion::Scheme { .. } if kicks.is_some() => {
            Err(SetupError::Refused("kicks need a plant that is moved by SwitchedRK"))
        }
        Motion::Scheme { theta, gamma } => {
            let step = ThetaGammaStep::new(grid.h(), theta, gamma, restitution)?;
            let plant = SchemePlant::new(step, force, (t0, initial), keep);
            run(controller, plant, surroundings, models, output, monitor)
        }
        Motion::Exact(_) if kicks.is_none() && force.dependence() == Dependence::Constant => {
            let plant = BallisticPlant::new(restitution, force, t0, initial);
            run(controller, plant, surroundings, models, output, monitor)
        }
        Motion::Exact(method) | Motion::Switched(method) => {
            // a period is one step, unless the error control wants more
            let method = SwitchedRk { first_step: Some(grid.h()), ..method };
            let plant =
                SwitchedPlant::new(method, restitution, force, (t0, initial), (keep, kicks))?;
            run(controller, plant, surroundings, models, output, monitor)
        }
    }
}

/// Force models of the controller.
struct Models<'a, F> {
    model: Told<'a, F>,
    reference: Told<'a, F>,
}

/// A force whose values are passed to the controller.
struct Told<'a, F> {
    force: &'a mut F,
    /// Its value, once it is known, of one that has no other.
    constant: Option<f64>,
}

impl<'a, F> Told<'a, F> {
    fn new(force: &'a mut F) -> Self {
        Self { force, constant: None }
    }

    fn at<E>(&mut self, t: f64, state: Physical) -> Result<f64, Failure<E>>
    where
        F: Force<E>,
    {
        if let Some(value) = self.constant {
            return Ok(value);
        }
        let value = finite_force(self.force, t, state)?;
        self.constant = (self.force.dependence() == Dependence::Constant).then_some(value);
        Ok(value)
    }
}

fn run<E, F: Force<E>>(
    controller: &mut (impl Controller<E> + ?Sized),
    plant: impl Plant<E>,
    surroundings: Loop<'_>,
    models: Models<'_, F>,
    output: &mut LoopOptions<'_, E>,
    monitor: &mut impl Monitor<E>,
) -> Result<LoopRun<E>, SetupError> {
    let n = surroundings.grid.n_steps();
    let mut walk = LoopWalk::start(controller, plant, surroundings, models, output)?;
    let ending = watched(n, monitor, |until, _| walk.go_to(until));
    Ok(walk.finish(ending))
}

/// A running closed loop: `k` periods are done, the last of them ended in `state`.
struct LoopWalk<'a, 'e, C: ?Sized, P, F, E> {
    controller: &'a mut C,
    plant: P,
    surroundings: Loop<'a>,
    models: Models<'a, F>,
    record: LoopRecord,
    k: usize,
    state: Physical,
    /// Force on the plant.
    u: f64,
    /// The model's force over the last period, without what the observer adds.
    known: f64,
    observer: Option<ImpactObserver>,
    /// Controls that do not act yet, the oldest first.
    pending: VecDeque<f64>,
    events: LoopEvents<'e, E>,
    dense: bool,
    guide: Option<ReferenceTracker<'e, E>>,
}

impl<'a, 'e, C, P, F, E> LoopWalk<'a, 'e, C, P, F, E>
where
    C: Controller<E> + ?Sized,
    P: Plant<E>,
    F: Force<E>,
{
    fn start(
        controller: &'a mut C,
        plant: P,
        surroundings: Loop<'a>,
        models: Models<'a, F>,
        output: &'a mut LoopOptions<'e, E>,
    ) -> Result<Self, SetupError> {
        let Loop { grid, initial, delay, observer, .. } = surroundings;
        let record = LoopRecord::with_room(grid.n_steps() + 1, observer.is_some())?;
        if delay > grid.n_steps() {
            let periods = "at most the number of periods of the run";
            return Err(SetupError::Count("delay", delay, periods));
        }
        let pending = std::iter::repeat_n(0.0, delay).collect();
        let duration = grid.t(grid.n_steps()) - grid.t(0);
        Ok(Self {
            controller,
            plant,
            surroundings,
            models,
            record,
            k: 0,
            state: initial,
            u: 0.0,
            known: 0.0,
            observer,
            pending,
            guide: output.reference.take().map(ReferenceTracker::new),
            events: LoopEvents::new(std::mem::take(&mut output.events), duration),
            dense: output.dense,
        })
    }

    fn go_to(&mut self, until: usize) -> Result<(), Failure<E>> {
        while self.k < until {
            self.period()?;
        }
        Ok(())
    }

    /// One period: measure, update, hold.
    fn period(&mut self) -> Result<(), Failure<E>> {
        let grid = self.surroundings.grid;
        let n = grid.n_steps();
        let t = grid.t(self.k);
        if self.k == 0 && self.guide.is_none() {
            self.bring_reference_ahead()?;
        }
        let (course, reference) = self.reference(t)?;
        let tick = self.tick(t, reference, course)?;
        self.record.push((t, self.state, reference), self.u, &*self.controller, tick)?;
        self.record.note(self.observer.as_ref());
        let h = if self.k + 1 == n { grid.last_h() } else { grid.h() };
        let period = Period { t, t_next: grid.t(self.k + 1), h };
        self.plant.expect(self.expected(tick));
        let next = self.plant.advance(period, self.state, self.u)?;
        if !(next.x.is_finite() && next.xdot.is_finite()) {
            return Err(Failure::Status(Status::StateNotFinite));
        }
        let ends = (std::mem::replace(&mut self.state, next), next);
        self.k += 1;
        if self.events.follow(period, ends, &self.plant)? {
            return Err(Failure::Status(Status::TerminatedByEvent));
        }
        Ok(())
    }

    /// Brings a reference of the controller's own as far ahead as its controls are late.
    fn bring_reference_ahead(&mut self) -> Result<(), Failure<E>> {
        let Some(from) = self.controller.reference_ahead() else { return Ok(()) };
        let (mut at, grid, due) = (from, self.surroundings.grid, self.controller.due());
        for k in 0..due {
            let force = self.models.reference.at(grid.t(0) + k as f64 * grid.h(), at)?;
            // a force that is too large is rejected by the update
            if self.controller.bring_ahead(force).is_err() {
                break;
            }
            at = self.controller.reference_ahead().unwrap_or(at);
        }
        Ok(())
    }

    /// Input of the controller from a given reference, and the state of the reference.
    fn reference(
        &mut self,
        t: f64,
    ) -> Result<(Option<ReferencePeriod>, Option<Physical>), Failure<E>> {
        let Some(guide) = &mut self.guide else { return Ok((None, self.controller.reference())) };
        let grid = self.surroundings.grid;
        let mut period = |k: usize| guide.period(k, (grid.t(k), grid.t(k + 1)));
        let (delay, last) = (self.controller.delay(), grid.n_steps() - 1);
        if delay == 0 {
            let course = period(self.k).map_err(Failure::Raised)?;
            return Ok((Some(course), Some(course.now.state)));
        }
        // of each period once, in order: on which side it is shows from those before; controls that
        // act after the run are none of anything
        let from = if self.k == 0 { 0 } else { (self.k + delay).min(last) };
        let mut course = period(from).map_err(Failure::Raised)?;
        for k in from + 1..=(self.k + delay).min(last) {
            course = period(k).map_err(Failure::Raised)?;
        }
        let here = guide.state(self.k, t).map_err(Failure::Raised)?;
        Ok((Some(course), Some(here)))
    }

    /// The step that the control is of, where nothing came between: neither noise nor delay, and
    /// the update (these are its bits) was as it should be.
    fn expected(&self, tick: u8) -> Option<(RegulationStep, f64)> {
        let step = self.controller.closed_step()?;
        let Loop { sensor, delay, .. } = &self.surroundings;
        let direct = tick == 0 && *delay == 0 && self.observer.is_none();
        let seen = direct && sensor.measure(self.k, self.state) == self.state;
        seen.then_some((step, self.known))
    }

    /// Asks the controller.
    fn ask(
        &mut self,
        t: f64,
        reference: Option<Physical>,
        course: Option<ReferencePeriod>,
    ) -> Result<Result<f64, TickError<E>>, Failure<E>> {
        let Estimate { state: measured, d } = match self.observe() {
            Ok(estimate) => estimate,
            Err(error) => return Ok(Err(error.into())),
        };
        self.known = self.models.model.at(t, measured)?;
        let force = self.known + d;
        let force_ref = match reference {
            Some(here) if course.is_none() && self.controller.takes_force_ref() => {
                let (then, ahead) = match self.controller.delay() {
                    0 => (t, None),
                    late => (
                        t + late as f64 * self.surroundings.grid.h(),
                        self.controller.reference_ahead(),
                    ),
                };
                self.models.reference.at(then, ahead.unwrap_or(here))?
            }
            _ => 0.0,
        };
        let tick = Tick { t, measured, force, force_ref };
        Ok(match course {
            Some(course) => self.controller.tick_to(tick, course),
            None => self.controller.tick(tick),
        })
    }

    /// The state estimate at this sample: the measurement, or the observer's estimate.
    fn observe(&mut self) -> Result<Estimate, SettingError> {
        let Physical { x, xdot } = self.surroundings.sensor.measure(self.k, self.state);
        let Some(observer) = &mut self.observer else {
            return Ok(Estimate { state: Physical { x, xdot }, d: 0.0 });
        };
        observer.tick(Measurement { x, xdot: Some(xdot) }, self.known, self.u)
    }

    /// Decides what acts from `t` on. Gives the bits of the update.
    fn tick(
        &mut self,
        t: f64,
        reference: Option<Physical>,
        course: Option<ReferencePeriod>,
    ) -> Result<u8, Failure<E>> {
        let (sent, bits) = match self.ask(t, reference, course)? {
            Ok(u) if u.is_finite() => (u, self.controller.status().bits()),
            Ok(_) | Err(TickError::Refused(_)) => {
                (*self.pending.back().unwrap_or(&self.u), REFUSED)
            }
            Err(TickError::Raised(error)) => return Err(Failure::Raised(error)),
        };
        self.u = match self.pending.pop_front() {
            Some(due) => {
                self.pending.push_back(sent);
                due
            }
            None => sent,
        };
        Ok(bits)
    }

    /// The latest start of a rest that has lasted a period, or the whole run.
    fn latest_rest(&self) -> f64 {
        let (grid, k) = (self.surroundings.grid, self.k);
        let shortened = k == grid.n_steps() && grid.last_h() < grid.h();
        if shortened {
            (grid.t(k) - grid.h()).max(grid.t(0))
        } else {
            grid.t(k.saturating_sub(1))
        }
    }

    fn finish(mut self, ending: Failure<E>) -> LoopRun<E> {
        let updates = Updates::of(&self.record.ticks);
        // the last sample, unless the run ended within the period that starts there
        if self.record.ticks.len() == self.k {
            let t = self.surroundings.grid.t(self.k);
            // what the reference raises now, it raised at the sample before, or the run is over
            let given = self.guide.as_mut().map(|guide| guide.state(self.k, t).ok());
            let reference = given.unwrap_or_else(|| self.controller.reference());
            let last = (t, self.state, reference);
            let pushed = self.record.push(last, self.u, &*self.controller, 0);
            // the estimate at the end of the last period; a measurement that is rejected leaves it
            let _ = self.observe();
            if pushed.is_ok() {
                self.record.note(self.observer.as_ref());
            }
        }
        let (status, raised) = match ending {
            Failure::Status(status) => (updates.ending(status), None),
            Failure::Raised(error) => (Status::Raised, Some(error)),
        };
        let (mut events, nfev) = (self.plant.events(), self.plant.nfev());
        // the control of the next sample may end a rest: it counts once it has lasted a period
        let latest = self.latest_rest();
        events.rest_time = events.rest_time.filter(|rest| *rest <= latest);
        let LoopRecord { columns, signs, estimates, ticks } = self.record;
        let path = self.dense.then(|| self.plant.path());
        let hits = self.events.into_hits();
        LoopRun {
            columns,
            signs,
            estimates,
            ticks,
            updates,
            events,
            path,
            hits,
            status,
            nfev,
            raised,
        }
    }
}

// Optional records of a closed loop: the motion between samples, and user events.

/// Options of a closed loop: optional inputs and records.
pub struct LoopOptions<'a, E> {
    /// The given reference, if any: the controller then does not advance its own.
    pub reference: Option<ReferenceWithWall<'a, E>>,
    /// Whether to keep the motion between the samples.
    pub dense: bool,
    /// The user's events. A level is a function as others are.
    pub events: Vec<UserEvent<'a, E>>,
    /// Increasing times of velocity jumps (s) and the velocities after them; a jump at a sample follows it.
    pub kicks: Option<(&'a [f64], Kick<'a, E, PathPoint>)>,
}

impl<E> Default for LoopOptions<'_, E> {
    fn default() -> Self {
        Self { reference: None, dense: false, events: Vec::new(), kicks: None }
    }
}

/// The events of the user along the plant.
struct LoopEvents<'a, E> {
    seeker: EventLocator<'a, E, PathPoint>,
    reserve: Reserve,
    started: bool,
    /// Impacts that were seen.
    impacts: usize,
}

impl<'a, E> LoopEvents<'a, E> {
    /// Events of a run that takes a time (s).
    fn new(events: Vec<UserEvent<'a, E>>, duration: f64) -> Self {
        let seeker = EventLocator::new(events, point(Physical::default()), duration);
        Self { seeker, reserve: Reserve::default(), started: false, impacts: 0 }
    }

    /// Follows a period that is over; whether an event ends the run.
    fn follow(
        &mut self,
        Period { t, t_next, .. }: Period,
        (from, to): (Physical, Physical),
        plant: &impl Plant<E>,
    ) -> Result<bool, Failure<E>> {
        if self.seeker.is_idle() {
            return Ok(false);
        }
        self.seeker.make_room(&mut self.reserve)?;
        if !self.started {
            self.seeker.start(t, &point(from)).map_err(Failure::Raised)?;
            self.started = true;
        }
        let impacts = &plant.impacts()[self.impacts..];
        self.impacts += impacts.len();
        let stop = self.pieces((t, t_next), to, impacts, plant).map_err(Failure::Raised)?;
        Ok(stop.is_some())
    }

    /// Follows the smooth segments between impacts, and the jumps.
    fn pieces(
        &mut self,
        (mut t, t_next): (f64, f64),
        end: Physical,
        impacts: &[Impact],
        plant: &impl Plant<E>,
    ) -> Result<Option<LocatedEvent>, E> {
        for &Impact { t: at, xdot_before, xdot_after } in impacts {
            let contact = point(Physical { x: 0.0, xdot: xdot_before });
            let motion = |time: f64, to: &mut PathPoint| {
                *to = if time >= at { contact } else { point(plant.at(time)) };
            };
            let mut stop = None;
            if at > t {
                let part = SmoothPart { span: (t, at), motion, crossings: unknown };
                stop = self.seeker.along(&part)?;
            }
            if stop.is_none() {
                stop = self.seeker.across(at, &point(Physical { x: 0.0, xdot: xdot_after }))?;
            }
            if stop.is_some() {
                return Ok(stop);
            }
            t = at;
        }
        let motion = |time: f64, to: &mut PathPoint| {
            *to = point(if time >= t_next { end } else { plant.at(time) });
        };
        self.seeker.along(&SmoothPart { span: (t, t_next), motion, crossings: unknown })
    }

    /// Occurrences of each event.
    fn into_hits(self) -> Vec<Vec<LocatedEvent>> {
        self.seeker.into_hits()
    }
}

fn point(Physical { x, xdot }: Physical) -> PathPoint {
    PathPoint { x, xdot, sigma: 1.0 }
}
