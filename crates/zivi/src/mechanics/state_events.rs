//! Events that the user defines: zeros of functions of time, coordinates and velocities.

use std::collections::TryReserveError;

use crate::numeric::root;
use crate::record::reserve::Reserve;
use crate::record::user_events::changes;
use crate::Direction;

/// A function `g(t, q, q')` of which `E` is the error it may raise.
pub type StateFunction<'a, E> = Box<dyn FnMut(f64, &[f64], &[f64]) -> Result<f64, E> + 'a>;

/// An event: where `g(t, q, q')` changes its sign, found as for [`crate::UserEvent`].
pub struct StateEvent<'a, E> {
    /// The function.
    pub function: StateFunction<'a, E>,
    /// Which changes of sign count.
    pub direction: Direction,
    /// The run ends at the event of this number (1 for the first), if any.
    pub terminal: Option<usize>,
}

/// An event that happened: time, coordinates and gaps, their rates.
#[derive(Clone, Debug, PartialEq)]
pub struct StateHit {
    /// Time (s).
    pub t: f64,
    /// `q`, then `g`.
    pub x: Vec<f64>,
    /// `q'`, then `g'`.
    pub v: Vec<f64>,
}

/// Parts of a step, at the ends of which a function is evaluated.
const PARTS: u32 = 4;
/// Events of a function for which there is room before a piece of the motion is followed.
const OF_A_PIECE: usize = 64;

/// The motion over some time, as a function that writes `x` and `v`.
pub(super) type Along<'m> = &'m dyn Fn(f64, &mut [f64], &mut [f64]);

/// Follows the events along the motion.
pub(super) struct StateWatch<'e, 'a, E> {
    events: &'e mut [StateEvent<'a, E>],
    /// The functions' values at the end of what was followed.
    values: Vec<f64>,
    hits: Vec<Vec<StateHit>>,
    n: usize,
    x: Vec<f64>,
    v: Vec<f64>,
}

impl<'e, 'a, E> StateWatch<'e, 'a, E> {
    pub(super) fn new(events: &'e mut [StateEvent<'a, E>], n: usize, m: usize) -> Self {
        let hits = events.iter().map(|_| Vec::new()).collect();
        let values = vec![0.0; events.len()];
        Self { events, values, hits, n, x: vec![0.0; n + m], v: vec![0.0; n + m] }
    }

    /// Makes room for some events of each function.
    pub(super) fn make_room(&mut self, reserve: &mut Reserve) -> Result<(), TryReserveError> {
        let arrays = 2 * size_of::<f64>() * (1 + 2 * self.x.len());
        self.hits.iter_mut().try_for_each(|hits| reserve.room(hits, OF_A_PIECE, arrays))
    }

    pub(super) fn is_idle(&self) -> bool {
        self.events.is_empty()
    }

    pub(super) fn into_hits(self) -> Vec<Vec<StateHit>> {
        self.hits
    }

    /// Evaluates the functions at the start.
    pub(super) fn start(&mut self, t: f64, x: &[f64], v: &[f64]) -> Result<(), E> {
        for (event, value) in self.events.iter_mut().zip(&mut self.values) {
            *value = (event.function)(t, &x[..self.n], &v[..self.n])?;
        }
        Ok(())
    }

    /// Follows a smooth part of the motion; the event that ends the run, if one does.
    pub(super) fn along(
        &mut self,
        from: f64,
        to: f64,
        motion: Along<'_>,
    ) -> Result<Option<StateHit>, E> {
        let mut found: Vec<(f64, usize)> = Vec::new();
        let Self { events, values, n, x, v, .. } = self;
        for (i, event) in events.iter_mut().enumerate() {
            let mut value_at = |t: f64| {
                motion(t, x, v);
                (event.function)(t, &x[..*n], &v[..*n])
            };
            let mut before = (from, values[i]);
            for part in 1..=PARTS {
                let t = from + f64::from(part) / f64::from(PARTS) * (to - from);
                let t = if part == PARTS { to } else { t };
                let after = (t, value_at(t)?);
                if changes(before.1, after.1, event.direction) {
                    found.push((root::between(before, after, &mut value_at)?.best, i));
                }
                before = after;
            }
            values[i] = before.1;
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        Ok(self.record(&found, motion))
    }

    /// Follows a jump of the velocity.
    pub(super) fn across(&mut self, t: f64, x: &[f64], v: &[f64]) -> Result<Option<StateHit>, E> {
        let mut found = Vec::new();
        for (i, event) in self.events.iter_mut().enumerate() {
            let value = (event.function)(t, &x[..self.n], &v[..self.n])?;
            if changes(self.values[i], value, event.direction) {
                found.push((t, i));
            }
            self.values[i] = value;
        }
        Ok(self.record(&found, &|_, to_x, to_v| {
            to_x.copy_from_slice(x);
            to_v.copy_from_slice(v);
        }))
    }

    /// Notes events in their order, up to one that ends the run.
    fn record(&mut self, found: &[(f64, usize)], motion: Along<'_>) -> Option<StateHit> {
        for &(t, i) in found {
            motion(t, &mut self.x, &mut self.v);
            let hit = StateHit { t, x: self.x.clone(), v: self.v.clone() };
            self.hits[i].push(hit.clone());
            if self.events[i].terminal == Some(self.hits[i].len()) {
                return Some(hit);
            }
        }
        None
    }
}
