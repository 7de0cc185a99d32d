//! Fixed-step schemes of mechanical systems: Moreau-Jean, theta-gamma, their joint friction.
//!
//! Runs with fixed steps: what the schemes share.

use crate::friction::Collision;
use crate::kinetics::lcp::problem;
use crate::kinetics::{lcp, Kinetics, Model};
use crate::mechanics::recording::{
    check_cones, check_free, check_rigid, check_sizes, MechanicalRun, MechanicalSamples,
};
use crate::numeric::dense::axpy;
use crate::record::columns::Reserve;
use crate::record::events::{EventLog, Occurrence};
use crate::record::gap_set::{ContactMode, GapSet};
use crate::record::recorder::MotionPoint;
use crate::record::status::{Failure, PollInterval};
use crate::record::user_events::{unknown, EventLocator, SmoothPart};
use crate::system::dynamics::{Dynamics, Layout};
use crate::system::force::Friction;
use crate::{
    Branch, Counts, Grid, Lifted, LocatedEvent, Monitor, MoreauJean, Physical, Restitution,
    SetupError, Status, UserEvent,
};
use zivi_core::{transform, StepSolution, ThetaGammaStep};

/// A scheme that takes fixed steps.
pub(crate) trait Scheme {
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

    /// Records the events of a step; at this call the present state is its end, the next state its
    /// start.
    fn note<E>(&mut self, t: f64, t_end: f64, state: &mut Stepped) -> Result<(), Failure<E>>;

    /// Events that are known at the end only.
    fn finish(&mut self, _state: &mut Stepped) {}
}

type StateEventLocator<'a, E> = EventLocator<'a, E, MotionPoint>;

/// The state of a run with fixed steps.
pub(crate) struct Stepped {
    pub(crate) layout: Layout,
    pub(crate) e: Vec<f64>,
    pub(crate) kinetics: Kinetics,
    /// Coordinates and gaps, their rates, and the free accelerations of the coordinates.
    pub(crate) x: Vec<f64>,
    pub(crate) v: Vec<f64>,
    pub(crate) free: Vec<f64>,
    /// The end of the step; impulses by gap, followed by reactions.
    pub(crate) next_x: Vec<f64>,
    pub(crate) next_v: Vec<f64>,
    pub(crate) lambda: Vec<f64>,
    pub(crate) friction: Friction,
    /// Modes of friction and the gaps with contact.
    pub(crate) pattern: ContactMode,
    /// The gaps that are at rest.
    pub(crate) closed: GapSet,
    pub(crate) group: u64,
    pub(crate) occurrences: Vec<Occurrence>,
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
    pub(crate) fn iterate<E, D: Dynamics<E>>(
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
    pub(crate) fn move_to(&mut self, h: f64, q: &[f64], w: &[f64]) -> f64 {
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

    /// The gaps at rest, and the modes of friction at them and in joints.
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
pub(crate) fn simulate<E, D: Dynamics<E>>(
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
    check_free(layout)?;
    check_cones(layout, &friction)?;
    check_rigid(&friction)?;
    // compiled once for all systems
    let mut dynamics: &mut dyn Dynamics<E> = dynamics;
    let mut model = Model::new(&mut dynamics);
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

// Moreau-Jean time stepping for systems with several gaps.
//
// ```text
// w+ = w + h A_theta + M^-1 N_I^T P      A_theta = theta A(t+, q+, w+) + (1 - theta) A(t, q, w)
// q+ = q + h (theta w+ + (1 - theta) w)
// 0 <= P  perp  g'+ + e g' >= 0          on I = {i: g_i + h/2 g_i' <= 0}                    (1)
// ```
//
// With friction the impulses are those of [`crate::friction`], with `-P_T in mu P_N Sign(w+ + e_t w-)` at
// gaps and `-P_T in h L Sign(w+)` in joints. `A = M^-1 F`; mass matrix and gradients of the impulses are those at the end of the step, found
// with it by fixed-point iteration. Contact is decided at velocity level, so a gap may be
// negative, by up to about `h |g'|`. The order is one, through accumulations of any kind. Where
// the `e_i` differ, impulses on several gaps of which some open may raise the energy.

/// Simulates a mechanical system with Moreau-Jean time stepping.
///
/// Recorded are impacts (impulses on gaps that close), Zeno points (a closed gap after slow speeds)
/// and lift-offs (see [`crate::simulate_moreau_jean`]); reactions are `P/h`.
///
/// # Errors
/// [`SetupError`] before anything is computed. Later failures are in the run's status.
pub fn simulate_mechanical_moreau_jean<E, D: Dynamics<E>>(
    method: MoreauJean,
    dynamics: &mut D,
    e: &[f64],
    grid: Grid,
    (q, w): (&[f64], &[f64]),
    events: Vec<UserEvent<'_, E, MotionPoint>>,
    monitor: &mut impl Monitor<E>,
) -> Result<MechanicalRun<E>, SetupError> {
    let MoreauJean { theta } = method.validated()?;
    simulate(
        Impulses { theta, before: ContactMode::default() },
        dynamics,
        e,
        grid,
        (q, w),
        events,
        monitor,
    )
}

/// The scheme.
struct Impulses {
    theta: f64,
    /// Modes of friction in the last step.
    before: ContactMode,
}

impl Scheme for Impulses {
    /// Closed gaps without speed under an acceleration towards the wall are at rest.
    fn begin(&mut self, state: &mut Stepped) -> Result<(), SetupError> {
        let n = state.layout.n;
        let rests = |&i: &usize| {
            state.x[n + i] <= 0.0 && state.v[n + i] == 0.0 && state.kinetics.b(i) <= 0.0
        };
        state.closed = (0..state.layout.m).filter(rests).collect();
        Ok(())
    }

    fn step<E, D: Dynamics<E>>(
        &mut self,
        t_end: f64,
        h: f64,
        state: &mut Stepped,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let (n, m, theta) = (state.layout.n, state.layout.m, self.theta);
        let closing = |i: &usize| state.x[n + i] + 0.5 * h * state.v[n + i] <= 0.0;
        let set: GapSet = (0..m).filter(closing).collect();
        let first = state.free.clone();
        state.iterate(t_end, h, model, |state| {
            for i in 0..m {
                state.next_x[n + i] = state.kinetics.gap(i);
                state.next_v[n + i] = state.kinetics.rate(i, &state.next_v[..n]);
            }
            if state.layout.p > 0 {
                state.take_slips(h, theta);
            }
            let mut w = vec![0.0; n];
            state.kinetics.free_to(&mut w);
            for ((w, v), first) in w.iter_mut().zip(&state.v).zip(&first) {
                *w = v + h * (theta * *w + (1.0 - theta) * first);
            }
            match state.layout.p {
                0 => push(state, set, &mut w)?,
                _ => push_with_friction(state, (set, h), &mut w)?,
            }
            let mean = |(w, v): (&f64, &f64)| theta * w + (1.0 - theta) * v;
            let rates = w.iter().zip(&state.v).map(mean);
            let q: Vec<f64> = rates.zip(&state.x).map(|(rate, x)| x + h * rate).collect();
            Ok(state.move_to(h, &q, &w))
        })
    }

    fn note<E>(&mut self, t: f64, t_end: f64, state: &mut Stepped) -> Result<(), Failure<E>> {
        let (n, h) = (state.layout.n, t_end - t);
        let gaps = &state.lambda[..state.layout.m];
        state.group += u64::from(gaps.iter().any(|&impulse| impulse > 0.0));
        for gap in 0..state.layout.m {
            let (before, after) = (state.next_v[n + gap], state.v[n + gap]);
            let impulse = state.lambda[gap];
            let pull = h * state.kinetics.b(gap);
            let slow = before.abs() <= pull.abs() && after.abs() <= pull.abs();
            if state.closed.has(gap) {
                // a gap that settles may lack an impulse for a step; one that opens gets faster
                let leaves = after > pull.abs() || (pull > 0.0 && state.x[n + gap] > 0.0);
                if impulse == 0.0 && leaves {
                    state.closed = state.closed.without(GapSet::of(gap));
                    state.occurrences.push(Occurrence::LiftOff { t, gap });
                }
            } else if impulse > 0.0 && slow {
                state.closed = state.closed.with(GapSet::of(gap));
                let closed = state.closed;
                state.occurrences.push(Occurrence::Zeno { t: t_end, gap, closed });
            } else if impulse > 0.0 && before < 0.0 {
                let (t, group) = (t_end, state.group);
                let impact = Occurrence::Impact { t, gap, before, after, impulse, group };
                state.occurrences.push(impact);
            }
        }
        state.lambda.iter_mut().for_each(|impulse| *impulse /= h);
        for channel in 0..state.layout.p {
            let (was, is) = (self.before.number(channel), state.pattern.number(channel));
            if was != is && is != 2 {
                let it = Occurrence::Transition { t: t_end, channel, before: was, after: is };
                state.occurrences.push(it);
            }
        }
        self.before = state.pattern;
        Ok(())
    }
}

impl Stepped {
    /// Slips at the end of the step, how far they went, and the work of friction.
    fn take_slips(&mut self, h: f64, theta: f64) {
        let Layout { n, m, p, .. } = self.layout;
        let mut work = 0.0;
        for row in m..m + p {
            let sticks =
                self.pattern.stick.has(row - m) && self.friction.channels[row - m].e_t == 0.0;
            let rate = self.kinetics.rate(row, &self.next_v[..n]);
            let c = n + row;
            self.next_v[c] = if sticks { 0.0 } else { rate };
            self.next_x[c] = self.x[c] + h * (theta * self.next_v[c] + (1.0 - theta) * self.v[c]);
            work -= 0.5 * self.lambda[row] * (self.next_v[c] + self.v[c]);
        }
        self.next_v[n + m + p] = self.v[n + m + p] + work;
    }
}

/// Adds the impulses of a step with friction to the velocities.
fn push_with_friction<E>(
    state: &mut Stepped,
    (set, duration): (GapSet, f64),
    w: &mut [f64],
) -> Result<(), Failure<E>> {
    let Layout { n, m, p, .. } = state.layout;
    let free: Vec<f64> = (0..m + p).map(|row| state.kinetics.rate(row, w)).collect();
    let Stepped { e, v, friction, kinetics, .. } = state;
    let (before, is_jammed) = (&v[n..n + m + p], false);
    let collision = Collision { set, e, friction, before, free: &free, duration, is_jammed };
    let found = collision.newton(kinetics)?;
    w.iter_mut().zip(&found.push).for_each(|(w, push)| *w += push);
    state.lambda.copy_from_slice(&found.impulses);
    state.pattern = found.pattern;
    Ok(())
}

/// Adds the impulses of (1) to the velocities.
fn push<E>(state: &mut Stepped, set: GapSet, w: &mut [f64]) -> Result<(), Failure<E>> {
    state.lambda.fill(0.0);
    if set.is_empty() {
        return Ok(());
    }
    let (n, e, v) = (state.layout.n, &state.e, &state.v);
    let (matrix, right) =
        problem(&mut state.kinetics, set, |at, i| at.rate(i, w) + e[i] * v[n + i]);
    let solution = lcp::solve(&matrix, &right).ok_or(Failure::Status(Status::ImpactNotSolved))?;
    for (i, p) in set.iter().zip(solution.z) {
        state.lambda[i] = p;
        let mobility = state.kinetics.mobility(i);
        w.iter_mut().zip(mobility).for_each(|(w, d)| *w += p * d);
    }
    Ok(())
}

// The implicit step in `(s, v)` of each gap, for one gap or gaps at right angles.
//
// A gap that no impulse of another changes is a scalar motion with the free acceleration `b` for
// its force. With `g = |s|` and `g' = R lambda_s v`, one step is
//
// ```text
// (s+, v+)     the step theta = gamma = 1 of [`crate::ThetaGamma`] under b = n . A + h
// g'+          R lambda_s v+,  R = 1 - kappa lambda_s lambda_v
// w+           w + h A, its speeds of the gaps set to g'+ along M^-1 n                    (1)
// q+           q + h w_T, moved along M^-1 n to g(q+) = |s+|
// ```
//
// Friction in joints is one more sign: the forces `f_c in -L_c Sign(w_c+)` are added to those of `A`, one
// joint after the other, with the step solved for each of their values. At gaps `P_T` would make the
// velocities jump: friction there is rejected.
//
// Here `w_T` is the part of `w+` that leaves the gaps as they are, and everything else taken at the
// end of the step by fixed-point iteration. In contact `s = v = 0` exactly. Between gaps that are
// coupled `v` would jump at the impacts of the others: they are refused.

/// Largest kinetic cosine of gaps at right angles.
const ORTHOGONAL: f64 = 1e-9;

/// Simulates a mechanical system with the implicit scheme (1), `theta = gamma = 1`.
///
/// # Errors
/// [`SetupError`] before anything is computed: also for a gap with `e = 0`, an open gap below zero
/// and gaps whose kinetic cosine `n_i . M^-1 n_j / sqrt(D_ii D_jj)` is not zero at the start. Where
/// it ceases to be zero on the way the run ends with [`Status::StepNotSolved`].
pub fn simulate_mechanical_theta_gamma<E, D: Dynamics<E>>(
    dynamics: &mut D,
    e: &[f64],
    grid: Grid,
    (q, w): (&[f64], &[f64]),
    events: Vec<UserEvent<'_, E, MotionPoint>>,
    monitor: &mut impl Monitor<E>,
) -> Result<MechanicalRun<E>, SetupError> {
    if dynamics.friction().channels.iter().any(|channel| channel.gap.is_some()) {
        let range = "none at gaps for this method, in joints only: take SwitchedRK or MoreauJean";
        return Err(SetupError::Count("friction", dynamics.layout().p, range));
    }
    let step = |&e: &f64| {
        let restitution = Restitution::from_e(e);
        let restitution = restitution.map_err(|_| SetupError::Setting("e", e, "from 0 to 1"))?;
        Ok(ThetaGammaStep::new(grid.h(), 1.0, 1.0, restitution)?)
    };
    let steps = e.iter().map(step).collect::<Result<_, SetupError>>()?;
    let scheme = Implicit {
        t: grid.t(0),
        steps,
        z: Vec::new(),
        ends: Vec::new(),
        logs: Vec::new(),
        impulses: vec![Vec::new(); e.len()],
        joints: JointForces::new(dynamics.layout().p),
    };
    simulate(scheme, dynamics, e, grid, (q, w), events, monitor)
}

/// The scheme, with the gaps as it sees them.
struct Implicit {
    t: f64,
    steps: Vec<ThetaGammaStep>,
    z: Vec<Lifted>,
    ends: Vec<StepSolution>,
    logs: Vec<EventLog>,
    /// The impulses of the impacts of each gap.
    impulses: Vec<Vec<f64>>,
    joints: JointForces,
}

impl Scheme for Implicit {
    fn begin(&mut self, state: &mut Stepped) -> Result<(), SetupError> {
        let n = state.layout.n;
        for (i, step) in self.steps.iter().enumerate() {
            let (of_gap, of_rate) = state.kinetics.rounding(i, &state.x[..n], &state.v[..n]);
            let zero = |value: f64, noise: f64| if value.abs() <= noise { 0.0 } else { value };
            let (x, xdot) = (zero(state.x[n + i], 8.0 * of_gap), zero(state.v[n + i], of_rate));
            if x < 0.0 {
                return Err(SetupError::Setting("q0", x, "such that no gap g(t0, q0) is below 0"));
            }
            let z = transform::lift(Physical { x, xdot }, Branch::Positive, step.restitution());
            self.z.push(z);
            self.logs.push(EventLog::start(self.t, z, x == 0.0 && xdot < 0.0, step.restitution()));
        }
        if let Some(cosine) = coupled(state) {
            let range = "0 for this method, which needs gaps at right angles in the metric M";
            return Err(SetupError::Setting("the kinetic cosine of two gaps", cosine, range));
        }
        state.closed = at_rest(&self.z);
        self.note_impulses(state);
        Ok(())
    }

    fn step<E, D: Dynamics<E>>(
        &mut self,
        t_end: f64,
        h: f64,
        state: &mut Stepped,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let n = state.layout.n;
        let Self { steps, z, ends, joints, .. } = self;
        state.iterate(t_end, h, model, |state| {
            if coupled(state).is_some() {
                return Err(Failure::Status(Status::StepNotSolved));
            }
            let (q, w) = joints.solve(state, |state, pushed, forces| {
                ends.clear();
                for (i, (step, &z)) in steps.iter().zip(z.iter()).enumerate() {
                    // the last step of a grid may be shorter
                    let step = if step.h() == h { *step } else { step.with_h(h).unwrap_or(*step) };
                    let b = state.kinetics.b(i) + state.kinetics.pulled(i, forces);
                    let end = step.solve(z, b, transform::side(z, 1.0))?;
                    let r = step.restitution().r(end.lambda_s, end.lambda_v);
                    state.next_v[n + i] = r * end.lambda_s * end.v;
                    state.next_x[n + i] = end.s.abs();
                    ends.push(end);
                }
                ends_of_step(state, h, pushed)
            })?;
            let change = state.move_to(h, &q, &w);
            joints.finish_step(state, h);
            Ok(change)
        })
    }

    fn note<E>(&mut self, t: f64, t_end: f64, state: &mut Stepped) -> Result<(), Failure<E>> {
        for ((z, end), log) in self.z.iter_mut().zip(&self.ends).zip(&mut self.logs) {
            log.step((t, *z), (t_end, end.end()))?;
            *z = end.end();
        }
        self.note_impulses(state);
        state.closed = at_rest(&self.z);
        for i in 0..state.layout.m {
            let pressed = state.closed.has(i);
            let pull = state.kinetics.b(i) + state.kinetics.pulled(i, self.joints.forces());
            state.lambda[i] = if pressed { -pull / state.kinetics.d(i, i) } else { 0.0 };
        }
        self.joints.note(t_end, state);
        Ok(())
    }

    fn finish(&mut self, state: &mut Stepped) {
        let mut all: Vec<(f64, Occurrence)> = Vec::new();
        for (gap, log) in std::mem::take(&mut self.logs).into_iter().enumerate() {
            let events = log.finish();
            for (it, &impulse) in events.impacts.iter().zip(&self.impulses[gap]) {
                let (t, before, after, group) = (it.t, it.xdot_before, it.xdot_after, 0);
                all.push((t, Occurrence::Impact { t, gap, before, after, impulse, group }));
            }
            let closed = GapSet::of(gap);
            let zeno = events.zeno_times.iter();
            all.extend(zeno.map(|&t| (t, Occurrence::Zeno { t, gap, closed })));
            let lifts = events.liftoff_times.iter();
            all.extend(lifts.map(|&t| (t, Occurrence::LiftOff { t, gap })));
        }
        all.sort_by(|one, other| one.0.total_cmp(&other.0));
        let mut resting = GapSet::EMPTY;
        for (_, mut occurrence) in all {
            match &mut occurrence {
                Occurrence::Impact { group, .. } => {
                    state.group += 1;
                    *group = state.group;
                }
                Occurrence::Zeno { gap, closed, .. } => {
                    resting = resting.with(GapSet::of(*gap));
                    *closed = resting;
                }
                Occurrence::LiftOff { gap, .. } => resting = resting.without(GapSet::of(*gap)),
                _ => (),
            }
            state.occurrences.push(occurrence);
        }
    }
}

impl Implicit {
    /// The impulses of the impacts that are new, `(g'+ - g'-)/D_ii`.
    fn note_impulses(&mut self, state: &mut Stepped) {
        for (i, (log, impulses)) in self.logs.iter().zip(&mut self.impulses).enumerate() {
            for it in &log.impacts()[impulses.len()..] {
                impulses.push((it.xdot_after - it.xdot_before) / state.kinetics.d(i, i));
            }
        }
    }
}

/// The last two lines of (1): coordinates and velocities at the end of the step.
fn ends_of_step<E>(
    state: &mut Stepped,
    h: f64,
    pushed: &[f64],
) -> Result<(Vec<f64>, Vec<f64>), Failure<E>> {
    let (n, m) = (state.layout.n, state.layout.m);
    let all: GapSet = (0..m).collect();
    let mut w = vec![0.0; n];
    state.kinetics.free_to(&mut w);
    w.iter_mut().zip(pushed).for_each(|(w, pushed)| *w += pushed);
    w.iter_mut().zip(&state.v).for_each(|(w, v)| *w = v + h * *w);
    let (next_x, next_v) = (&state.next_x, &state.next_v);
    // twice: the first leaves rounding of the speeds
    for _ in 0..2 {
        state.kinetics.solve_regular(all, |at, i| -at.rate(i, &w))?;
        state.kinetics.apply(all, &mut w);
    }
    let mut q: Vec<f64> = state.x.iter().zip(&w).map(|(x, w)| x + h * w).collect();
    let along = |at: &crate::kinetics::Kinetics, i: usize, q: &[f64]| -> f64 {
        at.normal(i).iter().zip(q).zip(next_x).map(|((n, q), last)| n * (q - last)).sum()
    };
    state.kinetics.solve_regular(all, |at, i| next_x[n + i] - at.gap(i) - along(at, i, &q))?;
    state.kinetics.apply(all, &mut q);
    state.kinetics.solve_regular(all, |_, i| next_v[n + i])?;
    state.kinetics.apply(all, &mut w);
    Ok((q, w))
}

/// The gaps with `s = v = 0`.
fn at_rest(z: &[Lifted]) -> GapSet {
    z.iter().enumerate().filter(|(_, z)| **z == Lifted::default()).map(|(i, _)| i).collect()
}

/// The kinetic cosine of the first two gaps that are not at right angles.
fn coupled(state: &mut Stepped) -> Option<f64> {
    let m = state.layout.m;
    for i in 0..m {
        for j in 0..i {
            let cosine = state.kinetics.cosine(i, j);
            if cosine.abs() > ORTHOGONAL || cosine.is_nan() {
                return Some(cosine);
            }
        }
    }
    None
}

// Friction in joints within the implicit step: `f_c in -L_c Sign(w_c+)`.
//
// The slip speed at the end of a step rises with the force `f_c`. So it is `-L_c` where the slip is
// positive even then, `L_c` where it is negative, and else the value that makes it zero.

/// Bisections of a force; each is a step of the scheme without an evaluation.
const BISECTIONS: usize = 200;
/// A slip that is smaller than this part of the velocities is none.
const NONE: f64 = 1e-13;

/// Coordinates and velocities at the end of a step.
type End = (Vec<f64>, Vec<f64>);

/// The forces of friction in joints.
pub(crate) struct JointForces {
    forces: Vec<f64>,
    pattern: ContactMode,
    /// Modes of friction in the last step.
    before: ContactMode,
}

impl Kinetics {
    /// Contribution of the friction forces to `b_i`.
    pub(crate) fn pulled(&mut self, i: usize, forces: &[f64]) -> f64 {
        let rows = (0..forces.len()).map(|channel| self.row(channel)).collect::<Vec<_>>();
        rows.into_iter().zip(forces).map(|(row, force)| force * self.d(i, row)).sum()
    }
}

impl JointForces {
    pub(crate) fn new(p: usize) -> Self {
        let before = ContactMode::default();
        Self { forces: vec![0.0; p], pattern: before, before }
    }

    /// The forces, by channel.
    pub(crate) fn forces(&self) -> &[f64] {
        &self.forces
    }

    /// The end of the step, computed by `step` from the accelerations due to the forces, joint by
    /// joint.
    pub(crate) fn solve<E>(
        &mut self,
        state: &mut Stepped,
        mut step: impl FnMut(&mut Stepped, &[f64], &[f64]) -> Result<End, Failure<E>>,
    ) -> Result<End, Failure<E>> {
        let Layout { n, p, .. } = state.layout;
        let mut end = |state: &mut Stepped, forces: &[f64]| {
            let mut pushed = vec![0.0; n];
            for (channel, &force) in forces.iter().enumerate() {
                let row = state.kinetics.row(channel);
                axpy(&mut pushed, force, state.kinetics.mobility(row));
            }
            step(state, &pushed, forces)
        };
        for channel in 0..p {
            let row = state.kinetics.row(channel);
            let (slip, stick) = state.kinetics.friction_limits(channel);
            let mut forces = self.forces.clone();
            let mut at = |state: &mut Stepped, force: f64| -> Result<f64, Failure<E>> {
                forces[channel] = force;
                let (_, w) = end(state, &forces)?;
                let rate = state.kinetics.rate(row, &w);
                let size = w.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
                Ok(if rate.abs() <= NONE * size { 0.0 } else { rate })
            };
            let (force, sign) = if at(state, -stick)? > 0.0 && at(state, -slip)? > 0.0 {
                (-slip, 1.0)
            } else if at(state, stick)? < 0.0 && at(state, slip)? < 0.0 {
                (slip, -1.0)
            } else {
                (stopping(stick, |force| at(state, force))?, 0.0)
            };
            self.forces[channel] = force;
            self.pattern = self.pattern.with_channel(channel, sign);
        }
        end(state, &self.forces)
    }

    /// Slips at the end of the step, how far they went, and the work of friction.
    pub(crate) fn finish_step(&self, state: &mut Stepped, h: f64) {
        let Layout { n, m, p, .. } = state.layout;
        if p == 0 {
            return;
        }
        let mut work = 0.0;
        for channel in 0..p {
            let (row, sticks) = (m + channel, self.pattern.stick.has(channel));
            let rate = state.kinetics.rate(row, &state.next_v[..n]);
            let c = n + row;
            state.next_v[c] = if sticks { 0.0 } else { rate };
            state.next_x[c] = state.x[c] + h * state.next_v[c];
            work -= h * self.forces[channel] * state.next_v[c];
            state.lambda[row] = self.forces[channel];
        }
        state.next_v[n + m + p] = state.v[n + m + p] + work;
        state.pattern = self.pattern;
    }

    /// Notes what friction does otherwise than before.
    pub(crate) fn note(&mut self, t: f64, state: &mut Stepped) {
        for channel in 0..self.forces.len() {
            let (before, after) = (self.before.number(channel), self.pattern.number(channel));
            if before != after {
                let it = Occurrence::Transition { t, channel, before, after };
                state.occurrences.push(it);
            }
        }
        self.before = self.pattern;
    }
}

/// The force up to a size that stops a slip, which rises with it.
fn stopping<E>(
    most: f64,
    mut slip: impl FnMut(f64) -> Result<f64, Failure<E>>,
) -> Result<f64, Failure<E>> {
    let (mut low, mut high) = ((-most, slip(-most)?), (most, slip(most)?));
    for k in 0..BISECTIONS {
        if high.1 - low.1 <= 0.0 || high.0 - low.0 <= f64::EPSILON * most {
            break;
        }
        // the chord, every third time the middle
        let chord = (low.0 * high.1 - high.0 * low.1) / (high.1 - low.1);
        let force = if k % 3 == 2 { 0.5 * (low.0 + high.0) } else { chord };
        let rate = slip(force)?;
        if rate == 0.0 {
            return Ok(force);
        }
        let side = if rate < 0.0 { &mut low } else { &mut high };
        *side = (force, rate);
    }
    Ok(0.5 * (low.0 + high.0))
}

#[cfg(test)]
mod joint_friction_tests {
    use super::*;

    #[test]
    fn before_a_step_joints_have_no_force() {
        assert_eq!(JointForces::new(2).forces(), [0.0; 2]);
    }
}
