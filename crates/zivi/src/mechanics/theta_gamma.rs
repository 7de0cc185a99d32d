//! The implicit step in `(s, v)` of each gap, for one gap or gaps at right angles.
//!
//! A gap that no impulse of another changes is a scalar motion with the free acceleration `b` for
//! its force. With `g = |s|` and `g' = R lambda_s v`, one step is
//!
//! ```text
//! (s+, v+)     the step theta = gamma = 1 of [`crate::ThetaGamma`] under b = n . A + h
//! g'+          R lambda_s v+,  R = 1 - kappa lambda_s lambda_v
//! w+           w + h A, its speeds of the gaps set to g'+ along M^-1 n                    (1)
//! q+           q + h w_T, moved along M^-1 n to g(q+) = |s+|
//! ```
//!
//! Friction in joints is one more sign: the forces `f_c in -L_c Sign(w_c+)` are added to those of `A`, one
//! joint after the other, with the step solved for each of their values. At gaps `P_T` would make the
//! velocities jump: friction there is refused.
//!
//! Here `w_T` is the part of `w+` that leaves the gaps as they are, and everything else taken at the
//! end of the step by fixed-point iteration. In contact `s = v = 0` exactly. Between gaps that are
//! coupled `v` would jump at the impacts of the others: they are refused.

use super::fixed_steps::{simulate, Scheme, Stepped};
use super::joint_friction::JointForces;
use super::kinetics::Model;
use super::output::MechanicalRun;
use crate::record::events::EventLog;
use crate::record::failure::Failure;
use crate::record::gap_set::GapSet;
use crate::record::occurrence::Occurrence;
use crate::record::point::MotionPoint;
use crate::system::dynamics::Dynamics;
use crate::{Branch, Grid, Lifted, Monitor, Physical, Restitution, SetupError, Status, UserEvent};
use zivi_core::{transform, StepSolution, ThetaGammaStep};

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
    let along = |at: &super::kinetics::Kinetics, i: usize, q: &[f64]| -> f64 {
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
