//! The record of a closed loop.

use crate::drive::closed_loop::controller::{Controller, SIGNS};
use crate::drive::Updates;
pub use crate::drive::REFUSED;
use crate::record::status::Failure;
use crate::{DensePath, Events, LocatedEvent, SetupError, Status};
use std::collections::TryReserveError;
use zivi_core::observer::{Estimate, ImpactObserver};
use zivi_core::{Lifted, Physical};

/// Columns of the record: `t, x, xdot, x_ref, xdot_ref, u`.
pub const LOOP_COLUMNS: usize = 6;

/// Columns of an observer's estimates.
pub const ESTIMATES: usize = 3;

/// Results of a closed loop: states at the samples, and the held controls.
#[derive(Clone, Debug)]
pub struct LoopRun<E> {
    /// `t, x, xdot, x_ref, xdot_ref, u` (NaN where a controller has none); the control of a row
    /// holds from its time on, the last row repeats it.
    pub columns: [Vec<f64>; LOOP_COLUMNS],
    /// The signs of the updates, in rows of the same meaning.
    pub signs: SignRecord,
    /// Estimates of the observer at the samples, `x, xdot, d`; empty without one.
    pub estimates: [Vec<f64>; ESTIMATES],
    /// At each sample, as bits: 1 clamped, 2 saturated, 4 rejected.
    pub ticks: Vec<u8>,
    /// Counts of the updates.
    pub updates: Updates,
    /// Events at the wall; a rest until the end has lasted at least a period.
    pub events: Events,
    /// The motion between the samples, if [`super::LoopOptions::dense`] asked for it.
    pub path: Option<LoopPath>,
    /// Occurrences of each user event. One that ends the run does so with the period in
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

    /// The estimate at the sample that was pushed last.
    pub(super) fn note(&mut self, observer: Option<&ImpactObserver>) {
        let Some(observer) = observer else { return };
        let Estimate { state, d } = observer.estimate();
        for (column, value) in self.estimates.iter_mut().zip([state.x, state.xdot, d]) {
            column.push(value);
        }
    }

    /// A sample: the states at `t` and the controls held from there on.
    ///
    /// # Errors
    /// There is no memory for its signs; the record is unchanged.
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

// The signs of many updates.

/// Bits of the signs that need no more than their code.
const ONE: u64 = 1.0_f64.to_bits();
const MINUS_ONE: u64 = (-1.0_f64).to_bits();

/// Codes of a sign of an update: one of these values, the last other value at its place, or a new
/// one.
const PLUS: u16 = 0;
const MINUS: u16 = 1;
const AGAIN: u16 = 2;
const OTHER: u16 = 3;

/// The signs of many updates, `ls, lv, lsr, lvr, les, lev` of each. Six numbers per update would be
/// half of the memory of a loop, and allocation costs as much as the update; most are 1, -1 or
/// unchanged.
///
/// ```
/// use zivi::drive::closed_loop::SignRecord;
/// let mut record = SignRecord::default();
/// record.push([1.0, -1.0, 1.0, 1.0, 0.25, f64::NAN])?;
/// let rows: Vec<_> = record.iter().collect();
/// assert_eq!(rows[0][..5], [1.0, -1.0, 1.0, 1.0, 0.25]);
/// assert!(rows[0][5].is_nan());
/// # Ok::<(), std::collections::TryReserveError>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct SignRecord {
    /// Of each update the codes of its signs, the first in the lowest bits.
    codes: Vec<u16>,
    /// All signs with the code [`OTHER`], in their order.
    others: Vec<f64>,
    /// The last of them at each place.
    last: [f64; SIGNS],
}

impl SignRecord {
    /// An empty record with room for the codes of a number of updates.
    pub(super) fn with_room(ticks: usize) -> Result<Self, TryReserveError> {
        let mut codes = Vec::new();
        codes.try_reserve_exact(ticks)?;
        Ok(Self { codes, ..Self::default() })
    }

    /// Another update.
    ///
    /// # Errors
    /// There is no memory for it; the record is unchanged.
    #[inline]
    pub fn push(&mut self, signs: [f64; SIGNS]) -> Result<(), TryReserveError> {
        self.codes.try_reserve(1)?;
        self.others.try_reserve(SIGNS)?;
        let mut codes = 0;
        for (k, (last, sign)) in self.last.iter_mut().zip(signs).enumerate() {
            let code = match sign.to_bits() {
                ONE => PLUS,
                MINUS_ONE => MINUS,
                bits if bits == last.to_bits() => AGAIN,
                _ => {
                    self.others.push(sign);
                    *last = sign;
                    OTHER
                }
            };
            codes |= code << (2 * k);
        }
        self.codes.push(codes);
        Ok(())
    }

    /// Number of updates.
    #[must_use]
    pub fn len(&self) -> usize {
        self.codes.len()
    }

    /// Whether there is no update.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.codes.is_empty()
    }

    /// The signs of each update, to the last bit.
    pub fn iter(&self) -> impl Iterator<Item = [f64; SIGNS]> + '_ {
        let (mut others, mut last) = (self.others.iter(), [0.0; SIGNS]);
        self.codes.iter().map(move |codes| {
            let mut codes = *codes;
            last.each_mut().map(|last| {
                let code = codes & OTHER;
                codes >>= 2;
                match code {
                    PLUS => return 1.0,
                    MINUS => return -1.0,
                    OTHER => *last = *others.next().unwrap_or(last),
                    _ => {}
                }
                *last
            })
        })
    }
}

// The motion of the plant between samples, if stored.

/// The motion of the plant between its samples.
#[derive(Clone, Debug, PartialEq)]
pub enum LoopPath {
    /// Exact, from each sample under this force and the control that is held.
    Ballistic(f64),
    /// That of the switched method.
    Switched(DensePath),
    /// `s` and `v` at the samples, linear between them.
    Lifted(Vec<Lifted>),
}

#[cfg(test)]
#[allow(clippy::expect_used)]
mod sign_record_tests {
    use super::*;

    #[test]
    fn signs_are_given_back_to_the_last_bit() {
        let values =
            [1.0, -1.0, f64::NAN, 0.0, -0.0, 0.3, -f64::NAN, 1.0 - 1e-16, f64::MIN_POSITIVE];
        let mut given = Vec::new();
        // each value at each place, beside all others in turns
        for k in 0..values.len().pow(2) {
            given
                .push(std::array::from_fn(|j| values[(k + j * (k / values.len())) % values.len()]));
        }
        let mut record = SignRecord::with_room(given.len()).expect("room");
        assert!(record.is_empty());
        for signs in &given {
            record.push(*signs).expect("room");
        }
        assert!(record.len() == given.len() && !record.is_empty());
        let bits = |signs: [f64; SIGNS]| signs.map(f64::to_bits);
        let found: Vec<_> = record.iter().map(bits).collect();
        assert_eq!(found, given.into_iter().map(bits).collect::<Vec<_>>());
    }

    #[test]
    fn only_what_is_new_takes_more_than_its_code() {
        let mut record = SignRecord::with_room(1000).expect("room");
        for n in 0..1000 {
            let sign = if n % 3 == 0 { -1.0 } else { 1.0 };
            record.push([sign, 0.25, -sign, f64::NAN, sign, 0.0]).expect("room");
        }
        // the last of each place is zero at first
        assert!(record.others.len() == 2 && record.codes.capacity() == 1000);
    }
}
