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
//! what bounces: a chain holds times, speeds and pulls.

/// One impact of a chain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Bounce {
    /// Time (s).
    pub(super) t: f64,
    /// Speed after the impact (m/s).
    pub(super) u: f64,
    /// Pull towards the wall, `-f(t, 0, 0)` (m/s^2).
    pub(super) g: f64,
}

/// Columns of the table after the first.
const COLUMNS: usize = 5;

/// Impacts at ever smaller speeds, and the rows of the table that the last two of them give.
#[derive(Clone, Debug)]
pub(super) struct Chain {
    e: f64,
    bounces: Vec<Bounce>,
    /// Largest speed before an impact: the scale of the speeds.
    fastest: f64,
    /// The table's last row and the one before, as times since the first impact.
    row: [f64; COLUMNS + 1],
    row_before: [f64; COLUMNS + 1],
}

/// An estimate of the Zeno time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ZenoTime {
    /// The time (s).
    pub(super) t: f64,
    /// Estimate of its error (s).
    pub(super) error: f64,
}

impl Chain {
    pub(super) fn new(e: f64) -> Self {
        let row = [0.0; COLUMNS + 1];
        Self { e, bounces: Vec::new(), fastest: 0.0, row, row_before: row }
    }

    /// The impacts, oldest first.
    pub(super) fn bounces(&self) -> &[Bounce] {
        &self.bounces
    }

    pub(super) fn clear(&mut self) {
        self.bounces.clear();
    }

    /// Appends an impact; a chain that it does not continue is given up first.
    ///
    /// A chain loses speed at each impact, by about the factor `e`, under a pull. Without the
    /// first of these a periodic motion with `e > 2/3` would be one endless chain.
    pub(super) fn note(&mut self, bounce: Bounce) {
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
        self.extend_table(bounce);
    }

    /// Equations (2), (3).
    fn extend_table(&mut self, bounce: Bounce) {
        self.row_before = self.row;
        self.row[0] = bounce.t - self.bounces[0].t + self.remaining(bounce);
        let mut power = self.e;
        for j in 1..self.columns() {
            power *= self.e;
            self.row[j] = (self.row[j - 1] - power * self.row_before[j - 1]) / (1.0 - power);
        }
    }

    /// Entries of the last row.
    fn columns(&self) -> usize {
        self.bounces.len().min(COLUMNS + 1)
    }

    /// Time from an impact to the Zeno point under a constant pull, `2 u/(g (1 - e))`.
    pub(super) fn remaining(&self, bounce: Bounce) -> f64 {
        2.0 * bounce.u / (bounce.g * (1.0 - self.e))
    }

    /// Largest speed before an impact (m/s).
    pub(super) fn fastest(&self) -> f64 {
        self.fastest
    }

    /// Time since the first impact up to the last.
    pub(super) fn duration(&self) -> f64 {
        match self.bounces.as_slice() {
            [first, .., last] => last.t - first.t,
            _ => 0.0,
        }
    }

    /// Whether the speed has fallen by so much that rounding is all that is left of it.
    pub(super) fn is_spent(&self) -> bool {
        const FLOOR: f64 = 1e-13;
        self.bounces.last().is_some_and(|last| last.u <= FLOOR * self.fastest)
    }

    /// The entry of the last row with the smallest estimated error, from three impacts on.
    ///
    /// The estimate takes the larger of two differences, to the column before and to the row
    /// before; the first alone is optimistic by up to two digits.
    pub(super) fn zeno_time(&self) -> Option<ZenoTime> {
        let first = self.bounces.first()?;
        let mut best: Option<ZenoTime> = None;
        let mut power = self.e * self.e;
        for j in 1..self.columns().saturating_sub(1) {
            power *= self.e; // e^(j+2)
            let across = (self.row[j] - self.row[j - 1]).abs();
            let down = (self.row[j] - self.row_before[j]).abs() / (1.0 - power);
            let error = across.max(down);
            if best.is_none_or(|best| error < best.error) {
                best = Some(ZenoTime { t: first.t + self.row[j], error });
            }
        }
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
                let columns = chain.columns() - 1;
                let across = |j: usize| (chain.row[j] - chain.row[j - 1]).abs();
                let best = (1..columns).min_by(|&a, &b| across(a).total_cmp(&across(b)));
                let Some(j) = best else { continue };
                all += 1;
                optimistic += i32::from(error > 2.0 * zeno.error);
                naive += i32::from((first + chain.row[j] - 5.0).abs() > 2.0 * across(j));
            }
        }
        assert!(optimistic * 100 < all && naive > 5 * optimistic, "{optimistic} {naive} {all}");
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
    fn needs_three_impacts_and_gives_up_a_chain_that_speeds_up() {
        assert_eq!(expansion(0.5, 1.0, 2).zeno_time(), None);
        let mut chain = expansion(0.9, 1.0, 9);
        let Some(&last) = chain.bounces().last() else { panic!("empty") };
        chain.note(Bounce { t: 1.0, u: last.u, ..last });
        assert_eq!(chain.bounces().len(), 1);
    }
}
