//! Impacts at ever smaller speeds, and the Zeno point in which they end.
//!
//! The map from one impact to the next is the identity on `u = 0` and has the multiplier `e`
//! across it, whatever the force is. So the impact times, and the states `z` freed of the speed
//! `u` after the impact, have the expansions
//!
//! ```text
//! t_n = t_inf - C_1 e^n - C_2 e^(2n) - ...      z_n = z_inf + Z_1 e^n + Z_2 e^(2n) + ...     (1)
//! ```
//!
//! in known powers. With `g_i` the acceleration towards the wall while nothing else opens, and the
//! equations of motion in contact `z' = f(z)`,
//!
//! ```text
//! S_i^(0) = (t_i + d_i, z_i + d_i f(z_i))       d_i = 2 u_i/(g_i (1 - e))                     (2)
//! ```
//!
//! is the first column of the table of [`super::table`]. A mass above a wall has no `z`: its
//! impact sequences hold times, speeds and accelerations `g`. Powers and logarithms are those of the `libm` crate, here
//! and in all results of an impact sequence, for identical results on all machines.

use std::collections::TryReserveError;

use crate::numeric::coordinates::Coordinates;
use crate::numeric::tableau;
use crate::numeric::tableau::{Column, Powers, TableauEntry};
use crate::zeno::arc::Bounce;
use crate::zeno::table::{is_coarse, ExtrapolatedEnd, ZenoTable, ROWS};
use crate::zeno::tail::Tail;

/// By how much the speed falls from one row of the table to the next, if the impact sequence is long enough.
///
/// In 40 random runs with `e` of 0.9995 0.95 saves 2 % of the impacts before the jump and makes the
/// largest error 1.4 times as large; 0.8 needs 5 % more of them, 0.6 needs 21 % more.
const FALL: f64 = 0.9;

/// Range of speed ratios that continue an impact sequence, in units of `e`. The ratio is `e (1 + O(u))`: in
/// 160 random runs 0.9 and 1.1 change a single impact, and without either bound none. They tell
/// impact sequences from impacts after which something else happens.
const CONTINUES: (f64, f64) = (0.6, 1.5);

/// Impacts at decreasing speeds, identified by `K`, with states `Z`: the time since the first
/// impact and the quantities expanded along with it.
#[derive(Clone, Debug)]
pub(crate) struct Chain<Z, K = ()> {
    key: K,
    e: f64,
    bounces: Vec<Bounce>,
    /// Equation (2) for each of them, one after the other.
    rows: Vec<f64>,
    /// Largest speed before an impact: the scale of the speeds.
    fastest: f64,
    table: ZenoTable<Z>,
}

impl<Z: Coordinates, K: Copy + PartialEq> Chain<Z, K> {
    /// An empty impact sequence for a size of the state and a number of columns of the table after its first.
    pub(crate) fn new(key: K, e: f64, states: usize, columns: usize) -> Self {
        let (bounces, rows) = (Vec::new(), Vec::new());
        let table = ZenoTable::new(1 + states, columns);
        Self { key, e, bounces, rows, fastest: 0.0, table }
    }

    /// Key of the bouncing object.
    pub(crate) fn key(&self) -> K {
        self.key
    }

    /// With which restitution.
    pub(crate) fn e(&self) -> f64 {
        self.e
    }

    /// The impacts, oldest first.
    pub(crate) fn bounces(&self) -> &[Bounce] {
        &self.bounces
    }

    pub(crate) fn clear(&mut self) {
        self.bounces.clear();
        self.rows.clear();
    }

    /// From here on something else bounces, or the same.
    pub(crate) fn turn_to(&mut self, key: K, e: f64) {
        if key != self.key || e != self.e {
            self.clear();
            (self.key, self.e) = (key, e);
        }
    }

    /// Appends an impact in the state `z`, which moves at the rates `f` in contact; an impact sequence that it
    /// does not continue is given up first.
    ///
    /// An impact sequence loses speed at each impact, by about the factor `e`, under an acceleration towards the wall. Without the
    /// first of these a periodic motion with `e > 2/3` would be one endless impact sequence.
    ///
    /// # Errors
    /// Where there is no memory for it.
    pub(crate) fn note(
        &mut self,
        bounce: Bounce,
        z: &[f64],
        f: &[f64],
    ) -> Result<(), TryReserveError> {
        if let Some(last) = self.bounces.last() {
            let ratio = bounce.u / last.u;
            let (least, most) = (CONTINUES.0 * self.e, (CONTINUES.1 * self.e).min(1.0));
            let continues = ratio > least && ratio < most;
            if !(continues && bounce.g > 0.0) {
                self.clear();
            }
        }
        if self.bounces.is_empty() {
            self.fastest = 0.0;
        }
        self.fastest = self.fastest.max(bounce.u / self.e);
        self.bounces.try_reserve(1)?;
        self.rows.try_reserve(self.width())?;
        self.bounces.push(bounce);
        let (first, left) = (self.bounces[0].t, self.remaining(bounce));
        self.rows.push(bounce.t - first + left);
        self.rows.extend(z.iter().zip(f).map(|(z, f)| z + left * f));
        Ok(())
    }

    /// Distance in impacts between rows of the table over which the speed decreases by [`FALL`]:
    /// neighbouring impacts are nearly identical when `e` is near 1.
    fn stride(&self) -> usize {
        let longest = (libm::log(FALL) / libm::log(self.e)).round().max(1.0) as usize;
        longest.min(self.bounces.len() / ROWS).max(1)
    }

    /// The impacts of the rows of the table, the newest first, and the powers of its columns.
    pub(crate) fn selection(&self) -> (impl Iterator<Item = usize>, Powers, usize) {
        let (count, stride) = (self.bounces.len(), self.stride());
        let ratio = if stride == 1 { self.e } else { libm::pow(self.e, stride as f64) };
        let powers = Powers { ratio, first: ratio * ratio };
        ((0..count).rev().step_by(stride).take(ROWS), powers, stride)
    }

    /// How many columns the table has after its first.
    pub(crate) fn columns(&self) -> usize {
        self.table.columns()
    }

    /// The same from here on.
    pub(crate) fn set_columns(&mut self, columns: usize) {
        self.table.set_columns(columns);
    }

    /// Length of a row: the time since the first impact, then the state.
    pub(crate) fn width(&self) -> usize {
        self.table.width()
    }

    /// The row (2) of an impact.
    pub(crate) fn row(&self, i: usize) -> &[f64] {
        let width = self.width();
        &self.rows[i * width..][..width]
    }

    /// Time from an impact to the Zeno point under a constant acceleration `g`, `2 u/(g (1 - e))`.
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

    /// Whether what is left after the last impact is below rounding, of the time or of the speeds.
    pub(crate) fn is_over(&self) -> bool {
        self.bounces.last().is_some_and(|&last| {
            self.remaining(last) <= 4.0 * f64::EPSILON * last.t.abs() || self.is_spent()
        })
    }

    /// Whether the speed has fallen by so much that rounding is all that is left of it.
    fn is_spent(&self) -> bool {
        const FLOOR: f64 = 1e-13;
        self.bounces.last().is_some_and(|last| last.u <= FLOOR * self.fastest)
    }

    /// The last row (2): the end of the impact sequence without a table.
    pub(crate) fn leading(&self) -> Option<ExtrapolatedEnd<Z>> {
        let (first, last) = (self.bounces.first()?, self.bounces.len() - 1);
        Some(ExtrapolatedEnd::new(first.t, self.row(last), 0.0))
    }

    /// The end of the impact sequence under a constant acceleration `g`, from three impacts on, where a
    /// table of neighbours would magnify rounding: the row (2) is exact.
    pub(crate) fn end_under_constant_pull(&self) -> Option<f64> {
        let known = self.bounces.len() > 2 && is_coarse(self.e * self.e);
        self.leading().filter(|_| known).map(|landing| landing.t)
    }

    /// The end of the impact sequence, from three impacts on: the entry of the last row of the table with the
    /// smallest estimated error in the given scales (time, state).
    pub(crate) fn landing(&mut self, scales: &[f64]) -> Option<ExtrapolatedEnd<Z>> {
        let [first, _, .., last] = *self.bounces else { return None };
        let (chosen, powers, _) = self.selection();
        self.table.begin();
        for i in chosen {
            let width = self.table.width();
            self.table.push(&self.rows[i * width..][..width]);
        }
        self.table.landing(first.t, last.t, powers, scales)
    }

    /// Whether [`Self::landing`] may give one of a size of one or less, by the scale of the time.
    pub(crate) fn may_land(&self, scale: f64) -> bool {
        let [_, _, .., last] = *self.bounces else { return false };
        let (chosen, powers, _) = self.selection();
        let times = chosen.map(|i| &self.rows[i * self.width()]);
        ZenoTable::<Z>::may_land(times, (last.t, self.table.columns()), powers, scale)
    }

    /// The flights between the last impact and `zeno`, the first of them on the side `sigma`.
    pub(crate) fn tail(&self, zeno: f64, sigma: f64) -> Tail {
        Tail::new(&self.bounces, self.e, zeno, sigma)
    }
}

// The derivatives of the end of an impact sequence: the table of [`super::table`], differentiated.
//
// With `d = 2 u/(g (1 - e))` the first column and its derivative along an event are
//
// ```text
// S^(0) = (t + d, z + d f)      D^(0) = (dt + dd, dz + dd f + d df)
// dd = d (du/u - dg/g + de/(1 - e))                                                      (1)
// ```
//
// and with the powers `p = e^(j+1)`, which move with `e`,
//
// ```text
// D_i^(j) = (D_i - p D_(i-1))/(1 - p) + dp/(1 - p) (S_i^(j) - S_(i-1)^(j-1))             (2)
// ```
//
// Without the last term the expansion by `e` keeps terms `n e^n` and every column is of the order
// two; with it `D^(j)` has an error of order `u^(j+2)`, as `S^(j)` has.

/// The derivatives of a chain of impacts by one number.
#[derive(Clone, Debug, Default)]
pub(crate) struct ChainRates {
    /// Rows (1), of the length of the impact sequence's rows.
    rows: Vec<f64>,
}

/// Contribution of one impact: derivatives along the event.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rate<'a> {
    pub(crate) dt: f64,
    pub(crate) du: f64,
    pub(crate) dg: f64,
    pub(crate) de: f64,
    /// `f` and `df`.
    pub(crate) flow: [&'a [f64]; 2],
    pub(crate) dz: &'a [f64],
}

impl ChainRates {
    /// Notes the last impact of an impact sequence.
    pub(crate) fn note<Z, K>(&mut self, chain: &Chain<Z, K>, rate: &Rate<'_>)
    where
        Z: Coordinates,
        K: Copy + PartialEq,
    {
        let Some((&bounce, before)) = chain.bounces().split_last() else { return };
        if self.rows.len() != before.len() * chain.width() {
            self.rows.clear();
        }
        if self.rows.is_empty() && !before.is_empty() {
            return;
        }
        let d = chain.remaining(bounce);
        let Rate { dt, du, dg, de, flow: [f, df], dz } = *rate;
        let dd = d * (du / bounce.u - dg / bounce.g + de / (1.0 - chain.e()));
        self.rows.push(dt + dd);
        let state = dz.iter().zip(f).zip(df);
        self.rows.extend(state.map(|((dz, f), df)| dz + dd * f + d * df));
    }

    /// The derivatives of the end of the impact sequence: the entry of the table whose estimated error is the
    /// smallest in the scales, which may depend on a component and its value.
    pub(crate) fn landing<Z, K>(
        &self,
        chain: &Chain<Z, K>,
        de: f64,
        scale: impl Fn(usize, f64) -> f64,
    ) -> Option<ExtrapolatedEnd<Z>>
    where
        Z: Coordinates,
        K: Copy + PartialEq,
    {
        let width = chain.width();
        let last = self.rows.len().checked_sub(width)?;
        if self.rows.len() != chain.bounces().len() * width {
            return None;
        }
        let mut best = ExtrapolatedEnd::new(0.0, &self.rows[last..], f64::INFINITY);
        self.columns(chain, de, |entry| {
            let size = largest(entry, &scale);
            if entry.j <= chain.columns() && size < best.size {
                best = ExtrapolatedEnd::new(0.0, entry.newest, size);
            }
        });
        Some(best)
    }

    /// Shows the columns (2) of the table.
    fn columns<Z, K>(&self, chain: &Chain<Z, K>, de: f64, show: impl FnMut(&TableauEntry<'_>))
    where
        Z: Coordinates,
        K: Copy + PartialEq,
    {
        let (width, (chosen, powers, stride)) = (chain.width(), chain.selection());
        let moves = de != 0.0;
        let mut rates = Vec::with_capacity(ROWS * width);
        let mut values = Vec::with_capacity(if moves { ROWS * width } else { 0 });
        for i in chosen {
            rates.extend_from_slice(&self.rows[i * width..][..width]);
            if moves {
                values.extend_from_slice(chain.row(i));
            }
        }
        let moving = |Column { j, power, length }: Column, rates: &mut [f64]| {
            if !moves {
                return;
            }
            let dp = (stride * (j + 1)) as f64 * power / chain.e() * de;
            for i in 0..length {
                let before = values[i + width];
                values[i] = (values[i] - power * before) / (1.0 - power);
                rates[i] += dp / (1.0 - power) * (values[i] - before);
            }
        };
        let mut across = Z::zeros(width);
        tableau::columns_with(&mut rates, across.as_mut_slice(), powers, moving, show);
    }
}

/// The largest estimated error of an entry in the scales, NaN if one is.
fn largest(entry: &TableauEntry<'_>, scale: impl Fn(usize, f64) -> f64) -> f64 {
    let mut worst = 0.0_f64;
    for (c, rate) in entry.newest.iter().enumerate() {
        let size = entry.error(c) / scale(c, *rate);
        worst = if size > worst || size.is_nan() { size } else { worst };
    }
    worst
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::tableau;

    const COLUMNS: usize = 4;

    /// The chain of a mass.
    fn times(e: f64) -> Chain<f64> {
        Chain::new((), e, 0, COLUMNS)
    }

    fn note(chain: &mut Chain<f64>, bounce: Bounce) {
        assert!(chain.note(bounce, &[], &[]).is_ok());
    }

    /// An impact sequence with `t_n = t_inf - sum C_k e^(kn)` and the first-order acceleration that fits it.
    fn expansion(e: f64, t_inf: f64, n: i32) -> Chain<f64> {
        let mut chain = times(e);
        for i in 0..n {
            let q = e.powi(i);
            let t = t_inf - q - 0.3 * q * q + 0.1 * q.powi(3) - 0.02 * q.powi(4);
            let u = q * (1.0 + 0.2 * q - 0.05 * q * q);
            let g = 2.0 / (1.0 - e) * (1.0 + 0.1 * q);
            note(&mut chain, Bounce { t, u, g });
        }
        chain
    }

    #[test]
    fn the_time_alone_tells_whether_a_landing_is_good_enough() {
        let mut counts = [0; 2];
        for n in 2..16 {
            for digits in 1..16 {
                let mut chain = expansion(0.6, 7.0, n);
                let scales = [0.1_f64.powi(digits)];
                let good = chain.landing(&scales).is_some_and(|it| it.size <= 1.0);
                assert_eq!(chain.may_land(scales[0]), good, "{n} {digits}");
                counts[usize::from(good)] += 1;
            }
        }
        assert!(counts.iter().all(|&count| count > 40), "{counts:?}");
    }

    #[test]
    fn columns_remove_the_known_powers() {
        for e in [0.2, 0.5, 0.8] {
            let zeno = expansion(e, 7.0, 16).landing(&[1.0]).unwrap();
            assert!((zeno.t - 7.0).abs() < 1e-9, "{e}: {:e}", zeno.t - 7.0);
            assert!((zeno.t - 7.0).abs() <= zeno.size, "{e}: {zeno:?}");
        }
    }

    #[test]
    fn the_estimate_is_not_optimistic_where_a_difference_of_columns_is() {
        // expansions with coefficients of both signs: neighbouring columns agree by chance
        let (mut optimistic, mut naive, mut all) = (0, 0, 0);
        for case in 0..400 {
            let c = |k: i32| (f64::from(case * (k + 3)) * 0.7548776662).sin();
            let mut chain = times(0.6);
            for i in 0..8 {
                let q = 0.6f64.powi(i);
                let t = 5.0 - q - 0.5 * (c(2) * q.powi(2) + c(3) * q.powi(3) + c(4) * q.powi(4));
                let (u, g) = (q * (1.0 + 0.3 * c(5) * q), 5.0 * (1.0 + 0.2 * c(6) * q));
                note(&mut chain, Bounce { t, u, g });
                let Some(zeno) = chain.landing(&[1.0]) else { continue };
                let (error, first) = ((zeno.t - 5.0).abs(), chain.bounces[0].t);
                let (chosen, powers, _) = chain.selection();
                let mut column: Vec<f64> = chosen.map(|i| chain.row(i)[0]).collect();
                let mut best: Option<(f64, f64)> = None;
                tableau::columns(&mut column, &mut [0.0], powers, |entry| {
                    let across = (entry.newest[0] - entry.across[0]).abs();
                    if entry.j <= COLUMNS && best.is_none_or(|best| across < best.0) {
                        best = Some((across, entry.newest[0]));
                    }
                });
                let Some((across, t)) = best else { continue };
                all += 1;
                optimistic += i32::from(error > 2.0 * zeno.size);
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
        let mut chain = times(e);
        let (mut wrong, mut best) = (0, f64::INFINITY);
        for i in 0..12_000 {
            let q = 3e-2 * e.powi(i);
            let t = t_inf - 5e3 * (q + 0.4 * q * q + 0.1 * q.powi(3));
            // the speed for which the leading term fits
            let u = 0.5 * g * (1.0 - e) * 5e3 * q * (1.0 + 0.3 * q);
            note(&mut chain, Bounce { t, u, g });
            if let Some(zeno) = chain.landing(&[1.0]) {
                wrong += i32::from((zeno.t - t_inf).abs() > 3.0 * zeno.size);
                best = best.min(zeno.size);
            }
        }
        assert!(wrong == 0 && best < 1e-8, "{wrong} {best:e}");
    }

    #[test]
    fn a_constant_pull_is_exact() {
        let (e, g) = (0.5, 9.81);
        let mut chain = times(e);
        let (mut t, mut u) = (0.3, 2.0);
        for _ in 0..4 {
            note(&mut chain, Bounce { t, u, g });
            (t, u) = (t + 2.0 * u / g, e * u);
        }
        let exact = 0.3 + 2.0 * 2.0 / (g * (1.0 - e));
        assert!((chain.landing(&[1.0]).unwrap().t - exact).abs() < 1e-15);
        assert_eq!(chain.end_under_constant_pull(), None);
        let (near, mut chain) = (0.99_f64, times(0.99));
        for n in 0..3 {
            assert_eq!(chain.end_under_constant_pull(), None);
            let q = near.powi(n);
            note(&mut chain, Bounce { t: 1.0 - q, u: q, g: 2.0 / (1.0 - near) });
        }
        assert!(chain.end_under_constant_pull().is_some_and(|t| (t - 1.0).abs() < 1e-15));
    }

    #[test]
    fn an_impact_that_loses_far_more_begins_a_chain() {
        let mut chain = expansion(0.9, 1.0, 5);
        let last = *chain.bounces().last().unwrap();
        // down to 0.6 e of the speed before an impact continues the impact sequence
        note(&mut chain, Bounce { t: 1.0, u: 0.6 * last.u, ..last });
        assert_eq!(chain.bounces().len(), 6);
        note(&mut chain, Bounce { t: 1.1, u: 0.6 * 0.5 * last.u, ..last });
        assert_eq!(chain.bounces().len(), 1);
        // and so does one without a pull
        note(&mut chain, Bounce { t: 1.2, u: 0.25 * last.u, g: 0.0 });
        assert_eq!(chain.bounces().len(), 1);
    }

    #[test]
    fn the_estimate_of_the_second_column() {
        // S^(0) = 1, 2, 2.5 at three impacts: S^(1) by (3), the limit of its differences e^3 apart
        let e = 0.5_f64;
        let mut chain = times(e);
        for (t, u, s) in [(0.0, 1.0, 1.0), (1.0, 0.5, 2.0), (1.5, 0.2, 2.5)] {
            note(&mut chain, Bounce { t, u, g: 2.0 * u / ((s - t) * (1.0 - e)) });
        }
        let (before, row) = ((2.0 - 0.25) / 0.75, (2.5 - 0.25 * 2.0) / 0.75);
        let down = (row - before) / (1.0 - 0.125);
        let zeno = chain.landing(&[1.0]).unwrap();
        assert!((zeno.t - row).abs() < 1e-14);
        assert!((zeno.size - down.max(row - 2.5)).abs() < 1e-14, "{zeno:?} {down}");
        assert!(down > row - 2.5);
    }

    #[test]
    fn a_chain_is_spent_at_rounding_of_the_speeds_only() {
        let mut chain = times(0.5);
        for n in 0..45 {
            let u = 0.5f64.powi(n);
            note(&mut chain, Bounce { t: 2.0 - u, u, g: 4.0 });
            // the speed before the first impact was 2
            assert_eq!(chain.is_spent(), u <= 2e-13, "{u:e}");
        }
    }

    #[test]
    fn needs_three_impacts_and_gives_up_a_chain_that_speeds_up() {
        assert_eq!(expansion(0.5, 1.0, 2).landing(&[1.0]), None);
        let mut chain = expansion(0.9, 1.0, 9);
        let Some(&last) = chain.bounces().last() else { panic!("empty") };
        note(&mut chain, Bounce { t: 1.0, u: last.u, ..last });
        assert_eq!(chain.bounces().len(), 1);
    }
}

#[cfg(test)]
mod rates_tests {
    use super::*;
    use crate::zeno::arc::Bounce;

    /// An impact sequence whose times are `7 - q - 0.3 q^2 + 0.1 q^3`, `q = e^i`, and whose state is `2 + 1.3
    /// q^2 - q^3`, with the derivatives by a shift of time that moves the state with `q^2`, and by
    /// `e`; speeds and accelerations fit to first order, without a flow.
    fn expansion(e: f64, n: i32) -> (Chain<Vec<f64>>, [ChainRates; 2]) {
        let (mut chain, mut rates) = (Chain::new((), e, 1, 5), <[ChainRates; 2]>::default());
        for i in 0..n {
            let (q, by_e) = (e.powi(i), f64::from(i) * e.powi(i - 1));
            let t = 7.0 - q - 0.3 * q * q + 0.1 * q.powi(3);
            let t_by_e = -(1.0 + 0.6 * q - 0.3 * q * q) * by_e;
            let (u, u_by_e) = (q * (1.0 + 0.2 * q), (1.0 + 0.4 * q) * by_e);
            let pull = 2.0 / (1.0 - e);
            let g = pull * (1.0 + 0.1 * q);
            let g_by_e = pull / (1.0 - e) * (1.0 + 0.1 * q) + pull * 0.1 * by_e;
            let z = 2.0 + 1.3 * q * q - q.powi(3);
            let z_by_e = (2.6 * q - 3.0 * q * q) * by_e;
            assert!(chain.note(Bounce { t, u, g }, &[z], &[0.0]).is_ok());
            let flow = [&[0.0][..], &[0.0][..]];
            let by_p = Rate { dt: 1.0, du: 0.0, dg: 0.0, de: 0.0, flow, dz: &[q * q] };
            let by_e = Rate { dt: t_by_e, du: u_by_e, dg: g_by_e, de: 1.0, flow, dz: &[z_by_e] };
            rates[0].note(&chain, &by_p);
            rates[1].note(&chain, &by_e);
        }
        (chain, rates)
    }

    /// Errors of the time and the state, and their estimates.
    fn errors(e: f64, n: i32, column: usize, de: f64) -> [f64; 3] {
        let (chain, rates) = expansion(e, n);
        let found = rates[column].landing(&chain, de, |_, _| 1.0).unwrap();
        let exact = if column == 0 { 1.0 } else { 0.0 };
        [(found.t - exact).abs(), found.state()[0].abs(), found.size]
    }

    #[test]
    fn columns_remove_the_powers_from_times_and_states() {
        for e in [0.2, 0.5, 0.8] {
            for column in 0..2 {
                let [t, z, size] = errors(e, 14, column, column as f64);
                let worst = t.max(z);
                assert!(worst < 1e-7 && worst <= size.max(1e-13), "{e} {column}: {t:e} {z:e}");
            }
        }
    }

    #[test]
    fn ratios_that_do_not_move_leave_the_derivatives_by_e_at_second_order() {
        let (moving, naive) = (errors(0.5, 10, 1, 1.0), errors(0.5, 10, 1, 0.0));
        for c in 0..2 {
            assert!(naive[c] > 100.0 * moving[c], "{naive:?} {moving:?}");
        }
    }

    #[test]
    fn the_order_rises_by_one_with_each_column() {
        // the same column, from the impacts up to n and up to n + 1: u falls by e
        let of_time = |n: i32| -> Vec<f64> {
            let (chain, rates) = expansion(0.5, n);
            let mut found = vec![rates[1].rows[rates[1].rows.len() - 2]];
            rates[1].columns(&chain, 1.0, |entry| found.push(entry.newest[0]));
            found
        };
        let (before, after) = (of_time(9), of_time(10));
        for j in 0..2 {
            let order = (before[j] / after[j]).abs().log2();
            // the factor n of n e^n hides a little of it
            assert!((order - (j + 2) as f64).abs() < 0.35, "{j}: {order}");
        }
    }

    #[test]
    fn a_shift_of_all_times_is_one_of_the_end() {
        let (chain, rates) = expansion(0.5, 10);
        rates[0].columns(&chain, 0.0, |entry| assert!((entry.newest[0] - 1.0).abs() < 1e-12));
    }

    #[test]
    fn without_a_known_error_the_last_row_stands() {
        let (chain, rates) = expansion(0.5, 6);
        let found = rates[1].landing(&chain, 1.0, |_, _| 0.0).unwrap();
        assert!(found.size == f64::INFINITY);
        assert_eq!(found.t, rates[1].rows[rates[1].rows.len() - 2]);
    }

    #[test]
    fn an_impact_that_was_missed_gives_no_rates() {
        let (chain, mut rates) = expansion(0.5, 6);
        rates[0].rows.pop();
        assert!(rates[0].landing(&chain, 0.0, |_, _| 1.0).is_none());
    }
}
