//! The derivatives of a Zeno point: the table of times and states, differentiated.
//!
//! With `d = 2 u/(a (1 - e))` the first column of [`crate::mechanics::chain`] and its derivative
//! along an event are
//!
//! ```text
//! S^(0) = (t + d, z + d f)      D^(0) = (dt + dd, dz + dd f + d df)
//! dd = d (du/u - da/a + de/(1 - e))                                                      (1)
//! ```
//!
//! and with the ratios `r = e^(j+1)`, which move with `e`,
//!
//! ```text
//! D^(j) = (D_k - r D_(k-1))/(1 - r) + dr/(1 - r) (S^(j) - S_(k-1)^(j-1))                 (2)
//! ```
//!
//! Without the last term the derivatives by `e` would keep terms `n e^n` and the order two.

use crate::mechanics::chain::{StateChain, COLUMNS};
use crate::zeno::chain::Bounce;

/// The derivatives of a chain of impacts by one column.
#[derive(Clone, Debug, Default)]
pub(super) struct ChainRates {
    /// Rows (1), each as long as those of the chain.
    rows: Vec<f64>,
}

/// What one impact adds to a chain: derivatives along the event.
pub(super) struct Rate<'a> {
    pub(super) dt: f64,
    pub(super) du: f64,
    pub(super) da: f64,
    pub(super) de: f64,
    /// `f` and `df`.
    pub(super) flow: [&'a [f64]; 2],
    /// `dz`.
    pub(super) dz: &'a [f64],
}

/// The derivatives of a Zeno point by one column.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct ZenoRate {
    pub(super) dt: f64,
    pub(super) dz: Vec<f64>,
    /// The largest estimated error in the given scales.
    pub(super) size: f64,
}

impl ChainRates {
    /// Notes the last impact of a chain.
    pub(super) fn note(&mut self, chain: &StateChain, bounce: Bounce, rate: &Rate<'_>) {
        if self.rows.len() != (chain.len() - 1) * chain.width {
            self.rows.clear();
        }
        if self.rows.is_empty() && chain.len() > 1 {
            return;
        }
        let left = chain.times.remaining(bounce);
        let Rate { dt, du, da, de, flow: [f, df], dz } = *rate;
        let later = left * (du / bounce.u - da / bounce.g + de / (1.0 - chain.e));
        self.rows.push(dt + later);
        let state = dz.iter().zip(f).zip(df);
        self.rows.extend(state.map(|((dz, f), df)| dz + later * f + left * df));
    }

    /// The derivatives of the Zeno point of the chain: the entries of the table whose estimated
    /// error is the smallest, relative to `scales[c]/size + rtol |D_c|`.
    pub(super) fn zeno(
        &self,
        chain: &StateChain,
        de: f64,
        scales: impl Fn(usize, f64) -> f64,
    ) -> Option<ZenoRate> {
        let width = chain.width;
        if chain.len() == 0 || self.rows.len() != chain.rows.len() {
            return None;
        }
        let (last, stride) = (chain.len() - 1, chain.times.stride());
        let count = (last / stride + 1).min(COLUMNS + 2);
        // the newest row first
        let pick = |of: &[f64]| -> Vec<Vec<f64>> {
            (0..count).map(|k| of[(last - k * stride) * width..][..width].to_vec()).collect()
        };
        let (mut values, mut rates) = (pick(&chain.rows), pick(&self.rows));
        let mut best = rate_of(&rates[0], f64::INFINITY);
        let ratio = chain.e.powf(stride as f64);
        let mut power = ratio;
        for j in 1..=COLUMNS {
            power *= ratio;
            if rates.len() < 3 {
                break;
            }
            let across = rates[0].clone();
            let moves = (stride * (j + 1)) as f64 * power / chain.e * de;
            next_column(&mut values, &mut rates, power, moves);
            let judged = judge(&rates, &across, power * ratio, &scales);
            if judged < best.size {
                best = rate_of(&rates[0], judged);
            }
        }
        Some(best)
    }
}

fn rate_of(row: &[f64], size: f64) -> ZenoRate {
    ZenoRate { dt: row[0], dz: row[1..].to_vec(), size }
}

/// Equations (2), and those of the values.
fn next_column(values: &mut Vec<Vec<f64>>, rates: &mut Vec<Vec<f64>>, r: f64, moves: f64) {
    for k in 0..rates.len() - 1 {
        for c in 0..rates[k].len() {
            let (now, before) = (values[k][c], values[k + 1][c]);
            let value = (now - r * before) / (1.0 - r);
            let own = moves / (1.0 - r) * (value - before);
            values[k][c] = value;
            rates[k][c] = (rates[k][c] - r * rates[k + 1][c]) / (1.0 - r) + own;
        }
    }
    values.pop();
    rates.pop();
}

/// The larger of two differences of the newest row: to the column before and to the row before.
fn judge(
    rates: &[Vec<f64>],
    across: &[f64],
    power: f64,
    scales: impl Fn(usize, f64) -> f64,
) -> f64 {
    let mut worst = 0.0_f64;
    for (c, rate) in rates[0].iter().enumerate() {
        let down = (rate - rates[1][c]).abs() / (1.0 - power);
        let error = (rate - across[c]).abs().max(down) / scales(c, *rate);
        worst = if error > worst || error.is_nan() { error } else { worst };
    }
    worst
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mechanics::chain::Key;
    use crate::record::gap_set::GapSet;

    /// A chain whose times are `7 - q - 0.3 q^2 + 0.1 q^3`, `q = e^i`, and whose state is `2 + p q -
    /// q^2`, with the derivatives by `p` and by `e`. Its flow is zero: what is left of the state
    /// after a row of the chain is of the order `q`, so the state has one order less.
    fn expansion(e: f64, n: i32) -> (StateChain, [ChainRates; 2]) {
        let (mut chain, mut rates) = (StateChain::new(1), <[ChainRates; 2]>::default());
        let key = Key { hit: GapSet::of(0), closed: GapSet::EMPTY };
        for i in 0..n {
            let (q, by_e) = (e.powi(i), f64::from(i) * e.powi(i - 1));
            let t = 7.0 - q - 0.3 * q * q + 0.1 * q.powi(3);
            let t_by_e = -(1.0 + 0.6 * q - 0.3 * q * q) * by_e;
            let (u, u_by_e) = (q * (1.0 + 0.2 * q), (1.0 + 0.4 * q) * by_e);
            let pull = 2.0 / (1.0 - e);
            let g = pull * (1.0 + 0.1 * q);
            let g_by_e = pull / (1.0 - e) * (1.0 + 0.1 * q) + pull * 0.1 * by_e;
            let bounce = Bounce { t, u, g };
            let z = 2.0 + 1.3 * q * q - q.powi(3);
            let z_by_e = (2.6 * q - 3.0 * q * q) * by_e;
            assert!(chain.note(key, e, bounce, &[z], &[0.0]).is_ok());
            let flow = [&[0.0][..], &[0.0][..]];
            let by_p = Rate { dt: 0.0, du: 0.0, da: 0.0, de: 0.0, flow, dz: &[q * q] };
            let by_e = Rate { dt: t_by_e, du: u_by_e, da: g_by_e, de: 1.0, flow, dz: &[z_by_e] };
            rates[0].note(&chain, bounce, &by_p);
            rates[1].note(&chain, bounce, &by_e);
        }
        (chain, rates)
    }

    fn found(e: f64, n: i32, column: usize, de: f64) -> ZenoRate {
        let (chain, rates) = expansion(e, n);
        rates[column].zeno(&chain, de, |_, _| 1.0).unwrap()
    }

    #[test]
    fn columns_remove_the_powers_from_times_and_states() {
        for e in [0.2, 0.5, 0.8] {
            for column in 0..2 {
                let zeno = found(e, 14, column, column as f64);
                let worst = zeno.dt.abs().max(zeno.dz[0].abs());
                assert!(worst < 1e-7 && worst <= zeno.size.max(1e-13), "{e} {column}: {zeno:?}");
            }
        }
    }

    #[test]
    fn ratios_that_do_not_move_leave_the_derivatives_by_e_at_second_order() {
        let (moving, naive) = (found(0.5, 10, 1, 1.0), found(0.5, 10, 1, 0.0));
        assert!(naive.dt.abs() > 100.0 * moving.dt.abs(), "{naive:?} {moving:?}");
        assert!(naive.dz[0].abs() > 100.0 * moving.dz[0].abs(), "{naive:?} {moving:?}");
    }

    #[test]
    fn an_impact_that_was_missed_gives_no_rates() {
        let (chain, mut rates) = expansion(0.5, 6);
        rates[0].rows.pop();
        assert_eq!(rates[0].zeno(&chain, 0.0, |_, _| 1.0), None);
    }
}
