//! The derivatives of the end of an impact sequence: the table of [`super::table`], differentiated.
//!
//! With `d = 2 u/(g (1 - e))` the first column and its derivative along an event are
//!
//! ```text
//! S^(0) = (t + d, z + d f)      D^(0) = (dt + dd, dz + dd f + d df)
//! dd = d (du/u - dg/g + de/(1 - e))                                                      (1)
//! ```
//!
//! and with the powers `p = e^(j+1)`, which move with `e`,
//!
//! ```text
//! D_i^(j) = (D_i - p D_(i-1))/(1 - p) + dp/(1 - p) (S_i^(j) - S_(i-1)^(j-1))             (2)
//! ```
//!
//! Without the last term the expansion by `e` keeps terms `n e^n` and every column is of the order
//! two; with it `D^(j)` has an error of order `u^(j+2)`, as `S^(j)` has.

use super::chain::Chain;
use super::table::{ExtrapolatedEnd, ROWS};
use crate::numeric::coordinates::Coordinates;
use crate::numeric::tableau;
use crate::numeric::tableau::{Column, TableauEntry};

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
    use crate::zeno::arc::Bounce;

    /// An impact sequence whose times are `7 - q - 0.3 q^2 + 0.1 q^3`, `q = e^i`, and whose state is `2 + 1.3
    /// q^2 - q^3`, with the derivatives by a shift of time that moves the state with `q^2`, and by
    /// `e`; speeds and pulls that fit to first order, no flow.
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
