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

use crate::numeric::richardson::{self, Powers};
use crate::record::gap_set::GapSet;
use crate::zeno::chain::{Bounce, Chain};

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
        let (last, width) = (self.len().max(1) - 1, self.width);
        let row = |k: usize| &self.rows[(last - k * stride) * width..][..width];
        let start = self.times.bounces().first()?.t;
        let rows = (0..count).flat_map(row).copied().collect();
        Landing::extrapolated(rows, start, self.times.powers(stride), scales)
    }
}

impl Landing {
    /// The newest entry with the smallest estimated error, in the given scales, of the table of
    /// these rows: times since `start` followed by states, the newest first.
    pub(super) fn extrapolated(
        mut rows: Vec<f64>,
        start: f64,
        powers: Powers,
        scales: &[f64],
    ) -> Option<Self> {
        let mut best: Option<Self> = None;
        let mut across = vec![0.0; scales.len()];
        richardson::columns(&mut rows, &mut across, powers, |entry| {
            let rounding = |c: usize| f64::EPSILON * entry.newest[c].abs();
            let error: Vec<f64> =
                (0..scales.len()).map(|c| entry.error(c).max(rounding(c))).collect();
            let size = error.iter().zip(scales).fold(0.0_f64, |a, (b, scale)| a.max(b / scale));
            if best.as_ref().is_none_or(|best| size < best.size) {
                let (t, z) = (start + entry.newest[0], entry.newest[1..].to_vec());
                best = Some(Self { t, z, error, size });
            }
        });
        best
    }
}
