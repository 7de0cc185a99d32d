//! A run under way: what each piece of the motion adds to the record.

use super::integrator::{Counts, Piece, SwitchedIntegrator};
use super::path::{Curve, DensePath};
use super::picture::between_steps;
use super::run::{Output, SwitchedRun};
use super::samples::Samples;
use super::stages::{Counted, Point};
use super::stepper::Stepper;
use crate::record::events::Reader;
use crate::record::failure::Failure;
use crate::record::monitor::Pace;
use crate::record::reserve::Reserve;
use crate::record::seeker::{Seeker, SmoothPart};
use crate::record::trajectory::{SetupError, Trajectory};
use crate::record::user_events::{Hit, Level};
use crate::system::stops::Stops;
use crate::zeno::tail::Tail;
use crate::{Force, Impact, Monitor, Occurrence, PathPoint, Physical, Status};

/// Why a run ends.
pub(super) enum Ending<E> {
    Failed(Failure<E>),
    /// An event of the user ends it.
    Event(Hit),
}

impl<E> From<Failure<E>> for Ending<E> {
    fn from(failure: Failure<E>) -> Self {
        Ending::Failed(failure)
    }
}

/// An event that ends the run is passed on like an error.
fn unless_terminal<E>(found: Result<Option<Hit>, E>) -> Result<(), Ending<E>> {
    match found {
        Ok(None) => Ok(()),
        Ok(Some(hit)) => Err(Ending::Event(hit)),
        Err(error) => Err(Ending::Failed(Failure::Raised(error))),
    }
}

/// A run under way.
pub(super) struct Running<'a, E> {
    t1: f64,
    stops: Stops<'a>,
    integrator: SwitchedIntegrator,
    seeker: Seeker<'a, E, PathPoint>,
    samples: Samples<'a>,
    path: Option<DensePath>,
    /// Whether samples between the steps draw the motion.
    drawn: bool,
    reader: Reader,
    tails: Vec<Tail>,
    /// Set aside for what is made of all these lists.
    reserve: Reserve,
    /// What is recorded goes up to here.
    end: (f64, PathPoint),
}

/// Progress is told in parts of the span.
const PARTS: usize = 1_000_000;

/// Pieces of one part of the motion that events look at.
const MOST_LOOKS: f64 = 1e6;

/// Most arcs of a tail that events look at one by one. From e = 0.99996 on a tail may have more
/// before rounding ends it.
const ARCS: usize = 1_000_000;

impl<'a, E> Running<'a, E> {
    /// A run to `t1` from where the integrator starts.
    pub(super) fn new(mut integrator: SwitchedIntegrator, t1: f64, output: Output<'a, E>) -> Self {
        let start = PathPoint { x: 0.0, xdot: 0.0, sigma: 1.0 };
        integrator.looks.by_steps = output.t_eval.is_none();
        let reader = Reader::starting(integrator.now.t, integrator.is_at_rest());
        Self {
            t1,
            stops: Stops::new(output.tstops, t1),
            end: (integrator.now.t, start),
            integrator,
            seeker: Seeker::new(output.events, start),
            samples: Samples::new(output.t_eval),
            path: output.dense.then(DensePath::default),
            drawn: output.drawn && output.t_eval.is_none(),
            reader,
            tails: Vec::new(),
            reserve: Reserve::default(),
        }
    }

    /// Where the integrator is.
    pub(super) fn now(&self) -> Point {
        self.integrator.now
    }

    /// Takes the steps of a stepper to the end.
    pub(super) fn go<F: Force<E>>(
        &mut self,
        stepper: &mut impl Stepper<E, F>,
        force: &mut Counted<'_, F>,
        monitor: &mut impl Monitor<E>,
    ) -> Ending<E> {
        match self.try_go(stepper, force, monitor) {
            Ok(()) => Ending::Failed(Failure::Status(Status::Completed)),
            Err(ending) => ending,
        }
    }

    fn try_go<F: Force<E>>(
        &mut self,
        stepper: &mut impl Stepper<E, F>,
        force: &mut Counted<'_, F>,
        monitor: &mut impl Monitor<E>,
    ) -> Result<(), Ending<E>> {
        self.begin()?;
        let mut pace = Pace::start();
        let t0 = self.integrator.now.t;
        let mut until = self.stops.enter(t0, &mut force.smooth);
        loop {
            for _ in 0..pace.chunk() {
                if self.integrator.now.t >= self.t1 {
                    break;
                }
                if self.integrator.now.t >= until {
                    self.integrator.restart();
                    until = self.stops.enter(self.integrator.now.t, &mut force.smooth);
                }
                self.make_room()?;
                self.integrator.looks.dense_from = self.dense_from();
                let piece = stepper.step(&mut self.integrator, until, force)?;
                self.absorb(piece, force)?;
            }
            let t = self.integrator.now.t;
            let done = ((t - t0) / (self.t1 - t0) * PARTS as f64) as usize;
            monitor.poll(done, PARTS).map_err(Failure::Raised)?;
            if t >= self.t1 {
                return Ok(());
            }
            pace.adjust();
        }
    }

    /// Makes room for what the next piece of the motion adds to the record: where there is none,
    /// the run ends with all that it has.
    fn make_room(&mut self) -> Result<(), Failure<E>> {
        let Self { samples, path, reader, tails, seeker, reserve, .. } = self;
        reader.events.make_room(reserve)?;
        reserve.room(tails, 1, 0)?;
        samples.make_room(reserve)?;
        seeker.make_room(reserve)?;
        if let Some(path) = path {
            path.make_room(reserve)?;
        }
        Ok(())
    }

    /// From when on the motion between the ends of steps is asked for.
    fn dense_from(&self) -> f64 {
        if self.path.is_some() || !self.seeker.is_idle() {
            f64::NEG_INFINITY
        } else {
            self.samples.next_wanted().unwrap_or(f64::INFINITY)
        }
    }

    /// The initial state; a mass that arrives at the wall has its impact first.
    fn begin(&mut self) -> Result<(), Ending<E>> {
        let Point { t, x, xdot, .. } = self.integrator.now;
        let before = PathPoint { x, xdot, sigma: self.integrator.sigma };
        let arrives = self.integrator.state().arrives();
        if arrives {
            let piece = self.integrator.strike(self.integrator.now, self.integrator.now);
            self.integrator.tell(&piece, false, &mut |it| self.reader.note(it));
        }
        self.end = self.here();
        self.samples.at_step(t, self.end.1);
        self.seeker.start(t, &before).map_err(Failure::Raised)?;
        if arrives {
            self.jumped()?;
        }
        Ok(())
    }

    /// The state of the integrator.
    fn here(&self) -> (f64, PathPoint) {
        let (Point { t, x, xdot, .. }, sigma) = (self.integrator.now, self.integrator.sigma);
        (t, PathPoint { x, xdot, sigma })
    }

    fn absorb<F: Force<E>>(
        &mut self,
        piece: Piece,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Ending<E>> {
        match piece {
            Piece::Flight { from, sigma, impact } => self.flight(from, sigma, impact, force),
            Piece::Tail(tail) => self.tail(tail),
            Piece::Rest { from, lifted } => self.rest(from, lifted),
        }
    }

    fn flight<F: Force<E>>(
        &mut self,
        from: Point,
        sigma: f64,
        impact: Option<Impact>,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Ending<E>> {
        let end = self.here();
        if end.0 > self.dense_from() && end.0 > from.t {
            // at the end of a step onto the wall, exactly the state before the impact
            let contact = impact.map(|it| PathPoint { x: 0.0, xdot: it.xdot_before, sigma });
            let last = self.integrator.curves::<E, F>() - 1;
            for k in 0..=last {
                let curve = self.integrator.curve(k, sigma, force)?;
                if k > 0 {
                    // one of many steps at once, which are looked at one by one
                    self.end = (curve.start, curve.at(curve.start));
                    self.make_room()?;
                    self.integrator.spend()?;
                }
                let ends = if k == last { (end.0, contact) } else { (curve.end(), None) };
                self.along(&curve, ends)?;
            }
        }
        self.end = end;
        if let Some(impact) = impact {
            self.reader.note(Occurrence::of_mass(impact, self.integrator.counts.impacts));
            self.samples.at_step(end.0, end.1);
            return self.jumped();
        }
        self.samples.at_step(end.0, end.1);
        Ok(())
    }

    /// What there is along a curve up to where it ends, with the state there at a contact.
    fn along(
        &mut self,
        curve: &Curve,
        (end, contact): (f64, Option<PathPoint>),
    ) -> Result<(), Ending<E>> {
        if let Some(path) = &mut self.path {
            path.push_flight(curve);
        }
        let at = |t: f64| match contact {
            Some(contact) if t >= end => contact,
            _ => curve.at(t),
        };
        let stop = self.seek((curve.start, end), at, |it| curve.crossings(it, end));
        let until = until(&stop, end);
        self.samples.along(until, |t| curve.at(t));
        unless_terminal(stop)
    }

    /// Events along a part of the motion, which may be longer than a step of an embedded pair would
    /// be: `max_step` bounds what is looked at in one.
    fn seek(
        &mut self,
        (from, end): (f64, f64),
        motion: impl Fn(f64) -> PathPoint,
        crossings: impl Fn(Level) -> Vec<f64>,
    ) -> Result<Option<Hit>, E> {
        /// A step of that length is one, whatever rounding makes of it.
        const ROUNDING: f64 = 1.0 - 1e-9;
        if self.seeker.is_idle() {
            return Ok(None);
        }
        let pieces = (ROUNDING * (end - from) / self.integrator.settings.max_step).ceil();
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
            if let Some(stop) = self.seeker.along(&part)? {
                return Ok(Some(stop));
            }
            t = next;
        }
        Ok(None)
    }

    /// Events by the jump of the velocity.
    fn jumped(&mut self) -> Result<(), Ending<E>> {
        unless_terminal(self.seeker.across(self.end.0, &self.end.1))
    }

    fn tail(&mut self, mut tail: Tail) -> Result<(), Ending<E>> {
        let end = self.here();
        let stop = self.seek_in_tail(&tail, end);
        let until = until(&stop, end.0);
        self.samples.along(until, |t| tail.at(t));
        tail.cut(until);
        if let Some(path) = &mut self.path {
            path.push_tail(&tail);
        }
        self.tails.push(tail);
        if until == end.0 {
            self.reader.note(Occurrence::rest_of_mass(end.0));
        }
        unless_terminal(stop)?;
        self.end = end;
        self.samples.at_step(end.0, end.1);
        Ok(())
    }

    fn seek_in_tail(&mut self, tail: &Tail, end: (f64, PathPoint)) -> Result<Option<Hit>, E> {
        if self.seeker.is_idle() {
            return Ok(None);
        }
        let (mut t, mut next) = (tail.start(), tail.arc(0));
        for m in 1..=ARCS {
            let Some(arc) = next else { break };
            let motion = |t: f64, to: &mut PathPoint| *to = arc.at(t);
            let crossings = |level| Some(arc.crossings(level));
            let part = SmoothPart { span: (arc.start, arc.end), motion, crossings };
            if let Some(stop) = self.seeker.along(&part)? {
                return Ok(Some(stop));
            }
            (t, next) = (arc.end, tail.arc(m));
            let after = next.map_or(end.1, |next| next.at(t));
            if let Some(stop) = self.seeker.across(t, &after)? {
                return Ok(Some(stop));
            }
        }
        let motion = |_: f64, to: &mut PathPoint| *to = end.1;
        self.seeker.along(&SmoothPart { span: (t, end.0), motion, crossings: |_| Some(Vec::new()) })
    }

    fn rest(&mut self, from: f64, lifted: bool) -> Result<(), Ending<E>> {
        let end = self.here();
        self.reader.note(Occurrence::rest_of_mass(from));
        if end.0 > from {
            if let Some(path) = &mut self.path {
                path.push_rest(from, end.1.sigma);
            }
            let stop = self.seek((from, end.0), |_| end.1, |_| Vec::new());
            let until = until(&stop, end.0);
            self.samples.along(until, |_| end.1);
            unless_terminal(stop)?;
        }
        self.end = end;
        if lifted {
            self.reader.note(Occurrence::lift_off_of_mass(end.0));
            if end.0 > from {
                self.samples.at_step(end.0, end.1);
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
        let (status, raised) = match ending {
            Ending::Failed(Failure::Status(status)) => (status, None),
            Ending::Failed(Failure::Raised(error)) => (Status::Raised, Some(error)),
            Ending::Event(Hit { t, at }) => {
                self.end = (t, at);
                (Status::TerminatedByEvent, None)
            }
        };
        let (t, end) = self.end;
        self.samples.at_end(t, end);
        if let Some(path) = &mut self.path {
            path.finish(t, end);
            if self.drawn {
                // without the memory for them the samples at the steps are all
                if let Ok(rows) = between_steps(path) {
                    self.samples.add(&rows, &mut self.reserve);
                }
            }
        }
        drop(self.reserve);
        let columns = self.samples.into_columns(self.integrator.restitution, advise)?;
        let events = self.reader.events;
        let summary = None;
        let trajectory =
            Trajectory { columns, summary, events, failed_steps: Vec::new(), status, nfev };
        let counts = Counts { nfev, ..self.integrator.counts };
        let (path, tails, hits) = (self.path, self.tails, self.seeker.into_hits());
        let end = (t, Physical { x: end.x, xdot: end.xdot });
        Ok(SwitchedRun { trajectory, raised, path, tails, hits, counts, end })
    }
}

/// The end of a part of the motion, or where an event ends the run before.
fn until<E>(stop: &Result<Option<Hit>, E>, end: f64) -> f64 {
    match stop {
        Ok(Some(hit)) => hit.t,
        _ => end,
    }
}
