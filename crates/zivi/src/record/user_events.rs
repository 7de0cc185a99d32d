//! Events of the user, and their location.
//!
//! Events that the user defines: zeros of functions of time and state along the motion.

use crate::numeric::root;
use crate::record::columns::Reserve;
use crate::record::recorder::{PathPoint, Recorded};
use std::collections::TryReserveError;

/// Which changes of sign of a function are events.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Direction {
    /// From positive to negative.
    Falling,
    /// Both.
    #[default]
    Either,
    /// From negative to positive.
    Rising,
}

/// A level that an event waits for: its crossings are the roots of the polynomials of the motion,
/// found like impacts, without a look that could miss them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Level {
    /// `x` reaches this distance (m).
    Position(f64),
    /// `x'` reaches this velocity (m/s).
    Velocity(f64),
}

/// A function of time and state of which `E` is the error it may raise.
pub type EventFunction<'a, E, P = PathPoint> = Box<dyn FnMut(f64, &P) -> Result<f64, E> + 'a>;

/// An event: where a function of time and state changes its sign.
///
/// The function is evaluated at both ends of each step and at three points between, and at least 200
/// times in the span; the zero is found on the dense output. A zero counts when it is reached, not
/// when it is left: `g = x` has one event, a falling one, at each impact. At an impact `x'` jumps; if
/// `g` changes its sign thereby, the event is at the time of the impact and has the state after it.
/// In the remaining impacts of an accumulation (see [`crate::Tail`]) each flight counts as a step, down
/// to the shortest that rounding resolves, at most a million.
pub struct UserEvent<'a, E, P = PathPoint> {
    /// The function.
    pub function: EventFunction<'a, E, P>,
    /// Which changes of sign count.
    pub direction: Direction,
    /// The run ends at the event of this number (1 for the first), if any.
    pub terminal: Option<usize>,
    /// The level, if the function is a level: if the motion knows its crossings, the function is
    /// not evaluated.
    pub level: Option<Level>,
}

impl<'a, E, P> UserEvent<'a, E, P> {
    /// An event in both directions that does not end the run, of a function of time and state.
    pub fn of(function: impl FnMut(f64, &P) -> Result<f64, E> + 'a) -> Self {
        Self {
            function: Box::new(function),
            direction: Direction::Either,
            terminal: None,
            level: None,
        }
    }
}

impl<'a, E> UserEvent<'a, E> {
    /// The same of a function `g(t, x, x')`.
    pub fn new(mut function: impl FnMut(f64, f64, f64) -> Result<f64, E> + 'a) -> Self {
        Self::of(move |t, at| function(t, at.x, at.xdot))
    }

    /// An event where the motion crosses a level.
    #[must_use]
    pub fn at_level(level: Level) -> Self {
        let distance = move |_: f64, at: &PathPoint| {
            Ok(match level {
                Level::Position(c) => at.x - c,
                Level::Velocity(c) => at.xdot - c,
            })
        };
        Self { level: Some(level), ..Self::of(distance) }
    }
}

/// An event that happened.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocatedEvent<P = PathPoint> {
    /// Time (s).
    pub t: f64,
    /// The state.
    pub at: P,
}

/// Whether a function that goes from `before` to `after` reaches zero in the wanted direction.
pub(crate) fn changes(before: f64, after: f64, direction: Direction) -> bool {
    let rises = before < 0.0 && after >= 0.0;
    let falls = before > 0.0 && after <= 0.0;
    match direction {
        Direction::Rising => rises,
        Direction::Falling => falls,
        Direction::Either => rises || falls,
    }
}

// Seeks the events of the user along a motion, part by part.

/// Looks at a function along a smooth part of the motion, at least.
const LOOKS: usize = 4;
/// Least number of samples along a whole run, since a part (such as a rest) may be that long.
const LOOKS_OF_A_RUN: f64 = 200.0;
/// A part of that length is one, whatever rounding makes of it.
const ROUNDING: f64 = 1.0 - 1e-9;

/// A part of the motion along which functions are sampled.
pub(crate) trait Part<P> {
    /// When it starts and ends.
    fn span(&self) -> (f64, f64);

    /// Writes the state at a time.
    fn at(&self, t: f64, to: &mut P);

    /// Number of sampling intervals, each at most `longest` (s).
    fn looks(&self, longest: f64) -> usize {
        let (from, end) = self.span();
        parts(end - from, longest).max(LOOKS)
    }

    /// Writes the state of sample `number` of `looks`, from 0 on, and returns its time; the last is
    /// the end.
    fn look(&self, number: usize, looks: usize, to: &mut P) -> Option<f64> {
        let (from, end) = self.span();
        let t = match number + 1 {
            last if last == looks => end,
            beyond if beyond > looks => return None,
            part => from + part as f64 / looks as f64 * (end - from),
        };
        self.at(t, to);
        Some(t)
    }

    /// When a level is crossed, if the motion can tell.
    fn crossings(&self, _level: Level) -> Option<Vec<f64>> {
        None
    }

    /// The time at which a function changes its sign between two looks.
    fn root<E>(
        &self,
        before: (f64, f64),
        after: (f64, f64),
        _direction: Direction,
        value_at: impl FnMut(f64) -> Result<f64, E>,
    ) -> Result<f64, E> {
        Ok(root::between(before, after, value_at)?.best)
    }
}

/// A part of the motion without a jump.
pub(crate) struct SmoothPart<M, C> {
    pub(crate) span: (f64, f64),
    /// Writes the state at a time.
    pub(crate) motion: M,
    /// When a level is crossed.
    pub(crate) crossings: C,
}

impl<P, M, C> Part<P> for SmoothPart<M, C>
where
    M: Fn(f64, &mut P),
    C: Fn(Level) -> Option<Vec<f64>>,
{
    fn span(&self) -> (f64, f64) {
        self.span
    }

    fn at(&self, t: f64, to: &mut P) {
        (self.motion)(t, to);
    }

    fn crossings(&self, level: Level) -> Option<Vec<f64>> {
        (self.crossings)(level)
    }
}

/// How many parts of a length there are in another.
pub(crate) fn parts(whole: f64, longest: f64) -> usize {
    (ROUNDING * whole / longest).ceil() as usize
}

/// Sorts events by their time. Separate from its generic caller, which is compiled for every kind
/// of motion.
fn in_order_of_time(found: &mut [(f64, usize)]) {
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
}

/// The crossings of a level are unknown.
pub(crate) fn unknown(_: Level) -> Option<Vec<f64>> {
    None
}

/// Reserved number of events of a function per segment of the motion.
const OF_A_PIECE: usize = 64;

/// Seeks events along the motion.
pub(crate) struct EventLocator<'a, E, P> {
    events: Vec<UserEvent<'a, E, P>>,
    /// The functions' values at the end of the sampled part.
    values: Vec<f64>,
    hits: Vec<Vec<LocatedEvent<P>>>,
    /// Longest time between two looks (s).
    longest: f64,
    /// Where the functions are evaluated.
    at: P,
}

impl<'a, E, P: Recorded> EventLocator<'a, E, P> {
    /// A seeker along a motion of states like this one that takes a time (s).
    pub(crate) fn new(events: Vec<UserEvent<'a, E, P>>, like: P, duration: f64) -> Self {
        let hits = events.iter().map(|_| Vec::new()).collect();
        let values = vec![0.0; events.len()];
        Self { events, values, hits, longest: duration / LOOKS_OF_A_RUN, at: like }
    }

    /// Makes room for some events of each function.
    pub(crate) fn make_room(&mut self, reserve: &mut Reserve) -> Result<(), TryReserveError> {
        let arrays = 2 * size_of::<f64>() * (1 + self.at.numbers());
        self.hits.iter_mut().try_for_each(|hits| reserve.room(hits, OF_A_PIECE, arrays))
    }

    pub(crate) fn is_idle(&self) -> bool {
        self.events.is_empty()
    }

    pub(crate) fn into_hits(self) -> Vec<Vec<LocatedEvent<P>>> {
        self.hits
    }

    /// Evaluates the functions at the start.
    pub(crate) fn start(&mut self, t: f64, at: &P) -> Result<(), E> {
        for (event, value) in self.events.iter_mut().zip(&mut self.values) {
            *value = (event.function)(t, at)?;
        }
        Ok(())
    }

    /// Looks along a part of the motion; the event that ends the run, if one does.
    pub(crate) fn along(&mut self, part: &impl Part<P>) -> Result<Option<LocatedEvent<P>>, E> {
        let mut found: Vec<(f64, usize)> = Vec::new();
        for (i, event) in self.events.iter_mut().enumerate() {
            let (value, at) = (&mut self.values[i], &mut self.at);
            let note = |t: f64| found.push((t, i));
            match event.level.and_then(|level| part.crossings(level)) {
                Some(crossings) => event.by_crossings(&crossings, part, value, at, note)?,
                None => event.by_looks(part, self.longest, value, at, note)?,
            }
        }
        in_order_of_time(&mut found);
        Ok(self.record(&found, |t, to| part.at(t, to)))
    }

    /// Looks across a jump; the event that ends the run, if one does.
    pub(crate) fn across(&mut self, t: f64, after: &P) -> Result<Option<LocatedEvent<P>>, E> {
        let mut found = Vec::new();
        for (i, event) in self.events.iter_mut().enumerate() {
            let value = (event.function)(t, after)?;
            if changes(self.values[i], value, event.direction) {
                found.push((t, i));
            }
            self.values[i] = value;
        }
        Ok(self.record(&found, |_, to| to.clone_from(after)))
    }

    /// Notes events in their order, up to one that ends the run.
    fn record(
        &mut self,
        found: &[(f64, usize)],
        motion: impl Fn(f64, &mut P),
    ) -> Option<LocatedEvent<P>> {
        for &(t, i) in found {
            motion(t, &mut self.at);
            let hits = &mut self.hits[i];
            hits.push(LocatedEvent { t, at: self.at.clone() });
            if self.events[i].terminal == Some(hits.len()) {
                return hits.last().cloned();
            }
        }
        None
    }
}

impl<E, P> UserEvent<'_, E, P> {
    /// Notes when the function changes its sign, looked at along a part of the motion.
    fn by_looks(
        &mut self,
        part: &impl Part<P>,
        longest: f64,
        value: &mut f64,
        at: &mut P,
        mut note: impl FnMut(f64),
    ) -> Result<(), E> {
        let mut before = (part.span().0, *value);
        let looks = part.looks(longest);
        for number in 0.. {
            let Some(t) = part.look(number, looks, at) else { break };
            let after = (t, (self.function)(t, at)?);
            if changes(before.1, after.1, self.direction) {
                let value_at = |t: f64| {
                    part.at(t, at);
                    (self.function)(t, at)
                };
                note(part.root(before, after, self.direction, value_at)?);
            }
            before = after;
            *value = after.1;
        }
        Ok(())
    }

    /// The same where its only zeros are known: the sign between two of them is that in the middle.
    fn by_crossings(
        &mut self,
        crossings: &[f64],
        part: &impl Part<P>,
        value: &mut f64,
        at: &mut P,
        mut note: impl FnMut(f64),
    ) -> Result<(), E> {
        let mut value_at = |t: f64| {
            part.at(t, at);
            (self.function)(t, at)
        };
        let (mut start, end) = part.span();
        let mut before = *value;
        for &t in crossings.iter().chain(Some(&end)) {
            let empty = start >= t;
            let after = if empty { before } else { value_at(0.5 * (start + t))? };
            if changes(before, after, self.direction) {
                note(start);
            }
            (before, start) = (after, t);
        }
        let last = value_at(end)?;
        if crossings.last() == Some(&end) && changes(before, 0.0, self.direction) {
            note(end);
            *value = 0.0;
        } else {
            *value = if last == 0.0 { before } else { last };
        }
        Ok(())
    }
}
