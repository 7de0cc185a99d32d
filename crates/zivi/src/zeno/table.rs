//! The extrapolation table of an accumulation, and its stored form.
//!
//! The table of extrapolation of the end of an accumulation, of times and states together.
//!
//! ```text
//! S_i^(j) = (S_i^(j-1) - e^(j+1) S_(i-1)^(j-1)) / (1 - e^(j+1))                         (1)
//! ```
//!
//! removes one power after the other from rows whose errors begin with `e^2`: `S^(j)` has an error
//! of order `u^(j+2)`. The columns are those of [`richardson`]; this module selects an entry and
//! estimates its error.

use crate::numeric::coordinates::Coordinates;
use crate::numeric::tableau;
use crate::numeric::tableau::{Powers, TableauEntry};
use crate::record::recorder::is_sigma;
use crate::record::stored::Reader;
use crate::zeno::tail::Tail;
use crate::zeno::tail::TERMS;

/// Rows of the table.
pub(super) const ROWS: usize = 7;

/// From this growth of rounding in the first column on, rows that agree are not extrapolated: with rows
/// at distances of a tenth of the speed it is 10.
const COARSE: f64 = 24.0;
/// Rows agree within this multiple of their rounding: over 10 000 impacts the rounding of the
/// speeds accumulates to 30.
const AGREE: f64 = 64.0;

/// The extrapolated end of an accumulation.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ExtrapolatedEnd<Z> {
    pub(crate) t: f64,
    /// The time since the start, then the state.
    z: Z,
    /// Estimates of their errors.
    error: Z,
    /// The largest of them in the scales.
    pub(crate) size: f64,
}

impl<Z: Coordinates> ExtrapolatedEnd<Z> {
    /// The time since `start`, then the state, with an error of such a size, none by component.
    pub(crate) fn new(start: f64, row: &[f64], size: f64) -> Self {
        let mut z = Z::zeros(row.len());
        z.as_mut_slice().copy_from_slice(row);
        Self { t: start + row[0], z, error: Z::zeros(row.len()), size }
    }

    /// The same with estimates of the errors of the state.
    pub(crate) fn with_errors(mut self, errors: impl Iterator<Item = f64>) -> Self {
        self.error.as_mut_slice()[1..].iter_mut().zip(errors).for_each(|(to, error)| *to = error);
        self
    }

    /// The state.
    pub(crate) fn state(&self) -> &[f64] {
        &self.z.as_slice()[1..]
    }

    /// Estimates of the errors of the state.
    pub(crate) fn errors(&self) -> &[f64] {
        &self.error.as_slice()[1..]
    }
}

/// The table, and memory to work in.
#[derive(Clone, Debug)]
pub(crate) struct ZenoTable<Z> {
    /// The newest first.
    rows: Vec<f64>,
    /// Number of used columns after the first.
    columns: usize,
    across: Z,
    /// Rounding, and an upper bound.
    noise: Z,
    error: Z,
}

impl<Z: Coordinates> ZenoTable<Z> {
    /// For rows of a length, with a number of columns after the first.
    pub(crate) fn new(width: usize, columns: usize) -> Self {
        let [across, noise, error] = [(); 3].map(|()| Z::zeros(width));
        Self { rows: Vec::new(), columns, across, noise, error }
    }

    /// How many columns there are after the first.
    pub(super) fn columns(&self) -> usize {
        self.columns
    }

    pub(super) fn set_columns(&mut self, columns: usize) {
        self.columns = columns;
    }

    /// Length of a row.
    #[inline]
    pub(super) fn width(&self) -> usize {
        self.across.as_slice().len()
    }

    /// Without rows.
    pub(super) fn begin(&mut self) {
        self.rows.clear();
    }

    /// Appends a row that is older than those before it: the time since a start, then the state.
    pub(crate) fn push(&mut self, row: &[f64]) {
        self.rows.extend_from_slice(row);
    }

    /// Whether the time alone, the first number of the rows, may be known to its scale: otherwise
    /// no entry of [`Self::landing`] has a size of one or less.
    pub(crate) fn may_land<'r>(
        rows: impl Iterator<Item = &'r f64>,
        (now, columns): (f64, usize),
        powers: Powers,
        scale: f64,
    ) -> bool {
        let (mut count, mut times) = (0, [0.0; ROWS]);
        for (time, row) in times.iter_mut().zip(rows) {
            *time = *row;
            count += 1;
        }
        let mut noise = [(f64::EPSILON * times[0].abs()).max(f64::EPSILON * now.abs())];
        let agree = count > 2 && is_coarse(powers.first) && agrees(times[..count].iter(), noise[0]);
        let (mut across, mut may) = ([0.0], agree && AGREE * noise[0] <= scale);
        tableau::columns(&mut times[..count], &mut across, powers, |entry| {
            let size = judge(entry, &mut noise, &mut [0.0], &[scale]);
            may |= entry.j <= columns && (size <= 1.0 || size.is_nan());
        });
        may
    }

    /// The newest entry with the smallest estimated error in the given scales, from three rows on,
    /// the newest at the time `now`.
    ///
    /// The estimate is at least what rounding does: each column magnifies that of the one before by
    /// `(1 + p)/(1 - p)`, with the power `p` that it removes. Where that is large, a component whose
    /// rows differ only by rounding is the oldest of them, as under a constant acceleration. If
    /// all are, rounding is all that is in doubt. A slow drift that hides in it adds as much again for
    /// each time that the rows span up to the end: with a scale of `r` times that time at most `r`
    /// times the whole.
    #[inline]
    pub(crate) fn landing(
        &mut self,
        start: f64,
        now: f64,
        powers: Powers,
        scales: &[f64],
    ) -> Option<ExtrapolatedEnd<Z>> {
        let Self { rows, columns, across, noise, error } = self;
        let (noise, error) = (noise.as_mut_slice(), error.as_mut_slice());
        for (noise, entry) in noise.iter_mut().zip(rows.iter()) {
            *noise = f64::EPSILON * entry.abs();
        }
        noise[0] = noise[0].max(f64::EPSILON * now.abs());
        let settled = is_coarse(powers.first).then(|| settled::<Z>(rows, noise, scales));
        let mut best: Option<ExtrapolatedEnd<Z>> = None;
        tableau::columns(rows, across.as_mut_slice(), powers, |entry| {
            let size = judge(entry, noise, error, scales);
            if entry.j <= *columns && best.as_ref().is_none_or(|best| size < best.size) {
                let best =
                    best.get_or_insert_with(|| ExtrapolatedEnd::new(start, entry.newest, size));
                (best.t, best.size) = (start + entry.newest[0], size);
                best.z.as_mut_slice().copy_from_slice(entry.newest);
                best.error.as_mut_slice().copy_from_slice(error);
            }
        });
        if let (Some(best), Some((settled, size))) = (&mut best, settled) {
            for (z, row) in best.z.as_mut_slice().iter_mut().zip(settled.as_slice()) {
                *z = if row.is_nan() { *z } else { *row };
            }
            best.t = start + best.z.as_slice()[0];
            best.size = best.size.min(size);
        }
        best
    }
}

/// The oldest row, which has least of the rounding of the impacts, and NaN for components in which the
/// rows differ by more than rounding; the largest rounding in the scales, infinite if one is NaN.
fn settled<Z: Coordinates>(rows: &[f64], noise: &[f64], scales: &[f64]) -> (Z, f64) {
    let (mut settled, mut size) = (Z::zeros(noise.len()), 0.0_f64);
    for (c, value) in settled.as_mut_slice().iter_mut().enumerate() {
        *value = f64::NAN;
        if agrees(rows.iter().skip(c).step_by(noise.len()), noise[c]) {
            *value = rows[rows.len() - noise.len() + c];
            size = size.max(AGREE * noise[c] / scales.get(c).copied().unwrap_or(0.0));
        } else {
            size = f64::INFINITY;
        }
    }
    (settled, size)
}

/// Whether the rows of a component differ by rounding alone.
fn agrees<'r>(mut rows: impl Iterator<Item = &'r f64>, noise: f64) -> bool {
    let Some(newest) = rows.next() else { return false };
    rows.all(|row| (row - newest).abs() <= AGREE * noise)
}

/// Whether a first column that removes this power magnifies rounding too much.
#[inline]
pub(super) fn is_coarse(power: f64) -> bool {
    growth(power) > COARSE
}

/// By how much a column that removes a power magnifies rounding.
#[inline]
fn growth(power: f64) -> f64 {
    (1.0 + power) / (1.0 - power)
}

/// The estimated errors of an entry; the largest in the scales, NaN if one is.
#[inline]
fn judge(entry: &TableauEntry<'_>, noise: &mut [f64], error: &mut [f64], scales: &[f64]) -> f64 {
    let growth = growth(entry.power);
    let mut worst = 0.0_f64;
    for (c, scale) in scales.iter().enumerate() {
        noise[c] *= growth;
        error[c] = entry.error(c).max(noise[c]);
        let size = error[c] / scale;
        worst = if size > worst || size.is_nan() { size } else { worst };
    }
    worst
}

// Tails as plain numbers, within those of a motion ([`crate::record::stored`]).
//
// ```text
// tail  [ e, start, zeno, until, sigma,  C,  D,  A at the starts of flights,  A at their ends ]
// ```

/// Numbers that a tail consists of.
pub(crate) const TAIL_NUMBERS: usize = 5 + 4 * TERMS;

impl Tail {
    /// All that it consists of.
    pub(crate) fn to_numbers(&self) -> Vec<f64> {
        let Self { e, start, zeno, until, sigma, c, d, bends } = self;
        let head = [*e, *start, *zeno, *until, *sigma];
        head.iter().chain(c).chain(d).chain(bends.iter().flatten()).copied().collect()
    }

    /// Inverse of [`Tail::to_numbers`]; `None` for numbers that are none of a tail.
    pub(crate) fn read(from: &mut Reader<'_>) -> Option<Self> {
        /// The first format with equation (2), and how many terms (1) had before.
        const BENT: (f64, usize) = (4.0, 4);
        if from.format() >= BENT.0 {
            return Self::from_numbers(from.take(TAIL_NUMBERS)?);
        }
        let mut numbers = [0.0; TAIL_NUMBERS];
        for (at, length) in [(0, 5), (5, BENT.1), (5 + TERMS, BENT.1)] {
            numbers[at..][..length].copy_from_slice(from.take(length)?);
        }
        Self::from_numbers(&numbers)
    }

    fn from_numbers(numbers: &[f64]) -> Option<Self> {
        let (head, series) = numbers.split_at_checked(5)?;
        let &[e, start, zeno, until, sigma] = head else { return None };
        let mut all = [[0.0; TERMS]; 4];
        for (one, numbers) in all.iter_mut().zip(series.chunks(TERMS)) {
            *one = numbers.try_into().ok()?;
        }
        let [c, d, bends @ ..] = all;
        let finite = numbers.iter().all(|number| number.is_finite());
        let ordered = start <= until && until <= zeno && 0.0 < e && e < 1.0 && is_sigma(sigma);
        let tail = Self { e, start, zeno, until, sigma, c, d, bends };
        (finite && ordered).then_some(tail)
    }
}

#[cfg(test)]
mod table_tests {
    use super::*;

    const POWERS: Powers = Powers { ratio: 0.5, first: 0.25 };

    /// The limit of the time and a state, `t = 3 - q^2` and `z = 1 + a q^2`, `q = 0.5^k`, with a
    /// number of rows.
    fn landing(rows: i32, a: f64, scales: &[f64]) -> Option<ExtrapolatedEnd<Vec<f64>>> {
        let mut table = ZenoTable::new(2, 5);
        for k in (0..rows).rev() {
            let q2 = 0.25f64.powi(k);
            table.push(&[3.0 - q2, 1.0 + a * q2]);
        }
        table.landing(1010.0, 1012.9, POWERS, scales)
    }

    #[test]
    fn times_count_from_the_start_and_states_do_not() {
        let found = landing(4, 0.7, &[1.0, 1.0]).unwrap();
        assert!((found.t - 1013.0).abs() < 1e-12 && (found.state()[0] - 1.0).abs() < 1e-14);
        assert!(landing(2, 0.7, &[1.0, 1.0]).is_none());
    }

    #[test]
    fn the_size_is_that_of_the_worst_component_in_its_scale() {
        // nothing but rounding is left, of 1012.9 and of about 1
        let found = landing(4, 0.7, &[1.0, 1e-6]).unwrap();
        assert_eq!(found.size, found.errors()[0] / 1e-6);
        let time = landing(4, 0.7, &[1e-6, 1.0]).unwrap();
        let noise = 1012.9 * f64::EPSILON * (1.25 / 0.75) * (1.125 / 0.875); // of two columns
        assert!((time.size * 1e-6 / noise - 1.0).abs() < 1e-12, "{:e}", time.size);
    }

    #[test]
    fn a_state_that_is_no_number_has_no_size() {
        assert!(landing(5, f64::NAN, &[1.0, 1.0]).unwrap().size.is_nan());
    }

    #[test]
    fn where_all_rows_differ_by_rounding_alone_it_is_all_that_is_in_doubt() {
        let found = |off: f64, ratio: f64| {
            let mut table = ZenoTable::<Vec<f64>>::new(2, 5);
            let times = [3.0, 3.0 + 4.0 * f64::EPSILON, 3.0];
            times.iter().for_each(|&time| table.push(&[time, 1.0]));
            table.push(&[3.0 + off, 1.0]);
            let powers = Powers { ratio, first: ratio * ratio };
            let rows = [3.0, times[1], 3.0, 3.0 + off];
            let scale = 1e-12;
            let may = ZenoTable::<Vec<f64>>::may_land(rows.iter(), (12.9, 5), powers, scale);
            let size = table.landing(10.0, 12.9, powers, &[scale, 1.0]).unwrap().size;
            assert_eq!(may, size <= 1.0);
            size
        };
        // of the time 12.9 s, in units of 1e-12 s
        let rounding = AGREE * 12.9 * f64::EPSILON / 1e-12;
        assert!((found(0.0, 0.999) / rounding - 1.0).abs() < 1e-12);
        assert!((found(0.9 * rounding * 1e-12, 0.999) / rounding - 1.0).abs() < 1e-12);
        assert!(found(1.1 * rounding * 1e-12, 0.999) > 10.0 * rounding);
        // extrapolated where rows are far apart, with less rounding
        assert!(found(0.0, 0.5) < 0.1 * rounding);
    }

    #[test]
    fn rows_that_differ_by_rounding_alone_are_not_extrapolated_where_that_magnifies_it() {
        // neighbours of e = 0.999: the time is 3 but for rounding, the state has a term of its own
        let ratio = 0.999_f64;
        let found = |noise: f64, ratio: f64| {
            let mut table = ZenoTable::<Vec<f64>>::new(2, 5);
            for k in 0..5 {
                let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
                table.push(&[3.0 + sign * noise, 1.0 + 0.1 * ratio.powi(-2 * k)]);
            }
            let powers = Powers { ratio, first: ratio * ratio };
            let found = table.landing(10.0, 12.9, powers, &[1.0, 1.0]).unwrap();
            (found.t - 13.0, found.state()[0] - 1.0)
        };
        let noise = 4.0 * 12.9 * f64::EPSILON;
        let (t, z) = found(noise, ratio);
        assert!(t.abs() <= 2.0 * noise && z.abs() < 1e-9, "{t:e} {z:e}");
        // what is more than rounding is extrapolated, and so is everything where rows are far apart
        for (t, noise) in [(found(1e-9, ratio).0, 1e-9), (found(noise, 0.9).0, noise)] {
            assert!(t.abs() > 8.0 * noise, "{t:e}");
        }
    }
}

#[cfg(test)]
mod stored_tests {
    use super::*;
    use crate::record::stored::{MotionError, Reader, StoredKind, Writer};

    /// A tail after the header of a motion, in a format.
    fn read(format: f64, numbers: &[f64]) -> Result<Tail, MotionError> {
        let mut out = Writer::new(StoredKind::Point);
        out.numbers(numbers);
        let mut all = out.finish().unwrap();
        all[0] = format;
        Reader::read(StoredKind::Point, &all, Tail::read)
    }

    #[test]
    fn tails_of_both_formats_are_read() {
        let head = [0.5, 1.0, 3.0, 2.5, -1.0];
        let before: Vec<f64> = head.into_iter().chain((0..8).map(f64::from)).collect();
        let old = read(3.0, &before).unwrap();
        assert_eq!(
            (old.c, old.d),
            ([0.0, 1.0, 2.0, 3.0, 0.0, 0.0], [4.0, 5.0, 6.0, 7.0, 0.0, 0.0])
        );
        assert_eq!((old.until, old.bends), (2.5, [[0.0; TERMS]; 2]));
        let now: Vec<f64> = head.into_iter().chain((0..24).map(f64::from)).collect();
        let tail = read(4.0, &now).unwrap();
        assert_eq!(tail.to_numbers(), now);
        assert_eq!(tail.bends[1][5], 23.0);
        assert_eq!(read(4.0, &before), Err(MotionError::Damaged));
        assert_eq!(read(3.0, &now), Err(MotionError::Damaged));
    }
}
