//! Moreau-Jean time stepping for systems with several gaps.
//!
//! ```text
//! w+ = w + h A_theta + M^-1 N_I^T P      A_theta = theta A(t+, q+, w+) + (1 - theta) A(t, q, w)
//! q+ = q + h (theta w+ + (1 - theta) w)
//! 0 <= P  perp  g'+ + e g' >= 0          on I = {i: g_i + h/2 g_i' <= 0}                    (1)
//! ```
//!
//! `A = M^-1 F`; mass matrix and gradients of the impulses are those at the end of the step, found
//! with it by fixed-point iteration. Contact is decided at velocity level, so a gap may be
//! negative, by up to about `h |g'|`. The order is one, through accumulations of any kind. Where
//! the `e_i` differ, impulses on several gaps of which some open may raise the energy.

use super::gap_set::GapSet;
use super::kinetics::{Kinetics, Model};
use super::lcp;
use super::machine::problem;
use super::occurrence::Occurrence;
use super::run::{check_sizes, MechanicalRun, MechanicalSamples};
use super::state_events::{StateEvent, StateHit, StateWatch};
use crate::record::failure::Failure;
use crate::record::monitor::Pace;
use crate::record::reserve::Reserve;
use crate::system::dynamics::{Dynamics, Layout};
use crate::{Counts, Grid, Monitor, MoreauJean, SetupError, Status};

/// Fixed-point iterations of a step, and the change that ends them, relative to the state.
const SWEEPS: usize = 60;
const CONVERGED: f64 = 1e-13;

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
    mut events: Vec<StateEvent<'_, E>>,
    monitor: &mut impl Monitor<E>,
) -> Result<MechanicalRun<E>, SetupError> {
    let MoreauJean { theta } = method.validated()?;
    let layout = dynamics.layout();
    check_sizes(layout, e, q, w)?;
    let mut model = Model::new(dynamics);
    let mut walk = Walk::new(layout, theta, e, grid, (q, w));
    let mut watch = StateWatch::new(&mut events, layout.n, layout.m);
    let ending = walk.go(&mut model, &mut watch, monitor);
    let (status, raised) = match ending {
        Ok(None) => (Status::Completed, None),
        Ok(Some(hit)) => {
            walk.samples.push(hit.t, (&hit.x, &hit.v), &vec![0.0; layout.m], walk.pressed);
            (Status::TerminatedByEvent, None)
        }
        Err(Failure::Status(status)) => (status, None),
        Err(Failure::Raised(error)) => (Status::Raised, Some(error)),
    };
    let counts =
        Counts { nfev: model.count, accepted: walk.k as u64, rejected: 0, impacts: walk.group };
    let Walk { samples, occurrences, .. } = walk;
    let hits = watch.into_hits();
    Ok(MechanicalRun { layout, samples, occurrences, hits, path: None, status, raised, counts })
}

/// A run under way: `k` steps are done.
struct Walk {
    layout: Layout,
    theta: f64,
    e: Vec<f64>,
    grid: Grid,
    kinetics: Kinetics,
    k: usize,
    /// Coordinates and gaps, their rates, and the free accelerations of the coordinates.
    x: Vec<f64>,
    v: Vec<f64>,
    free: Vec<f64>,
    /// The step: its end and the impulses.
    next_x: Vec<f64>,
    next_v: Vec<f64>,
    impulses: Vec<f64>,
    /// The gaps that are at rest.
    pressed: GapSet,
    group: u64,
    samples: MechanicalSamples,
    occurrences: Vec<Occurrence>,
    reserve: Reserve,
}

impl Walk {
    fn new(layout: Layout, theta: f64, e: &[f64], grid: Grid, (q, w): (&[f64], &[f64])) -> Self {
        let zeros = vec![0.0; layout.n + layout.m];
        let (mut x, mut v) = (zeros.clone(), zeros.clone());
        x[..layout.n].copy_from_slice(q);
        v[..layout.n].copy_from_slice(w);
        Self {
            layout,
            theta,
            e: e.to_vec(),
            grid,
            kinetics: Kinetics::new(layout),
            k: 0,
            next_x: x.clone(),
            next_v: v.clone(),
            x,
            v,
            free: vec![0.0; layout.n],
            impulses: vec![0.0; layout.m],
            pressed: GapSet::EMPTY,
            group: 0,
            samples: MechanicalSamples::default(),
            occurrences: Vec::new(),
            reserve: Reserve::default(),
        }
    }

    fn go<E, D: Dynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
        watch: &mut StateWatch<'_, '_, E>,
        monitor: &mut impl Monitor<E>,
    ) -> Result<Option<StateHit>, Failure<E>> {
        self.begin(model)?;
        watch.start(self.grid.t(0), &self.x, &self.v).map_err(Failure::Raised)?;
        let mut pace = Pace::start();
        while self.k < self.grid.n_steps() {
            for _ in 0..pace.chunk().min(self.grid.n_steps() - self.k) {
                let (t, t_end) = (self.grid.t(self.k), self.grid.t(self.k + 1));
                self.make_room(watch)?;
                self.step(t_end, t_end - t, model)?;
                let stop = if watch.is_idle() { None } else { self.look(t, t_end, watch)? };
                if stop.is_some() {
                    return Ok(stop);
                }
                self.note(t, t_end);
                self.k += 1;
            }
            monitor.poll(self.k, self.grid.n_steps()).map_err(Failure::Raised)?;
            pace.adjust();
        }
        Ok(None)
    }

    /// Evaluates the start; gaps that touch without a speed under a pull are at rest.
    fn begin<E, D: Dynamics<E>>(&mut self, model: &mut Model<'_, D>) -> Result<(), Failure<E>> {
        let (n, t) = (self.layout.n, self.grid.t(0));
        self.kinetics.evaluate(model, t, &self.x[..n], &self.v[..n])?;
        self.kinetics.free_to(&mut self.free);
        for i in 0..self.layout.m {
            let (gap, rate) = (self.kinetics.gap(i), self.kinetics.rate(i, &self.v[..n]));
            (self.x[n + i], self.v[n + i]) = (gap, rate);
            if gap <= 0.0 && rate == 0.0 && self.kinetics.b(i) <= 0.0 {
                self.pressed = self.pressed.with(GapSet::of(i));
            }
        }
        self.samples.make_room(&mut self.reserve, 1, self.x.len(), self.layout.m)?;
        self.samples.push(t, (&self.x, &self.v), &self.impulses, self.pressed);
        Ok(())
    }

    fn make_room<E>(&mut self, watch: &mut StateWatch<'_, '_, E>) -> Result<(), Failure<E>> {
        let (size, m) = (self.x.len(), self.layout.m);
        self.samples.make_room(&mut self.reserve, 1, size, m)?;
        self.reserve.room(&mut self.occurrences, 2 * m, 2 * size_of::<f64>())?;
        watch.make_room(&mut self.reserve)?;
        Ok(())
    }

    /// One step of (1).
    fn step<E, D: Dynamics<E>>(
        &mut self,
        t_end: f64,
        h: f64,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let (n, m) = (self.layout.n, self.layout.m);
        let closing = |i: &usize| self.x[n + i] + 0.5 * h * self.v[n + i] <= 0.0;
        let set: GapSet = (0..m).filter(closing).collect();
        for i in 0..n {
            self.next_v[i] = self.v[i] + h * self.free[i];
            self.next_x[i] = self.x[i] + h * self.v[i];
        }
        for _ in 0..SWEEPS {
            self.kinetics.evaluate(model, t_end, &self.next_x[..n], &self.next_v[..n])?;
            for i in 0..m {
                self.next_x[n + i] = self.kinetics.gap(i);
                self.next_v[n + i] = self.kinetics.rate(i, &self.next_v[..n]);
            }
            if self.sweep(h, set)? <= CONVERGED {
                self.kinetics.free_to(&mut self.free);
                std::mem::swap(&mut self.x, &mut self.next_x);
                std::mem::swap(&mut self.v, &mut self.next_v);
                return Ok(());
            }
        }
        Err(Failure::Status(Status::ForceNotConverged))
    }

    /// The end of the step with mass, forces and gradients at the present iterate; by how much
    /// that changes it, relative to it.
    fn sweep<E>(&mut self, h: f64, set: GapSet) -> Result<f64, Failure<E>> {
        let (n, theta) = (self.layout.n, self.theta);
        let mut w: Vec<f64> = vec![0.0; n];
        self.kinetics.free_to(&mut w);
        for ((w, v), free) in w.iter_mut().zip(&self.v).zip(&self.free) {
            *w = v + h * (theta * *w + (1.0 - theta) * free);
        }
        self.impulses.fill(0.0);
        if !set.is_empty() {
            let (e, v) = (&self.e, &self.v);
            let (matrix, right) =
                problem(&mut self.kinetics, set, |at, i| at.rate(i, &w) + e[i] * v[n + i]);
            let solution = lcp::solve(&matrix, &right);
            let solution = solution.ok_or(Failure::Status(Status::ImpactNotSolved))?;
            for (i, p) in set.iter().zip(solution.z) {
                self.impulses[i] = p;
                let mobility = self.kinetics.mobility(i);
                w.iter_mut().zip(mobility).for_each(|(w, d)| *w += p * d);
            }
        }
        let (mut change, mut size) = (0.0_f64, f64::MIN_POSITIVE);
        for (i, &w) in w.iter().enumerate() {
            let q = self.x[i] + h * (theta * w + (1.0 - theta) * self.v[i]);
            change = change.max((w - self.next_v[i]).abs()).max((q - self.next_x[i]).abs() / h);
            size = size.max(w.abs()).max(self.v[i].abs()).max(h * self.free[i].abs());
            size = size.max(f64::EPSILON / CONVERGED * q.abs() / h);
            (self.next_v[i], self.next_x[i]) = (w, q);
        }
        if change.is_nan() {
            return Err(Failure::Status(Status::StateNotFinite));
        }
        Ok(change / size)
    }

    /// Follows the user's events along the line between both ends of the step, which has been
    /// taken.
    fn look<E>(
        &mut self,
        t: f64,
        t_end: f64,
        watch: &mut StateWatch<'_, '_, E>,
    ) -> Result<Option<StateHit>, Failure<E>> {
        let line = |at: f64, x: &mut [f64], v: &mut [f64]| {
            let part = (at - t) / (t_end - t);
            for c in 0..x.len() {
                x[c] = self.next_x[c] + part * (self.x[c] - self.next_x[c]);
                v[c] = self.next_v[c] + part * (self.v[c] - self.next_v[c]);
            }
        };
        watch.along(t, t_end, &line).map_err(Failure::Raised)
    }

    /// Notes what happened in the step that was taken, and its end.
    fn note(&mut self, t: f64, t_end: f64) {
        let (n, h) = (self.layout.n, t_end - t);
        self.group += u64::from(self.impulses.iter().any(|&impulse| impulse > 0.0));
        for gap in 0..self.layout.m {
            let (before, after) = (self.next_v[n + gap], self.v[n + gap]);
            let impulse = self.impulses[gap];
            let pull = h * self.kinetics.b(gap);
            let slow = before.abs() <= pull.abs() && after.abs() <= pull.abs();
            if self.pressed.has(gap) {
                let leaves = after > pull.abs() || (pull > 0.0 && self.x[n + gap] > 0.0);
                if impulse == 0.0 && leaves {
                    self.pressed = self.pressed.without(GapSet::of(gap));
                    self.occurrences.push(Occurrence::LiftOff { t, gap });
                }
            } else if impulse > 0.0 && slow {
                self.pressed = self.pressed.with(GapSet::of(gap));
                let closed = self.pressed;
                self.occurrences.push(Occurrence::Zeno { t: t_end, gap, closed });
            } else if impulse > 0.0 && before < 0.0 {
                let (t, group) = (t_end, self.group);
                self.occurrences.push(Occurrence::Impact { t, gap, before, after, impulse, group });
            }
        }
        let reactions = self.impulses.iter_mut();
        reactions.for_each(|impulse| *impulse /= h);
        self.samples.push(t_end, (&self.x, &self.v), &self.impulses, self.pressed);
    }
}
