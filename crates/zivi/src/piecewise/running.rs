//! A run in progress.

use crate::piecewise::steps::{Driver, Piecewise, Rhs};
use crate::record::columns::Reserve;
use crate::record::status::{Failure, PollInterval};
use crate::record::user_events::{EventLocator, LocatedEvent, Part, UserEvent};
use crate::system::force::Stops;
use crate::{Monitor, Status};
use std::collections::TryReserveError;

/// Velocity jumps: at each declared time it is called with the state, may change it, and returns
/// whether it did.
pub type Kick<'a, E, P> = Box<dyn FnMut(f64, &mut P) -> Result<bool, E> + 'a>;

/// Why a run ends.
pub(crate) enum Ending<E, P> {
    Failed(Failure<E>),
    /// An event of the user ends it.
    Event(Box<LocatedEvent<P>>),
}

impl<E, P> From<Failure<E>> for Ending<E, P> {
    fn from(failure: Failure<E>) -> Self {
        Ending::Failed(failure)
    }
}

/// Record of the motion of a method, in addition to user events.
pub(crate) trait Record<M> {
    /// Makes room for the next segment of the motion, with a maximal number of samples.
    fn make_room(
        &mut self,
        method: &mut M,
        samples: usize,
        reserve: &mut Reserve,
    ) -> Result<(), TryReserveError>;

    /// Whether the motion is kept as a function of time.
    fn is_dense(&self) -> bool;

    /// Whether all of the motion is, and not parts of it only.
    fn is_whole(&self) -> bool {
        self.is_dense()
    }
}

/// A run that records the segments of a method that calls `S`.
pub(crate) trait SegmentSink<M: Piecewise, S, E> {
    /// The initial state, in an interval that ends at `until`.
    fn begin(&mut self, until: f64, asked: &mut S) -> Result<(), Ending<E, M::Point>>;

    /// The velocities change at a declared time.
    fn kick(&mut self, until: f64, asked: &mut S) -> Result<(), Ending<E, M::Point>>;

    /// A segment of the motion, after which the method is where it ends.
    fn absorb(
        &mut self,
        piece: M::Piece,
        until: f64,
        asked: &mut S,
    ) -> Result<(), Ending<E, M::Point>>;
}

/// A run in progress.
pub(crate) struct Running<'a, E, M: Piecewise, R> {
    pub(crate) t1: f64,
    pub(crate) stops: Stops<'a>,
    pub(crate) method: M,
    pub(crate) kicks: Option<Kick<'a, E, M::Point>>,
    pub(crate) seeker: EventLocator<'a, E, M::Point>,
    pub(crate) wanted: OutputTimes<'a>,
    pub(crate) record: R,
    /// Reserve for the arrays made from the lists of the record.
    pub(crate) reserve: Reserve,
    /// End of the recorded motion.
    pub(crate) end: (f64, M::Point),
}

/// Progress is reported in parts of the span.
const PARTS: usize = 1_000_000;

impl<'a, E, M: Piecewise, R: Record<M>> Running<'a, E, M, R> {
    /// A run to `t1` from where a method starts, at a state, with the times at which the forces are
    /// not smooth and the output times.
    pub(crate) fn new(
        (method, start): (M, M::Point),
        t1: f64,
        (tstops, t_eval): (&'a [f64], Option<&'a [f64]>),
        events: Vec<UserEvent<'a, E, M::Point>>,
        record: R,
    ) -> Self {
        Self {
            t1,
            stops: Stops::new(tstops, t1),
            kicks: None,
            seeker: EventLocator::new(events, start.clone(), t1 - method.t()),
            wanted: OutputTimes::new(t_eval),
            record,
            reserve: Reserve::default(),
            end: (method.t(), start),
            method,
        }
    }

    /// Processes the segments of a driver to the end.
    pub(crate) fn go<S: Rhs>(
        &mut self,
        driver: &mut impl Driver<M, S, E>,
        asked: &mut S,
        monitor: &mut impl Monitor<E>,
    ) -> Ending<E, M::Point>
    where
        Self: SegmentSink<M, S, E>,
    {
        match self.try_go(driver, asked, monitor) {
            Ok(()) => Ending::Failed(Failure::Status(Status::Completed)),
            Err(ending) => ending,
        }
    }

    fn try_go<S: Rhs>(
        &mut self,
        driver: &mut impl Driver<M, S, E>,
        asked: &mut S,
        monitor: &mut impl Monitor<E>,
    ) -> Result<(), Ending<E, M::Point>>
    where
        Self: SegmentSink<M, S, E>,
    {
        self.make_room()?;
        let t0 = self.method.t();
        let mut until = self.stops.enter(t0, asked.smooth());
        self.begin(until, asked)?;
        let mut pace = PollInterval::start();
        loop {
            for _ in 0..pace.chunk() {
                if self.is_over(until) {
                    break;
                }
                let t = self.method.t();
                if t >= until && !self.method.is_pending(until) {
                    self.method.restart();
                    until = self.stops.enter(t, asked.smooth());
                    driver.enter(&mut self.method, asked)?;
                    if self.kicks.is_some() {
                        self.make_room()?;
                        self.kick(until, asked)?;
                        continue;
                    }
                }
                self.make_room()?;
                self.method.look_from(self.dense_from(), self.drawn_from());
                let piece = driver.step(&mut self.method, until, asked)?;
                self.absorb(piece, until, asked)?;
            }
            let done = ((self.method.t() - t0) / (self.t1 - t0) * PARTS as f64) as usize;
            monitor.poll(done, PARTS).map_err(Failure::Raised)?;
            if self.is_over(until) {
                return Ok(());
            }
            pace.adjust();
        }
    }

    fn is_over(&self, until: f64) -> bool {
        self.method.t() >= self.t1 && !self.method.is_pending(until)
    }

    /// Makes room in the record for the next segment of the motion; without memory, the run ends
    /// with its results so far.
    pub(crate) fn make_room(&mut self) -> Result<(), Failure<E>> {
        let Self { method, record, seeker, wanted, reserve, .. } = self;
        record.make_room(method, wanted.at_most(), reserve)?;
        Ok(seeker.make_room(reserve)?)
    }

    /// From when on the motion between the ends of steps is requested.
    pub(crate) fn dense_from(&self) -> f64 {
        if self.record.is_dense() || !self.seeker.is_idle() {
            f64::NEG_INFINITY
        } else {
            self.wanted.next().unwrap_or(f64::INFINITY)
        }
    }

    /// From when on the motion within steps is requested (s).
    pub(crate) fn drawn_from(&self) -> f64 {
        if self.record.is_whole() || !self.seeker.is_idle() {
            f64::NEG_INFINITY
        } else {
            self.wanted.next().unwrap_or(f64::INFINITY)
        }
    }

    /// Moves the end of the record to the present state.
    pub(crate) fn arrive(&mut self) {
        self.end.0 = self.method.t();
        self.method.state_to(&mut self.end.1);
    }

    /// The present state with the velocities after a jump; `None` without one.
    pub(crate) fn kicked(&mut self) -> Result<Option<M::Point>, Failure<E>> {
        let Some(kick) = &mut self.kicks else { return Ok(None) };
        let mut after = self.end.1.clone();
        self.method.state_to(&mut after);
        let is_kicked = kick(self.method.t(), &mut after).map_err(Failure::Raised)?;
        Ok(is_kicked.then_some(after))
    }

    /// Events along a part of the motion.
    pub(crate) fn seek(
        &mut self,
        part: &impl Part<M::Point>,
    ) -> Result<Option<LocatedEvent<M::Point>>, E> {
        self.seeker.along(part)
    }

    /// Events at the jump at the end of the record.
    pub(crate) fn jumped(&mut self) -> Result<(), Ending<E, M::Point>> {
        if self.seeker.is_idle() {
            return Ok(());
        }
        let (t, after) = &self.end;
        unless_terminal(self.seeker.across(*t, after))
    }

    /// Takes note of why the run ended.
    pub(crate) fn close(&mut self, ending: Ending<E, M::Point>) -> (Status, Option<E>) {
        match ending {
            Ending::Failed(Failure::Status(status)) => (status, None),
            Ending::Failed(Failure::Raised(error)) => (Status::Raised, Some(error)),
            Ending::Event(hit) => {
                let LocatedEvent { t, at } = *hit;
                self.end = (t, at);
                (Status::TerminatedByEvent, None)
            }
        }
    }
}

/// An event that ends the run is passed on like an error.
pub(crate) fn unless_terminal<E, P>(
    found: Result<Option<LocatedEvent<P>>, E>,
) -> Result<(), Ending<E, P>> {
    match found {
        Ok(None) => Ok(()),
        Ok(Some(hit)) => Err(Ending::Event(Box::new(hit))),
        Err(error) => Err(Ending::Failed(Failure::Raised(error))),
    }
}

/// The end of a part of the motion, or the earlier event that ends the run.
pub(crate) fn until<E, P>(found: &Result<Option<LocatedEvent<P>>, E>, end: f64) -> f64 {
    match found {
        Ok(Some(hit)) => hit.t,
        _ => end,
    }
}

// The times at which samples are wanted.

/// Output times in order; without them, samples are taken at the ends of steps.
#[derive(Clone, Copy, Debug)]
pub(crate) struct OutputTimes<'a> {
    /// Increasing.
    times: Option<&'a [f64]>,
    /// How many of them are passed.
    passed: usize,
}

impl<'a> OutputTimes<'a> {
    pub(crate) fn new(times: Option<&'a [f64]>) -> Self {
        Self { times, passed: 0 }
    }

    /// Whether samples are at the ends of steps.
    pub(crate) fn is_by_steps(&self) -> bool {
        self.times.is_none()
    }

    /// The next of the times.
    pub(crate) fn next(&self) -> Option<f64> {
        self.times.and_then(|times| times.get(self.passed).copied())
    }

    /// Passes the next time if before `t`.
    pub(crate) fn pass_before(&mut self, t: f64) -> Option<f64> {
        let next = self.next().filter(|&next| next < t)?;
        self.passed += 1;
        Some(next)
    }

    /// Whether there is a sample at the end `t` of a step; passes that time.
    pub(crate) fn pass_at(&mut self, t: f64) -> bool {
        let here = self.next() == Some(t);
        self.passed += usize::from(here);
        self.is_by_steps() || here
    }

    /// Whether a sample is missing where the run ends, after the last one at `last`.
    pub(crate) fn is_missing_at(&self, t: f64, last: Option<f64>) -> bool {
        match self.times {
            Some(_) => self.next() == Some(t),
            None => last.is_none_or(|last| last < t),
        }
    }

    /// Maximal number of further samples: at the ends of a segment, or at the end and all output
    /// times.
    pub(crate) fn at_most(&self) -> usize {
        const OF_A_PIECE: usize = 4;
        self.times.map_or(OF_A_PIECE, |times| times.len() - self.passed + 1)
    }
}

#[cfg(test)]
mod output_times_tests {
    use super::*;

    #[test]
    fn times_are_passed_one_after_the_other() {
        let mut wanted = OutputTimes::new(Some(&[1.0, 2.0, 3.0]));
        assert_eq!(wanted.at_most(), 4);
        assert_eq!((wanted.pass_before(2.0), wanted.pass_before(2.0)), (Some(1.0), None));
        assert!(wanted.pass_at(2.0) && !wanted.pass_at(2.0) && !wanted.pass_at(2.5));
        assert!(wanted.is_missing_at(3.0, None) && !wanted.is_missing_at(2.5, None));
        assert_eq!((wanted.next(), wanted.at_most()), (Some(3.0), 2));
    }

    #[test]
    fn without_times_each_end_of_a_step_is_one() {
        let mut wanted = OutputTimes::new(None);
        assert!(wanted.is_by_steps() && wanted.pass_at(0.5) && wanted.pass_at(0.5));
        assert_eq!((wanted.next(), wanted.pass_before(9.0)), (None, None));
        assert!(wanted.is_missing_at(1.0, Some(0.5)) && !wanted.is_missing_at(1.0, Some(1.0)));
    }
}
