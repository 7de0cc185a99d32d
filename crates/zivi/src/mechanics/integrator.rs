//! The switched method for mechanical systems: its parts, and which of them comes next.
//!
//! The mode is the set of closed gaps: without closed gaps it is free flight, otherwise motion on
//! the manifold of zero gaps. Between events both are one ordinary differential equation.

use std::collections::TryReserveError;

use crate::impact::accumulation::{note_lifted, Accumulation};
use crate::impact::{flag_together, Impacts};
use crate::kinetics::mode::{Key, Limit, Next};
use crate::kinetics::Model;
use crate::motion::path::Piece;
use crate::motion::state::{MechanicalState, Start};
use crate::motion::SmoothMotion;
use crate::numeric::dense::largest;
use crate::record::columns::Reserve;
use crate::record::events::{FlagKind, Occurrence};
use crate::record::gap_set::{ContactMode, GapSet};
use crate::record::recorder::MotionPoint;
use crate::record::status::Failure;
use crate::switched::SwitchedRk;
use crate::system::dynamics::{Dynamics, Layout};
use crate::system::force::Friction;
use crate::zeno::arc::Bounce;
use crate::zeno::chain::Chain;
use crate::{AnyImpactLaw, Counts, Status};

/// The switched method for mechanical systems as an object that advances segment by segment.
#[derive(Clone, Debug)]
pub(crate) struct MechanicalIntegrator {
    settings: SwitchedRk,
    state: MechanicalState,
    impacts: Impacts,
    accumulation: Accumulation,
    motion: SmoothMotion,
    next: Next,
    occurrences: Vec<Occurrence>,
    /// The mode whose forces were last noted as undetermined.
    undetermined: ContactMode,
    /// Whether the multipliers of equality rows were noted as undetermined.
    has_noted_equalities: bool,
    /// Events since the time last advanced by a step.
    stalled: u32,
    /// When what was slow was last brought to rest.
    rested: f64,
    /// When the last pieces began that cover little of the span, and how many there were.
    crawl: (f64, u32),
    /// When the run started; when the last event was, and steps since then.
    started: f64,
    smooth: (f64, u32),
}

/// State changed by a step, stored to reject it.
pub(crate) struct StepBackup {
    state: MechanicalState,
    motion: SmoothMotion,
    next: Next,
    stalled: u32,
}

impl StepBackup {
    /// Where the system was.
    pub(crate) fn state(&self) -> &MechanicalState {
        &self.state
    }
}

/// Events at one instant after which the motion is called unsolved. Each pair of impacts of a light
/// body between heavier ones may leave most of the speed.
const MOST_AT_ONCE: u32 = 20_000;
/// Changes of friction at one instant after which it is called undecided.
const MOST_CHANGES: u32 = 100;
/// Speeds below this part of the tolerance come to rest there.
const RESTS: f64 = 1e-2;
/// Steps without an event after which a motion that has covered less than this part of the span is given up.
const MOST_IDLE: u32 = 1000;
const IDLE: f64 = 1e-9;
/// A rotation so far from the middle of its chart changes it whatever happens.
const FAR: f64 = 2.0;
/// Pieces that cover less than this part of the span, after which speeds below this part of the tolerance come to
/// rest.
const MOST_CRAWLING: u32 = 1000;
const CRAWL: f64 = 1e-8;
const TRICKLE: f64 = 0.1;
/// A slip that ends with so little to spare, relative to the root of the tolerance, may not have.
const GRAZE: f64 = 10.0;
/// Occurrences that a segment of the motion has, at most, by gap.
const OF_A_PIECE: usize = 4;

impl MechanicalIntegrator {
    pub(crate) fn new(
        settings: SwitchedRk,
        layout: Layout,
        laws: &[AnyImpactLaw],
        friction: &Friction,
    ) -> Self {
        Self {
            settings,
            state: MechanicalState::new(layout, friction),
            impacts: Impacts::new(laws, friction, &settings),
            accumulation: Accumulation::new(settings, layout, friction),
            motion: SmoothMotion::new(&settings, layout, friction),
            next: Next::Step,
            occurrences: Vec::new(),
            undetermined: ContactMode::default(),
            has_noted_equalities: false,
            stalled: 0,
            rested: f64::NEG_INFINITY,
            crawl: (f64::NEG_INFINITY, 0),
            started: 0.0,
            smooth: (0.0, 0),
        }
    }

    /// Starts at a state whose gaps are open, or closed to rounding: at gaps with a speed towards
    /// zero the impact comes first. The value of a gap that is not open, if any.
    pub(crate) fn start<E, D: Dynamics<E>>(
        &mut self,
        t: f64,
        at: (&[f64], &[f64]),
        model: &mut Model<'_, D>,
    ) -> Result<Option<f64>, Failure<E>> {
        self.impacts.start(t);
        self.started = t;
        let begun = match self.state.start(t, at, self.settings.rounding(), model) {
            // an impact on no gap: one without a collision
            Err(Failure::Status(Status::InconsistentContact))
                if self.impacts.continues_where_jammed() =>
            {
                self.next = Next::LocatedEvent(GapSet::EMPTY);
                return Ok(None);
            }
            begun => begun?,
        };
        match begun {
            Start::Overlap(gap) => return Ok(Some(gap)),
            Start::At(hit) if !hit.is_empty() => self.next = Next::LocatedEvent(hit),
            // friction of closed gaps and joints begins here
            Start::At(_) => {
                self.state.note_transitions(ContactMode::default(), &mut self.occurrences);
                note_lifted(t, self.state.left(), &mut self.occurrences);
            }
        }
        Ok(None)
    }

    /// The velocities jump: at closed gaps with a speed towards zero the impact comes next.
    pub(crate) fn kick<E, D: Dynamics<E>>(
        &mut self,
        at: (&[f64], &[f64]),
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let (t, before) = (self.state.now().t, self.state.mode());
        if at.1.iter().any(|rate| !rate.is_finite()) {
            return Err(Failure::Status(Status::StateNotFinite));
        }
        self.accumulation.clear();
        let w = self.state.hold_kick(at, model)?;
        match self.state.start(t, (at.0, &w), self.settings.rounding(), model)? {
            Start::Overlap(_) => return Err(Failure::Status(Status::ContactNotSolved)),
            Start::At(hit) if !hit.is_empty() => self.next = Next::LocatedEvent(hit),
            Start::At(_) => {
                self.state.note_transitions(before, &mut self.occurrences);
                note_lifted(t, self.state.left(), &mut self.occurrences);
            }
        }
        let opened = before.closed.without(self.state.closed()).without(self.state.left());
        self.occurrences.extend(opened.iter().map(|gap| Occurrence::Opened { t, gap }));
        Ok(())
    }

    /// One more segment of the motion.
    pub(crate) fn advance<E, D: Dynamics<E>>(
        &mut self,
        t_end: f64,
        model: &mut Model<'_, D>,
    ) -> Result<Piece, Failure<E>> {
        self.stalled += 1;
        if self.stalled > MOST_AT_ONCE {
            return Err(Failure::Status(Status::ContactNotSolved));
        }
        if self.crawls(t_end) && self.rest(TRICKLE, model)? {
            return Ok(Piece::Instant);
        }
        match std::mem::replace(&mut self.next, Next::Step) {
            Next::LocatedEvent(gaps) => {
                let struck = self.strike(gaps, model);
                return self.unjammed(struck, model);
            }
            Next::Release { limit, h } => {
                let opened = self.open(limit, h, model);
                return self.unjammed(opened, model);
            }
            Next::Stop(channels) => {
                let stopped = self.stop_slip(channels, model);
                return self.unjammed(stopped, model);
            }
            Next::Jump(ahead) if ahead.landing.t <= t_end => {
                let (from, at) =
                    (self.motion.requested_from(), (self.impacts.e(), &mut self.state));
                let occurrences = &mut self.occurrences;
                return self.accumulation.jump(ahead, from, at, occurrences, model);
            }
            Next::Jump(_) | Next::Step => (),
        }
        self.accumulation.check_budget()?;
        self.state.open_unloaded();
        let through = self.state.through();
        if !through.is_empty() {
            return self.strike(through, model);
        }
        if self.change_charts(model) {
            return Ok(Piece::Charts);
        }
        let t = self.state.now().t;
        let linear = self.motion.linear_period(model);
        if let Some(period) = linear {
            self.accumulation.set_period(period);
        } else {
            self.state.prepare(model)?;
            self.note_undetermined(t);
        }
        let obstacle = self.accumulation.obstacle();
        let flown = self.motion.fly(t_end, &mut self.state, obstacle, model);
        // a box that rocks from edge to edge comes to rest where its steps do
        let is_too_short = matches!(flown, Err(Failure::Status(Status::StepSizeTooSmall)));
        if is_too_short && self.state.kinetics().has_cones() && self.rest(TRICKLE, model)? {
            return Ok(Piece::Instant);
        }
        self.next = flown?;
        if linear.is_some() && !self.motion.is_linear() {
            self.note_undetermined(t);
        }
        if self.state.now().t > t {
            self.stalled = 0;
        }
        self.check_progress(t, t_end)?;
        Ok(Piece::Motion)
    }

    /// Takes rotations that leave their charts into the others; whether there were such. Impacts that may lead
    /// to an accumulation are in one chart, as long as that is good.
    fn change_charts<E, D: Dynamics<E>>(&mut self, model: &Model<'_, D>) -> bool {
        if self.state.change_charts(FAR, model) {
            self.accumulation.forget_impacts();
            return true;
        }
        self.accumulation.has_no_impacts() && self.state.change_charts(1.0, model)
    }

    /// Whether the last segments of the motion have covered next to nothing of the span.
    fn crawls(&mut self, t_end: f64) -> bool {
        let (now, (from, pieces)) = (self.state.now().t, &mut self.crawl);
        if now - *from > CRAWL * (t_end - self.started) || *pieces > MOST_CRAWLING {
            (*from, *pieces) = (now, 0);
        }
        *pieces += 1;
        *pieces > MOST_CRAWLING && self.next == Next::Step
    }

    /// Brings to rest what is slower than this part of the tolerance, once at an instant.
    fn rest<E, D: Dynamics<E>>(
        &mut self,
        part: f64,
        model: &mut Model<'_, D>,
    ) -> Result<bool, Failure<E>> {
        let speed = largest(&self.state.now().xdot[..self.state.layout().n]);
        self.rest_below(part * self.settings.rtol * (1.0 + speed), model)
    }

    /// The same below a speed.
    fn rest_below<E, D: Dynamics<E>>(
        &mut self,
        slow: f64,
        model: &mut Model<'_, D>,
    ) -> Result<bool, Failure<E>> {
        let Self { state, impacts, accumulation, occurrences, .. } = self;
        let now = state.now().t;
        if self.rested == now {
            return Ok(false);
        }
        self.rested = now;
        let rests = accumulation.rest((slow, impacts.lingering()), state, occurrences, model)?;
        self.motion.forget_experience();
        Ok(rests)
    }

    /// Ends a motion whose steps without an event do not get on.
    fn check_progress<E>(&mut self, t: f64, t_end: f64) -> Result<(), Failure<E>> {
        let (from, steps) = &mut self.smooth;
        if *steps == 0 {
            *from = t;
        }
        *steps = if self.next == Next::Step { *steps + 1 } else { 0 };
        if *steps < MOST_IDLE {
            return Ok(());
        }
        *steps = 0;
        match self.state.now().t - *from < IDLE * (t_end - self.started) {
            true => Err(Failure::Status(Status::NoProgress)),
            false => Ok(()),
        }
    }

    /// Notes where the motion does not determine the forces, or is not determined itself, once in a mode.
    fn note_undetermined(&mut self, t: f64) {
        let mode = self.state.mode();
        if !self.has_noted_equalities && self.state.kinetics().has_dependent_equalities() {
            self.has_noted_equalities = true;
            let (kind, gaps, size) = (FlagKind::UndeterminedForces, GapSet::EMPTY, f64::INFINITY);
            self.occurrences.push(Occurrence::Flag { kind, t, gaps, size });
        }
        if self.state.take_ambiguity() {
            let (kind, gaps, size) = (FlagKind::MotionNotUnique, mode.closed, 0.0);
            self.occurrences.push(Occurrence::Flag { kind, t, gaps, size });
        }
        if mode == self.undetermined {
            return;
        }
        let gaps = mode.closed;
        let forces = self.state.undetermined();
        if let Some(size) = forces {
            let kind = FlagKind::UndeterminedForces;
            self.occurrences.push(Occurrence::Flag { kind, t, gaps, size });
        }
        let moves = self.state.is_shared_motion();
        if moves {
            let (kind, size) = (FlagKind::UndeterminedMotion, 0.0);
            self.occurrences.push(Occurrence::Flag { kind, t, gaps, size });
        }
        if moves || forces.is_some() {
            self.undetermined = mode;
        }
    }

    /// Where no motion obeys the law of friction, an impact without a collision, if requested.
    fn unjammed<E, D: Dynamics<E>>(
        &mut self,
        piece: Result<Piece, Failure<E>>,
        model: &mut Model<'_, D>,
    ) -> Result<Piece, Failure<E>> {
        match piece {
            Err(Failure::Status(Status::InconsistentContact))
                if self.impacts.continues_where_jammed() =>
            {
                self.strike(GapSet::EMPTY, model)
            }
            piece => piece,
        }
    }

    /// The impact on some gaps here and its consequences.
    fn strike<E, D: Dynamics<E>>(
        &mut self,
        hit: GapSet,
        model: &mut Model<'_, D>,
    ) -> Result<Piece, Failure<E>> {
        let soft = hit.iter().filter(|&gap| self.state.compliant().has(gap)).collect();
        let hit = hit.without(soft);
        if !soft.is_empty() {
            self.cross(soft, model)?;
            if hit.is_empty() {
                return Ok(Piece::Instant);
            }
        }
        let struck = self.impacts.solve(hit, &mut self.state, &mut self.occurrences, model);
        let struck = match struck {
            Err(Failure::Status(Status::InconsistentImpact)) if self.stops(hit, model)? => {
                return Ok(Piece::Instant);
            }
            struck => struck?,
        };
        let Self { state, impacts, accumulation, .. } = self;
        self.motion.forget_experience();
        let pull = self.motion.pull(hit, state);
        let ahead = accumulation.note((&struck, pull), (impacts.e(), state), model)?;
        self.next = Next::jump(ahead);
        Ok(Piece::Instant)
    }

    /// Brings to rest what is slower than the absolute tolerance: whether all of `hit` is closed then.
    fn stops<E, D: Dynamics<E>>(
        &mut self,
        hit: GapSet,
        model: &mut Model<'_, D>,
    ) -> Result<bool, Failure<E>> {
        let rests = self.rest_below(self.settings.atol[1], model)?;
        Ok(rests && hit.without(self.state.closed()).is_empty())
    }

    /// Compliant gaps come into contact, or leave it.
    fn cross<E, D: Dynamics<E>>(
        &mut self,
        gaps: GapSet,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let Self { state, occurrences, .. } = self;
        let (t, mode) = (state.now().t, state.mode());
        state.cross(gaps, model)?;
        for gap in gaps.iter() {
            match (mode.pressed.has(gap), state.mode().pressed.has(gap)) {
                (true, _) => occurrences.push(Occurrence::LiftOff { t, gap }),
                (_, true) => occurrences.push(Occurrence::Contact { t, gap }),
                _ => (),
            }
        }
        state.note_transitions(mode, occurrences);
        note_lifted(t, state.left(), occurrences);
        self.motion.press(mode.pressed, state.mode().pressed);
        self.accumulation.clear();
        Ok(())
    }

    /// The slip in some channels ends: they stick, or slip the other way.
    fn stop_slip<E, D: Dynamics<E>>(
        &mut self,
        channels: GapSet,
        model: &mut Model<'_, D>,
    ) -> Result<Piece, Failure<E>> {
        if self.stalled > MOST_CHANGES {
            return match self.rest(RESTS, model)? {
                true => Ok(Piece::Instant),
                false => Err(Failure::Status(Status::ModeChatter)),
            };
        }
        let Self { state, occurrences, .. } = self;
        let (mode, closed) = (state.mode(), state.closed());
        let others = mode.slipping().without(state.released()).without(channels);
        state.stop_slip(channels);
        let stopped: GapSet =
            channels.iter().map(|channel| state.kinetics().row(channel)).collect();
        state.project(state.kinetics().rows_of(mode).with(stopped), model)?;
        let held = state.held(others);
        state.stop_slip(held);
        let channels = channels.with(held);
        state.settle(closed)?;
        state.refresh()?;
        state.note_transitions(mode, occurrences);
        note_lifted(state.now().t, state.left(), occurrences);
        let stuck: GapSet = channels.iter().filter(|&c| state.mode().stick.has(c)).collect();
        // speeds of the size of errors hold about the root of them
        let graze = GRAZE * self.settings.rtol.sqrt();
        if let Some(size) = state.least_hold(stuck).filter(|&size| size < graze) {
            let (kind, t, gaps) = (FlagKind::SlipGraze, state.now().t, state.closed());
            occurrences.push(Occurrence::Flag { kind, t, gaps, size });
        }
        self.motion.forget_experience();
        self.accumulation.note_transition();
        Ok(Piece::Instant)
    }

    /// The contacts that open, or slip, where a limit of the mode is reached, in a step of length `h`.
    fn open<E, D: Dynamics<E>>(
        &mut self,
        limit: Limit,
        h: f64,
        model: &mut Model<'_, D>,
    ) -> Result<Piece, Failure<E>> {
        let Self { state, occurrences, .. } = self;
        let mode = state.mode();
        let left = self.motion.open((limit, h), self.stalled, state, model)?;
        if let Limit::Law(gap) = limit {
            self.motion.press(mode.pressed, state.mode().pressed);
            let t = state.now().t;
            occurrences.push(match mode.pressed.has(gap) {
                true => Occurrence::LiftOff { t, gap },
                false => Occurrence::Contact { t, gap },
            });
        }
        state.note_transitions(mode, occurrences);
        note_lifted(state.now().t, left, occurrences);
        flag_together(left, state, occurrences);
        match left.is_empty() && mode.stick != self.state.mode().stick {
            true => self.accumulation.note_transition(),
            false => self.accumulation.clear(),
        }
        self.state.refresh()?;
        Ok(Piece::Instant)
    }

    /// Forgets what was learnt from the forces: from here on they are others.
    pub(crate) fn restart(&mut self) {
        self.cancel_jump();
        self.state.forget_forces();
        self.accumulation.restart();
        self.motion.restart();
    }

    /// Flights of a run of this length (s) are probed for pulses of the forces.
    pub(crate) fn probe_flights(&mut self, span: f64) {
        self.motion.probe_flights(span);
    }

    /// Cancels the extrapolation: the accumulation is not known accurately enough.
    pub(crate) fn cancel_jump(&mut self) {
        if let Next::Jump(_) = self.next {
            self.next = Next::Step;
        }
    }

    /// Whether something happens before the time moves on past `t_end`.
    pub(crate) fn is_pending(&self, t_end: f64) -> bool {
        self.next.is_due(t_end)
    }

    /// State changed by a step.
    pub(crate) fn save(&self) -> StepBackup {
        let Self { state, motion, next, stalled, .. } = self;
        let (state, motion, next) = (state.clone(), motion.clone(), next.clone());
        StepBackup { state, motion, next, stalled: *stalled }
    }

    /// Gives up the last step: back to where the machine was before it, for one of length `h`.
    pub(crate) fn give_up_step(&mut self, before: &StepBackup, h: f64) {
        self.state.clone_from(&before.state);
        self.motion.go_back(&before.motion, h);
        self.next.clone_from(&before.next);
        self.stalled = before.stalled;
    }

    pub(crate) fn settings(&self) -> &SwitchedRk {
        &self.settings
    }

    /// State of the system with its forces.
    pub(crate) fn state(&self) -> &MechanicalState {
        &self.state
    }

    /// The same, to have the forces there computed, or impulses.
    pub(crate) fn state_mut(&mut self) -> &mut MechanicalState {
        &mut self.state
    }

    /// Next operation.
    pub(crate) fn next(&self) -> &Next {
        &self.next
    }

    /// The motion between events.
    pub(crate) fn motion(&self) -> &SmoothMotion {
        &self.motion
    }

    /// The same, mutable, for step limits and inspection.
    pub(crate) fn motion_mut(&mut self) -> &mut SmoothMotion {
        &mut self.motion
    }

    /// The impact law of a gap.
    pub(crate) fn law(&self, gap: usize) -> &AnyImpactLaw {
        self.impacts.law(gap)
    }

    /// The last impacts of one kind.
    pub(crate) fn chain(&self) -> &Chain<Vec<f64>, Key> {
        self.accumulation.chain()
    }

    /// The tolerances of the Zeno time of the impact sequence and of the state there.
    pub(crate) fn scales(&self, last: Bounce) -> Vec<f64> {
        self.accumulation.scales(&self.state, last)
    }

    /// Contact forces at a time and a point of the motion, whose closed gaps are set to zero.
    pub(crate) fn contact_forces<E, D: Dynamics<E>>(
        &mut self,
        t: f64,
        MotionPoint { x, v, mode }: &mut MotionPoint,
        model: &mut Model<'_, D>,
    ) -> Result<&[f64], Failure<E>> {
        let Layout { n, m, .. } = self.state.layout();
        for gap in mode.closed.iter() {
            (x[n + gap], v[n + gap]) = (0.0, 0.0);
        }
        mode.stick.iter().for_each(|channel| v[n + m + channel] = 0.0);
        self.motion.contact_forces((t, x, v), *mode, model)
    }

    /// Counters of the work without evaluations.
    pub(crate) fn counts(&self) -> Counts {
        let ((accepted, rejected), impacts) = (self.motion.steps().counts(), self.impacts.count());
        Counts { nfev: 0, accepted, rejected, impacts }
    }

    /// Makes room for the next segment of the motion.
    pub(crate) fn make_room(&mut self, reserve: &mut Reserve) -> Result<(), TryReserveError> {
        let most = OF_A_PIECE * (self.state.layout().m + 1);
        reserve.room(&mut self.occurrences, most, 2 * size_of::<f64>())
    }

    /// Events at the gaps.
    pub(crate) fn occurrences(&self) -> &[Occurrence] {
        &self.occurrences
    }

    pub(crate) fn into_occurrences(self) -> Vec<Occurrence> {
        self.occurrences
    }
}
