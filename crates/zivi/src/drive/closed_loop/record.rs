//! The record of a closed loop.

use zivi_core::observer::{Estimate, ImpactObserver};
use zivi_core::Physical;

use super::controller::Controller;
use super::path::LoopPath;
use super::sign_record::SignRecord;
use crate::drive::Updates;
pub use crate::drive::REFUSED;
use crate::record::failure::Failure;
use crate::{Events, LocatedEvent, SetupError, Status};

/// Columns of the record: `t, x, xdot, x_ref, xdot_ref, u`.
pub const LOOP_COLUMNS: usize = 6;

/// Columns of an observer's estimates.
pub const ESTIMATES: usize = 3;

/// A closed loop as far as it went: states at the samples, and what is held from there on.
#[derive(Clone, Debug)]
pub struct LoopRun<E> {
    /// `t, x, xdot, x_ref, xdot_ref, u` (NaN where a controller has none); the control of a row
    /// holds from its time on, the last row repeats it.
    pub columns: [Vec<f64>; LOOP_COLUMNS],
    /// The signs of the ticks, in rows of the same meaning.
    pub signs: SignRecord,
    /// What the observer thought at the samples, `x, xdot, d`; empty without one.
    pub estimates: [Vec<f64>; ESTIMATES],
    /// At each sample, as bits: 1 clamped, 2 saturated, 4 refused.
    pub ticks: Vec<u8>,
    /// What happened at them, in numbers.
    pub updates: Updates,
    /// What happened at the wall; a rest until the end has lasted a whole period.
    pub events: Events,
    /// The motion between the samples, if [`super::LoopOptions::dense`] asked for it.
    pub path: Option<LoopPath>,
    /// What happened of each event of the user. One that ends the run does so with the period in
    /// which it happens.
    pub hits: Vec<Vec<LocatedEvent>>,
    /// How the run ended.
    pub status: Status,
    /// Evaluations of the true force.
    pub nfev: u64,
    /// The error that a force, the controller or the monitor raised.
    pub raised: Option<E>,
}

/// Samples up to which a record is made: 16 GB. An operating system may promise more than it has.
const MOST_SAMPLES: usize = 160_000_000;

/// Fills the columns.
pub(super) struct LoopRecord {
    pub(super) columns: [Vec<f64>; LOOP_COLUMNS],
    pub(super) signs: SignRecord,
    pub(super) estimates: [Vec<f64>; ESTIMATES],
    pub(super) ticks: Vec<u8>,
}

impl LoopRecord {
    pub(super) fn with_room(rows: usize, observed: bool) -> Result<Self, SetupError> {
        if rows > MOST_SAMPLES {
            return Err(SetupError::Memory(rows));
        }
        let refused = |_| SetupError::Memory(rows);
        let mut columns: [Vec<f64>; LOOP_COLUMNS] = Default::default();
        for column in &mut columns {
            column.try_reserve_exact(rows).map_err(refused)?;
        }
        let mut estimates: [Vec<f64>; ESTIMATES] = Default::default();
        if observed {
            for column in &mut estimates {
                column.try_reserve_exact(rows).map_err(refused)?;
            }
        }
        let signs = SignRecord::with_room(rows).map_err(refused)?;
        let mut ticks = Vec::new();
        ticks.try_reserve_exact(rows).map_err(refused)?;
        Ok(Self { columns, signs, estimates, ticks })
    }

    /// What is thought of the mass at the sample that was pushed last.
    pub(super) fn note(&mut self, observer: Option<&ImpactObserver>) {
        let Some(observer) = observer else { return };
        let Estimate { state, d } = observer.estimate();
        for (column, value) in self.estimates.iter_mut().zip([state.x, state.xdot, d]) {
            column.push(value);
        }
    }

    /// A sample: the states at `t` and what is held from there on.
    ///
    /// # Errors
    /// There is no memory for its signs; the record is as it was.
    pub(super) fn push<E>(
        &mut self,
        (t, state, reference): (f64, Physical, Option<Physical>),
        u: f64,
        controller: &(impl Controller<E> + ?Sized),
        tick: u8,
    ) -> Result<(), Failure<E>> {
        self.signs.push(controller.signs())?;
        let none = Physical { x: f64::NAN, xdot: f64::NAN };
        let reference = reference.unwrap_or(none);
        let row = [t, state.x, state.xdot, reference.x, reference.xdot, u];
        for (column, value) in self.columns.iter_mut().zip(&row) {
            column.push(*value);
        }
        self.ticks.push(tick);
        Ok(())
    }
}
