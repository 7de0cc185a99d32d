//! Contacts of which one follows from the others: the motion does not determine their forces.
//!
//! ```text
//! D_CC nu = 0      lambda + alpha nu      the same motion for every alpha                  (1)
//! ```

use super::{dot, Kinetics, Undetermined};
use crate::record::gap_set::GapSet;

/// A part of a null vector below this is rounding.
const NONE: f64 = 1e-9;
/// Rows that follow from others have an acceleration of this part of its terms at most.
const CONSISTENT: f64 = 1e-7;

/// Of the solutions `x + alpha nu` that in the middle of those without a negative part; if they have no
/// end, the least.
pub(crate) fn balance(x: &mut [f64], null: &[f64]) {
    let largest = null.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
    let (mut least, mut most) = (f64::NEG_INFINITY, f64::INFINITY);
    for (x, nu) in x.iter().zip(null).filter(|(_, nu)| nu.abs() > NONE * largest) {
        match *nu > 0.0 {
            true => least = least.max(-x / nu),
            false => most = most.min(-x / nu),
        }
    }
    let alpha = match least.is_finite() && most.is_finite() {
        true => 0.5 * (least + most),
        false => -dot(x, null) / dot(null, null),
    };
    x.iter_mut().zip(null).for_each(|(x, nu)| *x += alpha * nu);
}

impl Kinetics {
    /// `x = D_CC^-1 r` with the right sides by row where one row follows from the others: of all
    /// solutions that in the middle of those without a negative part; if they have no end, the least. `nu`
    /// by the order in the set.
    pub(in crate::mechanics) fn solve_dependent(
        &mut self,
        set: GapSet,
        right: impl Fn(&Self, usize) -> f64,
    ) -> Result<Vec<f64>, Undetermined> {
        let basis = self.independent(set);
        let mut spare = set.without(basis).iter();
        let (Some(last), None) = (spare.next(), spare.next()) else {
            return Err(Undetermined::Contacts);
        };
        let of_last: Vec<f64> = (0..self.layout.rows()).map(|i| self.d(i, last)).collect();
        let place = |i: usize| basis.iter().position(|it| it == i);
        self.solve_regular(basis, |_, i| of_last[i])?;
        let part: Vec<f64> = self.right[..basis.len()].to_vec();
        let null: Vec<f64> = set.iter().map(|i| place(i).map_or(-1.0, |at| part[at])).collect();
        self.solve_regular(basis, right)?;
        let part = &self.right[..basis.len()];
        let mut x: Vec<f64> = set.iter().map(|i| place(i).map_or(0.0, |at| part[at])).collect();
        balance(&mut x, &null);
        self.right[..x.len()].copy_from_slice(&x);
        Ok(null)
    }

    /// The forces of a set of contacts, by its order, and `nu` by row where one does not follow from the
    /// motion.
    pub(super) fn solve_forces(&mut self, set: GapSet) -> Result<Option<Vec<f64>>, Undetermined> {
        if self.solve_regular(set, |at, i| -at.b[i]).is_ok() {
            return Ok(None);
        }
        let null = self.solve_dependent(set, |at, i| -at.b[i])?;
        let forces = self.right[..set.len()].to_vec();
        // the others must keep the contact that follows from them closed
        for i in set.iter() {
            let pushed: f64 = set.iter().zip(&forces).map(|(j, force)| self.d(i, j) * force).sum();
            let scale = self.acceleration_scale(i) + self.b[i].abs();
            if (self.b[i] + pushed).abs() > CONSISTENT * scale {
                return Err(Undetermined::Contacts);
            }
        }
        let mut by_row = vec![0.0; self.layout.rows()];
        set.iter().zip(null).for_each(|(row, part)| by_row[row] = part);
        Ok(Some(by_row))
    }
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use super::super::Model;
    use super::*;
    use crate::system::dynamics::{FunctionDynamics, Layout};
    use crate::system::friction::Friction;

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
    fn a_bar_on_three_supports_has_the_middle_of_the_forces_that_press() {
        // a weight of 1 beside the middle: f_1 + f_2 + f_3 = 1, f_3 - f_1 = s, 0 <= f_2 <= 1 - |s|
        for s in [-0.8, 0.0, 0.5] {
            let found = forces(&[[1.0, -1.0], [1.0, 0.0], [1.0, 1.0]], [-1.0, -s]);
            let middle = 0.5 * (1.0 - f64::abs(s));
            are_near(&found, &[0.5 * (1.0 - middle - s), middle, 0.5 * (1.0 - middle + s)]);
        }
    }

    #[test]
    fn between_two_walls_the_forces_are_the_least() {
        // each may press as much more as the other
        are_near(&forces(&[[1.0, 0.0], [-1.0, 0.0]], [-3.0, 1.0]), &[1.5, -1.5]);
    }
}
