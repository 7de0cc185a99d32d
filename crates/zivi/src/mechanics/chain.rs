//! The Zeno point of a gap over closed contacts, by extrapolation of times and states together.
//!
//! With the gaps `A` closed and gap `i` bouncing, the map from one impact to the next is the
//! identity where the speed `u` after it is zero, and multiplies `u` by `e` across that manifold.
//! So the times and the state `z = (q, q', other gaps)` projected on `A + i` have expansions in
//! `e^n, e^(2n), ...`, and with the equations of motion `z' = f(z)` in contact
//!
//! ```text
//! S_k^(0) = (t_k + d_k, z_k + d_k f(z_k)),      d_k = 2 u_k/(a_k (1 - e))              (1)
//! S_k^(j) = (S_k^(j-1) - e^(j+1) S_(k-1)^(j-1))/(1 - e^(j+1))                          (2)
//! ```
//!
//! has an error of order `u^(j+2)`; `a` is the pull on the gap while `A` is closed.

use std::collections::TryReserveError;

use crate::record::gap_set::GapSet;
use crate::switched::chain::{Bounce, Chain};

/// Columns of the table after the first.
pub(super) const COLUMNS: usize = 5;

/// What bounces on what.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Key {
    /// The gaps that are hit together.
    pub(super) hit: GapSet,
    /// The gaps that stay closed.
    pub(super) closed: GapSet,
}

/// Impacts at ever smaller speeds, each with the row (1) of the table.
#[derive(Clone, Debug)]
pub(super) struct StateChain {
    pub(super) key: Key,
    pub(super) times: Chain,
    pub(super) e: f64,
    /// Length of a row: the time since the first impact, then the state.
    pub(super) width: usize,
    pub(super) rows: Vec<f64>,
}

/// The extrapolated end of a chain.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Landing {
    pub(super) t: f64,
    pub(super) z: Vec<f64>,
    /// Estimated errors of the time and of `z`.
    pub(super) error: Vec<f64>,
    /// The largest of them in units of the tolerances.
    pub(super) size: f64,
}

impl StateChain {
    pub(super) fn new(width: usize) -> Self {
        let (key, e) = (Key::default(), 0.5);
        Self { key, times: Chain::new(e), e, width: width + 1, rows: Vec::new() }
    }

    pub(super) fn clear(&mut self) {
        self.times.clear();
        self.rows.clear();
    }

    /// How many impacts there are.
    pub(super) fn len(&self) -> usize {
        self.times.bounces().len()
    }

    /// Appends an impact whose projected state moves with the rates `f`; a chain that it does not
    /// continue is given up first.
    ///
    /// # Errors
    /// Where there is no memory for it.
    pub(super) fn note(
        &mut self,
        key: Key,
        e: f64,
        bounce: Bounce,
        z: &[f64],
        f: &[f64],
    ) -> Result<(), TryReserveError> {
        if key != self.key || e != self.e {
            self.times = Chain::new(e);
            (self.key, self.e) = (key, e);
        }
        self.times.note(bounce);
        if self.times.bounces().len() == 1 {
            self.rows.clear();
        }
        let (first, left) = (self.times.bounces()[0].t, self.times.remaining(bounce));
        self.rows.try_reserve(self.width)?;
        self.rows.push(bounce.t - first + left);
        self.rows.extend(z.iter().zip(f).map(|(z, f)| z + left * f));
        Ok(())
    }

    /// The last row of column zero.
    pub(super) fn leading(&self) -> Landing {
        let row = &self.rows[self.rows.len() - self.width..];
        let t = self.times.bounces()[0].t + row[0];
        Landing { t, z: row[1..].to_vec(), error: vec![0.0; self.width], size: 0.0 }
    }

    /// The entry of the last row with the smallest estimated error in the given scales (of the
    /// time, then of the state), from three impacts on.
    pub(super) fn landing(&self, scales: &[f64]) -> Option<Landing> {
        let stride = self.times.stride();
        let count = ((self.len().max(1) - 1) / stride + 1).min(COLUMNS + 2);
        if count < 3 {
            return None;
        }
        let ratio = self.e.powf(stride as f64);
        let mut column = self.strided(stride, count);
        let mut best: Option<Landing> = None;
        let mut power = ratio;
        for j in 1..count {
            power *= ratio;
            let before: Vec<f64> = column[column.len() - self.width..].to_vec();
            column = self.next_column(&column, power);
            if column.len() < 2 * self.width {
                break;
            }
            let landing = self.judge(&column, &before, power * ratio, scales);
            if j <= COLUMNS && best.as_ref().is_none_or(|best| landing.size < best.size) {
                best = Some(landing);
            }
        }
        best
    }

    /// Rows of column zero that lie `stride` impacts apart, the last of them that of the last.
    fn strided(&self, stride: usize, count: usize) -> Vec<f64> {
        let (last, width) = (self.len() - 1, self.width);
        let rows = (0..count).rev().map(|k| &self.rows[(last - k * stride) * width..][..width]);
        rows.flatten().copied().collect()
    }

    /// Equation (2).
    fn next_column(&self, column: &[f64], power: f64) -> Vec<f64> {
        let ahead = column[self.width..].iter().zip(column);
        ahead.map(|(now, before)| (now - power * before) / (1.0 - power)).collect()
    }

    /// The last entry of a column, with the larger of two differences as its error: to the column
    /// before and to the row before.
    fn judge(&self, column: &[f64], across: &[f64], power: f64, scales: &[f64]) -> Landing {
        let width = self.width;
        let (last, above) = (&column[column.len() - width..], &column[column.len() - 2 * width..]);
        let mut size = 0.0_f64;
        let error: Vec<f64> = (0..width)
            .map(|c| {
                let down = (last[c] - above[c]).abs() / (1.0 - power);
                let rounding = f64::EPSILON * last[c].abs();
                let error = (last[c] - across[c]).abs().max(down).max(rounding);
                size = size.max(error / scales[c]);
                error
            })
            .collect();
        let t = self.times.bounces()[0].t + last[0];
        Landing { t, z: last[1..].to_vec(), error, size }
    }
}
