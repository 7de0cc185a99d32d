//! Contact forces with friction: modes, and patterns of many contacts.
//!
//! Contact forces with friction, equations (1).

use crate::mechanics::kinetics::{Kinetics, Undetermined};
use crate::mechanics::shares::{orthonormal, shortest};
use crate::numeric::dense::{axpy, dot, largest};
use crate::numeric::elimination::{Elimination, Singular};
use crate::record::gap_set::{ContactMode, GapSet};

/// Pivots of the scaled `K` below this are zero.
const SINGULAR: f64 = 1e-9;
/// Rows that are left so much by the others are determined by them.
const DEPENDENT: f64 = 1e-9;
/// Forces with a smaller resultant acceleration, relative to each of them alone, do not move the
/// system.
const MOVES: f64 = 1e-9;

/// `K` of a mode, and the directions in which its forces act.
#[derive(Clone, Debug)]
pub(in crate::mechanics) struct Edges {
    /// The rows `R`: closed gaps, then sticking channels.
    rows: Vec<usize>,
    /// The columns `C`, one after the other.
    columns: Vec<f64>,
    /// `1/sqrt(D_ii)` by row: with them `K` has entries of order one.
    scales: Vec<f64>,
    scaled: Elimination,
    /// `det K` of rows that determine the others.
    kappa: f64,
    /// Of a singular `K`.
    null: Option<NullSpace>,
}

/// The forces `nu` with `K nu = 0`, by row of the mode.
#[derive(Clone, Debug)]
struct NullSpace {
    /// A basis of forces that do not change the motion: `C nu = 0`.
    still: Vec<Vec<f64>>,
    /// A basis of all, if others move the system: with friction `K` has not the null space of `C`.
    all: Vec<Vec<f64>>,
}

impl Edges {
    /// The rows of closed gaps and sticking channels.
    pub(in crate::mechanics) fn rows(&self) -> &[usize] {
        &self.rows
    }

    /// `det K` relative to the product of the mobilities: positive outside of Painlevé's paradox.
    pub(in crate::mechanics) fn kappa(&self) -> f64 {
        self.kappa
    }

    /// The forces, by row of the mode, that change the rates by so much.
    pub(in crate::mechanics) fn solve(&self, right: impl Fn(usize) -> f64) -> Vec<f64> {
        let scaled: Vec<f64> =
            self.rows.iter().zip(&self.scales).map(|(&row, scale)| scale * right(row)).collect();
        self.unscaled(self.scaled.solve(&scaled))
    }

    fn unscaled(&self, mut x: Vec<f64>) -> Vec<f64> {
        x.iter_mut().zip(&self.scales).for_each(|(x, scale)| *x *= scale);
        x
    }

    /// Makes some of the forces `x + V alpha` as small as possible; a basis of the remaining
    /// freedom.
    fn spare(
        &self,
        null: &[Vec<f64>],
        x: &mut [f64],
        spared: &dyn Fn(usize) -> bool,
    ) -> Vec<Vec<f64>> {
        let d = null.len();
        if d == 0 {
            return Vec::new();
        }
        let rows: Vec<usize> = (0..x.len()).filter(|&at| spared(self.rows[at])).collect();
        let matrix: Vec<f64> =
            rows.iter().flat_map(|&at| null.iter().map(move |nu| nu[at])).collect();
        let parts = Singular::new(&matrix, rows.len(), d);
        let rank = parts.values().iter().filter(|&&value| value > MOVES).count();
        let missing: Vec<f64> = rows.iter().map(|&at| -x[at]).collect();
        for (weight, nu) in parts.solve(&missing, rank).into_iter().zip(null) {
            axpy(x, weight, nu);
        }
        let combined = |weights: &[f64]| {
            let mut nu = vec![0.0; x.len()];
            weights.iter().zip(null).for_each(|(weight, one)| axpy(&mut nu, *weight, one));
            nu
        };
        parts.null_space(rank).chunks_exact(d).map(combined).collect()
    }

    /// Adds `C x` to a vector of coordinates.
    pub(in crate::mechanics) fn push(&self, forces: &[f64], vector: &mut [f64]) {
        let columns = self.columns.chunks_exact(vector.len());
        forces.iter().zip(columns).for_each(|(&force, column)| axpy(vector, force, column));
    }
}

impl Kinetics {
    /// The rows of the closed gaps and the sticking channels of a mode.
    pub(in crate::mechanics) fn rows_of(&self, mode: ContactMode) -> GapSet {
        mode.closed.with(mode.stick.iter().map(|channel| self.row(channel)).collect())
    }

    /// The directions of some channels: `B_c`, then `beta_c`.
    pub(in crate::mechanics) fn directions(&self, channels: GapSet) -> Vec<f64> {
        let still = vec![0.0; self.coordinates()];
        let each = channels.iter().map(|channel| self.row(channel));
        each.flat_map(|row| self.normal(row).iter().copied().chain([self.rate(row, &still)]))
            .collect()
    }

    /// As many rows of a set as determine the rest: closed gaps first, then their channels, then
    /// joints; of each kind the most independent ones.
    pub(in crate::mechanics) fn independent(&mut self, set: GapSet) -> GapSet {
        let rows: Vec<usize> = set.iter().collect();
        let kind = |at: &Self, row: usize| match row.checked_sub(at.layout.m) {
            None => 0,
            Some(channel) => 1 + usize::from(at.gap_of(channel).is_none()),
        };
        // the rows of a Cholesky factor with pivots, and what is left of the diagonal
        let mut factor: Vec<Vec<f64>> = vec![Vec::new(); rows.len()];
        let diagonal: Vec<f64> = rows.iter().map(|&row| self.d(row, row)).collect();
        let (mut left, mut chosen) = (diagonal.clone(), GapSet::EMPTY);
        for class in 0..3 {
            loop {
                let may = |&i: &usize| kind(self, rows[i]) == class && !chosen.has(rows[i]);
                // a row that equality rows hold has no mobility
                let part = |i: usize| if diagonal[i] > 0.0 { left[i] / diagonal[i] } else { 0.0 };
                let next = (0..rows.len()).filter(may).reduce(|i, j| match part(j) > part(i) {
                    true => j,
                    false => i,
                });
                let Some(next) = next.filter(|&i| part(i) >= DEPENDENT) else { break };
                chosen = chosen.with(GapSet::of(rows[next]));
                let (pivot, length) = (factor[next].clone(), left[next].sqrt());
                for i in 0..rows.len() {
                    let entry = (self.d(rows[i], rows[next]) - dot(&factor[i], &pivot)) / length;
                    factor[i].push(entry);
                    left[i] -= entry * entry;
                }
            }
        }
        chosen
    }

    /// Whether the rows of a mode hold a channel: its slip does not change.
    pub(in crate::mechanics) fn is_held(&mut self, mode: ContactMode, channel: usize) -> bool {
        let (rows, row) = (self.rows_of(mode), self.row(channel));
        let with = self.independent(rows.with(GapSet::of(row))).len();
        with == self.independent(rows).len()
    }

    /// `K` of a mode.
    pub(in crate::mechanics) fn edges(&mut self, mode: ContactMode) -> Result<Edges, Undetermined> {
        let set = self.rows_of(mode);
        let (n, rows): (usize, Vec<usize>) = (self.coordinates(), set.iter().collect());
        let mut columns = Vec::with_capacity(rows.len() * n);
        for &row in &rows {
            let from = columns.len();
            columns.extend_from_slice(self.mobility(row));
            if !mode.closed.has(row) {
                continue;
            }
            for channel in self.channels_of(row).filter(|&it| mode.slipping().has(it)) {
                let pull = -self.friction_limits(channel).0 * self.sign(mode, channel);
                let along = self.mobility(self.row(channel)).to_vec();
                axpy(&mut columns[from..], pull, &along);
            }
        }
        let scale = |d: f64| if d == 0.0 { 1.0 } else { d.sqrt().recip() };
        let scales: Vec<f64> = rows.iter().map(|&row| scale(self.d(row, row))).collect();
        let k = rows.len();
        let mut matrix = Vec::with_capacity(k * k);
        for (a, &row) in rows.iter().enumerate() {
            for (b, column) in columns.chunks_exact(n).enumerate() {
                matrix.push(scales[a] * scales[b] * dot(self.normal(row), column));
            }
        }
        let scaled = Elimination::new(matrix.clone(), k, SINGULAR);
        let mut edges =
            Edges { rows, columns, scales, kappa: scaled.determinant(), scaled, null: None };
        if edges.scaled.rank() < k {
            let basis = self.independent(set);
            if edges.scaled.rank() < basis.len() {
                return Err(Undetermined::Painleve);
            }
            let at: Vec<usize> = (0..k).filter(|&at| basis.has(edges.rows[at])).collect();
            edges.kappa = if mode.closed.iter().any(|gap| self.channels_of(gap).count() > 1) {
                // the corners of a box are equal: which of them is a basis changes by rounding
                sum_of_minors(&matrix, k, at.len())
            } else {
                let block = at.iter().flat_map(|&i| at.iter().map(move |&j| i * k + j));
                let block = block.map(|at| matrix[at]).collect();
                Elimination::new(block, at.len(), SINGULAR).determinant()
            };
            edges.null = Some(self.null_space(&edges));
        }
        Ok(edges)
    }

    /// Whether what sticks could also slip, with other shares of undetermined forces: where these move the
    /// system once it slips.
    pub(in crate::mechanics) fn may_slip_otherwise(&mut self, mode: ContactMode) -> bool {
        if self.undetermined.is_empty() {
            return false;
        }
        let rough: Vec<usize> = mode.stick.iter().filter(|&c| self.gap_of(c).is_some()).collect();
        let slip = rough.into_iter().fold(mode, |mode, channel| mode.with_channel(channel, 1.0));
        let moves = |edges: Edges| edges.null.is_some_and(|null| !null.all.is_empty());
        slip != mode && self.edges(slip).is_ok_and(moves)
    }

    /// The null space of a singular `K`.
    fn null_space(&self, edges: &Edges) -> NullSpace {
        let n = self.coordinates();
        let null = orthonormal(&edges.scaled.null_space());
        let d = null.len();
        // C nu by columns, as long as it is in the metric of the masses: its squares would not tell
        // 1e-9 from rounding
        let mut moved = vec![0.0; n * d];
        for (i, nu) in null.iter().enumerate() {
            let mut along = vec![0.0; n];
            edges.push(&edges.unscaled(nu.clone()), &mut along);
            for (c, part) in self.factor.transposed_times(&along).into_iter().enumerate() {
                moved[c * d + i] = part;
            }
        }
        let unscaled = |all: Vec<Vec<f64>>| -> Vec<Vec<f64>> {
            let each = all.into_iter().map(|nu| edges.unscaled(nu));
            orthonormal(&each.collect::<Vec<_>>())
        };
        let parts = Singular::new(&moved, n, d);
        let moving = parts.values().iter().filter(|&&size| size > MOVES).count();
        if moving == 0 {
            return NullSpace { still: unscaled(null), all: Vec::new() };
        }
        let combined = |weights: &[f64]| {
            let mut nu = vec![0.0; edges.rows.len()];
            weights.iter().zip(&null).for_each(|(weight, one)| axpy(&mut nu, *weight, one));
            nu
        };
        let still = parts.null_space(moving).chunks_exact(d).map(combined).collect();
        NullSpace { still: unscaled(still), all: unscaled(null) }
    }

    /// Of the forces of a mode with `K x = r` those with which it moves, where the motion depends on how
    /// contacts share their load: gaps carry it before joints do, with the least forces that press. Where gaps
    /// alone would pull, joints hold what they can.
    fn carried_by_gaps(&self, edges: &Edges, all: &[Vec<f64>], x: &mut [f64]) {
        let m = self.layout.m;
        let is_joint = |row: usize| row >= m && self.gap_of(row - m).is_none();
        let solved = x.to_vec();
        let rest = edges.spare(all, x, &is_joint);
        let gaps = || (0..solved.len()).filter(|&at| edges.rows[at] < m);
        shortest(x, &rest, gaps());
        let most = largest(&solved).max(largest(x));
        if gaps().any(|at| x[at] < -MOVES * most) {
            x.copy_from_slice(&solved);
            shortest(x, all, gaps());
        }
    }

    /// Accelerations and forces in a mode with friction.
    pub(in crate::mechanics) fn frictional_contact(
        &mut self,
        mode: ContactMode,
    ) -> Result<(), Undetermined> {
        let edges = self.edges(mode)?;
        let n = self.coordinates();
        let mut motion = vec![0.0; n];
        self.free_to(&mut motion);
        self.lambda.fill(0.0);
        for channel in mode.slipping().iter() {
            if self.gap_of(channel).is_some() {
                continue;
            }
            let (row, force) = (self.row(channel), -self.friction_limits(channel).0);
            self.lambda[row] = force * mode.sign(channel);
            let along = self.mobility(row).to_vec();
            axpy(&mut motion, self.lambda[row], &along);
        }
        let right = |row: usize| -(dot(self.normal(row), &motion) + self.curvature(row));
        let mut forces = edges.solve(right);
        self.undetermined.clear();
        self.is_shared_motion = false;
        if let Some(NullSpace { still, all }) = &edges.null {
            self.is_shared_motion = !all.is_empty();
            if self.is_shared_motion {
                self.carried_by_gaps(&edges, all, &mut forces);
            }
            self.undetermined = still.iter().map(|nu| self.by_row(mode, &edges, nu)).collect();
        }
        edges.push(&forces, &mut motion);
        let joints = self.lambda.clone();
        self.lambda = self.by_row(mode, &edges, &forces);
        self.lambda.iter_mut().zip(joints).for_each(|(force, joint)| *force += joint);
        for row in 0..self.layout.rows() {
            self.acceleration[n + row] = dot(self.normal(row), &motion) + self.curvature(row);
        }
        self.acceleration[..n].copy_from_slice(&motion);
        for &row in edges.rows() {
            self.acceleration[n + row] = 0.0;
        }
        self.note_compliant();
        Ok(())
    }

    /// Forces by row, from those in the rows of a mode: `-mu sigma lambda` where a gap slips.
    fn by_row(&self, mode: ContactMode, edges: &Edges, forces: &[f64]) -> Vec<f64> {
        let mut all = vec![0.0; self.layout.rows()];
        edges.rows().iter().zip(forces).for_each(|(&row, force)| all[row] = *force);
        for channel in mode.slipping().iter() {
            if let Some(gap) = self.gap_of(channel) {
                let pull = -self.friction_limits(channel).0 * self.sign(mode, channel);
                all[self.row(channel)] = pull * all[gap];
            }
        }
        all
    }

    /// Impulses by row, from one solution in the rows of a mode: among those with equal motion the
    /// least within the static limits, without the rows `spared` if possible.
    pub(in crate::mechanics) fn impulses(
        &self,
        mode: ContactMode,
        (edges, mut forces): (&Edges, Vec<f64>),
        most: &dyn Fn(usize) -> f64,
        spared: &dyn Fn(usize) -> bool,
    ) -> Vec<f64> {
        let Some(NullSpace { still, all }) = &edges.null else {
            return self.by_row(mode, edges, &forces);
        };
        if !all.is_empty() {
            self.carried_by_gaps(edges, all, &mut forces);
        }
        let least = |x: &[f64], null: &[Vec<f64>]| {
            let null: Vec<Vec<f64>> = null.iter().map(|nu| self.by_row(mode, edges, nu)).collect();
            let mut impulses = self.by_row(mode, edges, x);
            let (_, obeyed) = self.least_within(mode, &mut impulses, &null, most);
            (impulses, obeyed)
        };
        let mut without = forces.clone();
        let rest = edges.spare(still, &mut without, spared);
        match least(&without, &rest) {
            (impulses, true) => impulses,
            _ => least(&forces, still).0,
        }
    }

    /// The work that friction dissipates per time in a mode whose forces have been computed, with the rates by
    /// row.
    pub(in crate::mechanics) fn friction_power(&mut self, mode: ContactMode, rates: &[f64]) -> f64 {
        if !mode.slipping().is_empty() {
            // what the motion leaves open the sharing decides
            self.share_least(mode);
        }
        let m = self.layout.m;
        -dot(&self.lambda[m..], &rates[m..self.layout.rows()])
    }

    /// The impulses of friction, by channel, among those of a mode that give its rows these rates.
    pub(in crate::mechanics) fn friction_impulses(
        &mut self,
        mode: ContactMode,
        rate: impl Fn(usize) -> f64,
    ) -> Result<Vec<f64>, Undetermined> {
        let edges = self.edges(mode)?;
        let most = |channel: usize| self.friction_limits(channel).0;
        let all = self.impulses(mode, (&edges, edges.solve(rate)), &most, &|_| false);
        Ok(all[self.layout.m..].to_vec())
    }

    /// How coordinates and rows move where the forces of a mode give its rows these rates.
    pub(in crate::mechanics) fn displacement_along_edges(
        &mut self,
        mode: ContactMode,
        rate: impl Fn(usize) -> f64,
    ) -> Result<Vec<f64>, Undetermined> {
        let edges = self.edges(mode)?;
        let (n, rows) = (self.coordinates(), self.layout.rows());
        let mut all = vec![0.0; self.layout.size()];
        edges.push(&edges.solve(&rate), &mut all[..n]);
        for row in 0..rows {
            all[n + row] = dot(self.normal(row), &all[..n]);
        }
        for &row in edges.rows() {
            all[n + row] = rate(row);
        }
        Ok(all)
    }
}

/// The sum of all principal minors of this order of a matrix (U. Le Verrier's method): of a matrix of that rank the
/// product of the eigenvalues that are not zero.
fn sum_of_minors(matrix: &[f64], k: usize, order: usize) -> f64 {
    let mut power = matrix.to_vec();
    let mut coefficient = 0.0;
    for step in 1..=order {
        if step > 1 {
            (0..k).for_each(|i| power[i * k + i] -= coefficient);
            let entry = |at: usize| -> f64 {
                (0..k).map(|l| matrix[at / k * k + l] * power[l * k + at % k]).sum()
            };
            power = (0..k * k).map(entry).collect();
        }
        coefficient = (0..k).map(|i| power[i * k + i]).sum::<f64>() / step as f64;
    }
    if order.is_multiple_of(2) {
        -coefficient
    } else {
        coefficient
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_of_minors_are_those_of_the_characteristic_polynomial() {
        let a = [2.0, -1.0, 0.5, 0.3, 1.5, 0.2, -0.4, 0.6, 3.0];
        let minor = |i: usize, j: usize| a[i * 3 + i] * a[j * 3 + j] - a[i * 3 + j] * a[j * 3 + i];
        let determinant = Elimination::new(a.to_vec(), 3, 0.0).determinant();
        assert!((sum_of_minors(&a, 3, 1) - 6.5).abs() < 1e-14);
        let two = minor(0, 1) + minor(0, 2) + minor(1, 2);
        assert!((sum_of_minors(&a, 3, 2) - two).abs() < 1e-14);
        assert!((sum_of_minors(&a, 3, 3) - determinant).abs() < 1e-13);
    }
}
