//! Follows the events of the user along the motion of a mass.

use std::collections::TryReserveError;

use crate::numeric::root;
use crate::record::reserve::Reserve;
use crate::record::user_events::{changes, EventHit, Level, UserEvent};
use crate::PathPoint;

/// Parts of a step, at the ends of which a function is evaluated.
const PARTS: u32 = 4;

/// Events of a function for which there is room before a piece of the motion is followed.
const OF_A_PIECE: usize = 64;

/// Follows the events along the motion.
pub(crate) struct Watch<'e, 'a, E> {
    events: &'e mut [UserEvent<'a, E>],
    /// The functions' values at the end of what was followed.
    values: Vec<f64>,
    hits: Vec<Vec<EventHit>>,
}

impl<'e, 'a, E> Watch<'e, 'a, E> {
    /// Starts at a state.
    pub(crate) fn new(events: &'e mut [UserEvent<'a, E>]) -> Self {
        let hits = events.iter().map(|_| Vec::new()).collect();
        let values = vec![0.0; events.len()];
        Self { events, values, hits }
    }

    /// Makes room for some events of each function.
    pub(crate) fn make_room(&mut self, reserve: &mut Reserve) -> Result<(), TryReserveError> {
        let arrays = 2 * size_of::<EventHit>();
        self.hits.iter_mut().try_for_each(|hits| reserve.room(hits, OF_A_PIECE, arrays))
    }

    /// Evaluates the functions at the start.
    pub(crate) fn start(&mut self, t: f64, at: PathPoint) -> Result<(), E> {
        for (event, value) in self.events.iter_mut().zip(&mut self.values) {
            *value = (event.function)(t, at.x, at.xdot)?;
        }
        Ok(())
    }

    pub(crate) fn is_idle(&self) -> bool {
        self.events.is_empty()
    }

    pub(crate) fn into_hits(self) -> Vec<Vec<EventHit>> {
        self.hits
    }

    /// Follows a smooth part of the motion; the event that ends the run, if one does.
    pub(crate) fn along(
        &mut self,
        from: f64,
        to: f64,
        motion: impl Fn(f64) -> PathPoint,
        crossings: impl Fn(Level) -> Vec<f64>,
    ) -> Result<Option<EventHit>, E> {
        let mut found: Vec<(f64, usize)> = Vec::new();
        for (i, event) in self.events.iter_mut().enumerate() {
            let mut value_at = |t: f64| {
                let point = motion(t);
                (event.function)(t, point.x, point.xdot)
            };
            let mut before = (from, self.values[i]);
            if let Some(level) = event.level {
                // the sign between two crossings is that in the middle
                let mut start = from;
                let ends = crossings(level);
                for t in ends.iter().copied().chain(Some(to)) {
                    let empty = start >= t;
                    let after = if empty { before.1 } else { value_at(0.5 * (start + t))? };
                    if changes(before.1, after, event.direction) {
                        found.push((start, i));
                    }
                    (before, start) = ((t, after), t);
                }
                let last = value_at(to)?;
                if ends.last() == Some(&to) && changes(before.1, 0.0, event.direction) {
                    found.push((to, i));
                    self.values[i] = 0.0;
                } else {
                    self.values[i] = if last == 0.0 { before.1 } else { last };
                }
                continue;
            }
            for part in 1..=PARTS {
                let t = from + f64::from(part) / f64::from(PARTS) * (to - from);
                let t = if part == PARTS { to } else { t };
                let after = (t, value_at(t)?);
                if changes(before.1, after.1, event.direction) {
                    found.push((root::between(before, after, &mut value_at)?.best, i));
                }
                before = after;
            }
            self.values[i] = before.1;
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        Ok(self.record(&found, motion))
    }

    /// Follows a jump of the velocity.
    pub(crate) fn across(&mut self, t: f64, after: PathPoint) -> Result<Option<EventHit>, E> {
        let mut found = Vec::new();
        for (i, event) in self.events.iter_mut().enumerate() {
            let value = (event.function)(t, after.x, after.xdot)?;
            if changes(self.values[i], value, event.direction) {
                found.push((t, i));
            }
            self.values[i] = value;
        }
        Ok(self.record(&found, |_| after))
    }

    /// Notes events in their order, up to one that ends the run.
    fn record(
        &mut self,
        found: &[(f64, usize)],
        motion: impl Fn(f64) -> PathPoint,
    ) -> Option<EventHit> {
        for &(t, i) in found {
            let PathPoint { x, xdot, sigma } = motion(t);
            let hit = EventHit { t, x, xdot, sigma };
            self.hits[i].push(hit);
            if self.events[i].terminal == Some(self.hits[i].len()) {
                return Some(hit);
            }
        }
        None
    }
}
