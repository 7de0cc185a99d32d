//! The derivative of the Zeno time: the table of [`crate::zeno::chain`], differentiated.
//!
//! With `q = 2/(g (1 - e))` the first column and its derivative are
//!
//! ```text
//! S^(0) = t + q u        D^(0) = dt + q du - (q u/g) dg        [by e: + q u/(1 - e)]      (1)
//! ```
//!
//! and with the ratios `r = e^(j+1)`, which move with `e`,
//!
//! ```text
//! S^(j) = (S_i - r S_(i-1))/(1 - r)
//! D^(j) = (D_i - r D_(i-1))/(1 - r)        [by e: + r'/(1 - r) (S^(j) - S_(i-1)^(j-1))]   (2)
//! ```
//!
//! Without the last term the expansion by `e` keeps terms `n e^n` and every column is of the
//! order two; with it `D^(j)` has an error of order `u^(j+2)`, as `S^(j)` has.

use crate::zeno::chain::{Bounce, Chain, COLUMNS};

/// Rows of the table.
const ROWS: usize = COLUMNS + 2;

type Table = [[f64; COLUMNS + 1]; ROWS];

/// The derivatives of a chain of impacts, one row for each impact: `dt`, `du`, `dg` by column.
#[derive(Clone, Debug, Default)]
pub(in crate::switched) struct ChainRates {
    m: usize,
    rows: Vec<f64>,
}

/// The derivatives of a Zeno time, and estimates of their errors.
#[derive(Clone, Debug, Default, PartialEq)]
pub(in crate::switched) struct ZenoRates {
    pub(in crate::switched) dt: Vec<f64>,
    pub(in crate::switched) error: Vec<f64>,
}

impl ChainRates {
    pub(in crate::switched) fn new(m: usize) -> Self {
        Self { m, rows: Vec::new() }
    }

    /// Notes the last impact of a chain.
    pub(in crate::switched) fn note(&mut self, chain: &Chain, [dt, du, dg]: [&[f64]; 3]) {
        let before = chain.bounces().len().saturating_sub(1);
        if before == 0 || self.rows.len() != before * 3 * self.m {
            self.rows.clear();
        }
        for part in [dt, du, dg] {
            self.rows.extend_from_slice(part);
        }
    }

    /// `(dt, du, dg)` of the impact `i` of the chain.
    fn row(&self, i: usize, column: usize) -> [f64; 3] {
        let row = &self.rows[i * 3 * self.m..][..3 * self.m];
        [row[column], row[self.m + column], row[2 * self.m + column]]
    }

    /// The derivatives of the Zeno time of the chain: of each column of the table the entry whose
    /// estimated error is the smallest. `by_e` is the number of the column by `e`.
    pub(in crate::switched) fn zeno(
        &self,
        chain: &Chain,
        e: f64,
        by_e: Option<usize>,
    ) -> ZenoRates {
        let bounces = chain.bounces();
        let mut zeno = ZenoRates { dt: vec![0.0; self.m], error: vec![f64::INFINITY; self.m] };
        if bounces.is_empty() || self.rows.len() != bounces.len() * 3 * self.m {
            return zeno;
        }
        let (last, stride) = (bounces.len() - 1, chain.stride());
        let rows = (last / stride + 1).min(ROWS);
        let frame = Frame { e, stride: stride as f64, rows };
        let at = |i: usize| last - i * stride;
        let values = frame.values(|i| bounces[at(i)], bounces[0].t);
        for column in 0..self.m {
            let first = |i: usize| {
                let by_ratio = by_e == Some(column);
                first_rate(e, bounces[at(i)], self.row(at(i), column), by_ratio)
            };
            let rates = frame.rates(&values, first, by_e == Some(column));
            let (dt, error) = frame.best(&rates);
            (zeno.dt[column], zeno.error[column]) = (dt, error);
        }
        zeno
    }
}

/// The second of equations (1).
fn first_rate(e: f64, bounce: Bounce, [dt, du, dg]: [f64; 3], by_e: bool) -> f64 {
    let Bounce { u, g, .. } = bounce;
    let q = 2.0 / (g * (1.0 - e));
    let own = if by_e { q * u / (1.0 - e) } else { 0.0 };
    dt + q * du - q * u / g * dg + own
}

/// What the tables of values and of rates have in common.
struct Frame {
    e: f64,
    stride: f64,
    /// The newest is row 0.
    rows: usize,
}

impl Frame {
    /// `r = e^(stride (j+1))` of the column `j`.
    fn ratio(&self, j: usize) -> f64 {
        self.e.powf(self.stride * (j + 1) as f64)
    }

    fn fill(&self, first: impl Fn(usize) -> f64, more: impl Fn(usize, usize, f64) -> f64) -> Table {
        let mut table = [[0.0; COLUMNS + 1]; ROWS];
        for (i, row) in table.iter_mut().enumerate().take(self.rows) {
            row[0] = first(i);
        }
        for j in 1..=COLUMNS {
            let r = self.ratio(j);
            for i in 0..self.rows.saturating_sub(j) {
                let entry = (table[i][j - 1] - r * table[i + 1][j - 1]) / (1.0 - r);
                table[i][j] = entry + more(i, j, r);
            }
        }
        table
    }

    fn values(&self, bounce: impl Fn(usize) -> Bounce, start: f64) -> Table {
        let first = |i: usize| {
            let Bounce { t, u, g } = bounce(i);
            t - start + 2.0 * u / (g * (1.0 - self.e))
        };
        self.fill(first, |_, _, _| 0.0)
    }

    /// Equations (2).
    fn rates(&self, values: &Table, first: impl Fn(usize) -> f64, by_e: bool) -> Table {
        self.fill(first, |i, j, r| {
            if !by_e {
                return 0.0;
            }
            let moves = self.stride * (j + 1) as f64 * r / self.e;
            moves / (1.0 - r) * (values[i][j] - values[i + 1][j - 1])
        })
    }

    /// The entry of the newest row with the smallest estimated error: the larger of the
    /// differences to the column before and to the row before.
    fn best(&self, rates: &Table) -> (f64, f64) {
        let mut best = (rates[0][0], f64::INFINITY);
        for j in 1..(self.rows.min(COLUMNS + 1)).saturating_sub(1) {
            let across = (rates[0][j] - rates[0][j - 1]).abs();
            let down = (rates[0][j] - rates[1][j]).abs() / (1.0 - self.ratio(j + 1));
            let error = across.max(down);
            if error < best.1 {
                best = (rates[0][j], error);
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A chain whose times are `7 + p - q - 0.3 q^2 + 0.1 q^3`, `q = e^i`, with the derivatives by
    /// `p` and by `e`; speeds and pulls that fit to first order.
    fn expansion(e: f64, n: i32) -> (Chain, ChainRates) {
        let (mut chain, mut rates) = (Chain::new(e), ChainRates::new(2));
        for i in 0..n {
            let q = e.powi(i);
            let q_by_e = f64::from(i) * e.powi(i - 1);
            let t = 7.0 - q - 0.3 * q * q + 0.1 * q.powi(3);
            let t_by_e = -(1.0 + 0.6 * q - 0.3 * q * q) * q_by_e;
            let (u, u_by_e) = (q * (1.0 + 0.2 * q), (1.0 + 0.4 * q) * q_by_e);
            let pull = 2.0 / (1.0 - e);
            let g = pull * (1.0 + 0.1 * q);
            let g_by_e = pull / (1.0 - e) * (1.0 + 0.1 * q) + pull * 0.1 * q_by_e;
            chain.note(Bounce { t, u, g });
            rates.note(&chain, [&[1.0, t_by_e], &[0.0, u_by_e], &[0.0, g_by_e]]);
        }
        (chain, rates)
    }

    #[test]
    fn columns_remove_the_powers_from_the_derivatives_too() {
        for e in [0.2, 0.5, 0.8] {
            let (chain, rates) = expansion(e, 14);
            let zeno = rates.zeno(&chain, e, Some(1));
            for (rate, exact) in zeno.dt.iter().zip([1.0, 0.0]) {
                assert!((rate - exact).abs() < 1e-7, "{e}: {zeno:?}");
            }
            let honest = zeno.error.iter().zip(&zeno.dt).zip([1.0, 0.0]);
            for ((error, rate), exact) in honest {
                assert!((rate - exact).abs() <= error.max(1e-13), "{e}: {zeno:?}");
            }
        }
    }

    #[test]
    fn ratios_that_do_not_move_leave_the_derivative_by_e_at_second_order() {
        let (chain, rates) = expansion(0.5, 10);
        let moving = rates.zeno(&chain, 0.5, Some(1)).dt[1].abs();
        let naive = rates.zeno(&chain, 0.5, None).dt[1].abs();
        assert!(naive > 100.0 * moving, "{naive:e} {moving:e}");
    }

    #[test]
    fn the_order_rises_by_one_with_each_column() {
        // the same table, from the impacts up to n and up to n + 1: u falls by e
        let entry = |n: i32, column: usize, j: usize| {
            let (chain, rates) = expansion(0.5, n);
            let last = chain.bounces().len() - 1;
            let frame = Frame { e: 0.5, stride: 1.0, rows: ROWS };
            let values = frame.values(|i| chain.bounces()[last - i], chain.bounces()[0].t);
            let by_e = column == 1;
            let first = |i: usize| {
                first_rate(0.5, chain.bounces()[last - i], rates.row(last - i, column), by_e)
            };
            (frame.rates(&values, first, by_e)[0][j] - if by_e { 0.0 } else { 1.0 }).abs()
        };
        for j in 0..2 {
            let order = (entry(9, 1, j) / entry(10, 1, j)).log2();
            // the factor n of n e^n hides a little of it
            assert!((order - (j + 2) as f64).abs() < 0.35, "{j}: {order}");
        }
        assert!(entry(10, 0, 0) < 1e-12, "a shift of all times is one of the Zeno time");
    }
}
