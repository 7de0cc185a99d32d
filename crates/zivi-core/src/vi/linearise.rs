//! The Jacobian at the iterate and derived quantities.

use super::iterate::{Iterate, Outcome};
use super::natural::natural_component;
use super::problem::steps_into;
use super::{dense, fischer};

impl Iterate<'_, '_> {
    /// The Jacobian at the iterate, `Phi`, its slopes and the gradient of the merit
    /// `H' Phi`, `H = diag(slope_z) + diag(slope_f) J`. False where the Jacobian is not finite.
    pub(super) fn linearise(&mut self) -> Outcome<bool> {
        let n = self.n();
        dense::copy(self.work.trial, self.z);
        dense::copy(self.work.trial_f, self.work.f);
        let finite = self.jacobian_at_trial()?;
        let work = &mut *self.work;
        for i in 0..n {
            let (z, f) = (dense::at(self.z, i), dense::at(work.f, i));
            let (lower, upper) = (dense::at(self.lower, i), dense::at(self.upper, i));
            let (slope_z, slope_f) = fischer::slopes(z, f, lower, upper);
            dense::put(work.phi, i, fischer::component(z, f, lower, upper));
            dense::put(work.slope_z, i, slope_z);
            dense::put(work.slope_f, i, slope_f);
        }
        for ((g, phi), slope) in work.gradient.iter_mut().zip(&*work.phi).zip(&*work.slope_z) {
            *g = phi * slope;
        }
        for (i, row) in dense::rows(work.jacobian, n).enumerate() {
            let weight = dense::at(work.phi, i) * dense::at(work.slope_f, i);
            if weight != 0.0 {
                dense::axpy(work.gradient, weight, row);
            }
        }
        Ok(finite)
    }

    /// The scaled Jacobian at `work.trial`, where `F` is `work.trial_f`; entries that are not
    /// finite by differences. False where these are not finite either. That of an affine `F` is
    /// evaluated once.
    pub(super) fn jacobian_at_trial(&mut self) -> Outcome<bool> {
        let n = self.n();
        self.problem.poll()?;
        if self.jacobian_is_known && self.problem.is_affine() {
            return Ok(true);
        }
        let work = &mut *self.work;
        self.counts.jacobian += 1;
        self.inside_is_regular = false;
        self.problem.jacobian(work.trial, work.jacobian)?;
        let rows = work.jacobian.chunks_exact_mut(n).zip(work.scale.iter());
        for (row, scale) in rows.filter(|(_, scale)| **scale != 1.0) {
            row.iter_mut().for_each(|entry| *entry *= scale);
        }
        self.jacobian_is_known = dense::is_finite(work.jacobian) || self.mend_jacobian()?;
        Ok(self.jacobian_is_known)
    }

    /// `J_ij <- (F_i(z + h e_j) - F_i(z)) / h` for the entries that are not finite, towards the
    /// farther bound, or else the nearer one.
    fn mend_jacobian(&mut self) -> Outcome<bool> {
        let n = self.n();
        for j in 0..n {
            let is_whole =
                self.work.jacobian.iter().skip(j).step_by(n).all(|entry| entry.is_finite());
            if is_whole {
                continue;
            }
            let z = dense::at(self.work.trial, j);
            let room = [dense::at(self.upper, j) - z, dense::at(self.lower, j) - z];
            let mut mended = room == [0.0; 2] && self.clear_column(j);
            for step in steps_into(z, room, self.problem.rounding()) {
                mended = mended || self.difference_column(j, step)?;
            }
            if !mended {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// A fixed component does not move: what `F` would do with it does not matter.
    fn clear_column(&mut self, j: usize) -> bool {
        let n = self.n();
        let column = self.work.jacobian.iter_mut().skip(j).step_by(n);
        column.filter(|entry| !entry.is_finite()).for_each(|entry| *entry = 0.0);
        true
    }

    /// The entries of column `j` that are not finite, by the quotient over `step`.
    fn difference_column(&mut self, j: usize, step: f64) -> Outcome<bool> {
        let n = self.n();
        let work = &mut *self.work;
        let z = dense::at(work.trial, j);
        let moved = z + step;
        if moved == z {
            return Ok(false);
        }
        self.problem.poll()?;
        self.counts.f += 1;
        dense::put(work.trial, j, moved);
        let done = self.problem.map(work.trial, work.neighbour);
        dense::put(work.trial, j, z);
        done?;
        dense::scale(work.neighbour, work.scale);
        let values = work.neighbour.iter().zip(work.trial_f.iter());
        let column = work.jacobian.iter_mut().skip(j).step_by(n);
        for (entry, (there, here)) in column.zip(values).filter(|(entry, _)| !entry.is_finite()) {
            *entry = (there - here) / (moved - z);
        }
        Ok(self.work.jacobian.iter().skip(j).step_by(n).all(|entry| entry.is_finite()))
    }
}

/// Share of a row's terms that the differences of `F` must show.
const STEEP_ENOUGH: f64 = 0.1;

impl Iterate<'_, '_> {
    /// Whether the rows whose rounding is taken for their tolerance are as steep as the Jacobian
    /// says. Each component moves by `d_j = +-h |z_j|`, `h` the cube root of the rounding, in the
    /// direction in which all terms of the row grow, or backwards where a bound is in the way:
    ///
    /// ```text
    /// F_i(z + d forwards) - F_i(z + d backwards) = h sum_j |J_ij z_j| + O(h^2)
    /// ```
    pub(super) fn rows_are_as_steep(&mut self) -> Outcome<bool> {
        if self.problem.is_affine() || self.problem.is_differenced() {
            return Ok(true); // the Jacobian is made of F
        }
        for i in 0..self.n() {
            let (z, f) = (dense::at(self.z, i), dense::at(self.work.f, i));
            let (lower, upper) = (dense::at(self.lower, i), dense::at(self.upper, i));
            let at_tolerance = natural_component(z, f, lower, upper).abs() <= self.tol;
            if !at_tolerance && !self.row_is_as_steep(i)? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    fn row_is_as_steep(&mut self, i: usize) -> Outcome<bool> {
        let mut ends = [0.0; 2];
        let mut expected = 0.0;
        for (end, backwards) in ends.iter_mut().zip([false, true]) {
            expected += self.move_along_row(i, backwards);
            if !self.evaluate_trial()? {
                return Ok(false);
            }
            *end = dense::at(self.work.trial_f, i);
        }
        let [forth, back] = ends;
        Ok(forth - back >= STEEP_ENOUGH * expected)
    }

    /// `trial <- z + d` for the components that can move forwards, or for the others; returns the
    /// predicted change of row `i`.
    fn move_along_row(&mut self, i: usize, backwards: bool) -> f64 {
        let relative = libm::cbrt(self.problem.rounding());
        let n = self.n();
        let mut change = 0.0;
        for j in 0..n {
            let z = dense::at(self.z, j);
            let (lower, upper) = (dense::at(self.lower, j), dense::at(self.upper, j));
            let slope = dense::at(self.work.jacobian, i * n + j);
            let step = relative * z.abs() * slope.signum();
            let is_inside = |z: f64| lower <= z && z <= upper;
            let moved = match (is_inside(z + step), backwards) {
                (true, false) => z + step,
                (false, true) if is_inside(z - step) => z - step,
                _ => z,
            };
            dense::put(self.work.trial, j, moved);
            change += (slope * (moved - z)).abs();
        }
        change
    }
}
