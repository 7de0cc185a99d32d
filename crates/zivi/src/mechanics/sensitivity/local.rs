//! The mechanics at one state and its derivatives along any direction.
//!
//! With `r'` for the derivative of `r` along the direction, contacts `C` and forces `lambda` on
//! them, the accelerations `a = q''` of `M a - N_C^T lambda = F`, `N_C a + h_C = 0` change by
//!
//! ```text
//! M a' - N_C^T lambda' = F' - M' a + N_C'^T lambda
//! N_C a'               = -h_C' - N_C' a                                                   (1)
//! ```
//!
//! and the velocities after impulses `P` on a set `S`, `M (w+ - w-) = N_S^T P`, `N_S w+ + g_t = u`,
//!
//! ```text
//! M w+' - N_S^T P' = M w-' - M' (w+ - w-) + N_S'^T P
//! N_S w+'          = u' - N_S' w+ - g_t'                                                  (2)
//! ```

use crate::mechanics::kinetics::{Kinetics, Model};
use crate::numeric::vector::{axpy, dot};
use crate::record::failure::Failure;
use crate::record::gap_set::GapSet;
use crate::system::dynamics::Layout;
use crate::system::friction::Friction;
use crate::system::partials::{DifferentiableDynamics, TimedState};
use crate::Status;

/// A direction in time, state and parameters.
#[derive(Clone, Copy, Debug)]
pub(super) struct Direction<'a> {
    pub(super) t: f64,
    pub(super) q: &'a [f64],
    pub(super) w: &'a [f64],
    /// Which of the parameters that the derivatives are taken by.
    pub(super) parameter: Option<usize>,
}

/// A change of the velocities by impulses, and how it moves with the data.
pub(super) struct Exchange<'a> {
    /// The gaps with impulses.
    pub(super) set: GapSet,
    /// The impulses, in the order of the set.
    pub(super) impulses: &'a [f64],
    /// `w-` and `w+`.
    pub(super) before: &'a [f64],
    pub(super) after: &'a [f64],
}

/// Values and partial derivatives at one time and state.
#[derive(Clone, Debug)]
pub(super) struct Local {
    layout: Layout,
    pub(super) kinetics: Kinetics,
    /// The parameters that the derivatives are taken by.
    by: Vec<usize>,
    partials: Vec<f64>,
    /// How often they were evaluated.
    pub(super) count: u64,
}

impl Local {
    pub(super) fn new(layout: Layout, by: Vec<usize>) -> Self {
        let partials = vec![0.0; layout.len() * (1 + 2 * layout.n + by.len())];
        Self { layout, kinetics: Kinetics::new(layout, Friction::none()), by, partials, count: 0 }
    }

    /// The parameters that the derivatives are taken by.
    pub(super) fn by(&self) -> &[usize] {
        &self.by
    }

    /// Evaluates the system and its partial derivatives.
    pub(super) fn visit<E, D: DifferentiableDynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
        t: f64,
        q: &[f64],
        w: &[f64],
    ) -> Result<(), Failure<E>> {
        self.kinetics.evaluate(model, t, q, w)?;
        let t = model.smooth.nearest(t);
        self.count += 1;
        let at = TimedState { t, q, w };
        model.dynamics.partials(at, &self.by, &mut self.partials).map_err(Failure::Raised)?;
        if self.partials.iter().all(|value| value.is_finite()) {
            Ok(())
        } else {
            Err(Failure::Status(Status::ForceNotFinite))
        }
    }

    /// The derivatives of the numbers of an evaluation along a direction.
    pub(super) fn along(&self, direction: Direction<'_>) -> Vec<f64> {
        let (n, length) = (self.layout.n, self.layout.len());
        let mut row = vec![0.0; length];
        let mut add = |index: usize, factor: f64| {
            if factor != 0.0 {
                axpy(&mut row, factor, &self.partials[index * length..][..length]);
            }
        };
        add(0, direction.t);
        for c in 0..n {
            add(1 + c, direction.q[c]);
            add(1 + n + c, direction.w[c]);
        }
        if let Some(parameter) = direction.parameter {
            add(1 + 2 * n + parameter, 1.0);
        }
        row
    }

    fn normal<'r>(&self, row: &'r [f64], i: usize) -> &'r [f64] {
        let n = self.layout.n;
        &row[self.layout.gradient()][i * n..][..n]
    }

    /// `x - M' y`.
    fn less_mass(&self, row: &[f64], y: &[f64], x: &mut [f64]) {
        let n = self.layout.n;
        for (x, mass) in x.iter_mut().zip(row[self.layout.mass()].chunks_exact(n)) {
            *x -= dot(mass, y);
        }
    }

    /// Solves `M x - N_S^T y = right`, `N_S x = of_gap(i)`: `x` takes the place of `right`, `y` is
    /// returned.
    fn solve<E>(
        &mut self,
        set: GapSet,
        right: &mut [f64],
        of_gap: impl Fn(usize) -> f64,
    ) -> Result<Vec<f64>, Failure<E>> {
        self.kinetics.solve_mass(right);
        if set.is_empty() {
            return Ok(Vec::new());
        }
        let free = &*right;
        self.kinetics.solve_regular(set, |at, i| of_gap(i) - dot(at.normal(i), free))?;
        self.kinetics.apply(set, right);
        Ok(self.kinetics.solved()[..set.len()].to_vec())
    }

    /// Equations (1) for the mode in which the kinetics were last evaluated: the derivatives of the
    /// accelerations of coordinates and gaps, and of the forces by gap.
    pub(super) fn acceleration<E>(
        &mut self,
        closed: GapSet,
        row: &[f64],
    ) -> Result<(Vec<f64>, Vec<f64>), Failure<E>> {
        let Layout { n, m, .. } = self.layout;
        let at = self.kinetics.acceleration[..n].to_vec();
        let mut change = row[self.layout.force()].to_vec();
        self.less_mass(row, &at, &mut change);
        for i in closed.iter() {
            axpy(&mut change, self.kinetics.lambda[i], self.normal(row, i));
        }
        let bend = |i: usize| row[self.layout.curvature()][i];
        let turned: Vec<f64> = (0..m).map(|i| bend(i) + dot(self.normal(row, i), &at)).collect();
        let pressed = self.solve(closed, &mut change, |i| -turned[i])?;
        let mut forces = vec![0.0; m];
        closed.iter().zip(pressed).for_each(|(i, force)| forces[i] = force);
        let gap = |k: usize| {
            if closed.has(k) {
                0.0
            } else {
                turned[k] + dot(self.kinetics.normal(k), &change)
            }
        };
        let gaps: Vec<f64> = (0..m).map(gap).collect();
        change.extend(gaps);
        Ok((change, forces))
    }

    /// Equations (2), with `w-'` in `velocities`, which `w+'` takes the place of, and the rates of
    /// the gaps: those of the set become `target`, the others change by the impulses.
    pub(super) fn exchange<E>(
        &mut self,
        how: &Exchange<'_>,
        row: &[f64],
        target: impl Fn(usize) -> f64,
        velocities: &mut [f64],
        rates: &mut [f64],
    ) -> Result<(), Failure<E>> {
        let Exchange { set, impulses, before, after } = *how;
        let jump: Vec<f64> =
            after.iter().zip(before).map(|(after, before)| after - before).collect();
        let mut change = vec![0.0; self.layout.n];
        self.less_mass(row, &jump, &mut change);
        for (i, impulse) in set.iter().zip(impulses) {
            axpy(&mut change, *impulse, self.normal(row, i));
        }
        // the part of M w-' is solved for already
        let old = velocities.to_vec();
        let moves = |i: usize| dot(self.normal(row, i), after) + row[self.layout.rate()][i];
        let wanted: Vec<f64> = (0..self.layout.m)
            .map(|i| target(i) - moves(i) - dot(self.kinetics.normal(i), &old))
            .collect();
        self.solve(set, &mut change, |i| wanted[i])?;
        axpy(velocities, 1.0, &change);
        for (k, rate) in rates.iter_mut().enumerate() {
            *rate = if set.has(k) {
                target(k)
            } else {
                let turned = dot(self.normal(row, k), &jump);
                *rate + turned + dot(self.kinetics.normal(k), &change)
            };
        }
        Ok(())
    }

    /// The derivatives of the gaps and of their rates, by those of the state.
    pub(super) fn gaps(&self, row: &[f64], w: &[f64], by_w: &[f64]) -> Vec<[f64; 2]> {
        let one = |i: usize| {
            let rate = dot(self.normal(row, i), w) + row[self.layout.rate()][i];
            [row[self.layout.gap()][i], rate + dot(self.kinetics.normal(i), by_w)]
        };
        (0..self.layout.m).map(one).collect()
    }

    /// Moves the derivatives of a state, along the directions of the impulses, into the manifold
    /// where the gaps of a set stay zero.
    pub(super) fn project<E>(
        &mut self,
        set: GapSet,
        w: &[f64],
        parameter: Option<usize>,
        (q, v): (&mut [f64], &mut [f64]),
    ) -> Result<(), Failure<E>> {
        let direction =
            |q: &[f64], v: &[f64], at: &Self| at.along(Direction { t: 0.0, q, w: v, parameter });
        let gaps = direction(q, v, self)[self.layout.gap()].to_vec();
        self.kinetics.solve_regular(set, |_, i| -gaps[i])?;
        self.kinetics.apply(set, q);
        let row = direction(q, v, self);
        let rates = self.gaps(&row, w, v);
        self.kinetics.solve_regular(set, |_, i| -rates[i][1])?;
        self.kinetics.apply(set, v);
        Ok(())
    }
}
