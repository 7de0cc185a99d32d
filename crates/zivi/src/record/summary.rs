//! What is kept of a run, and what its samples say when they are not.

use zivi_core::Physical;

use crate::record::columns::{Columns, Quantity};

/// Which samples of a run are kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Keep {
    /// All of them.
    #[default]
    All,
    /// The first and every so many after it; none for `0`.
    Every(usize),
}

/// The last sample, and the extremes of all.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Summary {
    /// Time of the last sample (s).
    pub t: f64,
    /// Last distance from the wall (m).
    pub x: f64,
    /// Last velocity (m/s).
    pub xdot: f64,
    /// Largest sampled distance from the wall (m).
    pub x_max: f64,
    /// Largest sampled speed (m/s).
    pub speed_max: f64,
}

impl Default for Summary {
    /// Of no sample.
    fn default() -> Self {
        Self { t: f64::NAN, x: f64::NAN, xdot: f64::NAN, x_max: 0.0, speed_max: 0.0 }
    }
}

impl Summary {
    /// Of all samples of a run.
    #[must_use]
    pub fn of(columns: &Columns) -> Self {
        let mut summary = Self::default();
        summary.absorb(columns);
        summary
    }

    /// Goes on with one sample.
    pub(crate) fn note(&mut self, t: f64, Physical { x, xdot }: Physical) {
        let (x_max, speed_max) = (self.x_max.max(x.abs()), self.speed_max.max(xdot.abs()));
        *self = Self { t, x, xdot, x_max, speed_max };
    }

    /// Goes on with further samples.
    pub(crate) fn absorb(&mut self, columns: &Columns) {
        let last = |quantity| columns.of(quantity).last().copied();
        let largest = |quantity, so_far: f64| {
            columns.of(quantity).iter().fold(so_far, |largest, value| largest.max(value.abs()))
        };
        if let (Some(t), Some(x), Some(xdot)) =
            (last(Quantity::T), last(Quantity::X), last(Quantity::Xdot))
        {
            (self.t, self.x, self.xdot) = (t, x, xdot);
        }
        self.x_max = largest(Quantity::X, self.x_max);
        self.speed_max = largest(Quantity::Xdot, self.speed_max);
    }
}
