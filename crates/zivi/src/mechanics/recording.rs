//! A run under way: what each piece of the motion adds to the record.

use std::collections::TryReserveError;

use super::integrator::MechanicalIntegrator;
use super::kinetics::Model;
use super::output::{MechanicalOutput, MechanicalRun, MechanicalSamples, SpeedLog};
use super::path::{Curve, MechanicalPath};
use super::piece::{Flight, Piece};
use super::tail::SkippedArcs;
use crate::piecewise::method::{Advance, Piecewise, Rhs};
use crate::piecewise::running::{self as piecewise, unless_terminal, until, Record, SegmentSink};
use crate::record::contact_mode::ContactMode;
use crate::record::event_locator::{unknown, SmoothPart};
use crate::record::failure::Failure;
use crate::record::point::MotionPoint;
use crate::record::reserve::Reserve;
use crate::system::dynamics::Dynamics;
use crate::system::stops::Smooth;
use crate::{Counts, LocatedEvent, Status};

/// A run of a mechanical system under way.
pub(super) type Running<'a, E> = piecewise::Running<'a, E, MechanicalIntegrator, MechanicalRecord>;

type Ending<E> = piecewise::Ending<E, MotionPoint>;

/// What a run of a mechanical system records, besides the occurrences.
pub(super) struct MechanicalRecord {
    samples: MechanicalSamples,
    /// Where only the ends are sampled.
    speeds: Option<SpeedLog>,
    path: Option<MechanicalPath>,
    /// Whether the path is the whole motion, and not the arcs only that jumps skip.
    is_whole: bool,
    /// Where a sample at a wanted time is made.
    at: MotionPoint,
}

/// The motion over some time, as a function that writes the state.
type Along<'m> = &'m dyn Fn(f64, &mut MotionPoint);

/// Most arcs of a tail that events look at one by one.
const ARCS: usize = 1_000_000;

/// A run to `t1` from where the machine starts.
pub(super) fn running<E>(
    machine: MechanicalIntegrator,
    t1: f64,
    output: MechanicalOutput<'_, E>,
) -> Running<'_, E> {
    let MechanicalOutput { t_eval, tstops, ends, dense, arcs, events } = output;
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
    Running::new((machine, start), t1, (tstops, t_eval), events, record)
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

    fn absorb(
        &mut self,
        piece: Piece,
        until: f64,
        model: &mut Model<'f, D>,
    ) -> Result<(), Ending<E>> {
        // since the last piece
        let (from, mode) = (self.end.0, self.end.1.mode);
        match piece {
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

    pub(super) fn finish(mut self, ending: Ending<E>, nfev: u64) -> MechanicalRun<E> {
        let (status, raised) = self.close(ending);
        let Self { method: machine, seeker, wanted, record, reserve, end, .. } = self;
        let MechanicalRecord { mut samples, mut speeds, mut path, .. } = record;
        let (t, point) = &end;
        let (layout, counts) = (machine.state().layout(), machine.counts());
        let mut occurrences = machine.into_occurrences();
        // an event among skipped arcs ends the run before what they lead to
        occurrences.retain(|it| it.t() <= *t || status != Status::TerminatedByEvent);
        if wanted.is_missing_at(*t, samples.t.last().copied()) {
            if let Some(log) = &mut speeds {
                log.note(*t, &point.v[..layout.n], &occurrences);
            }
            let none = vec![0.0; layout.rows()];
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
