//! Contact forces with friction: modes, and patterns of many contacts.
//!
//! Contact forces with friction, equations (1).

use crate::kinetics::mode::Limit;
use crate::kinetics::shares::{orthonormal, shortest, ConeShares, Shares};
use crate::kinetics::{Kinetics, Undetermined};
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
pub(crate) struct Edges {
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
    pub(crate) fn rows(&self) -> &[usize] {
        &self.rows
    }

    /// `det K` relative to the product of the mobilities: positive outside of Painlevé's paradox.
    pub(crate) fn kappa(&self) -> f64 {
        self.kappa
    }

    /// The forces, by row of the mode, that change the rates by so much.
    pub(crate) fn solve(&self, right: impl Fn(usize) -> f64) -> Vec<f64> {
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
    pub(crate) fn push(&self, forces: &[f64], vector: &mut [f64]) {
        let columns = self.columns.chunks_exact(vector.len());
        forces.iter().zip(columns).for_each(|(&force, column)| axpy(vector, force, column));
    }
}

impl Kinetics {
    /// The rows of the closed gaps and the sticking channels of a mode.
    pub(crate) fn rows_of(&self, mode: ContactMode) -> GapSet {
        mode.closed.with(mode.stick.iter().map(|channel| self.row(channel)).collect())
    }

    /// The directions of some channels: `B_c`, then `beta_c`.
    pub(crate) fn directions(&self, channels: GapSet) -> Vec<f64> {
        let still = vec![0.0; self.coordinates()];
        let each = channels.iter().map(|channel| self.row(channel));
        each.flat_map(|row| self.normal(row).iter().copied().chain([self.rate(row, &still)]))
            .collect()
    }

    /// As many rows of a set as determine the rest: closed gaps first, then their channels, then
    /// joints; of each kind the most independent ones.
    pub(crate) fn independent(&mut self, set: GapSet) -> GapSet {
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
    pub(crate) fn is_held(&mut self, mode: ContactMode, channel: usize) -> bool {
        let (rows, row) = (self.rows_of(mode), self.row(channel));
        let with = self.independent(rows.with(GapSet::of(row))).len();
        with == self.independent(rows).len()
    }

    /// Whether a mode slips in two directions, and `det K` is not positive in its present ones.
    pub(crate) fn is_singular(&mut self, mode: ContactMode) -> bool {
        let has_cone = self.cones(mode.slipping()).next().is_some();
        has_cone && self.edges(mode).is_ok_and(|edges| edges.kappa() <= 0.0)
    }

    /// `K` of a mode.
    pub(crate) fn edges(&mut self, mode: ContactMode) -> Result<Edges, Undetermined> {
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
    pub(crate) fn may_slip_otherwise(&mut self, mode: ContactMode) -> bool {
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
    /// alone would need tensile forces, joints carry the load as far as possible.
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
    pub(crate) fn frictional_contact(&mut self, mode: ContactMode) -> Result<(), Undetermined> {
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
    pub(crate) fn impulses(
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
    pub(crate) fn friction_power(&mut self, mode: ContactMode, rates: &[f64]) -> f64 {
        if !mode.slipping().is_empty() {
            // what the motion leaves open the sharing decides
            self.share_least(mode);
        }
        let m = self.layout.m;
        -dot(&self.lambda[m..], &rates[m..self.layout.rows()])
    }

    /// The impulses of friction, by channel, among those of a mode that give its rows these rates.
    pub(crate) fn friction_impulses(
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
    pub(crate) fn displacement_along_edges(
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

// Conditions that must stay positive for a mode to last.
//
// ```text
// lambda_i      mu_s lambda_i -+ f_c,  L_s -+ f_c  (c sticks)      det K  (a contact slips)     (1)
// ```
//
// Where the motion leaves forces undetermined, `(lambda, f) + V alpha` with any `alpha` that keeps all of
// them positive will do: there is one while their margin is, the largest `t` with
// `a_j + s_j . alpha >= t` for all `j` and some `alpha`, where `a` are the values (1). A contact that sticks in two
// directions has the level `mu_s lambda - |f|`.

/// `det K` relative to the mobilities is zero below this.
const REGULAR: f64 = 1e-9;
/// Impulses below this part of the largest are rounding.
const NONE: f64 = 1e-9;

/// A number that must stay positive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LimitLevel {
    pub(crate) limit: Limit,
    pub(crate) value: f64,
    /// Its rounding error.
    pub(crate) noise: f64,
}

impl Kinetics {
    /// The numbers (1) of a mode, where its forces have been computed.
    pub(crate) fn limits(&mut self, mode: ContactMode) -> Vec<LimitLevel> {
        let mut all = self.levels(mode);
        if self.layout.p == 0 && self.undetermined.is_empty() {
            return all;
        }
        if !self.undetermined.is_empty() {
            let of = |level: &LimitLevel| self.unit(level.limit) * level.noise;
            let (value, noise) = if self.sticks_in_cones(mode) {
                let most = |channel: usize| self.friction_limits(channel).1;
                let shares = self.cone_shares(mode, &self.lambda, &self.undetermined, &most);
                (shares.margin().0, all.iter().map(of).fold(0.0, f64::max))
            } else {
                let margin = self.shares(mode).map(|shares| shares.margin()).unwrap_or_default();
                let noise = margin.support.iter().map(|(j, weight)| weight * of(&all[*j])).sum();
                (margin.value, noise)
            };
            all = vec![LimitLevel { limit: Limit::Margin, value, noise }];
        }
        let slips = |c: usize| self.gap_of(c).is_some() && self.friction_limits(c).0 > 0.0;
        if mode.slipping().iter().any(slips) {
            let kappa = self.edges(mode).map_or(0.0, |edges| edges.kappa());
            let (limit, value) = (Limit::Regularity, kappa - REGULAR);
            all.push(LimitLevel { limit, value, noise: 0.0 });
        }
        all
    }

    /// The same for each force separately, even if the motion does not determine it.
    pub(super) fn levels(&mut self, mode: ContactMode) -> Vec<LimitLevel> {
        let mut all: Vec<LimitLevel> =
            Vec::with_capacity(mode.closed.len() + 2 * mode.stick.len() + 1);
        for gap in mode.closed.iter() {
            let (limit, noise) = (Limit::Force(gap), self.noise(gap) / self.d(gap, gap));
            all.push(LimitLevel { limit, value: self.lambda[gap], noise });
        }
        for channel in mode.stick.iter() {
            match self.other_of(channel) {
                None => all.extend(self.stick_limits(channel)),
                Some(other) if channel < other => all.push(self.cone_limit([channel, other])),
                Some(_) => (),
            }
        }
        all
    }

    /// Whether a contact with two directions sticks.
    fn sticks_in_cones(&self, mode: ContactMode) -> bool {
        mode.stick.iter().any(|channel| self.other_of(channel).is_some())
    }

    /// The sum of levels that is the margin of undetermined forces, which becomes these: the least within their
    /// limits. None where the motion determines them.
    pub(crate) fn margin_levels(&mut self, mode: ContactMode) -> Option<Vec<(Limit, f64)>> {
        let margin = self.shares(mode)?.margin();
        self.share_least(mode);
        let all = self.levels(mode);
        let weight = |(j, weight): &(usize, f64)| {
            let limit = all[*j].limit;
            (limit, weight * self.unit(limit))
        };
        Some(margin.support.iter().map(weight).collect())
    }

    /// How the levels of a mode change with undetermined forces, where there are any and cones are intervals.
    pub(crate) fn shares(&self, mode: ContactMode) -> Option<Shares> {
        let most = |channel: usize| self.friction_limits(channel).1;
        let null = &self.undetermined;
        let is_linear = !null.is_empty() && !self.sticks_in_cones(mode);
        is_linear.then(|| self.shares_of(mode, &self.lambda, null, &most))
    }

    /// The same with round cones.
    fn cone_shares(
        &self,
        mode: ContactMode,
        forces: &[f64],
        null: &[Vec<f64>],
        most: &dyn Fn(usize) -> f64,
    ) -> ConeShares {
        let mut shares = ConeShares::new(null.len());
        let along = |unit: f64, of: &dyn Fn(&[f64]) -> f64| {
            (unit * of(forces), null.iter().map(|null| unit * of(null)).collect::<Vec<f64>>())
        };
        for gap in mode.closed.iter() {
            shares.push(along(self.roots[gap], &|forces| forces[gap]));
        }
        for channel in mode.stick.iter() {
            let (row, unit) = (self.row(channel), self.unit(Limit::Stick(channel, 1.0)));
            let limit = |forces: &[f64]| {
                self.gap_of(channel).map_or(0.0, |gap| most(channel) * forces[gap])
            };
            let fixed = if self.gap_of(channel).is_none() { unit * most(channel) } else { 0.0 };
            match self.other_of(channel) {
                Some(other) if channel < other => {
                    let across = self.row(other);
                    shares.push_cone([
                        along(unit, &limit),
                        along(unit, &|forces| forces[row]),
                        along(unit, &|forces| forces[across]),
                    ]);
                }
                Some(_) => (),
                None => {
                    for sign in [1.0, -1.0] {
                        let (a, s) = along(unit, &|forces| limit(forces) - sign * forces[row]);
                        shares.push((fixed + a, s));
                    }
                }
            }
        }
        shares
    }

    /// The same of any forces, which change along the vectors `null`, with these static limits.
    fn shares_of(
        &self,
        mode: ContactMode,
        forces: &[f64],
        null: &[Vec<f64>],
        most: &dyn Fn(usize) -> f64,
    ) -> Shares {
        let mut shares = Shares::new(null.len());
        let sides = |channel: usize| [1.0, -1.0].map(|sign| Limit::Stick(channel, sign));
        let limits = mode.closed.iter().map(Limit::Force);
        for limit in limits.chain(mode.stick.iter().flat_map(sides)) {
            let unit = self.unit(limit);
            let changes = |forces: &[f64]| match limit {
                Limit::Stick(channel, sign) => {
                    let pressed = self.gap_of(channel).map_or(0.0, |gap| forces[gap]);
                    most(channel) * pressed - sign * forces[self.row(channel)]
                }
                Limit::Force(gap) => forces[gap],
                Limit::Law(_) | Limit::Margin | Limit::Regularity => 0.0,
            };
            let fixed = match limit {
                Limit::Stick(channel, _) if self.gap_of(channel).is_none() => most(channel),
                _ => 0.0,
            };
            shares.push(
                unit * (fixed + changes(forces)),
                null.iter().map(|null| unit * changes(null)),
            );
        }
        shares
    }

    /// Makes forces by row the least that obey the inequalities of a mode, among those that differ along the
    /// vectors `null`, orthonormal in its rows; by how much one of them may vary, and whether there are such.
    pub(super) fn least_within(
        &self,
        mode: ContactMode,
        forces: &mut [f64],
        null: &[Vec<f64>],
        most: &dyn Fn(usize) -> f64,
    ) -> (f64, bool) {
        let rows = self.rows_of(mode);
        for one in null {
            let part: f64 = rows.iter().map(|row| one[row] * forces[row]).sum();
            axpy(forces, -part, one);
        }
        if self.sticks_in_cones(mode) {
            let shares = self.cone_shares(mode, forces, null, most);
            let (alpha, obeyed) = shares.least();
            null.iter().zip(&alpha).for_each(|(one, alpha)| axpy(forces, *alpha, one));
            let width = |(part, one): (usize, &Vec<f64>)| shares.width(&alpha, part) * largest(one);
            return (null.iter().enumerate().map(width).fold(0.0, f64::max), obeyed);
        }
        let shares = self.shares_of(mode, forces, null, most);
        let least = shares.least().map(|(alpha, _)| alpha);
        let obeyed = least.as_ref().is_some_and(|alpha| shares.are_obeyed(alpha));
        // within a step beyond the last forces that obey them, so that the work of friction is continuous
        let alpha = least.or_else(|| shares.of_margin()).unwrap_or_else(|| vec![0.0; null.len()]);
        null.iter().zip(&alpha).for_each(|(one, alpha)| axpy(forces, *alpha, one));
        let width = |(part, one): (usize, &Vec<f64>)| shares.width(&alpha, part) * largest(one);
        (null.iter().enumerate().map(width).fold(0.0, f64::max), obeyed)
    }

    /// Scale that makes levels comparable: the square root of the mobility of their row.
    fn unit(&self, limit: Limit) -> f64 {
        match limit {
            Limit::Force(gap) => self.roots[gap],
            Limit::Stick(channel, _) => self.roots[self.row(channel)],
            Limit::Law(_) | Limit::Margin | Limit::Regularity => 1.0,
        }
    }

    /// The size of the terms of a level.
    pub(crate) fn force_scale(&mut self, limit: Limit) -> f64 {
        let of = |at: &mut Self, row: usize| at.acceleration_scale(row) / at.d(row, row);
        match limit {
            Limit::Force(gap) => of(self, gap),
            Limit::Stick(channel, _) => {
                let (row, factor) = (self.row(channel), self.friction_limits(channel).1);
                let pressed = self.gap_of(channel).map_or(factor, |gap| factor * of(self, gap));
                of(self, row) + pressed
            }
            Limit::Law(_) | Limit::Margin | Limit::Regularity => {
                let rows = 0..self.layout.rows();
                let of = |row: usize| of(self, row) * self.d(row, row).sqrt();
                rows.map(of).fold(f64::MIN_POSITIVE, f64::max)
            }
        }
    }

    fn stick_limits(&mut self, channel: usize) -> [LimitLevel; 2] {
        let (row, factor) = (self.row(channel), self.friction_limits(channel).1);
        let mut noise = self.noise(row) / self.d(row, row);
        let largest = match self.gap_of(channel) {
            None => factor,
            Some(gap) => {
                noise += factor * self.noise(gap) / self.d(gap, gap);
                factor * self.lambda[gap]
            }
        };
        let force = self.lambda[row];
        [1.0, -1.0].map(|sign| LimitLevel {
            limit: Limit::Stick(channel, sign),
            value: largest - sign * force,
            noise,
        })
    }

    /// How far the force of a sticking contact with two directions is within its cone: a smooth function also
    /// where both components vanish, `(mu^2 lambda^2 - f^2)/(2 mu lambda)`.
    fn cone_limit(&mut self, pair: [usize; 2]) -> LimitLevel {
        let [one, other] = pair.map(|channel| self.stick_limits(channel)[0].noise);
        let (force, largest) = self.cone_force(pair);
        let value = match force <= f64::EPSILON * largest.abs() {
            true => 0.5 * largest,
            false if largest <= 0.0 => -force,
            false => 0.5 * (largest - force * (force / largest)),
        };
        LimitLevel { limit: Limit::Stick(pair[0], 1.0), value, noise: one.hypot(other) }
    }

    /// The tangential force of a contact with two directions, and the most that sticks.
    fn cone_force(&self, [first, second]: [usize; 2]) -> (f64, f64) {
        let [x, y] = [first, second].map(|channel| self.lambda[self.row(channel)]);
        let factor = self.friction_limits(first).1;
        (x.hypot(y), self.gap_of(first).map_or(factor, |gap| factor * self.lambda[gap]))
    }

    /// Whether impacts on the gaps `hit` keep sticking what sticks in a mode: those of flights under the
    /// present accelerations, `P ~ K^-1 (a (1 + e)/2, -w')`, where those of the motion between them
    /// have just been computed.
    pub(crate) fn bounces_hold(&mut self, hit: GapSet, mode: ContactMode, e: &[f64]) -> bool {
        if mode.stick.iter().all(|channel| self.gap_of(channel).is_none()) {
            return true;
        }
        let (n, m) = (self.coordinates(), self.layout.m);
        let rates = self.acceleration[n..].to_vec();
        let hits = |row: usize| match row.checked_sub(m) {
            None => hit.has(row),
            Some(channel) => self.gap_of(channel).is_some_and(|gap| hit.has(gap)),
        };
        let right = |row: usize| match (hits(row), row < m) {
            (false, _) => 0.0,
            (true, true) => -0.5 * (1.0 + e[row]) * rates[row],
            (true, false) => -rates[row],
        };
        let wanted: Vec<f64> = (0..self.layout.rows()).map(right).collect();
        let Ok(edges) = self.edges(mode) else { return false };
        let most = |channel: usize| self.friction_limits(channel).0;
        let solved = edges.solve(|row| wanted[row]);
        let impulses = self.impulses(mode, (&edges, solved), &most, &|_| false);
        let rounding = NONE * largest(&impulses);
        mode.stick.iter().all(|channel| {
            let Some(gap) = self.gap_of(channel) else { return true };
            let along = impulses[self.row(channel)];
            let across = self.other_of(channel).map_or(0.0, |other| impulses[self.row(other)]);
            along.hypot(across) <= most(channel) * impulses[gap] + rounding
        })
    }

    /// Makes the forces of a mode, where they have been computed, the least that obey the inequalities among
    /// those with its motion; by how much one of them may vary, or none if all are determined.
    pub(crate) fn share_least(&mut self, mode: ContactMode) -> Option<f64> {
        let null = std::mem::take(&mut self.undetermined);
        let mut forces = std::mem::take(&mut self.lambda);
        let most = |channel: usize| self.friction_limits(channel).1;
        let width =
            (!null.is_empty()).then(|| self.least_within(mode, &mut forces, &null, &most).0);
        (self.undetermined, self.lambda) = (null, forces);
        width
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

#[cfg(test)]
mod limits_tests {
    use super::*;
    use crate::kinetics::Model;
    use crate::system::dynamics::{FunctionDynamics, Layout};
    use crate::system::force::{Channel, Friction};
    use std::convert::Infallible;

    #[test]
    fn a_mass_that_bounces_sticks_while_the_mean_force_of_its_impacts_holds_it() {
        // M = diag(1, 4), g = q_2, w = q_1': P = -(F_1, (1 + e)/2 F_2), |P_T| <= mu P_N up to F_1 = 4
        let friction =
            Friction { channels: vec![Channel { gap: Some(0), e_t: 0.0 }], ..Friction::default() };
        let layout = Layout { n: 2, m: 1, p: 1, k: 0 };
        let stick = ContactMode::from(GapSet::of(0)).with_channel(0, 0.0);
        let mut holds = |pull: f64| {
            let function = |_: f64, _: &[f64], _: &[f64], out: &mut [f64]| {
                out.copy_from_slice(&[
                    1.0, 0.0, 0.0, 4.0, pull, -10.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0,
                    0.5, 0.5,
                ]);
                Ok::<(), Infallible>(())
            };
            let mut dynamics = FunctionDynamics { layout, function };
            let mut at = Kinetics::new(layout, &friction);
            at.evaluate(&mut Model::new(&mut dynamics), 0.0, &[0.0; 2], &[0.0; 2]).unwrap();
            at.contact(ContactMode::default()).unwrap();
            at.bounces_hold(GapSet::of(0), stick, &[0.6])
        };
        assert_eq!([3.99, -3.99, 4.01, -4.01].map(&mut holds), [true, true, false, false]);
    }
}
