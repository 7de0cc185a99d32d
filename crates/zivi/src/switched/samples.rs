//! The samples of a run: at the ends of steps, or at given times.

use zivi_core::{sgn, transform, Branch, Restitution};

use std::collections::TryReserveError;

use super::plot_samples::Row;
use crate::record::columns::{Columns, QUANTITIES};
use crate::record::reserve::Reserve;
use crate::record::trajectory::SetupError;
use crate::{PathPoint, Physical};

/// The samples of a run.
#[derive(Debug, Default)]
pub(super) struct Samples {
    rows: Vec<Row>,
}

impl Samples {
    /// Makes room for so many more.
    pub(super) fn make_room(
        &mut self,
        count: usize,
        reserve: &mut Reserve,
    ) -> Result<(), TryReserveError> {
        reserve.room(&mut self.rows, count, QUANTITIES * size_of::<f64>())
    }

    /// The time of the last one.
    pub(super) fn last(&self) -> Option<f64> {
        self.rows.last().map(|row| row[0])
    }

    pub(super) fn push(&mut self, t: f64, point: PathPoint) {
        self.rows.push([t, point.x, point.xdot, point.sigma]);
    }

    /// More samples, both in the order of time; where there is one already it stays. Without the
    /// memory for them and for the arrays that are made of them nothing is added.
    pub(super) fn add(&mut self, more: &[Row], reserve: &mut Reserve) {
        let (mut old, mut new) = (self.rows.len(), more.len());
        if reserve.room(&mut self.rows, new, QUANTITIES * size_of::<f64>()).is_err() {
            return;
        }
        self.rows.resize(old + new, [0.0; 4]);
        // merged from the back, in place
        while new > 0 {
            let next = more[new - 1];
            if old > 0 && self.rows[old - 1][0] > next[0] {
                old -= 1;
                self.rows[old + new] = self.rows[old];
            } else {
                new -= 1;
                self.rows[old + new] = next;
            }
        }
        self.rows.dedup_by_key(|row| row[0]);
    }

    /// All samples, with `s`, `v` and the multipliers of the branch; `advise` learns where their
    /// memory is.
    pub(super) fn into_columns(
        self,
        restitution: Restitution,
        advise: impl FnOnce(*const f64, usize),
    ) -> Result<Columns, SetupError> {
        let rows = self.rows;
        let mut columns = Columns::with_room(rows.len().max(1), advise)
            .map_err(|_| SetupError::Memory(rows.len()))?;
        let mut to = columns.extend(rows.len());
        for (k, &[t, x, xdot, sigma]) in rows.iter().enumerate() {
            let branch = if sigma > 0.0 { Branch::Positive } else { Branch::Negative };
            let state = Physical { x, xdot };
            let z = transform::lift(state, branch, restitution);
            let lambda_s = if state.is_at_origin() { 0.0 } else { sigma };
            // no negative zeros
            let (s, v) = (z.s + 0.0, z.v + 0.0);
            let row = [t, x, xdot, s, v, lambda_s, sigma * sgn(xdot) + 0.0, f64::NAN];
            for (to, value) in to.iter_mut().zip(row) {
                to[k] = value;
            }
        }
        Ok(columns)
    }
}
