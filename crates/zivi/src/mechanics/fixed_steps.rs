//! Runs with fixed steps: what the schemes share.

use super::kinetics::{Kinetics, Model};
use super::output::{MechanicalRun, MechanicalSamples};
use super::run::{check_friction, check_sizes};
use crate::record::contact_mode::ContactMode;
use crate::record::event_locator::{unknown, EventLocator, SmoothPart};
use crate::record::failure::Failure;
use crate::record::gap_set::GapSet;
use crate::record::monitor::PollInterval;
use crate::record::occurrence::Occurrence;
use crate::record::point::MotionPoint;
use crate::record::reserve::Reserve;
use crate::system::dynamics::{Dynamics, Layout};
use crate::system::friction::Friction;
use crate::{Counts, Grid, LocatedEvent, Monitor, SetupError, Status, UserEvent};

/// A scheme that takes fixed steps.
pub(super) trait Scheme {
    /// Looks at the start, where the system has been evaluated.
    fn begin(&mut self, state: &mut Stepped) -> Result<(), SetupError>;

    /// One step of length `h` to `t_end`: fills the next state and the impulses.
    fn step<E, D: Dynamics<E>>(
        &mut self,
        t_end: f64,
        h: f64,
        state: &mut Stepped,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>>;

    /// What happened in the step, whose end is the present state now and whose start the next.
    fn note<E>(&mut self, t: f64, t_end: f64, state: &mut Stepped) -> Result<(), Failure<E>>;

    /// What is known at the end only.
    fn finish(&mut self, _state: &mut Stepped) {}
}

type StateEventLocator<'a, E> = EventLocator<'a, E, MotionPoint>;

/// The state of a run with fixed steps.
pub(super) struct Stepped {
    pub(super) layout: Layout,
    pub(super) e: Vec<f64>,
    pub(super) kinetics: Kinetics,
    /// Coordinates and gaps, their rates, and the free accelerations of the coordinates.
    pub(super) x: Vec<f64>,
    pub(super) v: Vec<f64>,
    pub(super) free: Vec<f64>,
    /// The end of the step, and by gap what acts in it: impulses, then reactions.
    pub(super) next_x: Vec<f64>,
    pub(super) next_v: Vec<f64>,
    pub(super) lambda: Vec<f64>,
    pub(super) friction: Friction,
    /// What friction does, and which gaps it acts on.
    pub(super) pattern: ContactMode,
    /// The gaps that are at rest.
    pub(super) closed: GapSet,
    pub(super) group: u64,
    pub(super) occurrences: Vec<Occurrence>,
    samples: MechanicalSamples,
    reserve: Reserve,
}

/// Fixed-point iterations of a step, and the change that ends them, relative to the state.
const SWEEPS: usize = 60;
const CONVERGED: f64 = 1e-13;
/// Rounding of a coordinate that iterates may differ by.
const ROUNDING: f64 = 16.0 * f64::EPSILON;

impl Stepped {
    fn new(layout: Layout, e: &[f64], friction: &Friction, (q, w): (&[f64], &[f64])) -> Self {
        let zeros = vec![0.0; layout.size()];
        let (mut x, mut v) = (zeros.clone(), zeros);
        x[..layout.n].copy_from_slice(q);
        v[..layout.n].copy_from_slice(w);
        Self {
            layout,
            e: e.to_vec(),
            kinetics: Kinetics::new(layout, friction),
            friction: friction.clone(),
            pattern: ContactMode::default(),
            next_x: x.clone(),
            next_v: v.clone(),
            x,
            v,
            free: vec![0.0; layout.n],
            lambda: vec![0.0; layout.rows()],
            closed: GapSet::EMPTY,
            group: 0,
            occurrences: Vec::new(),
            samples: MechanicalSamples::default(),
            reserve: Reserve::default(),
        }
    }

    fn evaluate_start<E, D: Dynamics<E>>(
        &mut self,
        t: f64,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let n = self.layout.n;
        self.kinetics.evaluate(model, t, &self.x[..n], &self.v[..n])?;
        self.kinetics.free_to(&mut self.free);
        for i in 0..self.layout.m {
            let (gap, rate) = (self.kinetics.gap(i), self.kinetics.rate(i, &self.v[..n]));
            (self.x[n + i], self.v[n + i]) = (gap, rate);
        }
        for row in self.layout.m..self.layout.rows() {
            self.v[n + row] = self.kinetics.rate(row, &self.v[..n]);
        }
        Ok(())
    }

    /// Iterates `sweep`, which moves the next state by its return relative to the size of the
    /// state, until that is rounding; the system is evaluated at the iterates.
    pub(super) fn iterate<E, D: Dynamics<E>>(
        &mut self,
        t_end: f64,
        h: f64,
        model: &mut Model<'_, D>,
        mut sweep: impl FnMut(&mut Self) -> Result<f64, Failure<E>>,
    ) -> Result<(), Failure<E>> {
        let n = self.layout.n;
        for i in 0..n {
            self.next_v[i] = self.v[i] + h * self.free[i];
            self.next_x[i] = self.x[i] + h * self.v[i];
        }
        for _ in 0..SWEEPS {
            self.kinetics.evaluate(model, t_end, &self.next_x[..n], &self.next_v[..n])?;
            let change = sweep(self)?;
            if change.is_nan() {
                return Err(Failure::Status(Status::StateNotFinite));
            }
            if change <= CONVERGED {
                self.kinetics.free_to(&mut self.free);
                return Ok(());
            }
        }
        Err(Failure::Status(Status::ForceNotConverged))
    }

    /// Moves the next coordinates and velocities; by how much, relative to their size.
    pub(super) fn move_to(&mut self, h: f64, q: &[f64], w: &[f64]) -> f64 {
        let (mut change, mut size) = (0.0_f64, f64::MIN_POSITIVE);
        for (i, (&q, &w)) in q.iter().zip(w).enumerate() {
            let moved = (w - self.next_v[i]).abs().max((q - self.next_x[i]).abs() / h);
            // f64::max would drop NaN
            change = if moved > change || moved.is_nan() { moved } else { change };
            size = size.max(w.abs()).max(self.v[i].abs()).max(h * self.free[i].abs());
            size = size.max(ROUNDING / CONVERGED * q.abs() / h);
            (self.next_v[i], self.next_x[i]) = (w, q);
        }
        change / size
    }

    fn make_room<E>(&mut self, seeker: &mut StateEventLocator<'_, E>) -> Result<(), Failure<E>> {
        let rows = self.layout.rows();
        self.samples.make_room(&mut self.reserve, 1, self.layout)?;
        self.reserve.room(&mut self.occurrences, 2 * rows, 2 * size_of::<f64>())?;
        seeker.make_room(&mut self.reserve)?;
        Ok(())
    }

    /// The present state.
    fn point(&self) -> MotionPoint {
        MotionPoint { x: self.x.clone(), v: self.v.clone(), mode: self.mode() }
    }

    /// The gaps at rest, and what friction does at them and in joints.
    fn mode(&self) -> ContactMode {
        ContactMode { closed: self.closed, ..self.pattern }
    }

    fn sample(&mut self, t: f64) {
        self.samples.push(t, (&self.x, &self.v), &self.lambda, self.mode());
    }

    /// Follows the user's events along the line between both ends of the step.
    fn look<E>(
        &self,
        t: f64,
        t_end: f64,
        seeker: &mut StateEventLocator<'_, E>,
    ) -> Result<Option<LocatedEvent<MotionPoint>>, Failure<E>> {
        if seeker.is_idle() {
            return Ok(None);
        }
        let motion = |at: f64, to: &mut MotionPoint| {
            let part = (at - t) / (t_end - t);
            for c in 0..self.x.len() {
                to.x[c] = self.x[c] + part * (self.next_x[c] - self.x[c]);
                to.v[c] = self.v[c] + part * (self.next_v[c] - self.v[c]);
            }
            to.mode = self.mode();
        };
        let part = SmoothPart { span: (t, t_end), motion, crossings: unknown };
        seeker.along(&part).map_err(Failure::Raised)
    }
}

/// A run of a scheme.
pub(super) fn simulate<E, D: Dynamics<E>>(
    mut scheme: impl Scheme,
    dynamics: &mut D,
    e: &[f64],
    grid: Grid,
    (q, w): (&[f64], &[f64]),
    events: Vec<UserEvent<'_, E, MotionPoint>>,
    monitor: &mut impl Monitor<E>,
) -> Result<MechanicalRun<E>, SetupError> {
    let layout = dynamics.layout();
    check_sizes(layout, e.len(), q, w)?;
    if let Some(&e) = e.iter().find(|e| !(0.0..=1.0).contains(*e)) {
        return Err(SetupError::Setting("e", e, "from 0 to 1"));
    }
    let friction = dynamics.friction().clone();
    check_friction(layout, &friction)?;
    let mut model = Model::new(dynamics);
    let mut state = Stepped::new(layout, e, &friction, (q, w));
    let duration = grid.t(grid.n_steps()) - grid.t(0);
    let mut seeker = EventLocator::new(events, state.point(), duration);
    let mut steps = 0;
    let ending = match state.evaluate_start(grid.t(0), &mut model) {
        Err(failure) => Err(failure),
        Ok(()) => {
            scheme.begin(&mut state)?;
            walk(&mut scheme, &mut state, grid, &mut steps, (&mut model, &mut seeker, monitor))
        }
    };
    scheme.finish(&mut state);
    let (status, raised) = match ending {
        Ok(None) => (Status::Completed, None),
        Ok(Some(hit)) => {
            let MotionPoint { x, v, mode } = &hit.at;
            state.samples.push(hit.t, (x, v), &vec![0.0; layout.rows()], *mode);
            (Status::TerminatedByEvent, None)
        }
        Err(Failure::Status(status)) => (status, None),
        Err(Failure::Raised(error)) => (Status::Raised, Some(error)),
    };
    let (nfev, accepted) = (model.count, steps as u64);
    let counts = Counts { nfev, accepted, rejected: 0, impacts: state.group };
    let Stepped { samples, occurrences, .. } = state;
    let hits = seeker.into_hits();
    let (speeds, path) = (None, None);
    Ok(MechanicalRun { layout, samples, speeds, occurrences, hits, path, status, raised, counts })
}

/// All steps, or those up to an event of the user that ends the run.
fn walk<E, D: Dynamics<E>, M: Monitor<E>>(
    scheme: &mut impl Scheme,
    state: &mut Stepped,
    grid: Grid,
    steps: &mut usize,
    (model, seeker, monitor): (&mut Model<'_, D>, &mut StateEventLocator<'_, E>, &mut M),
) -> Result<Option<LocatedEvent<MotionPoint>>, Failure<E>> {
    state.make_room(seeker)?;
    state.sample(grid.t(0));
    seeker.start(grid.t(0), &state.point()).map_err(Failure::Raised)?;
    let mut pace = PollInterval::start();
    while *steps < grid.n_steps() {
        for _ in 0..pace.chunk().min(grid.n_steps() - *steps) {
            let (t, t_end) = (grid.t(*steps), grid.t(*steps + 1));
            state.make_room(seeker)?;
            scheme.step(t_end, t_end - t, state, model)?;
            if let Some(stop) = state.look(t, t_end, seeker)? {
                return Ok(Some(stop));
            }
            std::mem::swap(&mut state.x, &mut state.next_x);
            std::mem::swap(&mut state.v, &mut state.next_v);
            scheme.note(t, t_end, state)?;
            state.sample(t_end);
            *steps += 1;
        }
        monitor.poll(*steps, grid.n_steps()).map_err(Failure::Raised)?;
        pace.adjust();
    }
    Ok(None)
}
