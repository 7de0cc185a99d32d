//! A run under way: what each piece of the motion adds to the record.

use super::kinetics::Model;
use super::machine::{Machine, Piece};
use super::path::{Curve, MechanicalPath};
use super::run::{MechanicalOutput, MechanicalRun, MechanicalSamples};
use super::stepper::{Plainly, Stepper};
use super::tail::SkippedArcs;
use crate::record::failure::Failure;
use crate::record::gap_set::GapSet;
use crate::record::monitor::Pace;
use crate::record::point::MotionPoint;
use crate::record::reserve::Reserve;
use crate::record::seeker::{unknown, Seeker, SmoothPart};
use crate::system::dynamics::Dynamics;
use crate::system::stops::Stops;
use crate::{Counts, Hit, Monitor, Status};

/// Why a run ends.
pub(super) enum Ending<E> {
    Failed(Failure<E>),
    /// An event of the user ends it.
    Event(Hit<MotionPoint>),
}

impl<E> From<Failure<E>> for Ending<E> {
    fn from(failure: Failure<E>) -> Self {
        Ending::Failed(failure)
    }
}

/// A run under way.
pub(super) struct Running<'a, E> {
    t1: f64,
    stops: Stops<'a>,
    machine: Machine,
    seeker: Seeker<'a, E, MotionPoint>,
    t_eval: Option<&'a [f64]>,
    /// The next of the wanted times.
    next: usize,
    samples: MechanicalSamples,
    path: Option<MechanicalPath>,
    reserve: Reserve,
    /// What is recorded goes up to here.
    end: (f64, MotionPoint),
    /// Where a sample at a wanted time is made.
    at: MotionPoint,
}

/// The motion over some time, as a function that writes the state.
type Along<'m> = &'m dyn Fn(f64, &mut MotionPoint);

/// Progress is told in parts of the span.
const PARTS: usize = 1_000_000;
/// Most arcs of a tail that events look at one by one.
const ARCS: usize = 1_000_000;
/// Samples and occurrences that a piece of the motion has, at most, by gap.
const OF_A_PIECE: usize = 4;

impl<'a, E> Running<'a, E> {
    /// A run to `t1` from where the machine starts.
    pub(super) fn new(machine: Machine, t1: f64, output: MechanicalOutput<'a, E>) -> Self {
        let layout = machine.layout;
        let now = &machine.now;
        let point = MotionPoint { x: now.x.clone(), v: now.xdot.clone(), closed: machine.closed };
        Self {
            t1,
            stops: Stops::new(output.tstops, t1),
            seeker: Seeker::new(output.events, point.clone()),
            t_eval: output.t_eval,
            next: 0,
            samples: MechanicalSamples::default(),
            path: output.dense.then(|| MechanicalPath::new(layout)),
            reserve: Reserve::default(),
            at: point.clone(),
            end: (now.t, point),
            machine,
        }
    }

    pub(super) fn go<D: Dynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
        monitor: &mut impl Monitor<E>,
    ) -> Ending<E> {
        self.go_with(&mut Plainly, model, monitor)
    }

    /// The same, each piece asked for by someone who follows the motion.
    pub(super) fn go_with<D: Dynamics<E>>(
        &mut self,
        stepper: &mut impl Stepper<E, D>,
        model: &mut Model<'_, D>,
        monitor: &mut impl Monitor<E>,
    ) -> Ending<E> {
        match self.try_go(stepper, model, monitor) {
            Ok(()) => Ending::Failed(Failure::Status(Status::Completed)),
            Err(ending) => ending,
        }
    }

    fn try_go<D: Dynamics<E>>(
        &mut self,
        stepper: &mut impl Stepper<E, D>,
        model: &mut Model<'_, D>,
        monitor: &mut impl Monitor<E>,
    ) -> Result<(), Ending<E>> {
        self.make_room()?;
        let t0 = self.machine.now.t;
        let mut until = self.stops.enter(t0, &mut model.smooth);
        self.seeker.start(t0, &self.end.1).map_err(Failure::Raised)?;
        if !self.machine.is_pending(until) {
            self.at_step(model)?;
        }
        let mut pace = Pace::start();
        loop {
            for _ in 0..pace.chunk() {
                let t = self.machine.now.t;
                let waits = self.machine.is_pending(until.min(self.t1));
                if t >= self.t1 && !waits {
                    return Ok(());
                }
                if t >= until && !waits {
                    self.machine.restart();
                    until = self.stops.enter(t, &mut model.smooth);
                }
                self.piece(until, stepper, model)?;
            }
            let t = self.machine.now.t;
            let done = ((t - t0) / (self.t1 - t0) * PARTS as f64) as usize;
            monitor.poll(done, PARTS).map_err(Failure::Raised)?;
            pace.adjust();
        }
    }

    fn piece<D: Dynamics<E>>(
        &mut self,
        until: f64,
        stepper: &mut impl Stepper<E, D>,
        model: &mut Model<'_, D>,
    ) -> Result<(), Ending<E>> {
        self.make_room()?;
        self.machine.dense_from = self.dense_from();
        let (from, closed) = (self.machine.now.t, self.machine.closed);
        match stepper.step(&mut self.machine, until, model)? {
            Piece::Motion => self.motion(from, closed, model)?,
            Piece::Skipped(arcs) => self.skipped(&arcs, closed, model)?,
            Piece::Instant => {
                self.arrive();
                let (t, point) = &self.end;
                let stop = self.seeker.across(*t, point).map_err(Failure::Raised)?;
                self.unless_terminal(stop)?;
            }
        }
        if self.machine.is_pending(until) {
            return Ok(());
        }
        self.at_step(model)
    }

    /// From when on the motion between the ends of steps is asked for.
    fn dense_from(&self) -> f64 {
        if self.path.is_some() || !self.seeker.is_idle() {
            f64::NEG_INFINITY
        } else {
            self.next_wanted().unwrap_or(f64::INFINITY)
        }
    }

    /// Makes room for what the next piece of the motion adds: where there is none, the run ends
    /// with all that it has.
    fn make_room(&mut self) -> Result<(), Failure<E>> {
        let Self { samples, path, seeker, reserve, machine, t_eval, next, .. } = self;
        let (size, m) = (machine.now.x.len(), machine.layout.m);
        let count = t_eval.map_or(OF_A_PIECE, |times| times.len() - *next + 1);
        samples.make_room(reserve, count, size, m)?;
        reserve.room(&mut machine.occurrences, OF_A_PIECE * (m + 1), 2 * size_of::<f64>())?;
        seeker.make_room(reserve)?;
        if let Some(path) = path {
            path.make_room(reserve)?;
        }
        Ok(())
    }

    /// The end of what is recorded moves to the present state.
    fn arrive(&mut self) {
        let now = &self.machine.now;
        self.end.0 = now.t;
        self.end.1.x.clone_from(&now.x);
        self.end.1.v.clone_from(&now.xdot);
        self.end.1.closed = self.machine.closed;
    }

    fn motion<D: Dynamics<E>>(
        &mut self,
        from: f64,
        closed: GapSet,
        model: &mut Model<'_, D>,
    ) -> Result<(), Ending<E>> {
        let end = self.machine.now.t;
        if end > self.dense_from() && end > from {
            let length = self.machine.length;
            let curve = Curve::new(&self.machine.stages, &self.machine.now, length);
            if let Some(path) = &mut self.path {
                path.push_motion(&curve, closed);
            }
            let motion = |t: f64, to: &mut MotionPoint| {
                curve.at(t, &mut to.x, &mut to.v);
                to.closed = closed;
            };
            let stop = self.seek((from, end), &motion).map_err(Failure::Raised)?;
            self.sample_until(stop.as_ref().map_or(end, |hit| hit.t), &motion, model)?;
            self.unless_terminal(stop)?;
        }
        self.arrive();
        Ok(())
    }

    fn skipped<D: Dynamics<E>>(
        &mut self,
        arcs: &SkippedArcs,
        closed: GapSet,
        model: &mut Model<'_, D>,
    ) -> Result<(), Ending<E>> {
        let end = self.machine.now.t;
        let motion = |t: f64, to: &mut MotionPoint| {
            arcs.at(t, &mut to.x, &mut to.v);
            to.closed = closed;
        };
        if let Some(path) = &mut self.path {
            path.push_skipped(arcs, closed);
        }
        let stop = self.seek_in_arcs(arcs, closed, &motion).map_err(Failure::Raised)?;
        self.sample_until(stop.as_ref().map_or(end, |hit| hit.t), &motion, model)?;
        self.unless_terminal(stop)?;
        self.arrive();
        Ok(())
    }

    /// Events along a smooth part of the motion.
    fn seek(
        &mut self,
        span: (f64, f64),
        motion: impl Fn(f64, &mut MotionPoint),
    ) -> Result<Option<Hit<MotionPoint>>, E> {
        self.seeker.along(&SmoothPart { span, motion, crossings: unknown })
    }

    fn seek_in_arcs(
        &mut self,
        arcs: &SkippedArcs,
        closed: GapSet,
        motion: Along<'_>,
    ) -> Result<Option<Hit<MotionPoint>>, E> {
        if self.seeker.is_idle() {
            return Ok(None);
        }
        let mut t = arcs.start;
        for m in 0..ARCS {
            let Some((_, end)) = arcs.arc(m) else { break };
            // up to the next impact from before it, then from after it
            let before = |at: f64, to: &mut MotionPoint| {
                arcs.at_before(at, m, &mut to.x, &mut to.v);
                to.closed = closed;
            };
            if let Some(stop) = self.seek((t, end), before)? {
                return Ok(Some(stop));
            }
            t = end;
            motion(t, &mut self.at);
            if let Some(stop) = self.seeker.across(t, &self.at)? {
                return Ok(Some(stop));
            }
        }
        let end = self.machine.now.t;
        if let Some(stop) = self.seek((t, end), motion)? {
            return Ok(Some(stop));
        }
        let now = &self.machine.now;
        self.at.x.copy_from_slice(&now.x);
        self.at.v.copy_from_slice(&now.xdot);
        self.at.closed = self.machine.closed;
        self.seeker.across(now.t, &self.at)
    }

    /// An event that ends the run is passed on like an error.
    fn unless_terminal(&mut self, stop: Option<Hit<MotionPoint>>) -> Result<(), Ending<E>> {
        stop.map_or(Ok(()), |hit| Err(Ending::Event(hit)))
    }

    fn next_wanted(&self) -> Option<f64> {
        self.t_eval.and_then(|times| times.get(self.next).copied())
    }

    /// Samples the motion at the wanted times before `t`.
    fn sample_until<D: Dynamics<E>>(
        &mut self,
        t: f64,
        motion: Along<'_>,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        while let Some(at) = self.next_wanted().filter(|&next| next < t) {
            motion(at, &mut self.at);
            let n = self.machine.layout.n;
            let MotionPoint { x, v, closed } = &mut self.at;
            for gap in closed.iter() {
                (x[n + gap], v[n + gap]) = (0.0, 0.0);
            }
            let aside = &mut self.machine.aside;
            if closed.is_empty() {
                aside.lambda.fill(0.0);
            } else {
                aside.evaluate(model, at, &x[..n], &v[..n])?;
                aside.contact(*closed)?;
            }
            self.samples.push(at, (x, v), &aside.lambda, *closed);
            self.next += 1;
        }
        Ok(())
    }

    /// A sample at the present state, if one is wanted.
    fn at_step<D: Dynamics<E>>(&mut self, model: &mut Model<'_, D>) -> Result<(), Ending<E>> {
        let t = self.machine.now.t;
        match self.t_eval {
            None => (),
            Some(_) if self.next_wanted() == Some(t) => self.next += 1,
            Some(_) => return Ok(()),
        }
        self.machine.prepare(model)?;
        // an anchored gap
        self.arrive();
        let (now, lambda) = (&self.machine.now, &self.machine.lambda);
        self.samples.push(t, (&now.x, &now.xdot), lambda, self.machine.closed);
        Ok(())
    }

    pub(super) fn finish(mut self, ending: Ending<E>, nfev: u64) -> MechanicalRun<E> {
        let (status, raised) = match ending {
            Ending::Failed(Failure::Status(status)) => (status, None),
            Ending::Failed(Failure::Raised(error)) => (Status::Raised, Some(error)),
            Ending::Event(Hit { t, at }) => {
                self.end = (t, at);
                (Status::TerminatedByEvent, None)
            }
        };
        let (t, point) = &self.end;
        let wanted = match self.t_eval {
            Some(_) => self.next_wanted() == Some(*t),
            None => self.samples.t.last().is_none_or(|last| last < t),
        };
        if wanted {
            let none = vec![0.0; self.machine.layout.m];
            self.samples.push(*t, (&point.x, &point.v), &none, point.closed);
        }
        drop(self.reserve);
        if let Some(path) = &mut self.path {
            path.end = Some(self.end);
        }
        let Self { machine, samples, path, seeker, .. } = self;
        MechanicalRun {
            layout: machine.layout,
            samples,
            occurrences: machine.occurrences,
            hits: seeker.into_hits(),
            path,
            status,
            raised,
            counts: Counts { nfev, ..machine.counts },
        }
    }
}
