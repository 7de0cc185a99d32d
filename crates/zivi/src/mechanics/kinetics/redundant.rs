//! Contacts that follow from others: the motion does not determine their forces.
//!
//! ```text
//! D_CC nu = 0      lambda + V alpha, V a basis of such nu      the same motion for every alpha   (1)
//! ```

use super::{Kinetics, Undetermined};
use crate::mechanics::shares::{orthonormal, shortest};
use crate::record::gap_set::GapSet;

/// Rows that follow from others have an acceleration of this part of its terms at most.
const CONSISTENT: f64 = 1e-7;

impl Kinetics {
    /// `x = D_CC^-1 r` with the right sides by row: zero at rows that follow from those before them.
    pub(in crate::mechanics) fn solve_dependent(
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
    pub(in crate::mechanics) fn least_impulses(
        &mut self,
        set: GapSet,
    ) -> Result<Vec<f64>, Undetermined> {
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

    use super::super::Model;
    use super::*;
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
