//! What must stay positive for a mode to last.
//!
//! ```text
//! lambda_i      mu_s lambda_i -+ f_c,  L_s -+ f_c  (c sticks)      det K  (a contact slips)     (1)
//! ```
//!
//! Where the motion leaves one force undetermined, `(lambda, f) + alpha nu` with any `alpha` that keeps
//! all of them positive will do: there is one while `a_j/nu_j + a_k/|nu_k| > 0` for all
//! `nu_j > 0 > nu_k`, with `a` the values (1).

use crate::mechanics::kinetics::Kinetics;
use crate::mechanics::mode::Limit;
use crate::record::contact_mode::ContactMode;
use crate::record::gap_set::GapSet;

/// `det K` relative to the mobilities is zero below this.
const REGULAR: f64 = 1e-9;
/// A part of a null vector below this is rounding.
const NONE: f64 = 1e-9;

/// A number that must stay positive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::mechanics) struct Level {
    pub(in crate::mechanics) limit: Limit,
    pub(in crate::mechanics) value: f64,
    /// What is rounding of it.
    pub(in crate::mechanics) noise: f64,
}

/// A level and how it changes with the undetermined force.
type Shifted = (Level, f64);

impl Kinetics {
    /// The numbers (1) of a mode, where its forces have been computed.
    pub(in crate::mechanics) fn limits(&mut self, mode: ContactMode) -> Vec<Level> {
        let mut all: Vec<Level> = Vec::with_capacity(mode.closed.len() + 2 * mode.stick.len() + 1);
        for gap in mode.closed.iter() {
            let (limit, noise) = (Limit::Force(gap), self.noise(gap) / self.d(gap, gap));
            all.push(Level { limit, value: self.lambda[gap], noise });
        }
        if (self.layout.p == 0 || mode.is_frictionless()) && self.undetermined.is_none() {
            return all;
        }
        for channel in mode.stick.iter() {
            all.extend(self.stick_limits(channel));
        }
        if let Some(null) = self.undetermined.take() {
            all = self.paired(all, &null);
            self.undetermined = Some(null);
        }
        let slips = |c: usize| self.gap_of(c).is_some() && self.friction_limits(c).0 > 0.0;
        if mode.slipping().iter().any(slips) {
            let kappa = self.edges(mode).map_or(0.0, |edges| edges.kappa());
            let (limit, value) = (Limit::Regularity, kappa - REGULAR);
            all.push(Level { limit, value, noise: 0.0 });
        }
        all
    }

    /// The size of the terms of a level.
    pub(super) fn force_scale(&mut self, limit: Limit) -> f64 {
        let of = |at: &mut Self, row: usize| at.acceleration_scale(row) / at.d(row, row);
        match limit {
            Limit::Force(gap) => of(self, gap),
            Limit::Stick(channel, _) => {
                let (row, factor) = (self.row(channel), self.friction_limits(channel).1);
                let pressed = self.gap_of(channel).map_or(factor, |gap| factor * of(self, gap));
                of(self, row) + pressed
            }
            Limit::Pair | Limit::Regularity => {
                let m = self.layout.m;
                (0..m).map(|gap| of(self, gap)).fold(f64::MIN_POSITIVE, f64::max)
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

    /// By how much a level changes with the undetermined force.
    fn shift(&self, limit: Limit, null: &[f64]) -> f64 {
        match limit {
            Limit::Force(gap) => null[gap],
            Limit::Stick(channel, sign) => {
                let own = -sign * null[self.row(channel)];
                let pressed = self.gap_of(channel).map_or(0.0, |gap| null[gap]);
                own + self.friction_limits(channel).1 * pressed
            }
            Limit::Pair | Limit::Regularity => 0.0,
        }
    }

    fn shifted(&self, levels: Vec<Level>, null: &[f64]) -> [Vec<Shifted>; 3] {
        let largest = null.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        let mut parts = [Vec::new(), Vec::new(), Vec::new()];
        for level in levels {
            let shift = self.shift(level.limit, null);
            let part = if shift.abs() <= NONE * largest { 0 } else { 1 + usize::from(shift < 0.0) };
            parts[part].push((level, shift));
        }
        parts
    }

    fn paired(&self, levels: Vec<Level>, null: &[f64]) -> Vec<Level> {
        let [fixed, up, down] = self.shifted(levels, null);
        let mut all: Vec<Level> = fixed.into_iter().map(|(level, _)| level).collect();
        for (one, a) in &up {
            for (other, b) in &down {
                all.push(Level {
                    limit: Limit::Pair,
                    value: one.value / a - other.value / b,
                    noise: one.noise / a - other.noise / b,
                });
            }
        }
        all
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
        let impulses = edges.solve(|row| wanted[row]);
        let of = |row: usize| edges.rows().iter().position(|&it| it == row).map(|at| impulses[at]);
        let largest = impulses.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        mode.stick.iter().all(|channel| {
            let Some(gap) = self.gap_of(channel) else { return true };
            let (pressed, pull) = (of(gap).unwrap_or(0.0), of(self.row(channel)).unwrap_or(0.0));
            pull.abs() <= self.friction_limits(channel).0 * pressed + NONE * largest
        })
    }

    /// Moves the forces of a mode to the middle of what the inequalities leave open of the one that
    /// the motion does not determine; how far they may vary, or none if all are determined.
    pub(in crate::mechanics) fn center(&mut self, mode: ContactMode) -> Option<f64> {
        let null = self.undetermined.take()?;
        let mut all: Vec<Level> = Vec::new();
        for gap in mode.closed.iter() {
            all.push(Level { limit: Limit::Force(gap), value: self.lambda[gap], noise: 0.0 });
        }
        for channel in mode.stick.iter() {
            all.extend(self.stick_limits(channel));
        }
        let [_, up, down] = self.shifted(all, &null);
        let least = up.iter().fold(f64::NEG_INFINITY, |a, (it, by)| a.max(-it.value / by));
        let most = down.iter().fold(f64::INFINITY, |a, (it, by)| a.min(-it.value / by));
        let (alpha, width) = match (least.is_finite(), most.is_finite()) {
            (true, true) => (0.5 * (least + most), most - least),
            (true, false) => (least.max(0.0), f64::INFINITY),
            (false, true) => (most.min(0.0), f64::INFINITY),
            (false, false) => (0.0, f64::INFINITY),
        };
        self.lambda.iter_mut().zip(&null).for_each(|(force, part)| *force += alpha * part);
        let largest = null.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        self.undetermined = Some(null);
        Some(width * largest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mechanics::kinetics::Model;
    use crate::system::dynamics::{FunctionDynamics, Layout};
    use crate::system::friction::{Channel, Friction};
    use std::convert::Infallible;

    #[test]
    fn a_mass_that_bounces_sticks_while_the_mean_force_of_its_impacts_holds_it() {
        // M = diag(1, 4), g = q_2, w = q_1': P = -(F_1, (1 + e)/2 F_2), |P_T| <= mu P_N up to F_1 = 4
        let friction =
            Friction { channels: vec![Channel { gap: Some(0), e_t: 0.0 }], ..Friction::default() };
        let layout = Layout { n: 2, m: 1, p: 1 };
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
