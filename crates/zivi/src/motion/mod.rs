//! The motion between events: steps under error control, each searched for the first impact and the
//! first lift-off.

pub(crate) mod lift_off;
pub(crate) mod linear_flight;
pub(crate) mod one_coordinate;
pub(crate) mod path;
pub(crate) mod propagation;
mod slip;
pub(crate) mod state;
pub(crate) mod tail;

use crate::kinetics::mode::{
    AlongStep, AtEnd, ContactProbes, InContact, Limit, Next, Stages, State, DEFECT,
};
use crate::kinetics::{Kinetics, Model};
use crate::motion::lift_off::Release;
use crate::motion::linear_flight::{Bounds, LinearFlight};
use crate::motion::one_coordinate::Pull;
use crate::motion::path::Curve;
use crate::motion::state::MechanicalState;
use crate::numeric::grid::PulseProbes;
use crate::numeric::stages::{factor, worse, Equation, Plan, Tolerances, FACTORS};
use crate::piecewise::flight::{StepDecision, StepRoot, SteppedFlight};
use crate::piecewise::steps::{Start, StepHistory, Steps};
use crate::record::gap_set::{ContactMode, GapSet};
use crate::record::status::Failure;
use crate::switched::accumulation::Deviation;
use crate::switched::{Flights, SwitchedRk};
use crate::system::dynamics::{Dynamics, Layout};
use crate::system::force::{ContactForce, Friction};
use crate::Status;

/// Gaps that close within this fraction of a flight close together.
const TOGETHER: f64 = 1e-13;
/// Rounding of the time.
const ULPS: f64 = 4.0 * f64::EPSILON;
/// Iterations for the time of lift-off.
const ITERATIONS: usize = 4;
/// The first step after a lift-off, relative to that before.
const PART: f64 = 1e-2;
/// The factor for a step in which the direction of a slip turns, instead of one in which it is kept and the slip does not
/// end.
const UNFROZEN: f64 = 2.0 / 3.0;
/// After a compliant gap has opened, the first step takes at most this part of its rise time at the initial
/// acceleration.
const RISE: f64 = 0.9;
/// Steps of so few stages do not resolve the limits of contact.
const SPARSE: usize = 8;
/// Contacts that open so often at one instant open whatever the force does next.
const OFTEN: u32 = 8;

/// Those of the settings. Gaps and coordinates are rounded separately, by more than a single number.
pub(crate) fn tolerances(settings: &SwitchedRk) -> Tolerances {
    Tolerances { rounding: 4.0, ..settings.tolerances() }
}

/// How the slip in contacts with two directions goes on.
enum Slides {
    /// Explicit steps follow it.
    Turning,
    /// It turns too fast for them.
    Stiff,
    /// It ends in some contacts, whose directions stay as they are.
    Stopping(GapSet),
}

/// The motion between events.
#[derive(Clone, Debug)]
pub(crate) struct SmoothMotion {
    steps: Steps<Vec<f64>>,
    /// Data at the end of the last step.
    at_end: AtEnd,
    /// Length of the last step or of its part up to an event.
    length: f64,
    /// Step history for the length of the next step.
    experience: StepHistory,
    probes: ContactProbes,
    /// The probes of flights for pulses.
    pulses: PulseProbes,
    /// Whether directions in which something sticks turned or moved in the last step.
    turns: bool,
    /// The mechanics away from the state.
    aside: Kinetics,
    /// The flights of a linear system, once they are requested.
    linear: Option<Box<LinearFlight>>,
    /// How flights are computed.
    flights: Flights,
    /// From when on the motion within steps is requested (s).
    drawn_from: f64,
    /// Estimated time left of a slip in two directions at the start of the last step (s).
    slip_left: f64,
    /// How long steps were last with other compliant gaps pressed (s).
    lengths: Vec<(GapSet, f64)>,
}

/// So many sets of pressed gaps are remembered.
const MOST_LENGTHS: usize = 16;

impl SmoothMotion {
    pub(crate) fn new(settings: &SwitchedRk, layout: Layout, friction: &Friction) -> Self {
        let limits = settings.limits(tolerances(settings));
        let (pair, size) = (settings.order.pair(), layout.size());
        let steps = Steps::new(limits, pair, size, settings.first_step);
        Self {
            steps,
            at_end: AtEnd::new(layout),
            length: 0.0,
            experience: StepHistory::NONE,
            probes: ContactProbes::default(),
            pulses: PulseProbes::default(),
            turns: false,
            aside: Kinetics::new(layout, friction),
            linear: None,
            flights: if layout.p > 0 { Flights::RungeKutta } else { settings.flights },
            drawn_from: f64::INFINITY,
            slip_left: f64::INFINITY,
            lengths: Vec::new(),
        }
    }

    /// Steps that end later than `t` are complete, and the motion within those later than `drawn`, which
    /// are some of them, is requested.
    pub(crate) fn look_from(&mut self, t: f64, drawn: f64) {
        self.steps.look_from(t);
        self.drawn_from = drawn;
    }

    /// The steps.
    pub(crate) fn steps(&self) -> &Steps<Vec<f64>> {
        &self.steps
    }

    /// The same, mutable, for step limits and inspection.
    pub(crate) fn steps_mut(&mut self) -> &mut Steps<Vec<f64>> {
        &mut self.steps
    }

    /// The last step.
    pub(crate) fn last(&self) -> &Stages {
        self.steps.last()
    }

    /// The motion over the last step, or the part of it up to an event, which ends at a state.
    pub(crate) fn curve(&self, end: &State) -> Curve {
        let curve = self.linear.as_ref().and_then(|linear| linear.curve());
        curve.cloned().unwrap_or_else(|| Curve::new(self.last(), end, self.length))
    }

    /// The time of the fastest mode or load (s), where flights are those of a linear system.
    pub(crate) fn linear_period<E, D: Dynamics<E>>(&mut self, model: &Model<'_, D>) -> Option<f64> {
        if self.linear.is_none() && self.flights != Flights::RungeKutta {
            self.linear = LinearFlight::of(model.dynamics);
            if self.linear.is_none() {
                self.flights = Flights::RungeKutta;
            }
        }
        self.linear.as_ref().map(|linear| linear.period())
    }

    /// Times (s) from which extrapolated flights, and the motion along them, are requested.
    pub(crate) fn requested_from(&self) -> (f64, f64) {
        (self.steps.dense_from(), self.drawn_from)
    }

    /// Whether flights need nothing that is evaluated where they begin: neither forces nor gaps.
    pub(crate) fn is_independent(&self) -> bool {
        self.linear.as_ref().is_some_and(|linear| linear.anchors_gaps())
    }

    /// Whether a gap leads the coordinates and is not recomputed from them.
    pub(crate) fn is_led(&self) -> bool {
        self.linear.as_ref().is_some_and(|linear| !linear.anchors_gaps())
    }

    /// Acceleration of a gap that was hit alone towards its wall, if flights know it.
    pub(crate) fn pull(&self, hit: GapSet, state: &MechanicalState) -> Option<Pull> {
        self.linear.as_ref()?.pull(hit, state)
    }

    /// Whether flights are those of a linear system.
    pub(crate) fn is_linear(&self) -> bool {
        self.linear.is_some()
    }

    /// The flights of a linear system, if integrated as linear.
    pub(crate) fn linear(&mut self) -> Option<&mut LinearFlight> {
        self.linear.as_deref_mut()
    }

    /// One step of a linear system, or the part of it up to an event: what comes next.
    fn fly_linear<E, D: Dynamics<E>>(
        &mut self,
        t_end: f64,
        state: &mut MechanicalState,
        obstacle: Option<Deviation>,
        model: &mut Model<'_, D>,
    ) -> Result<Option<Next>, Failure<E>> {
        let Self { linear: Some(linear), steps, length, drawn_from, .. } = self else {
            return Ok(None);
        };
        let max_step = steps.limits().max_step;
        let longest = obstacle.map_or(max_step, |it| it.longest_step(state.now().t).min(max_step));
        let bounds = Bounds { t_end, longest, dense_from: *drawn_from };
        steps.spend()?;
        let (next, flown) = match linear.fly(&bounds, state, model) {
            // from here on by steps, which know what to do where forces are not determined
            Err(Failure::Status(Status::RedundantContacts)) => {
                (self.linear, self.flights) = (None, Flights::RungeKutta);
                state.prepare(model)?;
                return Ok(None);
            }
            flown => flown?,
        };
        steps.accept();
        *length = flown;
        Ok(Some(next))
    }

    /// Its length, or that of the part of it up to an event.
    pub(crate) fn length(&self) -> f64 {
        self.length
    }

    /// From here on the forces are others.
    pub(crate) fn restart(&mut self) {
        self.probes = ContactProbes::default();
        self.pulses.restart();
    }

    /// From here on flights of a run of this length (s) are probed for pulses.
    pub(crate) fn probe_flights(&mut self, span: f64) {
        self.pulses = PulseProbes::of(span);
    }

    /// Other compliant gaps are pressed from here on: steps are as long as the last time, or estimated.
    pub(crate) fn press(&mut self, before: GapSet, now: GapSet) {
        if before == now {
            return;
        }
        if let Some(length) = self.steps.next() {
            self.lengths.retain(|it| it.0 != before);
            self.lengths.insert(0, (before, length));
            self.lengths.truncate(MOST_LENGTHS);
        }
        let known = self.lengths.iter().find(|it| it.0 == now);
        self.steps.set_next(known.map(|it| it.1));
        self.experience = StepHistory::NONE;
    }

    /// After an event nothing speaks for long steps.
    pub(crate) fn forget_experience(&mut self) {
        self.experience = StepHistory::NONE;
    }

    /// Goes back to before the last step, which is given up for one of length `h`.
    pub(crate) fn go_back(&mut self, before: &Self, h: f64) {
        let rejected = self.steps.counts().1 + 1;
        self.clone_from(before);
        self.steps.retry(h, rejected);
    }

    /// Contact forces, and those of friction, at a time and a state that is on the contacts of a mode.
    pub(crate) fn contact_forces<E, D: Dynamics<E>>(
        &mut self,
        (t, x, v): (f64, &[f64], &[f64]),
        mode: ContactMode,
        model: &mut Model<'_, D>,
    ) -> Result<&[f64], Failure<E>> {
        if mode.closed.is_empty() && mode.is_plain() && self.aside.equalities().is_none() {
            self.aside.lambda.fill(0.0);
        } else {
            let n = self.aside.coordinates();
            self.aside.carry(mode.pressed);
            self.aside.evaluate(model, t, &x[..n], &v[..n])?;
            self.aside.turn(&v[n..]);
            self.aside.contact(mode)?;
            self.aside.share_least(mode);
        }
        Ok(self.aside.forces())
    }

    /// Opens the contacts that open where a limit of the mode is reached, in a step of length `h`, after
    /// a number of events at this instant: these.
    pub(crate) fn open<E, D: Dynamics<E>>(
        &mut self,
        (limit, h): (Limit, f64),
        events: u32,
        state: &mut MechanicalState,
        model: &mut Model<'_, D>,
    ) -> Result<GapSet, Failure<E>> {
        let left = lift_off::open((limit, h), events > OFTEN, state, &mut self.aside, model)?;
        if !matches!(limit, Limit::Law(_)) {
            self.steps.set_next(Some(PART * h));
        }
        Ok(left)
    }

    /// One step, or the part of it up to an event: what comes next.
    pub(crate) fn fly<E, D: Dynamics<E>>(
        &mut self,
        t_end: f64,
        state: &mut MechanicalState,
        obstacle: Option<Deviation>,
        model: &mut Model<'_, D>,
    ) -> Result<Next, Failure<E>> {
        if let Some(next) = self.fly_linear(t_end, state, obstacle, model)? {
            return Ok(next);
        }
        let mut plan = self.plan(t_end, state, obstacle, model)?;
        // below it rounding of the time is, at t = 0 that of a time of rest
        let rest = if state.mode() == ContactMode::default() { 0.0 } else { self.probes.horizon() };
        let shortest = (8.0 * f64::EPSILON * state.now().t.abs()).max(f64::EPSILON * rest);
        if !state.kinetics().has_cones() {
            return Flying { motion: self, state, model, t_end }.fly(plan, shortest);
        }
        self.at_end.ranges.begin(state.levels());
        let slides = self.slides(&mut plan, state);
        let mut flying = Flying { motion: self, state, model, t_end };
        match slides {
            Slides::Turning => flying.fly(plan, shortest),
            Slides::Stiff => flying.collocate(plan, shortest),
            Slides::Stopping(channels) => {
                flying.freeze(channels);
                let flown = flying.fly(plan, shortest);
                flying.freeze(GapSet::EMPTY);
                flown
            }
        }
    }

    fn plan<E, D: Dynamics<E>>(
        &mut self,
        t_end: f64,
        state: &MechanicalState,
        obstacle: Option<Deviation>,
        model: &mut Model<'_, D>,
    ) -> Result<Plan, Failure<E>> {
        let (Layout { n, m, .. }, mode, now) = (state.layout(), state.mode(), state.now());
        let longest = obstacle.map_or(f64::INFINITY, |obstacle| obstacle.longest_step(now.t));
        let mut equation = InContact { mode, kinetics: &mut self.aside, model, at_end: None };
        let from = (now, state.slope());
        let mut plan = self.steps.plan(from, n..n + m, longest, t_end, &mut equation)?;
        let end = self.pulses.end(now.t, self.probes.end(mode, now.t, t_end));
        if end < t_end {
            plan.h = plan.h.min(end - now.t);
        }
        // a step that must end while compliant gaps that have opened still rise
        for gap in mode.unloaded.iter() {
            let (rate, slope) = (now.xdot[n + gap], state.slope()[n + gap]);
            if slope < 0.0 && rate > 0.0 {
                plan.h = plan.h.min(RISE * rate / -slope);
            }
        }
        Ok(plan)
    }
}

/// Event that ends a step early.
#[derive(Clone, Copy)]
enum Event {
    /// A gap closes.
    Closing(usize),
    /// A limit of the mode is reached, of this number.
    Release(usize),
    /// The slip in a channel ends.
    Stop(usize),
    /// The law of a compliant gap changes its sign.
    Law(usize),
}

/// The step in progress.
struct Flying<'r, 'm, D> {
    motion: &'r mut SmoothMotion,
    state: &'r mut MechanicalState,
    model: &'r mut Model<'m, D>,
    t_end: f64,
}

impl<E, D: Dynamics<E>> SteppedFlight<Vec<f64>, E> for Flying<'_, '_, D> {
    type Event = Event;
    type Piece = Next;

    fn steps(&mut self) -> &mut Steps<Vec<f64>> {
        &mut self.motion.steps
    }

    fn parts(
        &mut self,
    ) -> (&mut Steps<Vec<f64>>, Start<'_, Vec<f64>>, impl Equation<Vec<f64>, Failure<E>>) {
        let SmoothMotion { steps, at_end, .. } = &mut *self.motion;
        let (now, slope, equation) = self.state.equation(self.model, at_end);
        (steps, (now, slope), equation)
    }

    fn is_curable(why: Status) -> bool {
        why != Status::RedundantContacts
    }

    fn is_curable_at_event(why: Status) -> bool {
        why == Status::StepSizeTooSmall
    }

    fn search(&mut self, growth: f64) -> Result<StepDecision<Event>, Failure<E>> {
        let (n, end) = (self.state.layout().n, &self.motion.last().end);
        if !self.state.left().iter().all(|i| end.x[n + i] > 0.0 && end.xdot[n + i] > 0.0) {
            return Ok(StepDecision::TOO_LONG);
        }
        if !self.released_channels_slip()? {
            return Ok(StepDecision::TOO_LONG);
        }
        if !self.frozen_slip_stops()? {
            return Ok(StepDecision::Shorten(UNFROZEN, Status::StepSizeTooSmall));
        }
        let contact = self.first_contact()?;
        if let Some(factor) = self.missed_events(contact.map(|(_, gap)| gap))? {
            return Ok(StepDecision::Shorten(factor, Status::StepSizeTooSmall));
        }
        if let Some(length) = self.missed_pulse(contact.map_or(1.0, |it| it.0))? {
            let factor = length / self.motion.last().h;
            return Ok(StepDecision::Shorten(factor, Status::StepSizeTooSmall));
        }
        let mut first = contact.map(|(theta, gap)| (theta, Event::Closing(gap)));
        if let Some((theta, channel)) = self.first_stop()? {
            if first.is_none_or(|(before, _)| theta < before) {
                first = Some((theta, Event::Stop(channel)));
            }
        }
        let ContactMode { pressed, unloaded, .. } = self.state.mode();
        for gap in pressed.with(unloaded).iter() {
            let theta = match self.first_turn(gap)? {
                Release::None => continue,
                Release::At(theta, _) => theta,
                _ => return Ok(StepDecision::Shorten(0.5, Status::StepSizeTooSmall)),
            };
            if first.is_none_or(|(before, _)| theta < before) {
                first = Some((theta, Event::Law(gap)));
            }
        }
        let release = match self.first_release(first.map_or(1.0, |(theta, _)| theta))? {
            Release::None => None,
            Release::At(theta, number) => Some((theta, number)),
            Release::Unclear => return Ok(StepDecision::Shorten(0.5, Status::ContactNotSolved)),
            Release::Varies(length) => {
                let factor = length / self.motion.last().h;
                return Ok(StepDecision::Shorten(factor, Status::StepSizeTooSmall));
            }
        };
        if self.motion.last().end.t > self.motion.steps.dense_from() {
            self.complete()?;
        }
        Ok(match (first, release) {
            (Some((theta, event)), other) if other.is_none_or(|(lift, _)| theta <= lift) => {
                StepDecision::Stop(theta, event)
            }
            (_, Some((theta, number))) => StepDecision::Stop(theta, Event::Release(number)),
            _ => StepDecision::Take(growth),
        })
    }

    fn stop(&mut self, length: f64, event: Event) -> Result<Option<Next>, Failure<E>> {
        match event {
            Event::Closing(gap) => self.land(length, gap),
            Event::Release(number) => self.lift(length, number).map(Some),
            Event::Stop(channel) => self.stop_slip(length, channel).map(Some),
            Event::Law(gap) => self.turn(length, gap).map(Some),
        }
    }

    fn take(&mut self) -> Result<Next, Failure<E>> {
        let drift = self.drift()?;
        let SmoothMotion { steps, at_end, length, experience, .. } = &mut *self.motion;
        steps.accept();
        *length = steps.last().h;
        experience.gain(*length);
        let end = steps.reaches(self.t_end).then_some(self.t_end);
        self.state.take((steps.last(), at_end), (end, &drift), self.model)?;
        Ok(Next::Step)
    }
}

impl<'m, D> Flying<'_, 'm, D> {
    /// The last step, which is complete, between its stages.
    fn along(&mut self) -> AlongStep<'_, 'm, D> {
        let SmoothMotion { steps, aside, .. } = &mut *self.motion;
        AlongStep {
            step: steps.last(),
            mode: self.state.mode(),
            turns: false,
            tolerances: &steps.limits().tolerances,
            aside,
            model: self.model,
        }
    }

    /// The first gap that closes in the step, and after which part of it.
    fn first_contact<E>(&mut self) -> Result<Option<(f64, usize)>, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let (n, left) = (self.state.layout().n, self.state.left());
        let mut first: Option<(f64, usize)> = None;
        for i in self.state.open_gaps().chain(self.state.compliant().iter()) {
            let root = match (left.has(i), self.state.is_deep(i)) {
                (true, _) => None,
                (_, false) => self.first_root(n + i)?,
                (_, true) if self.state.mode().pressed.has(i) => self.first_rise(n + i)?,
                // it has no force on either side of zero
                (_, true) => None,
            };
            if let Some(theta) = root {
                if first.is_none_or(|(before, _)| theta < before) {
                    first = Some((theta, i));
                }
            }
        }
        Ok(first)
    }

    /// The first limit of the mode that is reached in the step, of which the part up to `end` counts.
    fn first_release<E>(&mut self, end: f64) -> Result<Release, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let mode = self.state.mode();
        if mode.closed.is_empty() && mode.stick.is_empty() {
            return Ok(Release::None);
        }
        if self.motion.steps.is_jump() {
            // across a jump of the forces no polynomial fits
            self.finish()?;
            let released = self.motion.at_end.levels.iter().position(|&level| level < 0.0);
            return Ok(released.map_or(Release::None, |number| Release::At(1.0, number)));
        }
        let mut probes = self.motion.probes;
        let adaptive = self.motion.steps.limits().adaptive;
        if self.state.kinetics().has_cones() {
            self.finish()?;
            let last = self.motion.last();
            let is_probed = adaptive
                && !self.model.dynamics.is_steady()
                && probes.want(last.from.t, end * last.h, last.h);
            let is_close = last.pair.b.len() > SPARSE;
            let sure = self.motion.at_end.ranges.surely_positive();
            if let Some(turns) = sure.filter(|_| is_close && !is_probed) {
                self.motion.turns = turns;
                return Ok(Release::None);
            }
        }
        self.complete()?;
        let looking = adaptive.then_some(&mut probes);
        let mut along = self.along();
        let release = lift_off::first_release(&mut along, end, looking);
        self.motion.turns = along.turns;
        self.motion.probes = probes;
        release
    }

    /// Steps once more, onto the impact near `now + length`; none if that step passes the gap
    /// closely.
    fn land<E>(&mut self, length: f64, gap: usize) -> Result<Option<Next>, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let side = if self.state.is_deep(gap) { -1.0 } else { 1.0 };
        let root = self.step_onto(self.state.layout().n + gap, length, side)?;
        let h = self.motion.last().h;
        let delta = match root {
            None => return Ok(None),
            Some(StepRoot::Near { delta, .. }) => delta,
            Some(StepRoot::Within(theta)) => theta * h - h,
        };
        let judged = self.motion.steps.limits().adaptive && !self.motion.steps.is_jump();
        if judged && self.misfit() > 1.0 {
            return Err(Failure::Status(Status::StepSizeTooSmall));
        }
        let total = (h + delta).max(0.0);
        self.arrive(total, delta)?;
        Ok(Some(Next::LocatedEvent(self.hit_together(gap, total))))
    }

    /// Steps to where a limit of the mode is reached, near `now + length`.
    fn lift<E>(&mut self, length: f64, number: usize) -> Result<Next, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let whole = self.motion.last().h;
        let limit = {
            let mode = self.state.mode();
            let (kinetics, _) = self.state.parts();
            kinetics.limits(mode).get(number).map_or(Limit::Margin, |level| level.limit)
        };
        // from beyond a kink of the margin secants take longer
        let most = if limit == Limit::Margin { 3 * ITERATIONS } else { ITERATIONS };
        let mut one = (0.0, self.state.levels().get(number).copied().unwrap_or(0.0));
        let mut x = length;
        for iteration in 0..most {
            self.attempt(x)?;
            self.finish()?;
            let force = self.motion.at_end.levels.get(number).copied().unwrap_or(0.0);
            let slope = (force - one.1) / (x - one.0);
            let next = x - force / slope;
            one = (x, force);
            let rounding = 4.0 * f64::EPSILON * (self.state.now().t.abs() + x);
            let done = (next - x).abs() <= rounding;
            if done || !next.is_finite() || iteration + 1 == most {
                break;
            }
            x = next.clamp(0.0, whole);
        }
        self.arrive(x, 0.0)?;
        Ok(Next::Release { limit, h: whole })
    }

    /// To an event at the time `total` after the start of the last step, `delta` after its end.
    fn arrive<E>(&mut self, total: f64, delta: f64) -> Result<(), Failure<E>>
    where
        D: Dynamics<E>,
    {
        if self.state.now().t + total > self.motion.steps.dense_from() {
            self.complete()?;
        }
        let drift = self.drift()?;
        let motion = &mut *self.motion;
        motion.steps.accept();
        motion.experience = StepHistory::NONE;
        motion.length = total;
        self.state.move_along(motion.last(), (total, delta), self.t_end);
        self.state.undo_drift(&drift, self.model)?;
        self.state.hold_here(self.model)
    }

    /// The gap and those that close at the same time, to rounding of the flight's length.
    fn hit_together(&self, gap: usize, flight: f64) -> GapSet {
        let near = TOGETHER * flight + ULPS * self.state.now().t.abs();
        let is_hit = |i: usize| {
            let (x, v) = self.state.gap(i);
            v < 0.0 && x <= -v * near
        };
        let soft = self.state.compliant().iter().filter(|&i| !self.state.is_deep(i));
        let closing = self.state.open_gaps().chain(soft).filter(|&i| is_hit(i));
        closing.chain([gap]).collect()
    }
}

// Where the law of a compliant gap changes its sign: `a + b g + c g'` does, or the function itself.

/// Steps onto such a place, and how near to it the last one ends, relative to its length.
const TURNS: usize = 6;
const NEAR_TURN: f64 = 1e-3;

impl<D> Flying<'_, '_, D> {
    /// Where the law of a compliant gap that is below zero changes its sign in the step.
    fn first_turn<E>(&mut self, gap: usize) -> Result<Release, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let law = self.state.kinetics().law(gap).unwrap_or(ContactForce::Function);
        let sign = if self.state.mode().pressed.has(gap) { 1.0 } else { -1.0 };
        if law.sign().is_none() && law != ContactForce::Function {
            return Ok(Release::None);
        }
        let c = self.state.layout().n + gap;
        let signed = law.sign().map(|of| of.map(|it| sign * it));
        let turned = self.state.turned().has(gap);
        if !turned && signed.is_some_and(|of| self.motion.last().is_surely_positive(c, of)) {
            return Ok(Release::None);
        }
        self.complete()?;
        let [x, v] = self.motion.last().polynomials_of(c);
        let after_opening = |turn: Release| match turn {
            // a step that ends before it finds the gap open
            Release::At(theta, _) if sign < 0.0 && x.at(theta) > 0.0 => Release::Unclear,
            turn => turn,
        };
        if let Some([of_1, of_x, of_v]) = signed {
            let force = x.times(of_x).sum(&v.times(of_v)).plus(of_1);
            let root = match turned {
                true => force.starting_at(0.0).without_root_at_zero().first_negative(),
                false => force.first_negative(),
            };
            return Ok(after_opening(root.map_or(Release::None, |theta| Release::At(theta, gap))));
        }
        let turn = lift_off::first_turn(turned, |theta| {
            let force = self.model.contact_force(gap, -x.at(theta), -v.at(theta))?;
            Ok(sign * force)
        })?;
        Ok(after_opening(turn))
    }

    /// Steps to where the law of a compliant gap changes its sign, near `now + length`.
    fn turn<E>(&mut self, length: f64, gap: usize) -> Result<Next, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let (whole, c) = (self.motion.last().h, self.state.layout().n + gap);
        let law = self.state.kinetics().law(gap).unwrap_or(ContactForce::Function);
        let (mut h, mut delta) = (length, 0.0);
        for _ in 0..TURNS {
            self.attempt(h)?;
            self.finish()?;
            let last = self.motion.last();
            let (x, v, a) = (last.end.x[c], last.end.xdot[c], last.end_slope(c));
            let (force, slope) = match law.sign() {
                Some([of_1, of_x, of_v]) => (of_1 + of_x * x + of_v * v, of_x * v + of_v * a),
                None => {
                    // by a difference along the motion
                    let dt = (1e-6 * h).max(f64::MIN_POSITIVE);
                    let mut at = |t: f64| {
                        let (x, v) = (x + t * (v + 0.5 * t * a), v + t * a);
                        self.model.contact_force(gap, -x, -v)
                    };
                    let (before, here, after) = (at(-dt)?, at(0.0)?, at(dt)?);
                    (here, 0.5 * (after - before) / dt)
                }
            };
            delta = -force / slope;
            if !delta.is_finite() || (h + delta - length).abs() > 0.5 * whole {
                delta = 0.0;
                break;
            }
            if delta.abs() <= NEAR_TURN * h {
                break;
            }
            (h, delta) = (h + delta, 0.0);
        }
        let last = self.motion.last().h;
        self.arrive((last + delta).max(0.0), delta)?;
        Ok(Next::Release { limit: Limit::Law(gap), h: whole })
    }
}

// Features of the forces or of the surfaces that lie between the stages of a step.

/// Defect of the polynomials, relative to that of a missed feature, that shows a pulse.
const PULSE: f64 = 100.0;

impl<D> Flying<'_, '_, D> {
    /// Whether the step overlooks an event between its stages, and the factor by which it
    /// is to be shortened then; `contact` tells the gap that closes in it. The gaps that are
    /// integrated must be those of their functions at its end, and if a step may be a whole flight,
    /// the equation of motion must hold at the apex.
    fn missed_events<E>(&mut self, contact: Option<usize>) -> Result<Option<f64>, Failure<E>>
    where
        D: Dynamics<E>,
    {
        if !self.motion.steps.limits().adaptive || self.motion.steps.is_jump() {
            return Ok(None);
        }
        let mut excess = 0.0;
        if contact.is_none() {
            self.finish()?;
            excess = self.misfit();
        }
        if excess <= 1.0 && !self.motion.experience.is_enough(self.motion.last().h) {
            let (n, end) = (self.state.layout().n, &self.motion.last().end);
            let falls = |i: usize| contact == Some(i) || end.xdot[n + i] < 0.0;
            let turns = |&i: &usize| self.state.gap(i).1 > 0.0 && falls(i);
            let turning: Vec<usize> = self.state.open_gaps().filter(turns).collect();
            if !turning.is_empty() {
                excess = worse(excess, self.defect_at_apexes(&turning)?);
            }
        }
        if excess <= 1.0 {
            return Ok(None);
        }
        // the shorter step is looked at again
        self.motion.experience = StepHistory::NONE;
        let factor = factor(excess, self.motion.last().order_of_error());
        Ok(Some(factor.max(FACTORS.0)))
    }

    /// The length of a step that ends before a pulse of the force between the stages of a long one, of
    /// which a part counts.
    fn missed_pulse<E>(&mut self, part: f64) -> Result<Option<f64>, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let limits = self.motion.steps.limits();
        let (t, h) = (self.motion.last().from.t, self.motion.last().h);
        let wanted = limits.adaptive && limits.max_step == f64::INFINITY;
        if !self.motion.pulses.is_long(h)
            || !wanted
            || self.motion.steps.is_jump()
            || self.model.dynamics.is_steady()
            || self.model.dynamics.is_autonomous()
        {
            return Ok(None);
        }
        if self.state.kinetics().has_cones() {
            self.complete()?;
        }
        // aside: the step itself is completed if somebody asks for that
        let (mut step, mode) = (self.motion.last().clone(), self.state.mode());
        let kinetics = &mut self.motion.aside;
        step.complete(&mut InContact { mode, kinetics, model: self.model, at_end: None })?;
        let mut pulses = self.motion.pulses;
        let mut along = AlongStep { step: &step, ..self.along() };
        let rows = along.rows(along.aside.coordinates());
        let nodes = step.pair.c;
        let found =
            pulses.deviation((t, part * h), (h, nodes), |at| match along.defect(&rows, at / h) {
                Err(Failure::Status(_)) => Ok(false),
                defect => Ok(defect? <= PULSE),
            });
        self.motion.pulses = pulses;
        found
    }

    /// Distance of the gaps at the end of the finished step from their functions, relative to the
    /// tolerance.
    fn misfit(&self) -> f64 {
        let Layout { n, m, .. } = self.state.layout();
        let SmoothMotion { steps, at_end, .. } = &*self.motion;
        let (step, tolerances) = (steps.last(), &steps.limits().tolerances);
        let of = |c: usize| step.scales(c, tolerances)[0];
        let largest = (0..n).map(of).fold(0.0_f64, f64::max);
        let each = (0..m).map(|i| {
            let far = (at_end.gap[i] - step.end.x[n + i]).abs();
            far / (DEFECT * (of(n + i) + at_end.steepness[i] * largest))
        });
        each.fold(0.0, worse)
    }

    /// How far the polynomials of the step are from the equation of motion where gaps are largest.
    fn defect_at_apexes<E>(&mut self, gaps: &[usize]) -> Result<f64, Failure<E>>
    where
        D: Dynamics<E>,
    {
        self.complete()?;
        let Layout { n, m, .. } = self.state.layout();
        let mut along = self.along();
        let rows = along.rows(n + m);
        let (mut excess, mut apexes) = (0.0, Vec::new());
        for gap in gaps {
            let theta = rows[n + gap][1].first_negative().unwrap_or(0.5);
            // gaps over one body are largest together
            if !apexes.contains(&theta) {
                excess = worse(excess, along.defect(&rows, theta)?);
                apexes.push(theta);
            }
        }
        Ok(excess)
    }
}

// Where the slip in a channel of friction ends.

/// Iterations for the time at which a slip ends.
const STOPS: usize = 6;
const TOGETHER_SLIPS: f64 = 1e-11;
/// Feet of one body stop together if the slip speeds of the others are below this multiple of `kept`: a tenth of the
/// tolerance.
const TOGETHER_FEET: f64 = 10.0;

/// Gauss's nodes and weights of order 20 on `(0, 1)`: half of them, the others are their mirror images.
const GAUSS: [(f64, f64); 5] = [
    (0.013_046_735_741_414_139, 0.033_335_672_154_344_07),
    (0.067_468_316_655_507_74, 0.074_725_674_575_290_3),
    (0.160_295_215_850_487_8, 0.109_543_181_257_991_02),
    (0.283_302_302_935_376_4, 0.134_633_359_654_998_18),
    (0.425_562_830_509_184_4, 0.147_762_112_357_376_43),
];

impl<D> Flying<'_, '_, D> {
    /// How far the polynomials of the last step move along the directions in which it sticks, by
    /// channel: `int B q' + beta dt`, which should be nothing. Empty for steps of zero length, and
    /// for constant gradients with walls at rest, whose accelerations keep the step on the
    /// manifold.
    fn drift<E>(&mut self) -> Result<Vec<f64>, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let stick = self.state.mode().stick;
        if stick.is_empty() || !self.motion.turns || self.motion.last().h == 0.0 {
            return Ok(Vec::new());
        }
        self.complete()?;
        let p = self.state.layout().p;
        let mut along = self.along();
        let rows = along.rows(along.aside.coordinates());
        let mut drift = vec![0.0; p];
        for (node, weight) in GAUSS.into_iter().flat_map(|(x, w)| [(x, w), (1.0 - x, w)]) {
            along.evaluate(&rows, node)?;
            let h = along.step.h;
            let rates: Vec<f64> = rows.iter().map(|[x, _]| x.slope(node) / h).collect();
            for channel in stick.iter() {
                let row = along.aside.row(channel);
                drift[channel] += weight * h * along.aside.rate(row, &rates);
            }
        }
        Ok(drift)
    }

    /// Whether the channels that began to slip at the start of the step do so at its end.
    fn released_channels_slip<E>(&mut self) -> Result<bool, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let (released, mode) = (self.state.released(), self.state.mode());
        // contacts with two directions begin to slip in a step of their own
        let is_alone = |&channel: &usize| self.state.kinetics().other_of(channel).is_none();
        let released: GapSet = released.iter().filter(is_alone).collect();
        if released.is_empty() {
            return Ok(true);
        }
        self.finish()?;
        let (row, last) = (self.state.kinetics().row(0), self.motion.last());
        let first = self.state.layout().n + row;
        Ok(released.iter().all(|channel| {
            let (sign, c) = (mode.sign(channel), first + channel);
            sign * last.end.xdot[c] > 0.0 && sign * last.end_slope(c) > 0.0
        }))
    }

    /// The first channel whose slip ends in the step, and after which part of it.
    fn first_stop<E>(&mut self) -> Result<Option<(f64, usize)>, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let mode = self.state.mode();
        let kinetics = self.state.kinetics();
        let cones: GapSet = kinetics.cones(mode.slipping()).flatten().collect();
        let frozen = kinetics.frozen();
        let still = self.state.released().with(self.state.spent());
        let slipping = mode.slipping().without(still).without(cones);
        if slipping.is_empty() && frozen.is_empty() {
            return Ok(None);
        }
        self.complete()?;
        let first = self.state.layout().n + self.state.kinetics().row(0);
        let root = |channel: usize| {
            let [_, slip] = self.motion.last().polynomials_of(first + channel);
            let slip = if mode.slip_minus.has(channel) { slip.negated() } else { slip };
            slip.first_negative().map(|theta| (theta, channel))
        };
        let kinetics = self.state.kinetics();
        let ends = |pair: [usize; 2]| self.frozen_slip(pair).first_negative();
        let frozen = kinetics.cones(frozen).filter_map(|it| ends(it).map(|theta| (theta, it[0])));
        let roots = slipping.iter().filter_map(root).chain(frozen);
        Ok(roots.min_by(|one, other| one.0.total_cmp(&other.0)))
    }

    /// Steps to where the slip in a channel ends, near `now + length`; that in others ends with it to
    /// rounding.
    fn stop_slip<E>(&mut self, length: f64, channel: usize) -> Result<Next, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let first = self.state.layout().n + self.state.kinetics().row(0);
        let whole = self.motion.last().h;
        let second = self.state.kinetics().other_of(channel);
        let rounding = |x: f64, t: f64| 4.0 * f64::EPSILON * (t.abs() + x);
        let mut x = length;
        for _ in 0..STOPS {
            self.attempt(x)?;
            self.finish()?;
            let [slip, slope] = self.slip_at_end(channel);
            let next = x - slip / slope;
            if !next.is_finite() || next <= 0.0 || next > 2.0 * whole {
                break;
            }
            let moved = (next - x).abs();
            x = next;
            if moved <= rounding(x, self.state.now().t) {
                break;
            }
        }
        let near = TOGETHER_SLIPS * whole + rounding(x, self.state.now().t);
        let (last, mode) = (self.motion.last(), self.state.mode());
        let near_feet = TOGETHER_FEET * self.motion.kept(&last.end.xdot[..self.state.layout().n]);
        let stops = |&other: &usize| {
            let c = first + other;
            match self.state.kinetics().other_of(other) {
                // feet of one body stop together to errors of their slips only
                Some(pair) => {
                    let [one, two] = [c, first + pair].map(|c| last.end.xdot[c]);
                    other == channel || second == Some(other) || one.hypot(two) <= near_feet
                }
                None => {
                    other == channel || last.end.xdot[c].abs() <= last.end_slope(c).abs() * near
                }
            }
        };
        let channels = mode.slipping().iter().filter(stops).collect();
        self.arrive(x, x - self.motion.last().h)?;
        Ok(Next::Stop(channels))
    }
}

#[cfg(test)]
mod slip_tests {
    use crate::mechanics::{simulate_mechanical, MechanicalOutput};
    use crate::record::events::Occurrence;
    use crate::switched::{Order, SwitchedRk};
    use crate::system::dynamics::{Dynamics, Layout};
    use crate::system::force::{Channel, Friction};
    use crate::Silent;
    use std::convert::Infallible;

    /// A mass of 1 with the friction 30, and its acceleration while it slips.
    struct Braked(Friction, fn(f64) -> f64);

    impl Dynamics<Infallible> for Braked {
        fn layout(&self) -> Layout {
            Layout { n: 1, m: 0, p: 1, k: 0 }
        }

        fn friction(&self) -> &Friction {
            &self.0
        }

        fn evaluate(
            &mut self,
            t: f64,
            _: &[f64],
            _: &[f64],
            out: &mut [f64],
        ) -> Result<(), Infallible> {
            out.copy_from_slice(&[1.0, 30.0 + (self.1)(t), 1.0, 0.0, 0.0, 30.0, 30.0]);
            Ok(())
        }
    }

    #[test]
    fn a_stop_is_not_looked_for_far_from_the_step_that_has_it() {
        // 1 m/s, stopped after 0.052 s: by -20 m/s^2, but for 2 ms that no step of 0.1 s looks at.
        // The step onto 0.05 s ends in them, with a slope by which the slip would last to 1.05 s.
        // After 0.15 s the mass is pulled on.
        let acceleration = |t: f64| match t {
            t if (t - 0.05).abs() < 1e-3 => -0.131,
            t if t < 0.15 => -20.0,
            _ => 1.0,
        };
        let settings = SwitchedRk {
            order: Order::Five,
            max_step: 0.1,
            adaptive: false,
            ..SwitchedRk::DEFAULT
        };
        let friction =
            Friction { channels: vec![Channel { gap: None, e_t: 0.0 }], ..Friction::default() };
        let run = simulate_mechanical(
            settings,
            &mut Braked(friction, acceleration),
            &[],
            (0.0, 3.0),
            (&[0.0], &[1.0]),
            MechanicalOutput::default(),
            &mut Silent,
        )
        .unwrap();
        let stops: Vec<f64> = (run.occurrences.iter())
            .filter_map(|it| match *it {
                Occurrence::Transition { t, after: 0, .. } => Some(t),
                _ => None,
            })
            .collect();
        assert!(stops.len() == 1 && (stops[0] - 0.052).abs() < 3e-3, "{stops:?}");
    }
}
