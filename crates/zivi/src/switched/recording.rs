//! Runs of the switched method: loop and record.
//!
//! A whole run: steps, samples, events, dense output.

use super::mode::Counted;
use super::settings::Samples;
use super::settings::{Output, SwitchedRun};
use crate::piecewise::running as piecewise;
use crate::piecewise::running::{unless_terminal, until, Record, SegmentSink};
use crate::piecewise::steps::{Advance, Driver, NoSink, Piecewise, Rhs};
use crate::record::columns::{Columns, Reserve};
use crate::record::events::EventReader;
use crate::record::recorder::PathPoint;
use crate::record::status::Failure;
use crate::record::trajectory::{SetupError, Trajectory};
use crate::record::user_events::{Level, LocatedEvent, SmoothPart};
use crate::switched::flight::series::{FlightPart, SeriesStart};
use crate::switched::integrator::SwitchedIntegrator;
use crate::switched::mode::{Counts, Piece, Point};
use crate::switched::path::{DensePath, FlightCurve};
use crate::switched::settings::{Flights, SwitchedRk};
use crate::system::force::Smooth;
use crate::zeno::tail::Tail;
use crate::{AnyImpactLaw, Force, GridError, Impact, Monitor, Occurrence, Physical, Status};
use std::collections::TryReserveError;

/// Simulates `x'' = f`, `x >= 0`, `x'+ = -e x'-` with the switched Runge-Kutta method.
///
/// Samples have `s = sigma x` and `v = sigma x'/(1 - kappa sgn x')` on the branch `sigma` that
/// changes at each impact, with `kappa = 0` where the impact law has no constant coefficient; their
/// multipliers are the signs, at rest 0, and their residual is NaN: no inclusion is solved. On a plastic wall (`e = 0`) `v` is infinite while the mass moves off.
///
/// # Errors
/// [`SetupError`] before anything is computed. Whatever goes wrong later is in the run's status.
///
/// ```
/// use zivi::{
///     simulate_switched_rk, LinearForce, Output, Physical, Restitution, Silent, Status,
///     SwitchedRk,
/// };
///
/// // a mass on a table that vibrates with 1.5 g
/// let mut force = LinearForce {
///     stiffness: 0.0, damping: 0.0, gravity: 9.81,
///     amplitude: 14.715, omega: 6.283185307179586, phase: -1.5707963267948966,
/// };
/// let (start, restitution) = (Physical { x: 0.2, xdot: 0.0 }, Restitution::from_e(0.5)?);
/// let run = simulate_switched_rk(
///     SwitchedRk::with_tol(1e-9), restitution, &mut force, (0.0, 2.0), start, Output::default(),
///     &mut Silent,
/// )?;
/// assert_eq!(run.trajectory.status, Status::Completed);
/// let events = &run.trajectory.events;
/// assert!((events.zeno_times[0] - 0.8286081107).abs() < 1e-8);
/// assert!((events.liftoff_times[0] - 1.1161397636).abs() < 1e-8);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn simulate_switched_rk<E, F: Force<E>>(
    settings: SwitchedRk,
    law: impl Into<AnyImpactLaw>,
    force: &mut F,
    span: (f64, f64),
    initial: Physical,
    output: Output<'_, E>,
    monitor: &mut impl Monitor<E>,
) -> Result<SwitchedRun<E>, SetupError> {
    simulate_with(&mut NoSink, settings, law.into(), force, span, initial, output, monitor)
}

/// The same in the steps of somebody else.
#[allow(clippy::too_many_arguments)]
pub(super) fn simulate_with<E, F: Force<E>>(
    driver: &mut impl for<'f> Driver<SwitchedIntegrator, Counted<'f, F>, E>,
    settings: SwitchedRk,
    law: AnyImpactLaw,
    force: &mut F,
    (t0, t1): (f64, f64),
    initial: Physical,
    output: Output<'_, E>,
    monitor: &mut impl Monitor<E>,
) -> Result<SwitchedRun<E>, SetupError> {
    check_span(t0, t1, output.t_eval)?;
    check_stops(output.tstops)?;
    let mut integrator = SwitchedIntegrator::new(settings, law)?;
    integrator.start(t0, initial)?;
    integrator.probe(force.shortest_period().is_none(), t1 - t0);
    integrator.adopt(force);
    let linear = integrator.flight().linear().copied();
    if settings.flights == Flights::Series && linear.is_none() {
        return Err(SetupError::Setting("flights", f64::NAN, "series for a linear force only"));
    }
    let mut run = running(integrator, t1, output);
    let mut force = Counted::known(force, linear.as_ref());
    let ending = run.go(driver, &mut force, monitor);
    let nfev = force.count();
    run.finish(ending, nfev, |start, len| monitor.record_allocated(start, len))
}

pub(super) fn check_stops(tstops: &[f64]) -> Result<(), SetupError> {
    let mut last = f64::NEG_INFINITY;
    for &t in tstops {
        if !(t > last && t.is_finite()) {
            return Err(SetupError::Setting("tstops", t, "increasing finite times"));
        }
        last = t;
    }
    Ok(())
}

pub(crate) fn check_span(t0: f64, t1: f64, t_eval: Option<&[f64]>) -> Result<(), SetupError> {
    if !(t0.is_finite() && t1.is_finite() && (t1 - t0).is_finite()) {
        return Err(GridError::SpanNotFinite(t0, t1).into());
    }
    if t1 <= t0 {
        return Err(GridError::SpanEmpty(t0, t1).into());
    }
    let mut last = f64::NEG_INFINITY;
    for &t in t_eval.unwrap_or_default() {
        if !(t > last && t >= t0 && t <= t1) {
            return Err(SetupError::Setting("t_eval", t, "increasing times within t_span"));
        }
        last = t;
    }
    Ok(())
}

// A run in progress: each segment of the motion is added to the record.

/// A run of the mass in progress.
pub(super) type Running<'a, E> = piecewise::Running<'a, E, SwitchedIntegrator, MassRecord>;

type Ending<E> = piecewise::Ending<E, PathPoint>;

/// Record of a run of the mass.
pub(super) struct MassRecord {
    samples: Samples,
    path: Option<DensePath>,
    /// Whether samples between the steps draw the motion.
    drawn: bool,
    /// Whether the samples are handed out as they are.
    in_rows: bool,
    reader: EventReader,
    tails: Vec<Tail>,
}

/// Largest number of event samples per part of the motion.
const MOST_LOOKS: f64 = 1e6;

/// Largest number of flights of a tail that are searched for events. From e = 0.99996 on a tail may
/// have more before rounding ends it.
const ARCS: usize = 1_000_000;

/// A run to `t1` from where the integrator starts.
pub(super) fn running<E>(
    mut integrator: SwitchedIntegrator,
    t1: f64,
    output: Output<'_, E>,
) -> Running<'_, E> {
    let Output { t_eval, tstops, dense, drawn, in_rows, events, kicks } = output;
    integrator.flight().look_at_steps(t_eval.is_none());
    let record = MassRecord {
        samples: Samples::default(),
        path: dense.then(DensePath::default),
        drawn: drawn && t_eval.is_none(),
        in_rows,
        reader: EventReader::starting(integrator.t(), integrator.is_at_rest()),
        tails: Vec::new(),
    };
    let start = point(&integrator);
    let running = Running::new((integrator, start), t1, (tstops, t_eval), events, record);
    Running { kicks, ..running }
}

/// Where the integrator is.
fn point(integrator: &SwitchedIntegrator) -> PathPoint {
    let Point { x, xdot, .. } = integrator.now();
    PathPoint { x, xdot, sigma: integrator.sigma() }
}

impl Piecewise for SwitchedIntegrator {
    type Point = PathPoint;
    type Piece = Piece;

    fn t(&self) -> f64 {
        self.now().t
    }

    fn state_to(&self, to: &mut PathPoint) {
        *to = point(self);
    }

    fn restart(&mut self) {
        SwitchedIntegrator::restart(self);
    }

    fn look_from(&mut self, t: f64, _drawn: f64) {
        self.flight().steps_mut().look_from(t);
    }
}

impl<'f, E, F: Force<E>> Advance<Counted<'f, F>, E> for SwitchedIntegrator {
    fn next(&mut self, t_end: f64, force: &mut Counted<'f, F>) -> Result<Piece, Failure<E>> {
        self.step(t_end, force)
    }
}

impl<F> Rhs for Counted<'_, F> {
    fn smooth(&mut self) -> &mut Smooth {
        &mut self.smooth
    }
}

impl Record<SwitchedIntegrator> for MassRecord {
    fn make_room(
        &mut self,
        _: &mut SwitchedIntegrator,
        samples: usize,
        reserve: &mut Reserve,
    ) -> Result<(), TryReserveError> {
        self.reader.events.make_room(reserve)?;
        reserve.room(&mut self.tails, 1, 0)?;
        self.samples.make_room(samples, reserve)?;
        self.path.as_mut().map_or(Ok(()), |path| path.make_room(reserve))
    }

    fn is_dense(&self) -> bool {
        self.path.is_some()
    }
}

impl<'f, E, F: Force<E>> SegmentSink<SwitchedIntegrator, Counted<'f, F>, E> for Running<'_, E> {
    /// A mass that arrives at the wall has its impact first.
    fn begin(&mut self, _until: f64, _: &mut Counted<'f, F>) -> Result<(), Ending<E>> {
        let Self { method, record, .. } = self;
        let (t, before) = (method.t(), point(method));
        let arrives = method.state().arrives();
        if arrives {
            let piece = method.strike(method.now(), method.now());
            method.tell(&piece, false, &mut |it| record.reader.note(it));
        }
        self.arrive();
        self.sample_step();
        self.seeker.start(t, &before).map_err(Failure::Raised)?;
        if arrives {
            self.jumped()?;
        }
        Ok(())
    }

    fn kick(&mut self, _until: f64, _: &mut Counted<'f, F>) -> Result<(), Ending<E>> {
        let Some(PathPoint { x, xdot, .. }) = self.kicked()? else { return Ok(()) };
        let rested = self.method.is_at_rest();
        let t = self.method.t();
        if self.method.start_again(t, Physical { x, xdot }).is_err() {
            return Err(Failure::Status(Status::StateNotFinite).into());
        }
        if rested && !self.method.is_at_rest() {
            self.record.reader.note(Occurrence::Opened { t, gap: 0 });
        }
        self.arrive();
        self.sample_step();
        self.jumped()
    }

    fn absorb(
        &mut self,
        piece: Piece,
        _until: f64,
        force: &mut Counted<'f, F>,
    ) -> Result<(), Ending<E>> {
        match piece {
            Piece::Flight { from, sigma, impact } => self.flight(from, sigma, impact, force),
            Piece::Tail => match self.method.tail().cloned() {
                Some(tail) => self.tail(tail, force),
                None => Ok(()),
            },
            Piece::Rest { from, lifted } => self.rest(from, lifted),
        }
    }
}

impl<E> Running<'_, E> {
    /// A sample at the end of a step, unless the times are given.
    fn sample_step(&mut self) {
        if self.wanted.is_by_steps() {
            self.record.samples.push(self.end.0, self.end.1);
        }
    }

    /// Samples the motion at the wanted times before `t`.
    fn sample_until(&mut self, t: f64, motion: impl Fn(f64) -> PathPoint) {
        while let Some(at) = self.wanted.pass_before(t) {
            self.record.samples.push(at, motion(at));
        }
    }

    fn flight<F: Force<E>>(
        &mut self,
        from: Point,
        sigma: f64,
        impact: Option<Impact>,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Ending<E>> {
        let end = self.method.t();
        if end > self.dense_from() && end > from.t {
            // what no event and no wanted time looks into is kept by what it starts from
            let unseen = self.seeker.is_idle() && self.wanted.is_by_steps();
            let Self { method, record: MassRecord { path, .. }, .. } = self;
            let path = path.as_mut().filter(|_| unseen);
            if !path.is_some_and(|path| method.flight().keep_alone(sigma, path)) {
                self.follow(unseen, sigma, impact, force)?;
            }
        }
        self.arrive();
        self.sample_step();
        let Some(impact) = impact else { return Ok(()) };
        self.record.reader.note(Occurrence::of_mass(impact, self.method.counts().impacts));
        self.jumped()
    }

    /// The curves of a segment, one by one.
    #[inline(never)]
    fn follow<F: Force<E>>(
        &mut self,
        unseen: bool,
        sigma: f64,
        impact: Option<Impact>,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Ending<E>> {
        let end = self.method.t();
        // at the end of a step onto the wall, exactly the state before the impact
        let contact = impact.map(|it| PathPoint { x: 0.0, xdot: it.xdot_before, sigma });
        let last = self.method.flight().curves() - 1;
        for k in 0..=last {
            if k > 0 {
                // one of many steps at once, which are looked at one by one
                if let Some((start, FlightPart { start: SeriesStart { x, .. }, xdot, .. }, _)) =
                    self.method.flight().part(k)
                {
                    self.end = (start, PathPoint { x: x.max(0.0), xdot, sigma });
                }
                self.make_room()?;
                self.method.flight().steps_mut().spend()?;
            }
            let Self { method, record: MassRecord { path, .. }, .. } = self;
            let kept = path.as_mut().is_some_and(|it| method.flight().keep(k, sigma, it));
            if kept && unseen {
                continue;
            }
            let curve = method.flight().curve(k, sigma, force)?;
            if let Some(path) = path.as_mut().filter(|_| !kept) {
                path.push_flight(&curve);
            }
            let ends = if k == last { (end, contact) } else { (curve.end(), None) };
            self.along(&curve, ends)?;
        }
        Ok(())
    }

    /// Events along a curve up to its end, with the state there at a contact.
    fn along(
        &mut self,
        curve: &FlightCurve,
        (end, contact): (f64, Option<PathPoint>),
    ) -> Result<(), Ending<E>> {
        let at = |t: f64| match contact {
            Some(contact) if t >= end => contact,
            _ => curve.at(t),
        };
        let stop = self.seek_along((curve.start, end), at, |it| curve.crossings(it, end));
        self.sample_until(until(&stop, end), |t| curve.at(t));
        unless_terminal(stop)
    }

    /// Events along a part of the motion, which may be longer than a step of an embedded pair would
    /// be: `max_step` bounds the sampling interval.
    fn seek_along(
        &mut self,
        (from, end): (f64, f64),
        motion: impl Fn(f64) -> PathPoint,
        crossings: impl Fn(Level) -> Vec<f64>,
    ) -> Result<Option<LocatedEvent>, E> {
        /// A step of that length is one, whatever rounding makes of it.
        const ROUNDING: f64 = 1.0 - 1e-9;
        if self.seeker.is_idle() {
            return Ok(None);
        }
        let pieces = (ROUNDING * (end - from) / self.method.settings().max_step).ceil();
        let pieces = pieces.clamp(1.0, MOST_LOOKS) as usize;
        let mut t = from;
        for piece in 1..=pieces {
            let part = piece as f64 / pieces as f64;
            let next = if piece == pieces { end } else { from + part * (end - from) };
            let within = |level| {
                let mut all = crossings(level);
                all.retain(|&at| (t < at || piece == 1) && at <= next);
                Some(all)
            };
            let motion = |t: f64, to: &mut PathPoint| *to = motion(t);
            let part = SmoothPart { span: (t, next), motion, crossings: within };
            if let Some(stop) = self.seek(&part)? {
                return Ok(Some(stop));
            }
            t = next;
        }
        Ok(None)
    }

    fn tail<F: Force<E>>(
        &mut self,
        mut tail: Tail,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Ending<E>> {
        let (end, after) = (self.method.t(), point(&self.method));
        if end > self.dense_from() {
            force.bend(&mut tail)?;
        }
        let stop = self.seek_in_tail(&tail, (end, after));
        let until = until(&stop, end);
        self.sample_until(until, |t| tail.at(t));
        tail.cut(until);
        if let Some(path) = &mut self.record.path {
            path.push_tail(&tail);
        }
        self.record.tails.push(tail);
        if until == end {
            self.record.reader.note(Occurrence::rest_of_mass(end));
        }
        unless_terminal(stop)?;
        self.arrive();
        self.sample_step();
        Ok(())
    }

    fn seek_in_tail(
        &mut self,
        tail: &Tail,
        end: (f64, PathPoint),
    ) -> Result<Option<LocatedEvent>, E> {
        if self.seeker.is_idle() {
            return Ok(None);
        }
        let (mut t, mut next) = (tail.start(), tail.arc(0));
        for m in 1..=ARCS {
            let Some(arc) = next else { break };
            let motion = |t: f64, to: &mut PathPoint| *to = arc.at(t);
            let crossings = |level| Some(arc.crossings(level));
            let part = SmoothPart { span: (arc.start, arc.end), motion, crossings };
            if let Some(stop) = self.seek(&part)? {
                return Ok(Some(stop));
            }
            (t, next) = (arc.end, tail.arc(m));
            let after = next.map_or(end.1, |next| next.at(t));
            if let Some(stop) = self.seeker.across(t, &after)? {
                return Ok(Some(stop));
            }
        }
        let motion = |_: f64, to: &mut PathPoint| *to = end.1;
        self.seek(&SmoothPart { span: (t, end.0), motion, crossings: |_| Some(Vec::new()) })
    }

    fn rest(&mut self, from: f64, lifted: bool) -> Result<(), Ending<E>> {
        let (end, at) = (self.method.t(), point(&self.method));
        self.record.reader.note(Occurrence::rest_of_mass(from));
        if end > from {
            if let Some(path) = &mut self.record.path {
                path.push_rest(from, at.sigma);
            }
            let stop = self.seek_along((from, end), |_| at, |_| Vec::new());
            self.sample_until(until(&stop, end), |_| at);
            unless_terminal(stop)?;
        }
        self.arrive();
        if lifted {
            self.record.reader.note(Occurrence::lift_off_of_mass(end));
            if end > from {
                self.sample_step();
            }
        }
        Ok(())
    }

    pub(super) fn finish(
        mut self,
        ending: Ending<E>,
        nfev: u64,
        advise: impl FnOnce(*const f64, usize),
    ) -> Result<SwitchedRun<E>, SetupError> {
        let (status, raised) = self.close(ending);
        let (t, end) = self.end;
        let Self { method, seeker, wanted, record, reserve, .. } = self;
        let MassRecord { mut samples, mut path, drawn, in_rows, reader, tails } = record;
        if wanted.is_missing_at(t, samples.last()) {
            samples.push(t, end);
        }
        if let Some(path) = &mut path {
            path.finish(t, end);
        }
        drop(reserve);
        let transform = method.law().transform();
        let drawn = path.as_ref().filter(|_| drawn);
        let (columns, rows) = if in_rows {
            (Columns::default(), Some(samples))
        } else {
            (samples.columns(drawn, transform, advise)?, None)
        };
        let (events, summary) = (reader.events, None);
        let trajectory =
            Trajectory { columns, summary, events, failed_steps: Vec::new(), status, nfev };
        let counts = Counts { nfev, ..method.counts() };
        let end = (t, Physical { x: end.x, xdot: end.xdot });
        let hits = seeker.into_hits();
        Ok(SwitchedRun { trajectory, raised, rows, path, tails, hits, counts, end })
    }
}

#[cfg(test)]
mod run_tests {
    use super::*;

    #[test]
    fn stops_are_finite_and_increase() {
        assert!(check_stops(&[]).is_ok() && check_stops(&[-1.0, 0.5, 2.0]).is_ok());
        for stops in [&[1.0, 0.5][..], &[1.0, 1.0], &[0.0, f64::INFINITY], &[f64::NAN]] {
            assert!(check_stops(stops).is_err(), "{stops:?}");
        }
    }
}
