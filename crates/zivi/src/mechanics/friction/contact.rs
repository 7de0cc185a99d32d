//! Contact forces with friction, equations (1).

use crate::mechanics::kinetics::{Kinetics, Undetermined};
use crate::numeric::cholesky;
use crate::numeric::elimination::Elimination;
use crate::numeric::vector::{axpy, dot};
use crate::record::contact_mode::ContactMode;
use crate::record::gap_set::GapSet;

/// Pivots of the scaled `K` below this are zero.
const SINGULAR: f64 = 1e-9;
/// Rows that are left so much by the others are determined by them.
const DEPENDENT: f64 = 1e-9;
/// Most patterns of stick and slip that are tried where several contacts are undecided.
pub(super) const MOST_PATTERNS: usize = 1 << 14;

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
}

impl Edges {
    /// The rows of closed gaps and sticking channels.
    pub(in crate::mechanics) fn rows(&self) -> &[usize] {
        &self.rows
    }

    /// `det K` relative to the product of the mobilities: positive outside of Painlevé's paradox.
    pub(in crate::mechanics) fn kappa(&self) -> f64 {
        // rows that follow from others are no paradox
        if self.scaled.rank() < self.rows.len() {
            1.0
        } else {
            self.scaled.determinant()
        }
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

    /// As many rows of a set as determine the rest, closed gaps first.
    pub(in crate::mechanics) fn independent(&mut self, set: GapSet) -> GapSet {
        let mut chosen: Vec<usize> = Vec::new();
        for row in set.iter() {
            chosen.push(row);
            let k = chosen.len();
            let mut gram = vec![0.0; k * k];
            for (a, &i) in chosen.iter().enumerate() {
                for (b, &j) in chosen.iter().enumerate() {
                    gram[a * k + b] = self.d(i, j);
                }
            }
            let left = cholesky::factor(&mut gram, k);
            if left < DEPENDENT || left.is_nan() {
                chosen.pop();
            }
        }
        chosen.into_iter().collect()
    }

    /// `K` of a mode.
    pub(in crate::mechanics) fn edges(&mut self, mode: ContactMode) -> Result<Edges, Undetermined> {
        let set = self.rows_of(mode);
        let (n, rows): (usize, Vec<usize>) = (self.coordinates(), set.iter().collect());
        let mut columns = Vec::with_capacity(rows.len() * n);
        for &row in &rows {
            let from = columns.len();
            columns.extend_from_slice(self.mobility(row));
            let slip = mode.closed.has(row).then(|| self.channel_of(row)).flatten();
            if let Some(channel) = slip.filter(|&channel| mode.slipping().has(channel)) {
                let pull = -self.friction_limits(channel).0 * mode.sign(channel);
                let along = self.mobility(self.row(channel)).to_vec();
                axpy(&mut columns[from..], pull, &along);
            }
        }
        let scales: Vec<f64> = rows.iter().map(|&row| self.d(row, row).sqrt().recip()).collect();
        let k = rows.len();
        let mut scaled = Vec::with_capacity(k * k);
        for (a, &row) in rows.iter().enumerate() {
            for (b, column) in columns.chunks_exact(n).enumerate() {
                scaled.push(scales[a] * scales[b] * dot(self.normal(row), column));
            }
        }
        let scaled = Elimination::new(scaled, k, SINGULAR);
        if scaled.rank() < k {
            match k - self.independent(set).len() {
                0 => return Err(Undetermined::Painleve),
                1 if scaled.rank() + 1 == k => (),
                _ => return Err(Undetermined::Stick),
            }
        }
        Ok(Edges { rows, columns, scales, scaled })
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
        let forces = edges.solve(right);
        edges.push(&forces, &mut motion);
        for (&row, force) in edges.rows().iter().zip(forces) {
            self.lambda[row] = force;
        }
        let null = edges.scaled.null_vector().map(|null| edges.unscaled(null));
        self.undetermined = null.map(|null| {
            let mut by_row = vec![0.0; self.lambda.len()];
            edges.rows().iter().zip(null).for_each(|(&row, part)| by_row[row] = part);
            by_row
        });
        for channel in mode.slipping().iter() {
            let Some(gap) = self.gap_of(channel) else { continue };
            let pull = -self.friction_limits(channel).0 * mode.sign(channel);
            let row = self.row(channel);
            self.lambda[row] = pull * self.lambda[gap];
        }
        for row in 0..self.layout.rows() {
            self.acceleration[n + row] = dot(self.normal(row), &motion) + self.curvature(row);
        }
        self.acceleration[..n].copy_from_slice(&motion);
        for &row in edges.rows() {
            self.acceleration[n + row] = 0.0;
        }
        Ok(())
    }

    /// The work that friction dissipates per time, with the rates by row.
    pub(in crate::mechanics) fn friction_power(&self, rates: &[f64]) -> f64 {
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
        let (forces, mut all) = (edges.solve(rate), vec![0.0; self.layout.p]);
        for (&row, force) in edges.rows().iter().zip(forces) {
            match row.checked_sub(self.layout.m) {
                Some(channel) => all[channel] = force,
                None => {
                    let slips = |c: &usize| mode.slipping().has(*c);
                    if let Some(channel) = self.channel_of(row).filter(slips) {
                        all[channel] =
                            -self.friction_limits(channel).0 * mode.sign(channel) * force;
                    }
                }
            }
        }
        Ok(all)
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
