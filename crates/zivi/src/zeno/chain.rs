//! The Zeno point of a sequence of impacts, by extrapolation with known ratios.
//!
//! The map from one impact to the next is the identity on `u = 0` and has the multiplier `e`
//! across it, whatever the force is. So the impact times have the expansion
//!
//! ```text
//! t_n = t_inf - C_1 e^n - C_2 e^(2n) - ...                                            (1)
//! ```
//!
//! in known powers. With `u_i` the speed after impact `i` and `g_i` the pull towards the wall,
//!
//! ```text
//! S_i^(0) = t_i + 2 u_i / (g_i (1 - e))                                               (2)
//! S_i^(j) = (S_i^(j-1) - e^(j+1) S_(i-1)^(j-1)) / (1 - e^(j+1))                       (3)
//! ```
//!
//! removes one power after the other: `S^(j)` has an error of order `u^(j+2)`. Nothing here knows
//! what bounces: a chain holds times, speeds and pulls. Powers and logarithms are those of the
//! `libm` crate, here and in what follows from a chain: the same on every machine.

use crate::numeric::richardson::{self, Powers};

/// One impact of a chain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bounce {
    /// Time (s).
    pub(crate) t: f64,
    /// Speed after the impact (m/s).
    pub(crate) u: f64,
    /// Pull towards the wall, `-f(t, 0, 0)` (m/s^2).
    pub(crate) g: f64,
}

/// Columns of the table after the first.
pub(crate) const COLUMNS: usize = 5;

/// By how much the speed falls from one row of the table to the next, if the chain is long enough.
const FALL: f64 = 0.9;

/// Impacts at ever smaller speeds.
#[derive(Clone, Debug)]
pub(crate) struct Chain {
    e: f64,
    bounces: Vec<Bounce>,
    /// Largest speed before an impact: the scale of the speeds.
    fastest: f64,
}

/// An estimate of the Zeno time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ZenoTime {
    /// The time (s).
    pub(crate) t: f64,
    /// Estimate of its error (s).
    pub(crate) error: f64,
}

impl Chain {
    pub(crate) fn new(e: f64) -> Self {
        Self { e, bounces: Vec::new(), fastest: 0.0 }
    }

    /// The impacts, oldest first.
    pub(crate) fn bounces(&self) -> &[Bounce] {
        &self.bounces
    }

    pub(crate) fn clear(&mut self) {
        self.bounces.clear();
    }

    /// Appends an impact; a chain that it does not continue is given up first.
    ///
    /// A chain loses speed at each impact, by about the factor `e`, under a pull. Without the
    /// first of these a periodic motion with `e > 2/3` would be one endless chain.
    pub(crate) fn note(&mut self, bounce: Bounce) {
        if let Some(last) = self.bounces.last() {
            let ratio = bounce.u / last.u;
            let continues = ratio > 0.6 * self.e && ratio < (1.5 * self.e).min(1.0);
            if !(continues && bounce.g > 0.0) {
                self.clear();
            }
        }
        if self.bounces.is_empty() {
            self.fastest = 0.0;
        }
        self.fastest = self.fastest.max(bounce.u / self.e);
        self.bounces.push(bounce);
    }

    /// Rows of the table lie so many impacts apart that the speed falls by [`FALL`], if there are
    /// that many: neighbours tell little from each other when `e` is near 1.
    pub(crate) fn stride(&self) -> usize {
        let longest = (libm::log(FALL) / libm::log(self.e)).round().max(1.0) as usize;
        longest.min(self.bounces.len() / (COLUMNS + 2)).max(1)
    }

    /// By how much the speed falls over so many impacts.
    fn ratio(&self, stride: usize) -> f64 {
        if stride == 1 {
            self.e
        } else {
            libm::pow(self.e, stride as f64)
        }
    }

    /// The entries (2) of the last rows, times since the first impact, the newest first, and how
    /// many there are; the table (3) of them has columns in these powers.
    fn first_column(&self) -> ([f64; COLUMNS + 2], usize, Powers) {
        let (last, first, stride) = (self.bounces.len() - 1, self.bounces[0].t, self.stride());
        let rows = (last / stride + 1).min(COLUMNS + 2);
        let mut column = [0.0; COLUMNS + 2];
        for (i, entry) in column[..rows].iter_mut().enumerate() {
            let bounce = self.bounces[last - i * stride];
            *entry = bounce.t - first + self.remaining(bounce);
        }
        (column, rows, self.powers(stride))
    }

    /// Those of equation (3) for rows that lie so many impacts apart.
    pub(crate) fn powers(&self, stride: usize) -> Powers {
        let ratio = self.ratio(stride);
        Powers { ratio, first: ratio * ratio }
    }

    /// Time from an impact to the Zeno point under a constant pull, `2 u/(g (1 - e))`.
    pub(crate) fn remaining(&self, bounce: Bounce) -> f64 {
        2.0 * bounce.u / (bounce.g * (1.0 - self.e))
    }

    /// Largest speed before an impact (m/s).
    pub(crate) fn fastest(&self) -> f64 {
        self.fastest
    }

    /// Time since the first impact up to the last.
    pub(crate) fn duration(&self) -> f64 {
        match self.bounces.as_slice() {
            [first, .., last] => last.t - first.t,
            _ => 0.0,
        }
    }

    /// Whether the speed has fallen by so much that rounding is all that is left of it.
    pub(crate) fn is_spent(&self) -> bool {
        const FLOOR: f64 = 1e-13;
        self.bounces.last().is_some_and(|last| last.u <= FLOOR * self.fastest)
    }

    /// The entry of the last row with the smallest estimated error, from three impacts on.
    ///
    /// The estimate is at least what rounding does: each column magnifies that of the one before by
    /// `(1 + q^(j+1))/(1 - q^(j+1))`.
    pub(crate) fn zeno_time(&self) -> Option<ZenoTime> {
        let (first, last) = (self.bounces.first()?, self.bounces.last()?);
        let (mut column, rows, powers) = self.first_column();
        let mut noise = f64::EPSILON * last.t.abs().max(column[0].abs());
        let mut best: Option<ZenoTime> = None;
        richardson::columns(&mut column[..rows], &mut [0.0], powers, |entry| {
            noise *= (1.0 + entry.power) / (1.0 - entry.power);
            let error = entry.error(0).max(noise);
            if entry.j < COLUMNS && best.is_none_or(|best| error < best.error) {
                best = Some(ZenoTime { t: first.t + entry.newest[0], error });
            }
        });
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A chain with `t_n = t_inf - sum C_k e^(kn)` and the first-order pull that fits it.
    fn expansion(e: f64, t_inf: f64, n: i32) -> Chain {
        let mut chain = Chain::new(e);
        for i in 0..n {
            let q = e.powi(i);
            let t = t_inf - q - 0.3 * q * q + 0.1 * q.powi(3) - 0.02 * q.powi(4);
            let u = q * (1.0 + 0.2 * q - 0.05 * q * q);
            let g = 2.0 / (1.0 - e) * (1.0 + 0.1 * q);
            chain.note(Bounce { t, u, g });
        }
        chain
    }

    #[test]
    fn columns_remove_the_known_powers() {
        for e in [0.2, 0.5, 0.8] {
            let zeno = expansion(e, 7.0, 16).zeno_time().unwrap();
            assert!((zeno.t - 7.0).abs() < 1e-9, "{e}: {:e}", zeno.t - 7.0);
            assert!((zeno.t - 7.0).abs() <= zeno.error, "{e}: {zeno:?}");
        }
    }

    #[test]
    fn the_estimate_is_not_optimistic_where_a_difference_of_columns_is() {
        // expansions with coefficients of both signs: neighbouring columns agree by chance
        let (mut optimistic, mut naive, mut all) = (0, 0, 0);
        for case in 0..400 {
            let c = |k: i32| (f64::from(case * (k + 3)) * 0.7548776662).sin();
            let mut chain = Chain::new(0.6);
            for i in 0..8 {
                let q = 0.6f64.powi(i);
                let t = 5.0 - q - 0.5 * (c(2) * q.powi(2) + c(3) * q.powi(3) + c(4) * q.powi(4));
                let (u, g) = (q * (1.0 + 0.3 * c(5) * q), 5.0 * (1.0 + 0.2 * c(6) * q));
                chain.note(Bounce { t, u, g });
                let (Some(zeno), first) = (chain.zeno_time(), chain.bounces[0].t) else { continue };
                let error = (zeno.t - 5.0).abs();
                let (mut column, rows, powers) = chain.first_column();
                let mut best: Option<(f64, f64)> = None;
                richardson::columns(&mut column[..rows], &mut [0.0], powers, |entry| {
                    let across = (entry.newest[0] - entry.across[0]).abs();
                    if entry.j < COLUMNS && best.is_none_or(|best| across < best.0) {
                        best = Some((across, entry.newest[0]));
                    }
                });
                let Some((across, t)) = best else { continue };
                all += 1;
                optimistic += i32::from(error > 2.0 * zeno.error);
                naive += i32::from((first + t - 5.0).abs() > 2.0 * across);
            }
        }
        assert!(optimistic * 100 < all && naive > 5 * optimistic, "{optimistic} {naive} {all}");
    }

    #[test]
    fn rounding_is_part_of_the_estimate() {
        // e near 1 and times of 1000 s: differences of neighbours are all rounding, and in thousands
        // of rows some agree by chance
        let (e, t_inf, g) = (0.9999_f64, 1000.0, 9.81);
        let mut chain = Chain::new(e);
        let (mut wrong, mut best) = (0, f64::INFINITY);
        for i in 0..12_000 {
            let q = 3e-2 * e.powi(i);
            let t = t_inf - 5e3 * (q + 0.4 * q * q + 0.1 * q.powi(3));
            // the speed for which the leading term fits
            let u = 0.5 * g * (1.0 - e) * 5e3 * q * (1.0 + 0.3 * q);
            chain.note(Bounce { t, u, g });
            if let Some(zeno) = chain.zeno_time() {
                wrong += i32::from((zeno.t - t_inf).abs() > 3.0 * zeno.error);
                best = best.min(zeno.error);
            }
        }
        assert!(wrong == 0 && best < 1e-8, "{wrong} {best:e}");
    }

    #[test]
    fn a_constant_pull_is_exact() {
        let (e, g) = (0.5, 9.81);
        let mut chain = Chain::new(e);
        let (mut t, mut u) = (0.3, 2.0);
        for _ in 0..4 {
            chain.note(Bounce { t, u, g });
            (t, u) = (t + 2.0 * u / g, e * u);
        }
        let exact = 0.3 + 2.0 * 2.0 / (g * (1.0 - e));
        assert!((chain.zeno_time().unwrap().t - exact).abs() < 1e-15);
    }

    #[test]
    fn an_impact_that_loses_far_more_begins_a_chain() {
        let mut chain = expansion(0.9, 1.0, 5);
        let last = *chain.bounces().last().unwrap();
        // down to 0.6 e of the speed before an impact continues the chain
        chain.note(Bounce { t: 1.0, u: 0.6 * last.u, ..last });
        assert_eq!(chain.bounces().len(), 6);
        chain.note(Bounce { t: 1.1, u: 0.6 * 0.5 * last.u, ..last });
        assert_eq!(chain.bounces().len(), 1);
        // and so does one without a pull
        chain.note(Bounce { t: 1.2, u: 0.25 * last.u, g: 0.0 });
        assert_eq!(chain.bounces().len(), 1);
    }

    #[test]
    fn the_estimate_of_the_second_column() {
        // S^(0) = 1, 2, 2.5 at three impacts: S^(1) by (3), the limit of its differences e^3 apart
        let e = 0.5_f64;
        let mut chain = Chain::new(e);
        for (t, u, s) in [(0.0, 1.0, 1.0), (1.0, 0.5, 2.0), (1.5, 0.2, 2.5)] {
            chain.note(Bounce { t, u, g: 2.0 * u / ((s - t) * (1.0 - e)) });
        }
        let (before, row) = ((2.0 - 0.25) / 0.75, (2.5 - 0.25 * 2.0) / 0.75);
        let down = (row - before) / (1.0 - 0.125);
        let zeno = chain.zeno_time().unwrap();
        assert!((zeno.t - row).abs() < 1e-14);
        assert!((zeno.error - down.max(row - 2.5)).abs() < 1e-14, "{zeno:?} {down}");
        assert!(down > row - 2.5);
    }

    #[test]
    fn a_chain_is_spent_at_rounding_of_the_speeds_only() {
        let mut chain = Chain::new(0.5);
        for n in 0..45 {
            let u = 0.5f64.powi(n);
            chain.note(Bounce { t: 2.0 - u, u, g: 4.0 });
            // the speed before the first impact was 2
            assert_eq!(chain.is_spent(), u <= 2e-13, "{u:e}");
        }
    }

    #[test]
    fn needs_three_impacts_and_gives_up_a_chain_that_speeds_up() {
        assert_eq!(expansion(0.5, 1.0, 2).zeno_time(), None);
        let mut chain = expansion(0.9, 1.0, 9);
        let Some(&last) = chain.bounces().last() else { panic!("empty") };
        chain.note(Bounce { t: 1.0, u: last.u, ..last });
        assert_eq!(chain.bounces().len(), 1);
    }
}
