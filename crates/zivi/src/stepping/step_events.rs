//! Events of the user along a run of fixed steps.
//!
//! Each function is evaluated at the end of every step, at the wall where `s` changes sign within
//! the step, and inside long steps; if its sign differs from the previous one, the zero is found on
//! the interpolation of the step.

use std::ops::ControlFlow;

use zivi_core::{transform, Lifted, Physical};

use crate::record::columns::Reserve;
use crate::record::recorder::{DenseStep, StepEnd};
use crate::record::user_events::{changes, parts, EventLocator, Part};
use crate::{Direction, Keep, LocatedEvent, Monitor, PathPoint, Status, UserEvent};

/// A monitor that follows events along a run of fixed steps; one of them may end it
/// ([`Status::TerminatedByEvent`]) with the step in which it happens.
///
/// ```
/// use std::convert::Infallible;
/// use zivi::{
///     simulate_theta_gamma, ConstantForce, StepEvents, Grid, Physical, Restitution, Silent, Status,
///     ThetaGamma, UserEvent,
/// };
///
/// let (ball, restitution) = (Physical { x: 1.0, xdot: 0.0 }, Restitution::from_e(0.5)?);
/// let grid = Grid::new(0.0, 1e3, 1e-3)?;
/// let half = UserEvent::new(|_, x, _| Ok::<_, Infallible>(x - 0.5));
/// let mut silent = Silent;
/// let mut monitor = StepEvents::new(vec![UserEvent { terminal: Some(1), ..half }], 1e3, &mut silent);
/// let method = ThetaGamma::implicit_euler();
/// let run =
///     simulate_theta_gamma(method, restitution, &mut ConstantForce(-4.0), grid, ball, &mut monitor)?;
/// assert_eq!(run.trajectory.status, Status::TerminatedByEvent);
/// assert!(run.trajectory.columns.len() < 502);
/// assert!((monitor.into_hits()[0][0].t - 0.5).abs() < 1e-3);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct StepEvents<'m, 'a, M, E> {
    monitor: &'m mut M,
    seeker: EventLocator<'a, E, PathPoint>,
    started: bool,
    reserve: Reserve,
}

impl<'m, 'a, M, E> StepEvents<'m, 'a, M, E> {
    /// Follows events (their levels are functions as others are) of a run that takes a time (s), and
    /// tells `monitor` the rest.
    pub fn new(events: Vec<UserEvent<'a, E>>, duration: f64, monitor: &'m mut M) -> Self {
        let like = PathPoint { x: 0.0, xdot: 0.0, sigma: 1.0 };
        let seeker = EventLocator::new(events, like, duration);
        Self { monitor, seeker, started: false, reserve: Reserve::default() }
    }

    /// Occurrences of each event in order of time, up to the one that ended the run.
    pub fn into_hits(self) -> Vec<Vec<LocatedEvent>> {
        self.seeker.into_hits()
    }
}

/// A state and its image.
fn point(Physical { x, xdot }: Physical, z: Lifted) -> PathPoint {
    PathPoint { x, xdot, sigma: transform::side(z, 1.0) }
}

impl Part<PathPoint> for DenseStep {
    fn span(&self) -> (f64, f64) {
        (self.from.t, self.to.t)
    }

    fn at(&self, t: f64, to: &mut PathPoint) {
        *to = point(DenseStep::at(self, t), self.z(t));
    }

    fn looks(&self, longest: f64) -> usize {
        parts(self.to.t - self.from.t, longest).max(1)
    }

    fn look(&self, number: usize, looks: usize, to: &mut PathPoint) -> Option<f64> {
        let (t, state) = self.nth_look(number, looks)?;
        *to = point(state, self.z(t));
        Some(t)
    }

    /// By bisection: a jump of the velocity has no zero.
    fn root<E>(
        &self,
        (mut left, _): (f64, f64),
        (mut right, _): (f64, f64),
        direction: Direction,
        mut value_at: impl FnMut(f64) -> Result<f64, E>,
    ) -> Result<f64, E> {
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
}

/// Bisections of an interval.
const BISECTIONS: usize = 60;

impl<E, M: Monitor<E>> Monitor<E> for StepEvents<'_, '_, M, E> {
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
        !self.seeker.is_idle()
    }

    fn follow(&mut self, step: &DenseStep) -> Result<ControlFlow<Status>, E> {
        if self.seeker.make_room(&mut self.reserve).is_err() {
            return Ok(ControlFlow::Break(Status::OutOfMemory));
        }
        if !self.started {
            let StepEnd { t, state, z } = step.from;
            self.seeker.start(t, &point(state, z))?;
            self.started = true;
        }
        Ok(match self.seeker.along(step)? {
            Some(_) => ControlFlow::Break(Status::TerminatedByEvent),
            None => ControlFlow::Continue(()),
        })
    }
}
