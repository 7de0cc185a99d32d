//! The samples of a run: at the ends of steps, or at given times.

use zivi_core::{sgn, transform, Branch, Restitution};

use std::collections::TryReserveError;

use super::picture::Row;
use crate::record::reserve::Reserve;
use crate::record::trajectory::{Columns, SetupError, QUANTITIES};
use crate::{PathPoint, Physical};

/// Samples at the ends of steps that a piece of the motion has, at most.
const OF_A_PIECE: usize = 4;

/// What is sampled.
pub(super) struct Samples<'a> {
    t_eval: Option<&'a [f64]>,
    /// The next of the wanted times.
    next: usize,
    rows: Vec<Row>,
}

impl<'a> Samples<'a> {
    pub(super) fn new(t_eval: Option<&'a [f64]>) -> Self {
        Self { t_eval, next: 0, rows: Vec::new() }
    }

    /// Makes room for what a piece of the motion adds, and for all of the given times.
    pub(super) fn make_room(&mut self, reserve: &mut Reserve) -> Result<(), TryReserveError> {
        let wanted = self.t_eval.map_or(OF_A_PIECE, |times| times.len() - self.next);
        reserve.room(&mut self.rows, wanted, QUANTITIES * size_of::<f64>())
    }

    /// The next of the given times.
    pub(super) fn next_wanted(&self) -> Option<f64> {
        self.t_eval.and_then(|times| times.get(self.next).copied())
    }

    /// Samples the motion at the wanted times before `t`.
    pub(super) fn along(&mut self, t: f64, motion: impl Fn(f64) -> PathPoint) {
        while let Some(at) = self.next_wanted().filter(|&next| next < t) {
            self.push(at, motion(at));
            self.next += 1;
        }
    }

    /// A sample at the end of a step, unless the times are given.
    pub(super) fn at_step(&mut self, t: f64, point: PathPoint) {
        if self.t_eval.is_none() {
            self.push(t, point);
        }
    }

    /// A sample where the run ends, if it is wanted and not there yet.
    pub(super) fn at_end(&mut self, t: f64, point: PathPoint) {
        let wanted = match self.t_eval {
            Some(times) => times.get(self.next) == Some(&t),
            None => self.rows.last().is_none_or(|row| row[0] < t),
        };
        if wanted {
            self.push(t, point);
        }
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

    fn push(&mut self, t: f64, point: PathPoint) {
        self.rows.push([t, point.x, point.xdot, point.sigma]);
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
