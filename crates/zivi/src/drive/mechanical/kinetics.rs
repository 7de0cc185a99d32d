//! A state of a mechanical system by its gaps.

use super::law_error::LawError;
use crate::mechanics::shortest;
use crate::numeric::cholesky;
use crate::numeric::dense::dot;
use crate::numeric::elimination::Singular;
use crate::system::dynamics::Layout;

/// Least relative mobility of a gap given the others.
const REDUNDANT: f64 = 1e-10;

/// Kinetics of gaps and controls at a state.
#[derive(Clone, Debug)]
pub struct GapKinetics {
    layout: Layout,
    /// The evaluation of the system, as [`Layout`] says.
    pub(super) row: Vec<f64>,
    /// `g'`.
    pub(super) rates: Vec<f64>,
    /// `L L^T = M`.
    pub(super) mass: Vec<f64>,
    /// The rows `M^-1 n_i`.
    pub(super) mobility: Vec<f64>,
    /// `W`, and `L L^T = W`.
    pub(super) d: Vec<f64>,
    pub(super) d_factor: Vec<f64>,
    /// Whether the gaps are independent of each other.
    is_independent: bool,
    /// The same of some of the gaps.
    small: Vec<f64>,
    right: Vec<f64>,
}

impl GapKinetics {
    /// Of no state yet.
    #[must_use]
    pub fn new(layout: Layout) -> Self {
        let Layout { n, m, .. } = layout;
        let zeros = |count| vec![0.0; count];
        Self {
            layout,
            row: zeros(layout.len()),
            rates: zeros(m),
            mass: zeros(n * n),
            mobility: zeros(m * n),
            d: zeros(m * m),
            d_factor: zeros(m * m),
            is_independent: true,
            small: Vec::with_capacity(m * m),
            right: Vec::with_capacity(m),
        }
    }

    /// Of one evaluation. The gaps may depend on each other, as both limits of a joint do.
    ///
    /// # Errors
    /// [`LawError::Indefinite`].
    pub fn of<E>(layout: Layout, row: &[f64], w: &[f64]) -> Result<Self, LawError<E>> {
        let mut it = Self::new(layout);
        it.row.copy_from_slice(row);
        it.renew(w).map(|()| it)
    }

    /// Those of one gap of a system alone, of the same evaluation.
    pub(super) fn alone<E>(&mut self, of: &Self, gap: usize, w: &[f64]) -> Result<(), LawError<E>> {
        let (all, own) = (of.layout, self.layout);
        self.row[own.mass()].copy_from_slice(&of.row[all.mass()]);
        self.row[own.force()].copy_from_slice(of.force());
        self.row[own.gap()].copy_from_slice(&of.gaps()[gap..=gap]);
        self.row[own.gradient()].copy_from_slice(of.normal(gap));
        self.row[own.curvature()].copy_from_slice(&of.curvatures()[gap..=gap]);
        self.row[own.rate()].copy_from_slice(&of.row[all.rate()][gap..=gap]);
        self.renew(w)?;
        self.check_independent()
    }

    /// Refuses gaps that depend on each other.
    pub(super) fn check_independent<E>(&self) -> Result<(), LawError<E>> {
        match self.is_independent {
            true => Ok(()),
            false => Err(LawError::Dependent),
        }
    }

    /// Computes them from the evaluation in `row`.
    pub(super) fn renew<E>(&mut self, w: &[f64]) -> Result<(), LawError<E>> {
        let Self { layout, row, rates, mass, mobility, d, d_factor, is_independent, .. } = self;
        let Layout { n, m, .. } = *layout;
        mass.copy_from_slice(&row[layout.mass()]);
        // written so that a NaN is one, too
        let definite = cholesky::factor(mass, n) > 0.0;
        if !definite {
            return Err(LawError::Indefinite);
        }
        let normals = &row[layout.gradient()][..m * n];
        mobility.copy_from_slice(normals);
        for i in 0..m {
            cholesky::solve(mass, n, &mut mobility[i * n..][..n]);
            rates[i] = dot(&normals[i * n..][..n], w) + row[layout.rate()][i];
        }
        for i in 0..m {
            for j in 0..=i {
                let one = dot(&normals[i * n..][..n], &mobility[j * n..][..n]);
                let other = dot(&normals[j * n..][..n], &mobility[i * n..][..n]);
                let both = 0.5 * (one + other);
                (d[i * m + j], d[j * m + i]) = (both, both);
            }
        }
        d_factor.copy_from_slice(d);
        *is_independent = m == 0 || cholesky::factor(d_factor, m) > REDUNDANT;
        Ok(())
    }

    pub(super) fn layout(&self) -> Layout {
        self.layout
    }

    pub(super) fn gaps(&self) -> &[f64] {
        &self.row[self.layout.gap()]
    }

    pub(super) fn force(&self) -> &[f64] {
        &self.row[self.layout.force()]
    }

    pub(super) fn curvatures(&self) -> &[f64] {
        &self.row[self.layout.curvature()][..self.layout.m]
    }

    /// The gradient of a gap.
    pub(super) fn normal(&self, i: usize) -> &[f64] {
        &self.row[self.layout.gradient()][i * self.layout.n..][..self.layout.n]
    }

    /// The row `M^-1 n_i`.
    pub(super) fn mobility_of(&self, i: usize) -> &[f64] {
        &self.mobility[i * self.layout.n..][..self.layout.n]
    }

    /// `M v`.
    pub(super) fn momentum(&self, v: &[f64]) -> Vec<f64> {
        let n = self.layout.n;
        self.row[self.layout.mass()].chunks_exact(n).map(|row| dot(row, v)).collect()
    }

    /// `b <- W_AA^-1 b` for the gaps of a set, in order; others stay. Where gaps of it depend on each
    /// other, of all solutions the least without a negative part, or the least of all.
    pub(super) fn solve_among(&mut self, set: &[bool], b: &mut [f64]) {
        let m = self.layout.m;
        if self.is_independent && set.iter().all(|&it| it) {
            return cholesky::solve(&self.d_factor, m, b);
        }
        let Self { small, right, d, .. } = self;
        let chosen = || (0..m).filter(|&i| set[i]);
        let block = || chosen().flat_map(|i| chosen().map(move |j| i * m + j)).map(|at| d[at]);
        small.clear();
        small.extend(block());
        right.clear();
        right.extend(chosen().map(|i| b[i]));
        let size = right.len();
        if cholesky::factor(small, size) > REDUNDANT {
            cholesky::solve(small, size, right);
        } else {
            let found = Singular::new(&block().collect::<Vec<f64>>(), size, size);
            let rank = found.rank(REDUNDANT);
            *right = found.solve(right, rank);
            let null: Vec<Vec<f64>> =
                found.null_space(rank).chunks_exact(size).map(<[f64]>::to_vec).collect();
            shortest(right, &null, 0..size);
        }
        chosen().zip(&*right).for_each(|(i, x)| b[i] = *x);
    }

    /// The forces of closed contacts that keep their gaps closed under the forces of the evaluation, 0
    /// of open ones.
    pub fn contact_forces(&mut self, closed: &[bool]) -> Vec<f64> {
        let free = |i| dot(self.mobility_of(i), self.force()) + self.curvatures()[i];
        let mut forces: Vec<f64> =
            (0..closed.len()).map(|i| if closed[i] { -free(i) } else { 0.0 }).collect();
        self.solve_among(closed, &mut forces);
        forces
    }

    /// Takes from a velocity, or such, `M^-1 N_A^T W_AA^-1 b`.
    pub(super) fn push(&mut self, set: &[bool], mut b: Vec<f64>, v: &mut [f64]) {
        self.solve_among(set, &mut b);
        for i in (0..self.layout.m).filter(|&i| set[i]) {
            v.iter_mut().zip(self.mobility_of(i)).for_each(|(v, by)| *v -= b[i] * by);
        }
    }

    /// Takes from a velocity, or such, what moves the gaps of a set, M-orthogonally.
    pub fn without_gaps(&mut self, set: &[bool], v: &mut [f64]) {
        let moved = (0..self.layout.m).map(|i| dot(self.normal(i), v)).collect();
        self.push(set, moved, v);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_change_with_the_velocities_and_with_their_walls() {
        // g = (1, 2) . q + 5 t
        let layout = Layout::smooth(2, 1);
        let mut row = vec![0.0; layout.len()];
        row[layout.mass()].copy_from_slice(&[1.0, 0.0, 0.0, 1.0]);
        row[layout.gradient()].copy_from_slice(&[1.0, 2.0]);
        row[layout.rate()].copy_from_slice(&[5.0]);
        let kinetics = GapKinetics::of::<()>(layout, &row, &[3.0, -1.0]).unwrap();
        assert_eq!(kinetics.rates, [6.0]);
    }

    /// A bar of mass 2 and inertia 1 that its weight presses to feet at these places, by height and angle.
    fn bar(feet: &[f64]) -> GapKinetics {
        let layout = Layout::smooth(2, feet.len());
        let mut row = vec![0.0; layout.len()];
        row[layout.mass()].copy_from_slice(&[2.0, 0.0, 0.0, 1.0]);
        row[layout.force()].copy_from_slice(&[-20.0, 0.0]);
        let gradients: Vec<f64> = feet.iter().flat_map(|&at| [1.0, at]).collect();
        row[layout.gradient()].copy_from_slice(&gradients);
        GapKinetics::of::<()>(layout, &row, &[0.0, 0.0]).unwrap()
    }

    #[test]
    fn contact_forces_bear_the_weight_also_where_they_are_not_determined() {
        let close = |found: Vec<f64>, exact: &[f64]| {
            let apart = found.iter().zip(exact).map(|(a, b)| (a - b).abs());
            assert!(found.len() == exact.len() && apart.fold(0.0, f64::max) < 1e-12, "{found:?}");
        };
        // moments about the middle: 3 f = f'
        close(bar(&[-3.0, 1.0]).contact_forces(&[true, true]), &[5.0, 15.0]);
        close(bar(&[-3.0, 0.0]).contact_forces(&[false, true]), &[0.0, 20.0]);
        // of (5, 0, 15) + alpha (-1, 3, -2) the least: alpha = 35/14
        let mut three = bar(&[-3.0, -1.0 / 3.0, 1.0]);
        close(three.contact_forces(&[true; 3]), &[2.5, 7.5, 10.0]);
        close(three.contact_forces(&[true, false, true]), &[5.0, 0.0, 15.0]);
        close(bar(&[-1.0, 0.0, 1.0]).contact_forces(&[true; 3]), &[20.0 / 3.0; 3]);
        // two that are not determined: the least
        close(bar(&[-1.0, -1.0, 1.0, 1.0]).contact_forces(&[true; 4]), &[5.0; 4]);
    }
}
