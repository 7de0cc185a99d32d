//! Moreau-Jean time stepping for systems with several gaps.
//!
//! ```text
//! w+ = w + h A_theta + M^-1 N_I^T P      A_theta = theta A(t+, q+, w+) + (1 - theta) A(t, q, w)
//! q+ = q + h (theta w+ + (1 - theta) w)
//! 0 <= P  perp  g'+ + e g' >= 0          on I = {i: g_i + h/2 g_i' <= 0}                    (1)
//! ```
//!
//! With friction the impulses are those of [`super::friction`], with `-P_T in mu P_N Sign(w+ + e_t w-)` at
//! gaps and `-P_T in h L Sign(w+)` in joints. `A = M^-1 F`; mass matrix and gradients of the impulses are those at the end of the step, found
//! with it by fixed-point iteration. Contact is decided at velocity level, so a gap may be
//! negative, by up to about `h |g'|`. The order is one, through accumulations of any kind. Where
//! the `e_i` differ, impulses on several gaps of which some open may raise the energy.

use super::contact_problem::problem;
use super::fixed_steps::{simulate, Scheme, Stepped};
use super::friction::Collision;
use super::kinetics::Model;
use super::lcp;
use super::output::MechanicalRun;
use crate::record::contact_mode::ContactMode;
use crate::record::failure::Failure;
use crate::record::gap_set::GapSet;
use crate::record::occurrence::Occurrence;
use crate::record::point::MotionPoint;
use crate::system::dynamics::{Dynamics, Layout};
use crate::{Grid, Monitor, MoreauJean, SetupError, Status, UserEvent};

/// Simulates a mechanical system with Moreau-Jean time stepping.
///
/// Recorded are impacts (impulses on gaps that close), Zeno points (a gap that is pressed from slow
/// speeds on) and lift-offs, as in [`crate::simulate_moreau_jean`]; reactions are `P/h`.
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
    /// What friction did in the last step.
    before: ContactMode,
}

impl Scheme for Impulses {
    /// Gaps that touch without a speed under a pull are at rest.
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
        let Layout { n, m, p } = self.layout;
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
    let Layout { n, m, p } = state.layout;
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
