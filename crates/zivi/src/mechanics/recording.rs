//! Runs of mechanical systems: output, loop, record, and the counts of its events.
//!
//! A run in progress: the contribution of each segment of the motion to the record.

use std::collections::TryReserveError;

use crate::kinetics::Model;
use crate::mechanics::integrator::MechanicalIntegrator;
use crate::motion::path::{Curve, Flight, MechanicalPath, Piece};
use crate::motion::tail::SkippedArcs;
use crate::piecewise::running as piecewise;
use crate::piecewise::running::{unless_terminal, until, Record, SegmentSink};
use crate::piecewise::steps::{Advance, Driver, NoSink, Piecewise, Rhs};
use crate::record::columns::Reserve;
use crate::record::events::Occurrence;
use crate::record::gap_set::{ContactMode, GapSet};
use crate::record::status::Failure;
use crate::record::user_events::{unknown, SmoothPart};
use crate::switched::SwitchedRk;
use crate::system::dynamics::{Driven, Dynamics, Layout, MOST};
use crate::system::force::{Channel, Friction, FrictionalImpact, Smooth};
use crate::{
    AnyImpactLaw, Counts, GridError, Kick, LocatedEvent, Monitor, MotionPoint, SetupError, Status,
    UserEvent,
};

/// A run of a mechanical system in progress.
pub(crate) type Running<'a, E> = piecewise::Running<'a, E, MechanicalIntegrator, MechanicalRecord>;

type Ending<E> = piecewise::Ending<E, MotionPoint>;

/// Record of a run of a mechanical system, in addition to the occurrences.
pub(crate) struct MechanicalRecord {
    samples: MechanicalSamples,
    /// Where only the ends are sampled.
    speeds: Option<SpeedLog>,
    path: Option<MechanicalPath>,
    /// Whether the path is the whole motion, and not the flights only that jumps skip.
    is_whole: bool,
    /// Where a sample at a wanted time is made.
    at: MotionPoint,
}

/// The motion over some time, as a function that writes the state.
type Along<'m> = &'m dyn Fn(f64, &mut MotionPoint);

/// Most flights of a tail that events look at one by one.
const ARCS: usize = 1_000_000;

/// A run to `t1` from where the machine starts.
pub(crate) fn running<E>(
    machine: MechanicalIntegrator,
    t1: f64,
    output: MechanicalOutput<'_, E>,
) -> Running<'_, E> {
    let MechanicalOutput { t_eval, tstops, ends, dense, arcs, events, kicks } = output;
    let start = MotionPoint {
        x: machine.state().now().x.clone(),
        v: machine.state().now().xdot.clone(),
        mode: machine.state().mode(),
    };
    let record = MechanicalRecord {
        samples: MechanicalSamples::default(),
        speeds: (ends && t_eval.is_none()).then(|| SpeedLog::from(machine.state().now().t)),
        path: (dense || arcs).then(|| MechanicalPath::new(machine.state().layout())),
        is_whole: dense,
        at: start.clone(),
    };
    let running = Running::new((machine, start), t1, (tstops, t_eval), events, record);
    Running { kicks, ..running }
}

impl Piecewise for MechanicalIntegrator {
    type Point = MotionPoint;
    type Piece = Piece;

    fn t(&self) -> f64 {
        self.state().now().t
    }

    fn state_to(&self, to: &mut MotionPoint) {
        let now = self.state().now();
        to.x.clone_from(&now.x);
        to.v.clone_from(&now.xdot);
        to.mode = self.state().mode();
    }

    fn is_pending(&self, t_end: f64) -> bool {
        MechanicalIntegrator::is_pending(self, t_end)
    }

    fn restart(&mut self) {
        MechanicalIntegrator::restart(self);
    }

    fn look_from(&mut self, t: f64, drawn: f64) {
        self.motion_mut().look_from(t, drawn);
    }
}

impl<'f, E, D: Dynamics<E>> Advance<Model<'f, D>, E> for MechanicalIntegrator {
    fn next(&mut self, t_end: f64, model: &mut Model<'f, D>) -> Result<Piece, Failure<E>> {
        self.advance(t_end, model)
    }
}

impl<D> Rhs for Model<'_, D> {
    fn smooth(&mut self) -> &mut Smooth {
        &mut self.smooth
    }
}

impl Record<MechanicalIntegrator> for MechanicalRecord {
    fn make_room(
        &mut self,
        machine: &mut MechanicalIntegrator,
        samples: usize,
        reserve: &mut Reserve,
    ) -> Result<(), TryReserveError> {
        let layout = machine.state().layout();
        self.samples.make_room(reserve, samples, layout)?;
        machine.make_room(reserve)?;
        self.path.as_mut().map_or(Ok(()), |path| path.make_room(reserve))
    }

    fn is_dense(&self) -> bool {
        // the same steps to the last bit, whatever is kept of them
        self.path.is_some()
    }

    fn is_whole(&self) -> bool {
        self.is_whole
    }
}

impl<'f, E, D: Dynamics<E>> SegmentSink<MechanicalIntegrator, Model<'f, D>, E> for Running<'_, E> {
    fn begin(&mut self, until: f64, model: &mut Model<'f, D>) -> Result<(), Ending<E>> {
        self.seeker.start(self.end.0, &self.end.1).map_err(Failure::Raised)?;
        self.sample_step(until, model)
    }

    fn kick(&mut self, until: f64, model: &mut Model<'f, D>) -> Result<(), Ending<E>> {
        let Some(MotionPoint { x, v, .. }) = self.kicked()? else {
            let deferred = !self.wanted.is_by_steps();
            return if deferred { self.sample_step(until, model) } else { Ok(()) };
        };
        let n = self.method.state().layout().n;
        self.method.kick((&x[..n], &v[..n]), model)?;
        self.arrive();
        self.jumped()?;
        self.sample_step(until, model)
    }

    fn absorb(
        &mut self,
        piece: Piece,
        until: f64,
        model: &mut Model<'f, D>,
    ) -> Result<(), Ending<E>> {
        // since the last piece
        let (from, mode) = (self.end.0, self.end.1.mode);
        match piece {
            Piece::Charts => {
                // the same state: no sample, and events are looked for from here on
                self.arrive();
                self.seeker.start(self.end.0, &self.end.1).map_err(Failure::Raised)?;
                return Ok(());
            }
            Piece::Motion => self.motion(from, mode, model)?,
            Piece::Skipped(arcs) => self.skipped(&arcs, mode, model)?,
            Piece::Descent(flights) => self.descent(&flights, model)?,
            Piece::Instant => {
                self.arrive();
                self.jumped()?;
            }
        }
        self.sample_step(until, model)
    }
}

impl<E> Running<'_, E> {
    fn motion<D: Dynamics<E>>(
        &mut self,
        from: f64,
        mode: ContactMode,
        model: &mut Model<'_, D>,
    ) -> Result<(), Ending<E>> {
        let end = self.method.state().now().t;
        if end > self.drawn_from() && end > from {
            let motion = self.method.motion();
            let mut curve = motion.curve(self.method.state().now());
            curve.begin_at(&self.end.1);
            self.follow(&curve, (from, end), mode, model)?;
        }
        self.arrive();
        Ok(())
    }

    /// A smooth part of the motion.
    fn follow<D: Dynamics<E>>(
        &mut self,
        curve: &Curve,
        (from, end): (f64, f64),
        mode: ContactMode,
        model: &mut Model<'_, D>,
    ) -> Result<(), Ending<E>> {
        if let Some(path) = self.record.path.as_mut().filter(|_| self.record.is_whole) {
            path.push_motion(curve, mode);
        }
        let motion = |t: f64, to: &mut MotionPoint| {
            curve.at(t, &mut to.x, &mut to.v);
            to.mode = mode;
        };
        let stop = self.seek_along((from, end), motion);
        self.sample_until(until(&stop, end), &motion, model)?;
        unless_terminal(stop)
    }

    /// The way into a corner, from impact to impact.
    fn descent<D: Dynamics<E>>(
        &mut self,
        flights: &[Flight],
        model: &mut Model<'_, D>,
    ) -> Result<(), Ending<E>> {
        for Flight { curve, mode } in flights {
            let (from, end) = (curve.start, curve.start + curve.h);
            let at = &mut self.record.at;
            curve.at(from, &mut at.x, &mut at.v);
            at.mode = *mode;
            unless_terminal(self.seeker.across(from, &self.record.at))?;
            self.follow(curve, (from, end), *mode, model)?;
        }
        self.arrive();
        self.jumped()
    }

    fn skipped<D: Dynamics<E>>(
        &mut self,
        arcs: &SkippedArcs,
        mode: ContactMode,
        model: &mut Model<'_, D>,
    ) -> Result<(), Ending<E>> {
        let end = self.method.state().now().t;
        let motion = |t: f64, to: &mut MotionPoint| {
            arcs.at(t, &mut to.x, &mut to.v);
            to.mode = mode;
        };
        if let Some(path) = &mut self.record.path {
            path.push_skipped(arcs, mode);
        }
        let stop = self.seek_in_arcs(arcs, mode, &motion);
        self.sample_until(until(&stop, end), &motion, model)?;
        unless_terminal(stop)?;
        self.arrive();
        Ok(())
    }

    /// Events along a smooth part of the motion.
    fn seek_along(
        &mut self,
        span: (f64, f64),
        motion: impl Fn(f64, &mut MotionPoint),
    ) -> Result<Option<LocatedEvent<MotionPoint>>, E> {
        self.seek(&SmoothPart { span, motion, crossings: unknown })
    }

    fn seek_in_arcs(
        &mut self,
        arcs: &SkippedArcs,
        mode: ContactMode,
        motion: Along<'_>,
    ) -> Result<Option<LocatedEvent<MotionPoint>>, E> {
        if self.seeker.is_idle() {
            return Ok(None);
        }
        let mut t = arcs.start;
        for m in 0..ARCS {
            let Some((_, end)) = arcs.arc(m) else { break };
            // up to the next impact from before it, then from after it
            let before = |at: f64, to: &mut MotionPoint| {
                arcs.at_before(at, m, &mut to.x, &mut to.v);
                to.mode = mode;
            };
            if let Some(stop) = self.seek_along((t, end), before)? {
                return Ok(Some(stop));
            }
            t = end;
            motion(t, &mut self.record.at);
            if let Some(stop) = self.seeker.across(t, &self.record.at)? {
                return Ok(Some(stop));
            }
        }
        let end = self.method.state().now().t;
        if let Some(stop) = self.seek_along((t, end), motion)? {
            return Ok(Some(stop));
        }
        self.method.state_to(&mut self.record.at);
        self.seeker.across(end, &self.record.at)
    }

    /// Samples the motion at the wanted times before `t`.
    fn sample_until<D: Dynamics<E>>(
        &mut self,
        t: f64,
        motion: Along<'_>,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        while let Some(at) = self.wanted.pass_before(t) {
            let MechanicalRecord { samples, at: point, .. } = &mut self.record;
            motion(at, point);
            let lambda = self.method.contact_forces(at, point, model)?;
            samples.push(at, (&point.x, &point.v), lambda, point.mode);
        }
        Ok(())
    }

    /// A sample at the present state, if one is wanted and nothing happens there yet.
    fn sample_step<D: Dynamics<E>>(
        &mut self,
        until: f64,
        model: &mut Model<'_, D>,
    ) -> Result<(), Ending<E>> {
        let t = self.method.state().now().t;
        // a sample at a velocity jump has the state after it
        let deferred = self.kicks.is_some() && t >= until && t < self.t1;
        if deferred && !self.wanted.is_by_steps() {
            return Ok(());
        }
        if self.method.is_pending(until) || !self.wanted.pass_at(t) {
            return Ok(());
        }
        let is_end = self.record.samples.t.is_empty() || t >= self.t1;
        if let Some(log) = &mut self.record.speeds {
            let (now, n) = (self.method.state().now(), self.method.state().layout().n);
            log.note(t, &now.xdot[..n], self.method.occurrences());
            // others evaluate them for the next step
            if !is_end && self.method.motion().is_independent() {
                return Ok(());
            }
        }
        if self.method.motion().is_led() {
            self.method.state_mut().know(model)?;
        } else {
            self.method.state_mut().prepare(model)?;
            // an anchored gap
            self.arrive();
        }
        if self.record.speeds.is_some() && !is_end {
            return Ok(());
        }
        let state = self.method.state();
        let (now, lambda) = (state.now(), state.lambda());
        self.record.samples.push(t, (&now.x, &now.xdot), lambda, state.mode());
        Ok(())
    }

    pub(crate) fn finish(mut self, ending: Ending<E>, nfev: u64) -> MechanicalRun<E> {
        let (status, raised) = self.close(ending);
        let Self { method: machine, seeker, wanted, record, reserve, end, .. } = self;
        let MechanicalRecord { mut samples, mut speeds, mut path, .. } = record;
        let (t, point) = &end;
        let (layout, counts) = (machine.state().layout(), machine.counts());
        let mut occurrences = machine.into_occurrences();
        // an event among skipped flights ends the run before what they lead to
        occurrences.retain(|it| it.t() <= *t || status != Status::TerminatedByEvent);
        if wanted.is_missing_at(*t, samples.t.last().copied()) {
            if let Some(log) = &mut speeds {
                log.note(*t, &point.v[..layout.n], &occurrences);
            }
            let none = vec![0.0; layout.forces()];
            samples.push(*t, (&point.x, &point.v), &none, point.mode);
        }
        drop(reserve);
        if let Some(path) = &mut path {
            path.end = Some(end);
        }
        MechanicalRun {
            layout,
            samples,
            speeds: speeds.map(|log| log.speeds),
            occurrences,
            hits: seeker.into_hits(),
            path,
            status,
            raised,
            counts: Counts { nfev, ..counts },
        }
    }
}

// A whole run of a mechanical system: samples, occurrences, events, dense output.

/// Simulates a mechanical system over a span by the switched Runge-Kutta method.
///
/// ```text
/// M q'' = F + N^T lambda      0 <= g  perp  lambda >= 0      impacts: g+ = g- + D P,
///                                                  0 <= P  perp  g+ + e g- >= 0
/// ```
///
/// with `e = e(-g-)` of the impact law of each gap.
///
/// # Errors
/// [`SetupError`] before anything is computed, for settings, sizes or a start out of range.
///
/// ```
/// use std::convert::Infallible;
/// use zivi::mechanics::{simulate_mechanical, MechanicalOutput};
/// use zivi::system::dynamics::{FunctionDynamics, Layout};
/// use zivi::system::impact_law::newton_impacts;
/// use zivi::{Silent, Status, SwitchedRk};
///
/// // a ball of 2 kg above a floor at y = 0, with drift in x
/// let layout = Layout::smooth(2, 1);
/// let function = |_: f64, q: &[f64], _: &[f64], out: &mut [f64]| {
///     out[layout.mass()].copy_from_slice(&[2.0, 0.0, 0.0, 2.0]);
///     out[layout.force()].copy_from_slice(&[0.0, -2.0 * 9.81]);
///     out[layout.gap()].copy_from_slice(&[q[1]]);
///     out[layout.gradient()].copy_from_slice(&[0.0, 1.0]);
///     out[layout.curvature()].fill(0.0);
///     out[layout.rate()].fill(0.0);
///     Ok::<(), Infallible>(())
/// };
/// let run = simulate_mechanical(
///     SwitchedRk::default(), &mut FunctionDynamics { layout, function }, &newton_impacts(&[0.5])?,
///     (0.0, 3.0), (&[0.0, 1.0], &[1.0, 0.0]), MechanicalOutput::default(), &mut Silent,
/// )?;
/// assert_eq!(run.status, Status::Completed);
/// // at rest on the floor, 3 m further on
/// let last = run.samples.x.len() - 3;
/// assert!((run.samples.x[last] - 3.0).abs() < 1e-9 && run.samples.x[last + 2] == 0.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn simulate_mechanical<E, D: Dynamics<E>>(
    settings: SwitchedRk,
    dynamics: &mut D,
    laws: &[AnyImpactLaw],
    (t0, t1): (f64, f64),
    (q, w): (&[f64], &[f64]),
    output: MechanicalOutput<'_, E>,
    monitor: &mut impl Monitor<E>,
) -> Result<MechanicalRun<E>, SetupError> {
    let settings = settings.validated()?;
    let layout = dynamics.layout();
    check_sizes(layout, laws.len(), q, w)?;
    check_span(t0, t1)?;
    let friction = dynamics.friction().clone();
    check_cones(layout, &friction)?;
    // compiled once for all systems
    let mut dynamics: &mut dyn Dynamics<E> = dynamics;
    let mut model = Model::new(&mut dynamics);
    let mut machine = MechanicalIntegrator::new(settings, layout, laws, &friction);
    machine.probe_flights(t1 - t0);
    let begun = started(machine.start(t0, (q, w), &mut model))?;
    let mut running = running(machine, t1, output);
    let ending = match begun {
        Err(failure) => failure.into(),
        Ok(()) => running.go(&mut NoSink, &mut model, monitor),
    };
    Ok(running.finish(ending, model.count))
}

/// Converts the result of a start to an error of the setup or of the run.
pub(crate) fn started<E>(
    start: Result<Option<f64>, Failure<E>>,
) -> Result<Result<(), Failure<E>>, SetupError> {
    match start {
        Ok(Some(value)) if value.is_nan() => {
            let range = "such that positions and velocities obey the equality rows";
            Err(SetupError::Setting("q0 and qdot0", value, range))
        }
        Ok(Some(value)) => {
            Err(SetupError::Setting("q0", value, "such that no gap g(t0, q0) is below 0"))
        }
        Err(Failure::Status(Status::MassNotDefinite)) => {
            let range = "symmetric positive definite at the start";
            Err(SetupError::Setting("mass", f64::NAN, range))
        }
        start => Ok(start.map(|_| ())),
    }
}

pub(crate) fn check_sizes(
    Layout { n, m, p, k }: Layout,
    laws: usize,
    q: &[f64],
    w: &[f64],
) -> Result<(), SetupError> {
    if n == 0 || n > MOST {
        return Err(SetupError::Count("n", n, "from 1 to 256"));
    }
    if m + p > MOST {
        return Err(SetupError::Count("m", m + p, "at most 256, with the channels of friction"));
    }
    if k > MOST {
        return Err(SetupError::Count("equalities", k, "at most 256"));
    }
    for (name, given, wanted) in [("e", laws, m), ("q0", q.len(), n), ("qdot0", w.len(), n)] {
        if given != wanted {
            return Err(SetupError::Count(name, given, "one number each"));
        }
    }
    for (name, state) in [("q0", q), ("qdot0", w)] {
        if let Some(&value) = state.iter().find(|value| !value.is_finite()) {
            return Err(SetupError::Setting(name, value, "finite"));
        }
    }
    Ok(())
}

/// For derivatives, which know friction in one direction at a gap, and Newton's law.
pub(crate) fn check_differentiable(friction: &Friction) -> Result<(), SetupError> {
    let mut gaps: Vec<usize> = friction.channels.iter().filter_map(|it| it.gap).collect();
    let count = gaps.len();
    gaps.dedup();
    if gaps.len() < count {
        let cones = count - gaps.len();
        return Err(SetupError::Count("friction in two directions", cones, "none in derivatives"));
    }
    if friction.law != FrictionalImpact::Newton || friction.impact_without_collision {
        return Err(SetupError::Count(
            "other laws of impacts",
            1,
            "none in derivatives: take Newton's",
        ));
    }
    Ok(())
}

/// For what does not know equality rows.
pub(crate) fn check_free(layout: Layout) -> Result<(), SetupError> {
    match layout.k {
        0 => Ok(()),
        k => Err(SetupError::Count("equalities", k, "none: take SwitchedRk without derivatives")),
    }
}

/// For what takes rigid gaps only.
pub(crate) fn check_rigid(friction: &Friction) -> Result<(), SetupError> {
    match friction.compliant.len() {
        0 => Ok(()),
        count => Err(SetupError::Count("compliant", count, "none: take SwitchedRk")),
    }
}

/// The same as [`check_friction`] where a rigid gap may have two channels, one after the other: the directions of a
/// cone, under Newton's law and without tangential restitution.
pub(crate) fn check_cones(layout: Layout, friction: &Friction) -> Result<(), SetupError> {
    let is_plain = friction.law == FrictionalImpact::Newton && !friction.impact_without_collision;
    let mut one_each: Vec<Channel> = Vec::new();
    let mut is_second = false;
    for channel in &friction.channels {
        let is_soft = friction.compliant.iter().any(|it| Some(it.0) == channel.gap);
        let may_be = is_plain && !is_soft && channel.gap.is_some() && channel.e_t == 0.0;
        is_second = may_be && !is_second && one_each.last() == Some(channel);
        if !is_second {
            one_each.push(*channel);
        }
    }
    let seconds = friction.channels.len() - one_each.len();
    let layout = Layout { p: layout.p.saturating_sub(seconds), ..layout };
    check_friction(layout, &Friction { channels: one_each, ..friction.clone() })
}

pub(crate) fn check_friction(
    Layout { m, p, .. }: Layout,
    friction: &Friction,
) -> Result<(), SetupError> {
    if friction.channels.len() != p {
        return Err(SetupError::Count("friction", friction.channels.len(), "one for each channel"));
    }
    let mut seen = GapSet::EMPTY;
    for channel in &friction.channels {
        if !(0.0..=1.0).contains(&channel.e_t) {
            return Err(SetupError::Setting("e_t", channel.e_t, "from 0 to 1"));
        }
        let Some(gap) = channel.gap else { continue };
        if gap >= m || seen.has(gap) {
            return Err(SetupError::Count("friction", gap, "one gap each, at most one channel"));
        }
        seen = seen.with(GapSet::of(gap));
    }
    let increases = friction.compliant.windows(2).all(|pair| pair[0].0 < pair[1].0);
    let wrong = friction.compliant.iter().find(|(gap, law)| *gap >= m || !law.is_valid());
    match wrong.or(friction.compliant.first().filter(|_| !increases)) {
        None => Ok(()),
        Some((gap, _)) => {
            Err(SetupError::Count("compliant", *gap, "gaps, ascending, with a law in range"))
        }
    }
}

pub(crate) fn check_span(t0: f64, t1: f64) -> Result<(), SetupError> {
    if !(t0.is_finite() && t1.is_finite()) {
        return Err(GridError::SpanNotFinite(t0, t1).into());
    }
    if t1 <= t0 {
        return Err(GridError::SpanEmpty(t0, t1).into());
    }
    Ok(())
}

// Options and results of a run of a mechanical system.

/// Output options of a run, in addition to events at the gaps.
pub struct MechanicalOutput<'a, E> {
    /// Times of the samples, increasing and within the span. `None`: a sample at the start, at the
    /// end of each step, after each event at a gap, and at the end.
    pub t_eval: Option<&'a [f64]>,
    /// Times at which the forces are not smooth (s), increasing.
    pub tstops: &'a [f64],
    /// Without times of samples: only the first of them and that at the end, and how fast the system
    /// was at the others ([`MechanicalRun::speeds`]). Forces of linear systems are not evaluated there.
    pub ends: bool,
    /// Whether to keep the motion as a function of time.
    pub dense: bool,
    /// Whether to keep of the motion at least the flights that jumps skip, with the impacts on them.
    pub arcs: bool,
    /// The user's events.
    pub events: Vec<UserEvent<'a, E, MotionPoint>>,
    /// Kicks at some of the declared times, before impacts on the closed gaps that they load.
    pub kicks: Option<Kick<'a, E, MotionPoint>>,
}

impl<E> Default for MechanicalOutput<'_, E> {
    fn default() -> Self {
        let (ends, dense, arcs) = (false, false, false);
        Self { t_eval: None, tstops: &[], ends, dense, arcs, events: Vec::new(), kicks: None }
    }
}

/// Samples of a mechanical system.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MechanicalSamples {
    /// Times (s).
    pub t: Vec<f64>,
    /// `q`, `g` and the friction quantities, `layout.size()` numbers per sample.
    pub x: Vec<f64>,
    /// Their rates, as many.
    pub v: Vec<f64>,
    /// Contact forces and those of friction, `m + p` numbers a sample.
    pub lambda: Vec<f64>,
    /// The closed gaps and the modes of friction.
    pub modes: Vec<ContactMode>,
}

impl MechanicalSamples {
    /// Reserves room for `n` more samples with these numbers of coordinates and gaps.
    pub(crate) fn make_room(
        &mut self,
        reserve: &mut Reserve,
        count: usize,
        layout: Layout,
    ) -> Result<(), TryReserveError> {
        const ASIDE: usize = size_of::<f64>();
        reserve.room(&mut self.t, count, ASIDE)?;
        reserve.room(&mut self.x, count * layout.size(), ASIDE)?;
        reserve.room(&mut self.v, count * layout.size(), ASIDE)?;
        reserve.room(&mut self.lambda, count * layout.forces(), ASIDE)?;
        reserve.room(&mut self.modes, count, layout.rows())
    }

    pub(crate) fn push(
        &mut self,
        t: f64,
        (x, v): (&[f64], &[f64]),
        lambda: &[f64],
        mode: ContactMode,
    ) {
        self.t.push(t);
        self.x.extend_from_slice(x);
        self.v.extend_from_slice(v);
        self.lambda.extend_from_slice(lambda);
        self.modes.push(mode);
    }
}

/// The largest `|q'_i|` at the ends of steps, of a run that keeps no samples there.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Speeds {
    /// When something last happened at the gaps or to friction, or the start (s).
    pub since: f64,
    /// From the start on.
    pub fastest: f64,
    /// From then on.
    pub fastest_since: f64,
}

/// The speeds of a run in progress.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SpeedLog {
    pub(crate) speeds: Speeds,
    /// The last time that was looked at, and the speed there.
    last: (f64, f64),
    /// How many occurrences are known.
    known: usize,
}

impl SpeedLog {
    pub(crate) fn from(t0: f64) -> Self {
        let speeds = Speeds { since: t0, ..Speeds::default() };
        Self { speeds, last: (t0, 0.0), known: 0 }
    }

    /// Records a time, its velocities and the events up to it.
    pub(crate) fn note(&mut self, t: f64, velocities: &[f64], occurrences: &[Occurrence]) {
        let speed = velocities.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
        let Self { speeds, last, known } = self;
        for it in occurrences.iter().skip(*known) {
            let is_aside = matches!(it, Occurrence::Contact { .. } | Occurrence::Flag { .. });
            if !is_aside && it.t() > speeds.since {
                speeds.since = it.t();
                speeds.fastest_since = if last.0 >= it.t() { last.1 } else { 0.0 };
            }
        }
        *known = occurrences.len();
        *last = (t, if last.0 == t { speed.max(last.1) } else { speed });
        speeds.fastest = speeds.fastest.max(speed);
        speeds.fastest_since = speeds.fastest_since.max(speed);
    }
}

/// A run of a mechanical system.
#[derive(Clone, Debug, PartialEq)]
pub struct MechanicalRun<E> {
    /// How many coordinates and gaps there are.
    pub layout: Layout,
    /// Samples.
    pub samples: MechanicalSamples,
    /// How fast the system was, where only the ends were sampled.
    pub speeds: Option<Speeds>,
    /// Events at the gaps, in order.
    pub occurrences: Vec<Occurrence>,
    /// The user's events, by function.
    pub hits: Vec<Vec<LocatedEvent<MotionPoint>>>,
    /// The motion as a function of time, if requested.
    pub path: Option<MechanicalPath>,
    /// How the run ended.
    pub status: Status,
    /// The error that the system, an event or the monitor raised.
    pub raised: Option<E>,
    /// How much work was done.
    pub counts: Counts,
}

// Counts of the events of a run.

/// Most impacts of one accumulation that count.
const MOST_COUNTED: usize = 1_000_000;

/// How often what happened at the gaps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Totals {
    /// Impacts, those of several gaps at one instant as one.
    pub impacts: usize,
    /// When the first of them was (s); NaN without one.
    pub first_impact: f64,
    /// When the last was.
    pub last_impact: f64,
    /// Gaps that came to rest.
    pub zeno: usize,
    /// Contacts that the forces opened.
    pub liftoffs: usize,
    /// Gaps that came to rest together.
    pub corners: usize,
    /// Flags.
    pub flags: usize,
}

impl<E> MechanicalRun<E> {
    /// How often what happened, with the impacts down to a part of the speed of the fastest, also those
    /// that jumps to Zeno points skipped.
    #[must_use]
    pub fn totals(&self, slowest: f64) -> Totals {
        let [first_impact, last_impact] = [f64::INFINITY, f64::NEG_INFINITY];
        let mut all = Totals { first_impact, last_impact, ..Totals::default() };
        let fastest = self.occurrences.iter().fold(0.0_f64, |most, it| match it {
            Occurrence::Impact { before, .. } => most.max(-before),
            _ => most,
        });
        let speed = slowest * fastest;
        let (mut last, mut bounced) = (None, GapSet::EMPTY);
        let mut skipped = self.path.iter().flat_map(|path| &path.skipped).peekable();
        for it in &self.occurrences {
            match *it {
                Occurrence::Impact { t, gap, before, after, group, .. } => {
                    if after > 0.0 {
                        bounced = bounced.with(GapSet::of(gap));
                    }
                    if -before >= speed && last != Some(group) {
                        last = Some(group);
                        all.count((t, t), 1);
                    }
                }
                Occurrence::Zeno { t, gap, .. } => {
                    all.zeno += 1;
                    while skipped.peek().is_some_and(|arcs| arcs.end < t) {
                        skipped.next();
                    }
                    let arcs = skipped.next_if(|arcs| arcs.end == t && speed > 0.0);
                    let tail = arcs.filter(|_| bounced.has(gap)).and_then(|it| it.arcs.as_ref());
                    if let Some(tail) = tail {
                        let (count, end) = tail.count_down_to(speed);
                        all.count((tail.time_of(1), end), count.min(MOST_COUNTED));
                    }
                }
                Occurrence::LiftOff { .. } => all.liftoffs += 1,
                Occurrence::Corner { .. } => all.corners += 1,
                Occurrence::Flag { .. } => all.flags += 1,
                _ => (),
            }
        }
        if all.impacts == 0 {
            (all.first_impact, all.last_impact) = (f64::NAN, f64::NAN);
        }
        all
    }
}

impl Totals {
    fn count(&mut self, (first, last): (f64, f64), count: usize) {
        if count > 0 {
            self.impacts += count;
            self.first_impact = self.first_impact.min(first);
            self.last_impact = self.last_impact.max(last);
        }
    }
}

// A mechanical system under a control that is sampled and held: one run whose forces change at the
// samples.

/// Sampling times of a control, and other times at which the forces are not smooth.
#[derive(Clone, Copy, Debug)]
pub struct Sampling<'a> {
    /// Times of the samples, from the start to the end of the run (s).
    pub times: &'a [f64],
    /// These and all others at which the forces are not smooth, increasing (s).
    pub stops: &'a [f64],
}

/// The samples of a loop: state, contact forces under the control that begins there, control.
#[derive(Default)]
struct LoopSamples {
    motion: MechanicalSamples,
    u: Vec<f64>,
}

/// A sampled controller: the control at sample `k` for time, coordinates and velocities.
pub trait Ticks<E> {
    /// Writes the control into `u`.
    ///
    /// # Errors
    /// Whatever ends the run.
    fn tick(&mut self, k: usize, t: f64, state: (&[f64], &[f64]), u: &mut [f64]) -> Result<(), E>;
}

impl<E, T> Ticks<E> for T
where
    T: FnMut(usize, f64, (&[f64], &[f64]), &mut [f64]) -> Result<(), E>,
{
    fn tick(&mut self, k: usize, t: f64, state: (&[f64], &[f64]), u: &mut [f64]) -> Result<(), E> {
        self(k, t, state, u)
    }
}

/// Takes the segments of a run as they come, and changes the control at the samples.
struct Held<'a, C> {
    ticks: &'a mut C,
    times: &'a [f64],
    /// Samples so far.
    k: usize,
    u: Vec<f64>,
    samples: LoopSamples,
}

impl<C> Held<'_, C> {
    /// A sample at the present state, with the contact forces of the control that is held.
    fn sample<E, D: Dynamics<E>, F>(
        &mut self,
        machine: &mut MechanicalIntegrator,
        model: &mut Model<'_, Driven<D, F>>,
    ) -> Result<(), Failure<E>>
    where
        Driven<D, F>: Dynamics<E>,
    {
        let (t, layout) = (machine.state().now().t, machine.state().layout());
        let pending = machine.is_pending(t);
        if !pending {
            machine.state_mut().prepare(model)?;
        }
        let state = machine.state();
        let none = vec![0.0; layout.forces()];
        let lambda = if pending { &none } else { state.lambda() };
        let (now, mode) = (state.now(), state.mode());
        let (lambda, mode) = pressed(layout, lambda, mode);
        self.samples.motion.push(t, (&now.x, &now.xdot), &lambda, mode);
        self.samples.u.extend_from_slice(&self.u);
        Ok(())
    }
}

/// Contact forces and contacts from here on: a gap that is pulled opens.
fn pressed(layout: Layout, lambda: &[f64], mode: ContactMode) -> (Vec<f64>, ContactMode) {
    let mut lambda = lambda.to_vec();
    let closed = mode.closed.iter().filter(|&i| lambda[i] >= 0.0).collect();
    lambda[..layout.m].iter_mut().for_each(|it| *it = it.max(0.0));
    (lambda, ContactMode { closed, ..mode })
}

impl<'f, E, D, F, C> Driver<MechanicalIntegrator, Model<'f, Driven<D, F>>, E> for Held<'_, C>
where
    D: Dynamics<E>,
    Driven<D, F>: Dynamics<E>,
    C: Ticks<E>,
{
    fn step(
        &mut self,
        machine: &mut MechanicalIntegrator,
        t_end: f64,
        model: &mut Model<'f, Driven<D, F>>,
    ) -> Result<crate::motion::path::Piece, Failure<E>> {
        machine.advance(t_end, model)
    }

    fn enter(
        &mut self,
        machine: &mut MechanicalIntegrator,
        model: &mut Model<'f, Driven<D, F>>,
    ) -> Result<(), Failure<E>> {
        let now = machine.state().now();
        if !self.times.get(self.k).is_some_and(|&t| now.t >= t) {
            return Ok(()); // the forces have a break of their own here
        }
        let n = machine.state().layout().n;
        let state = (&now.x[..n], &now.xdot[..n]);
        self.ticks.tick(self.k, now.t, state, &mut self.u).map_err(Failure::Raised)?;
        self.k += 1;
        model.dynamics.hold(&self.u);
        self.sample(machine, model)
    }
}

/// Simulates a mechanical system by the switched Runge-Kutta method under a control that changes at
/// the samples; `u` is the control from the start on, the updates begin with the next sample.
///
/// The samples of the run are those of the loop, with the contact forces under the control that begins
/// there. A velocity jump at a sample follows it. Also returned: its controls, `r` numbers a sample; the last is repeated at the end.
///
/// # Errors
/// [`SetupError`] before anything is computed, for settings, sizes or a start out of range.
pub fn simulate_mechanical_loop<E, D, F>(
    settings: SwitchedRk,
    system: (&mut Driven<D, F>, &[AnyImpactLaw]),
    sampling: Sampling<'_>,
    (q, w): (&[f64], &[f64]),
    (u, ticks): (&[f64], &mut impl Ticks<E>),
    (dense, kicks): (bool, Option<Kick<'_, E, MotionPoint>>),
    monitor: &mut impl Monitor<E>,
) -> Result<(MechanicalRun<E>, Vec<f64>), SetupError>
where
    D: Dynamics<E>,
    Driven<D, F>: Dynamics<E>,
{
    let settings = settings.validated()?;
    let (driven, laws) = system;
    let layout = Dynamics::<E>::layout(driven);
    let [t0, .., t1] = *sampling.times else {
        return Err(SetupError::Count("times", sampling.times.len(), "at least 2"));
    };
    check_sizes(layout, laws.len(), q, w)?;
    check_span(t0, t1)?;
    if u.len() != driven.control().len() {
        return Err(SetupError::Count("u", u.len(), "one number for each input"));
    }
    let friction = Dynamics::<E>::friction(driven).clone();
    check_friction(layout, &friction)?;
    driven.hold(u);
    let mut model = Model::new(driven);
    let mut machine = MechanicalIntegrator::new(settings, layout, laws, &friction);
    let begun = started(machine.start(t0, (q, w), &mut model))?;
    let samples = LoopSamples::default();
    let mut held = Held { ticks, times: sampling.times, k: 1, u: u.to_vec(), samples };
    let begun = match begun {
        Ok(()) => held.sample(&mut machine, &mut model),
        failed => failed,
    };
    let output = MechanicalOutput {
        t_eval: Some(&[]),
        tstops: sampling.stops,
        dense,
        kicks,
        ..MechanicalOutput::default()
    };
    let mut running = running(machine, t1, output);
    let ending = match begun {
        Err(failure) => failure.into(),
        Ok(()) => running.go(&mut held, &mut model, monitor),
    };
    if running.method.state().now().t >= t1 {
        // the last control is repeated; where the forces there fail, the run is what it is
        let _: Result<(), Failure<E>> = held.sample(&mut running.method, &mut model);
    }
    let LoopSamples { motion, u } = held.samples;
    let run = running.finish(ending, model.count);
    Ok((MechanicalRun { samples: motion, ..run }, u))
}

#[cfg(test)]
mod run_tests {
    use super::*;
    use crate::system::force::{Channel, ContactForce};

    #[test]
    fn friction_has_its_channels_and_a_gap_one_at_most() {
        let layout = Layout { n: 2, m: 2, p: 2, k: 0 };
        let check = |gaps: &[Option<usize>], e_t: f64| {
            let channels = gaps.iter().map(|&gap| Channel { gap, e_t }).collect();
            check_friction(layout, &Friction { channels, ..Friction::default() })
        };
        for gaps in [[Some(0), Some(1)], [Some(1), None], [None, None]] {
            for e_t in [0.0, 0.3, 1.0] {
                assert!(check(&gaps, e_t).is_ok(), "{gaps:?} {e_t}");
            }
        }
        let refused = |gaps: &[Option<usize>], wrong: usize| {
            let found = check(gaps, 0.0);
            matches!(found, Err(SetupError::Count("friction", count, _)) if count == wrong)
        };
        assert!(refused(&[Some(0)], 1));
        assert!(refused(&[Some(0), Some(1), None], 3));
        assert!(refused(&[None, Some(2)], 2));
        assert!(refused(&[Some(1), Some(1)], 1));
        for wrong in [-0.1, 1.1, f64::NAN] {
            assert!(matches!(check(&[Some(0), None], wrong), Err(SetupError::Setting("e_t", ..))));
        }
    }

    #[test]
    fn compliant_gaps_are_some_of_the_gaps_with_laws_in_range() {
        let (layout, spring) = (Layout::smooth(2, 2), |k, c| ContactForce::SpringDamper { k, c });
        let check = |compliant: &[(usize, ContactForce)]| {
            let friction = Friction { compliant: compliant.to_vec(), ..Friction::default() };
            (check_friction(layout, &friction).is_ok(), check_rigid(&friction).is_ok())
        };
        let hertz = ContactForce::Power { k: 1.0, p: 1.5 };
        assert_eq!(check(&[]), (true, true));
        assert_eq!(check(&[(0, hertz), (1, spring(1.0, 0.0))]), (true, false));
        assert_eq!(check(&[(1, hertz), (0, hertz)]), (false, false));
        assert_eq!(check(&[(2, hertz)]), (false, false));
        for (k, c) in [(0.0, 0.0), (f64::NAN, 0.0), (f64::INFINITY, 0.0), (1.0, -1.0)] {
            assert_eq!(check(&[(0, spring(k, c))]), (false, false), "{k} {c}");
        }
        for (p, alpha) in [(0.9, 0.0), (11.0, 0.0), (1.5, -0.1)] {
            let law = ContactForce::HuntCrossley { k: 1.0, p, alpha };
            assert_eq!(check(&[(0, law)]), (false, false), "{p} {alpha}");
        }
    }
}

#[cfg(test)]
mod output_tests {
    use super::*;

    #[test]
    fn speeds_count_from_the_last_occurrence_on_and_at_it() {
        let mut log = SpeedLog::from(0.5);
        let zeno = |t| Occurrence::LiftOff { t, gap: 0 };
        let flag = Occurrence::Contact { t: 9.0, gap: 0 };
        let mut occurrences = vec![];
        let mut told = |t, v: f64, new: &[Occurrence]| {
            occurrences.extend_from_slice(new);
            log.note(t, &[v, -0.1], &occurrences);
            let Speeds { since, fastest, fastest_since } = log.speeds;
            [since, fastest, fastest_since]
        };
        assert_eq!(told(0.5, -3.0, &[]), [0.5, 3.0, 3.0]);
        assert_eq!(told(1.0, 2.0, &[]), [0.5, 3.0, 3.0]);
        // that at the time of an occurrence counts, whichever was first
        assert_eq!(told(1.0, 1.0, &[zeno(1.0), flag]), [1.0, 3.0, 2.0]);
        assert_eq!(told(1.5, 4.0, &[]), [1.0, 4.0, 4.0]);
        assert_eq!(told(2.0, 0.5, &[zeno(1.7)]), [1.7, 4.0, 0.5]);
        assert_eq!(told(2.5, 0.0, &[zeno(1.6)]), [1.7, 4.0, 0.5]);
    }

    #[test]
    fn room_is_made_for_every_number_of_the_samples() {
        let (mut samples, mut reserve) = (MechanicalSamples::default(), Reserve::default());
        samples.make_room(&mut reserve, 100, Layout::smooth(4, 3)).unwrap();
        let MechanicalSamples { t, x, v, lambda, modes } = &samples;
        let rooms = [t.capacity(), x.capacity(), v.capacity(), lambda.capacity(), modes.capacity()];
        let needed = [100, 700, 700, 300, 100];
        assert!(rooms.iter().zip(needed).all(|(room, n)| *room >= n), "{rooms:?}");
    }
}
