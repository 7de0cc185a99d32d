//! Conditions that must stay positive for a mode to last.
//!
//! ```text
//! lambda_i      mu_s lambda_i -+ f_c,  L_s -+ f_c  (c sticks)      det K  (a contact slips)     (1)
//! ```
//!
//! Where the motion leaves forces undetermined, `(lambda, f) + V alpha` with any `alpha` that keeps all of
//! them positive will do: there is one while their margin is, the largest `t` with
//! `a_j + s_j . alpha >= t` for all `j` and some `alpha`, where `a` are the values (1). A contact that sticks in two
//! directions has the level `mu_s lambda - |f|`.

use crate::mechanics::kinetics::Kinetics;
use crate::mechanics::mode::Limit;
use crate::mechanics::shares::ConeShares;
use crate::mechanics::shares::Shares;
use crate::numeric::dense::{axpy, largest};
use crate::record::gap_set::{ContactMode, GapSet};

/// `det K` relative to the mobilities is zero below this.
const REGULAR: f64 = 1e-9;
/// Impulses below this part of the largest are rounding.
const NONE: f64 = 1e-9;

/// A number that must stay positive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::mechanics) struct Level {
    pub(in crate::mechanics) limit: Limit,
    pub(in crate::mechanics) value: f64,
    /// Its rounding error.
    pub(in crate::mechanics) noise: f64,
}

impl Kinetics {
    /// The numbers (1) of a mode, where its forces have been computed.
    pub(in crate::mechanics) fn limits(&mut self, mode: ContactMode) -> Vec<Level> {
        let mut all = self.levels(mode);
        if self.layout.p == 0 && self.undetermined.is_empty() {
            return all;
        }
        if !self.undetermined.is_empty() {
            let of = |level: &Level| self.unit(level.limit) * level.noise;
            let (value, noise) = if self.sticks_in_cones(mode) {
                let most = |channel: usize| self.friction_limits(channel).1;
                let shares = self.cone_shares(mode, &self.lambda, &self.undetermined, &most);
                (shares.margin().0, all.iter().map(of).fold(0.0, f64::max))
            } else {
                let margin = self.shares(mode).map(|shares| shares.margin()).unwrap_or_default();
                let noise = margin.support.iter().map(|(j, weight)| weight * of(&all[*j])).sum();
                (margin.value, noise)
            };
            all = vec![Level { limit: Limit::Margin, value, noise }];
        }
        let slips = |c: usize| self.gap_of(c).is_some() && self.friction_limits(c).0 > 0.0;
        if mode.slipping().iter().any(slips) {
            let kappa = self.edges(mode).map_or(0.0, |edges| edges.kappa());
            let (limit, value) = (Limit::Regularity, kappa - REGULAR);
            all.push(Level { limit, value, noise: 0.0 });
        }
        all
    }

    /// The same for each force separately, even if the motion does not determine it.
    pub(super) fn levels(&mut self, mode: ContactMode) -> Vec<Level> {
        let mut all: Vec<Level> = Vec::with_capacity(mode.closed.len() + 2 * mode.stick.len() + 1);
        for gap in mode.closed.iter() {
            let (limit, noise) = (Limit::Force(gap), self.noise(gap) / self.d(gap, gap));
            all.push(Level { limit, value: self.lambda[gap], noise });
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
    pub(in crate::mechanics) fn margin_levels(
        &mut self,
        mode: ContactMode,
    ) -> Option<Vec<(Limit, f64)>> {
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
    pub(in crate::mechanics) fn shares(&self, mode: ContactMode) -> Option<Shares> {
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
    pub(in crate::mechanics) fn force_scale(&mut self, limit: Limit) -> f64 {
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

    fn stick_limits(&mut self, channel: usize) -> [Level; 2] {
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
        [1.0, -1.0].map(|sign| Level {
            limit: Limit::Stick(channel, sign),
            value: largest - sign * force,
            noise,
        })
    }

    /// How far the force of a sticking contact with two directions is within its cone: a smooth function also
    /// where both components vanish, `(mu^2 lambda^2 - f^2)/(2 mu lambda)`.
    fn cone_limit(&mut self, pair: [usize; 2]) -> Level {
        let [one, other] = pair.map(|channel| self.stick_limits(channel)[0].noise);
        let (force, largest) = self.cone_force(pair);
        let value = match force <= f64::EPSILON * largest.abs() {
            true => 0.5 * largest,
            false if largest <= 0.0 => -force,
            false => 0.5 * (largest - force * (force / largest)),
        };
        Level { limit: Limit::Stick(pair[0], 1.0), value, noise: one.hypot(other) }
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
    pub(in crate::mechanics) fn bounces_hold(
        &mut self,
        hit: GapSet,
        mode: ContactMode,
        e: &[f64],
    ) -> bool {
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
    pub(in crate::mechanics) fn share_least(&mut self, mode: ContactMode) -> Option<f64> {
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
    use crate::mechanics::kinetics::Model;
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
