//! The equality rows of a state: what is left of accelerations and mobilities on the manifold, and projections
//! onto it, equations (1) and (2) of [`crate::kinetics::equalities`].

use crate::kinetics::equalities::{clear, Equalities, AGREES, PROJECTIONS, SLIGHT, VELOCITIES};
use crate::kinetics::shares::{orthonormal, shortest};
use crate::kinetics::{Kinetics, Model, Undetermined, REDUNDANT};
use crate::numeric::dense::dot;
use crate::numeric::stages::StepError;
use crate::record::gap_set::GapSet;
use crate::record::status::Failure;
use crate::system::dynamics::{Dynamics, Layout};
use crate::Status;

impl Kinetics {
    /// The equality rows of a layout, if there are any.
    pub(super) fn rows_of_equality(layout: Layout) -> Option<Box<Equalities>> {
        (layout.k > 0).then(|| Box::new(Equalities::new(layout)))
    }

    /// The equality rows where the system was evaluated last, if there are any.
    pub(crate) fn equalities(&self) -> Option<&Equalities> {
        self.equalities.as_deref()
    }

    /// From here on projections use these rows, which belong to a place nearby.
    pub(crate) fn restore_equalities(&mut self, from: &Equalities) {
        if let Some(to) = &mut self.equalities {
            to.as_mut().clone_from(from);
        }
    }

    /// The next evaluation is on the manifold.
    pub(crate) fn land_on_manifold(&mut self) {
        if let Some(rows) = &mut self.equalities {
            rows.on_manifold = true;
        }
    }

    /// `M^-1 G^T` and `D` of another evaluation.
    pub(super) fn renew_equalities(&mut self) {
        if let Some(rows) = &mut self.equalities {
            rows.renew(&self.values, &self.factor);
        }
    }

    /// Free accelerations on the manifold, the first of (1).
    pub(super) fn hold_free<E>(&mut self) -> Result<(), Failure<E>> {
        let Some(rows) = &mut self.equalities else { return Ok(()) };
        rows.free.copy_from_slice(&self.free);
        let wanted = |free: &[f64], row: usize| rows.acceleration(&self.values, row, free);
        let right: Vec<f64> = (0..rows.layout.k).map(|row| wanted(&self.free, row)).collect();
        let forces = rows.solve(|row| right[row]);
        let mut sizes: Vec<f64> = self.free.iter().map(|a| a.abs()).collect();
        for (row, force) in forces.iter().enumerate() {
            for (i, part) in rows.mobility(row).iter().enumerate() {
                self.free[i] -= force * part;
                sizes[i] += (force * part).abs();
            }
        }
        rows.sizes.copy_from_slice(&sizes);
        if std::mem::take(&mut rows.on_manifold) {
            for row in (0..rows.layout.k).filter(|row| !rows.basis.contains(row)) {
                let terms = rows.gradient(&self.values, row).iter().zip(&sizes);
                let curvature = self.values[rows.layout.equality_curvature().start + row];
                let size: f64 = terms.map(|(g, a)| (g * a).abs()).sum::<f64>() + curvature.abs();
                if rows.acceleration(&self.values, row, &self.free).abs() > AGREES * size {
                    return Err(Failure::Status(Status::InconsistentConstraints));
                }
            }
        }
        Ok(())
    }

    /// The mobility of a row on the manifold, the second of (1), where the mass alone has been solved for.
    pub(super) fn hold_mobility(&mut self, i: usize) {
        let Some(rows) = &self.equalities else { return };
        let n = self.layout.n;
        let column = &mut self.mobility[i * n..][..n];
        let normal = &self.values[self.gradient + i * n..][..n];
        let whole = dot(normal, column);
        // the second removes what rounding has left of the first
        for _ in 0..2 {
            let along = column.to_vec();
            rows.pull(column, |row| dot(rows.gradient(&self.values, row), &along));
        }
        // NaN counts as free
        if dot(normal, column) <= REDUNDANT * whole {
            column.fill(0.0);
        }
    }

    /// By coordinate the size of the terms of `A`, where there are equality rows.
    pub(super) fn sizes_of_free(&self) -> Option<&[f64]> {
        self.equalities.as_ref().map(|rows| &rows.sizes[..])
    }

    /// Contact forces by row, then the multipliers of the equality rows, where the forces are known.
    pub(crate) fn forces(&mut self) -> &[f64] {
        let Some(mut rows) = self.equalities.take() else { return &self.lambda };
        let Layout { n, k, .. } = self.layout;
        let mut right: Vec<f64> =
            (0..k).map(|row| rows.acceleration(&self.values, row, &rows.free)).collect();
        let contacts = self.lambda.len();
        for (i, force) in self.lambda.iter().enumerate().filter(|it| *it.1 != 0.0) {
            let normal = &self.values[self.gradient + i * n..][..n];
            for (row, right) in right.iter_mut().enumerate() {
                *right += force * dot(normal, rows.mobility(row));
            }
        }
        let mut multipliers = rows.solve(|row| -right[row]);
        rows.shorten(&self.values, &mut multipliers);
        rows.forces[..contacts].copy_from_slice(&self.lambda);
        rows.forces[contacts..].copy_from_slice(&multipliers);
        &self.equalities.insert(rows).forces
    }

    /// Whether multipliers of equality rows are not determined by the motion.
    pub(crate) fn has_dependent_equalities(&self) -> bool {
        self.equalities.as_ref().is_some_and(|rows| {
            // a row without a gradient acts on nothing
            let acting = rows.scales.iter().filter(|scale| **scale > 0.0).count();
            rows.basis.len() < acting
        })
    }

    /// One iteration of (2) at the place of the last evaluation: whether one more is needed at another. Gaps
    /// move with the coordinates.
    pub(crate) fn pull_back(&mut self, q: &mut [f64], w: &mut [f64]) -> bool {
        let Some(rows) = &self.equalities else { return false };
        let (far, fast) = (rows.far(&self.values, q), rows.fast(&self.values, w));
        if far.max(fast) <= clear(q, w) {
            return false;
        }
        let before = q.to_vec();
        rows.pull_position(&self.values, q);
        rows.pull_velocity(&self.values, w);
        let moved: Vec<f64> = q.iter().zip(&before).map(|(q, before)| q - before).collect();
        let gaps = self.layout.gap().start;
        for i in 0..self.layout.m {
            self.values[gaps + i] += dot(self.normal(i), &moved);
        }
        far > SLIGHT || fast > SLIGHT
    }

    /// Projects a state onto the manifold (2), with the mobilities of an evaluation nearby.
    pub(crate) fn hold<E, D: Dynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
        t: f64,
        (q, w): (&mut [f64], &mut [f64]),
    ) -> Result<(), Failure<E>> {
        self.forget_place();
        let Some(rows) = &self.equalities else { return Ok(()) };
        let mut last = f64::INFINITY;
        for iteration in 0..=PROJECTIONS {
            model.evaluate_equalities(t, (q, w), &mut self.values)?;
            let far = rows.far(&self.values, q);
            // as near as rounding lets it come
            if far <= clear(q, w) || far >= 0.5 * last || iteration == PROJECTIONS {
                break;
            }
            last = far;
            rows.pull_position(&self.values, q);
            rows.pull_velocity(&self.values, w);
            if far <= SLIGHT {
                break;
            }
        }
        for _ in 0..VELOCITIES {
            if rows.fast(&self.values, w) > clear(q, w) {
                rows.pull_velocity(&self.values, w);
            }
        }
        match rows.basis.len() == rows.layout.k || rows.obeys(&self.values, (q, w)) {
            true => Ok(()),
            false => Err(Failure::Status(Status::InconsistentConstraints)),
        }
    }

    /// Accelerations of a place nearby on the manifold of the last projection.
    pub(crate) fn hold_acceleration(&self, a: &mut [f64]) {
        if let Some(rows) = &self.equalities {
            let right: Vec<f64> =
                (0..rows.layout.k).map(|row| rows.acceleration(&self.values, row, a)).collect();
            rows.pull(a, |row| right[row]);
        }
    }

    /// Takes out of errors of coordinates what a projection (2) removes; gaps move with the coordinates.
    pub(crate) fn project_errors(&self, errors: &mut [StepError]) {
        let Some(rows) = &self.equalities else { return };
        let parts: [fn(&mut StepError) -> &mut f64; 4] =
            [|it| &mut it.x[0], |it| &mut it.x[1], |it| &mut it.xdot[0], |it| &mut it.xdot[1]];
        let n = self.layout.n;
        for part in parts {
            let mut error: Vec<f64> = errors[..n].iter_mut().map(|it| *part(it)).collect();
            let before = error.clone();
            rows.pull(&mut error, |row| dot(rows.gradient(&self.values, row), &before));
            let moved: Vec<f64> = error.iter().zip(&before).map(|(to, from)| to - from).collect();
            for row in 0..self.layout.rows() {
                *part(&mut errors[n + row]) += dot(self.normal(row), &moved);
            }
            errors.iter_mut().zip(error).for_each(|(it, error)| *part(it) = error);
        }
    }

    /// Whether the state of the last evaluation obeys the equality rows to a part of their terms.
    pub(crate) fn obeys_equalities(&self, q: &[f64], w: &[f64]) -> bool {
        self.equalities.as_ref().is_none_or(|rows| rows.obeys(&self.values, (q, w)))
    }
}

// Contacts that follow from others: the motion does not determine their forces.
//
// ```text
// D_CC nu = 0      lambda + V alpha, V a basis of such nu      the same motion for every alpha   (1)
// ```

/// Rows that follow from others have an acceleration of this part of its terms at most.
const CONSISTENT: f64 = 1e-7;

impl Kinetics {
    /// `x = D_CC^-1 r` with the right sides by row: zero at rows that follow from those before them.
    pub(crate) fn solve_dependent(
        &mut self,
        set: GapSet,
        right: impl Fn(&Self, usize) -> f64,
    ) -> Result<(), Undetermined> {
        let basis = self.independent(set);
        self.solve_regular(basis, right)?;
        self.spread(basis, set);
        Ok(())
    }

    /// The last solution on some rows of a set, in the order of the set, zero at the others.
    fn spread(&mut self, basis: GapSet, set: GapSet) {
        let mut x = self.right[..basis.len()].iter().copied();
        let all: Vec<f64> =
            set.iter().map(|i| if basis.has(i) { x.next().unwrap_or(0.0) } else { 0.0 }).collect();
        self.right[..all.len()].copy_from_slice(&all);
    }

    /// The vectors `nu` of a set of rows, one for each that follows from those of a basis, by row.
    /// The factor of the basis is then known, if it exists.
    fn null_vectors(&mut self, basis: GapSet, set: GapSet) -> Result<Vec<Vec<f64>>, Undetermined> {
        let mut all: Vec<Vec<f64>> = Vec::new();
        for last in set.without(basis).iter() {
            let of_last: Vec<f64> = (0..self.layout.rows()).map(|i| self.d(i, last)).collect();
            match all.is_empty() {
                true => self.solve_regular(basis, |_, i| of_last[i])?,
                false => self.solve_again(basis, |_, i| of_last[i])?,
            }
            let mut null = vec![0.0; of_last.len()];
            basis.iter().zip(&self.right).for_each(|(row, part)| null[row] = *part);
            null[last] = -1.0;
            all.push(null);
        }
        Ok(all)
    }

    /// The forces of a set of contacts, by its order: of all those that keep it closed the least without a
    /// negative part; and a basis of (1) by row, empty for a unique solution.
    pub(super) fn solve_forces(&mut self, set: GapSet) -> Result<Vec<Vec<f64>>, Undetermined> {
        if self.solve_regular(set, |at, i| -at.b[i]).is_ok() {
            return Ok(Vec::new());
        }
        let basis = self.independent(set);
        let null = self.null_vectors(basis, set)?;
        match null.is_empty() {
            true => self.solve_regular(basis, |at, i| -at.b[i])?,
            false => self.solve_again(basis, |at, i| -at.b[i])?,
        }
        self.spread(basis, set);
        let null = orthonormal(&null);
        let mut forces = vec![0.0; self.layout.rows()];
        set.iter().zip(&self.right).for_each(|(row, force)| forces[row] = *force);
        // the others must keep the contacts that follow from them closed
        for i in set.iter() {
            let pushed: f64 = set.iter().map(|j| self.d(i, j) * forces[j]).sum();
            let scale = self.acceleration_scale(i) + self.b[i].abs();
            if (self.b[i] + pushed).abs() > CONSISTENT * scale {
                return Err(Undetermined::Contacts);
            }
        }
        shortest(&mut forces, &null, set.iter());
        let by_order: Vec<f64> = set.iter().map(|row| forces[row]).collect();
        self.right[..by_order.len()].copy_from_slice(&by_order);
        Ok(null)
    }

    /// Of the solutions of [`Self::solve`] on a set of rows the least without a negative part, where one
    /// has just been found.
    pub(crate) fn least_impulses(&mut self, set: GapSet) -> Result<Vec<f64>, Undetermined> {
        let mut all = vec![0.0; self.layout.rows()];
        set.iter().zip(&self.right).for_each(|(row, x)| all[row] = *x);
        let basis = self.independent(set);
        let null = self.null_vectors(basis, set)?;
        shortest(&mut all, &null, set.iter());
        Ok(set.iter().map(|row| all[row]).collect())
    }
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use super::*;
    use crate::kinetics::Model;
    use crate::system::dynamics::{FunctionDynamics, Layout};
    use crate::system::force::Friction;

    /// The forces on all contacts of two coordinates of masses `2` and `0.3`, from their normals.
    fn forces(normals: &[[f64; 2]], load: [f64; 2]) -> Vec<f64> {
        let layout = Layout::smooth(2, normals.len());
        let function = |_: f64, _: &[f64], _: &[f64], out: &mut [f64]| {
            out.fill(0.0);
            out[layout.mass()].copy_from_slice(&[2.0, 0.0, 0.0, 0.3]);
            out[layout.force()].copy_from_slice(&load);
            out[layout.gradient()].copy_from_slice(normals.as_flattened());
            Ok::<(), Infallible>(())
        };
        let mut system = FunctionDynamics { layout, function };
        let mut kinetics = Kinetics::new(layout, Friction::none());
        assert!(kinetics.evaluate(&mut Model::new(&mut system), 0.0, &[0.0; 2], &[0.0; 2]).is_ok());
        kinetics.contact((0..normals.len()).collect::<GapSet>()).unwrap();
        kinetics.lambda.clone()
    }

    fn are_near(found: &[f64], exact: &[f64]) {
        let near = found.iter().zip(exact).all(|(a, b)| (a - b).abs() < 1e-12);
        assert!(near && found.len() == exact.len(), "{found:?} {exact:?}");
    }

    #[test]
    fn a_bar_on_three_supports_has_the_least_forces_that_press() {
        // a weight of 1 beside the middle: f_1 + f_2 + f_3 = 1, f_3 - f_1 = s: those of equal springs,
        // 1/3 - s/2, 1/3, 1/3 + s/2, while they press; beyond it the first has none
        for s in [-0.8_f64, 0.0, 0.5] {
            let found = forces(&[[1.0, -1.0], [1.0, 0.0], [1.0, 1.0]], [-1.0, -s]);
            let springs = match s.abs() <= 2.0 / 3.0 {
                true => [1.0 / 3.0 - s / 2.0, 1.0 / 3.0, 1.0 / 3.0 + s / 2.0],
                false => [-s, 1.0 + s, 0.0],
            };
            are_near(&found, &springs);
        }
    }

    #[test]
    fn between_two_walls_the_one_that_is_pressed_bears_the_load() {
        are_near(&forces(&[[1.0, 0.0], [-1.0, 0.0]], [-3.0, 1.0]), &[3.0, 0.0]);
        // as between two more
        let all = [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]];
        are_near(&forces(&all, [-3.0, 1.0]), &[3.0, 0.0, 0.0, 1.0]);
    }
}
