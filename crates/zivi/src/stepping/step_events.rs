//! Events of the user along a run of fixed steps.
//!
//! Each function is looked at at the end of every step, and at the wall where `s` changes its sign
//! within the step; where its sign differs from that of the look before, the zero is sought on the
//! interpolation of the step.

use std::ops::ControlFlow;

use zivi_core::{transform, Physical};

use crate::record::reserve::Reserve;
use crate::record::stretch::{Knot, Stretch};
use crate::record::user_events::changes;
use crate::{Direction, EventHit, Keep, Monitor, Status, UserEvent};

/// A monitor that follows events along a run of fixed steps; one of them may end it
/// ([`Status::TerminatedByEvent`]) with the step in which it happens.
///
/// ```
/// use std::convert::Infallible;
/// use zivi::{
///     simulate_theta_gamma, ConstantForce, Following, Grid, Physical, Restitution, Silent, Status,
///     ThetaGamma, UserEvent,
/// };
///
/// let (ball, restitution) = (Physical { x: 1.0, xdot: 0.0 }, Restitution::from_e(0.5)?);
/// let grid = Grid::new(0.0, 1e3, 1e-3)?;
/// let half = UserEvent::new(|_, x, _| Ok::<_, Infallible>(x - 0.5));
/// let mut silent = Silent;
/// let mut monitor = Following::new(vec![UserEvent { terminal: Some(1), ..half }], &mut silent);
/// let method = ThetaGamma::implicit_euler();
/// let run =
///     simulate_theta_gamma(method, restitution, &mut ConstantForce(-4.0), grid, ball, &mut monitor)?;
/// assert_eq!(run.trajectory.status, Status::TerminatedByEvent);
/// assert!(run.trajectory.columns.len() < 502);
/// assert!((monitor.into_hits()[0][0].t - 0.5).abs() < 1e-3);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Following<'m, 'a, M, E> {
    monitor: &'m mut M,
    events: Vec<UserEvent<'a, E>>,
    /// The functions' values at the last look; none before the first step.
    values: Vec<f64>,
    hits: Vec<Vec<EventHit>>,
    reserve: Reserve,
}

impl<'m, 'a, M, E> Following<'m, 'a, M, E> {
    /// Follows events (their levels are functions as others are), and tells `monitor` the rest.
    pub fn new(events: Vec<UserEvent<'a, E>>, monitor: &'m mut M) -> Self {
        let hits = events.iter().map(|_| Vec::new()).collect();
        Self { monitor, events, values: Vec::new(), hits, reserve: Reserve::default() }
    }

    /// What happened of each event, in the order of time, up to the one that ended the run.
    pub fn into_hits(self) -> Vec<Vec<EventHit>> {
        self.hits
    }

    /// Evaluates the functions where the run starts.
    fn start(&mut self, Knot { t, state, .. }: Knot) -> Result<(), E> {
        let value = |event: &mut UserEvent<'a, E>| (event.function)(t, state.x, state.xdot);
        self.values = self.events.iter_mut().map(value).collect::<Result<_, E>>()?;
        Ok(())
    }

    /// The times of the events of a step and their numbers.
    fn found(&mut self, step: &Stretch) -> Result<Vec<(f64, usize)>, E> {
        let mut found = Vec::new();
        for (i, (event, last)) in self.events.iter_mut().zip(&mut self.values).enumerate() {
            let mut left = step.from.t;
            for (t, Physical { x, xdot }) in step.looks() {
                let value = (event.function)(t, x, xdot)?;
                if changes(*last, value, event.direction) {
                    found.push((root(event, step, left, t)?, i));
                }
                (left, *last) = (t, value);
            }
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        Ok(found)
    }

    /// Notes the events of a step up to one that ends the run.
    fn note(&mut self, found: &[(f64, usize)], step: &Stretch) -> ControlFlow<Status> {
        for &(t, i) in found {
            let (Physical { x, xdot }, hits) = (step.at(t), &mut self.hits[i]);
            if self.reserve.room(hits, 1, size_of::<EventHit>()).is_err() {
                return ControlFlow::Break(Status::OutOfMemory);
            }
            hits.push(EventHit { t, x, xdot, sigma: transform::side(step.z(t), 1.0) });
            if self.events[i].terminal == Some(hits.len()) {
                return ControlFlow::Break(Status::TerminatedByEvent);
            }
        }
        ControlFlow::Continue(())
    }
}

/// Bisections of an interval.
const BISECTIONS: usize = 60;

/// The time between two looks at which the function has changed its sign; a jump of the velocity
/// has no zero.
fn root<E>(
    event: &mut UserEvent<'_, E>,
    step: &Stretch,
    mut left: f64,
    mut right: f64,
) -> Result<f64, E> {
    let direction: Direction = event.direction;
    let mut value_at = |t: f64| {
        let Physical { x, xdot } = step.at(t);
        (event.function)(t, x, xdot)
    };
    let mut low = value_at(left)?;
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (left + right);
        if !(left < middle && middle < right) {
            break;
        }
        let value = value_at(middle)?;
        if changes(low, value, direction) {
            right = middle;
        } else {
            (left, low) = (middle, value);
        }
    }
    Ok(right)
}

impl<E, M: Monitor<E>> Monitor<E> for Following<'_, '_, M, E> {
    fn poll(&mut self, done: usize, of: usize) -> Result<(), E> {
        self.monitor.poll(done, of)
    }

    fn keep(&self) -> Keep {
        self.monitor.keep()
    }

    fn record_allocated(&mut self, start: *const f64, len: usize) {
        self.monitor.record_allocated(start, len);
    }

    fn follows(&self) -> bool {
        !self.events.is_empty()
    }

    fn follow(&mut self, step: &Stretch) -> Result<ControlFlow<Status>, E> {
        if self.values.is_empty() {
            self.start(step.from)?;
        }
        let found = self.found(step)?;
        Ok(self.note(&found, step))
    }
}
