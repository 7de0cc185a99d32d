//! Tables of time: piecewise polynomials between breakpoints, of one value or of several.
//!
//! ```text
//! u(t) = sum_k a_ik (t - t_i)^k      t_i <= t < t_(i+1)
//! ```
//!
//! Beyond its ends a table keeps its first and last values, or repeats itself. Its breakpoints are breaks
//! of whatever it drives, and a time counts to the interval that it lies in as a number of the
//! machine: the breakpoints of later periods are `t_i + n P` as they are rounded.

use super::force::WallMotion;
use crate::system::slopes::{DifferentiableForce, Place, Slopes};
use crate::{Dependence, Force, LinearForce};

/// Values as piecewise polynomials of time.
#[derive(Clone, Debug, PartialEq)]
pub struct TimeTable {
    knots: Vec<f64>,
    /// Ordered by interval and value, `a_0, a_1, ...`.
    coefficients: Vec<f64>,
    /// How many coefficients a polynomial has.
    order: usize,
    /// How many values there are.
    width: usize,
    /// Values before the first breakpoint and after the last one; a table without them is periodic.
    ends: Option<[Vec<f64>; 2]>,
    /// Intervals per unit of time, on average.
    density: f64,
}

/// Most coefficients of a polynomial.
const MOST_ORDER: usize = 8;

impl TimeTable {
    /// A table of increasing breakpoints, with `order` coefficients for each of `width` values in each
    /// interval, and the values outside, without which it is periodic. None if the numbers
    /// do not fit together.
    #[must_use]
    pub fn new(
        knots: Vec<f64>,
        coefficients: Vec<f64>,
        (order, width): (usize, usize),
        ends: Option<[Vec<f64>; 2]>,
    ) -> Option<Self> {
        let intervals = knots.len().checked_sub(1).filter(|&count| count > 0)?;
        let increasing = knots.windows(2).all(|pair| pair[0] < pair[1]);
        let finite = knots.iter().chain(&coefficients).all(|number| number.is_finite());
        let sizes = (1..=MOST_ORDER).contains(&order) && width > 0;
        let fits = coefficients.len() == intervals * order * width
            && ends.iter().flatten().all(|end| end.len() == width);
        let density = intervals as f64 / (knots[intervals] - knots[0]);
        (increasing && finite && sizes && fits).then_some(Self {
            knots,
            coefficients,
            order,
            width,
            ends,
            density,
        })
    }

    /// A linear combination of tables that have the same breakpoints, if they do.
    #[must_use]
    pub fn combination(parts: &[(f64, &Self)]) -> Option<Self> {
        let first = parts.first()?.1;
        let alike = |it: &Self| {
            it.knots == first.knots
                && (it.order, it.width, it.ends.is_some())
                    == (first.order, first.width, first.ends.is_some())
        };
        let end = |k: usize| {
            let ends = parts.iter().map(|(w, it)| Some((*w, &it.ends.as_ref()?[k][..])));
            weighted(&ends.collect::<Option<Vec<_>>>()?, |it| it)
        };
        if !parts.iter().all(|(_, it)| alike(it)) {
            return None;
        }
        Some(Self {
            coefficients: weighted(parts, |it| &it.coefficients)?,
            ends: end(0).zip(end(1)).map(|(before, after)| [before, after]),
            ..first.clone()
        })
    }

    /// How many values there are.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Location of a time: the interval, and the time since its breakpoint; none outside.
    #[inline]
    fn locate(&self, t: f64) -> Located {
        let (first, last) = (self.knots[0], self.knots[self.knots.len() - 1]);
        if self.ends.is_some() {
            if t < first || t.is_nan() {
                return Located::Before;
            }
            if t >= last {
                return Located::After;
            }
            return self.within(t, 0.0);
        }
        let period = last - first;
        let mut n = ((t - first) / period).floor();
        // the last breakpoint is the first one of the next period
        if t < first + n * period {
            n -= 1.0;
        } else if t >= first + (n + 1.0) * period {
            n += 1.0;
        }
        self.within(t, n * period)
    }

    /// The interval whose breakpoints, moved by `shift`, are around a time.
    #[inline]
    fn within(&self, t: f64, shift: f64) -> Located {
        let (knots, most) = (&self.knots, self.knots.len() - 2);
        let guess = ((t - shift - knots[0]) * self.density) as usize;
        let mut i = guess.min(most);
        let begins = |i: usize| i == 0 || knots[i] + shift <= t;
        let ends = |i: usize| i == most || t < knots[i + 1] + shift;
        // of breakpoints at equal distances the guess is at most one off
        if !begins(i) {
            i -= 1;
        } else if !ends(i) {
            i += 1;
        }
        if !(begins(i) && ends(i)) {
            i = knots[1..=most].partition_point(|&knot| knot + shift <= t);
        }
        Located::In(i, t - (knots[i] + shift))
    }

    /// The value in a column at a time.
    #[inline]
    #[must_use]
    pub fn value(&self, t: f64, column: usize) -> f64 {
        match (self.locate(t), &self.ends) {
            (Located::In(i, s), _) => {
                let a = self.polynomial(i, column);
                a.iter().rev().fold(0.0, |sum, a| sum * s + a)
            }
            (Located::Before, Some([first, _])) => first[column],
            (_, Some([_, last])) => last[column],
            (_, None) => f64::NAN,
        }
    }

    /// All values at a time.
    pub fn values(&self, t: f64, out: &mut [f64]) {
        match (self.locate(t), &self.ends) {
            (Located::In(i, s), _) => {
                for (column, out) in out.iter_mut().enumerate() {
                    let a = self.polynomial(i, column);
                    *out = a.iter().rev().fold(0.0, |sum, a| sum * s + a);
                }
            }
            (Located::Before, Some([first, _])) => out.copy_from_slice(first),
            (_, Some([_, last])) => out.copy_from_slice(last),
            (_, None) => out.fill(f64::NAN),
        }
    }

    /// The value in a column and its first two derivatives at a time.
    #[must_use]
    pub fn motion(&self, t: f64, column: usize) -> [f64; 3] {
        let Located::In(i, s) = self.locate(t) else { return [self.value(t, column), 0.0, 0.0] };
        let [mut value, mut first, mut second] = [0.0; 3];
        for a in self.polynomial(i, column).iter().rev() {
            second = second * s + first;
            first = first * s + value;
            value = value * s + a;
        }
        [value, first, 2.0 * second]
    }

    /// The coefficients of a column from a time on, in powers of the time since then, up to the
    /// next breakpoint, written into `out` and padded with zeros.
    pub(crate) fn expansion(&self, t: f64, column: usize, out: &mut [f64]) {
        out.fill(0.0);
        let Located::In(i, s) = self.locate(t) else {
            out[0] = self.value(t, column);
            return;
        };
        let a = self.polynomial(i, column);
        out[..a.len()].copy_from_slice(a);
        // Horner's scheme again and again
        for first in 0..a.len() {
            for k in (first..a.len() - 1).rev() {
                out[k] += s * out[k + 1];
            }
        }
    }

    /// How many coefficients its polynomials have.
    pub(crate) fn order(&self) -> usize {
        self.order
    }

    fn polynomial(&self, interval: usize, column: usize) -> &[f64] {
        &self.coefficients[(interval * self.width + column) * self.order..][..self.order]
    }
}

/// The weighted sum of lists of equal length.
pub(crate) fn weighted<T: ?Sized>(parts: &[(f64, &T)], of: fn(&T) -> &[f64]) -> Option<Vec<f64>> {
    let mut sum = vec![0.0; of(parts.first()?.1).len()];
    for (weight, part) in parts {
        let numbers = of(part);
        if numbers.len() != sum.len() {
            return None;
        }
        sum.iter_mut().zip(numbers).for_each(|(sum, number)| *sum += weight * number);
    }
    Some(sum)
}

/// Where a time lies in a table.
enum Located {
    Before,
    /// In an interval, at a time after its breakpoint.
    In(usize, f64),
    After,
}

/// A linear force whose excitation is a wave plus a table.
#[derive(Clone, Copy, Debug)]
pub struct TableForce<'a> {
    /// The force without the table.
    pub linear: LinearForce,
    /// The rest of the excitation (m/s^2).
    pub table: &'a TimeTable,
}

impl<E> Force<E> for TableForce<'_> {
    #[inline]
    fn at(&mut self, t: f64, x: f64, xdot: f64) -> Result<f64, E> {
        Ok(self.linear.at(t, x, xdot)? + self.table.value(t, 0))
    }

    fn dependence(&self) -> Dependence {
        match Force::<E>::dependence(&self.linear) {
            Dependence::Constant => Dependence::Time,
            other => other,
        }
    }

    fn dependence_at_rest(&self) -> Dependence {
        Dependence::Time
    }

    fn is_same(&self, other: &Self) -> bool {
        self.linear == other.linear && std::ptr::eq(self.table, other.table)
    }
}

impl<E> DifferentiableForce<E> for TableForce<'_> {
    fn parameters(&self) -> usize {
        DifferentiableForce::<E>::parameters(&self.linear)
    }

    fn slopes(
        &mut self,
        at: Place,
        by_time: bool,
        by: &[usize],
        out: &mut [f64],
    ) -> Result<Slopes, E> {
        let mut slopes = self.linear.slopes(at, by_time, by, out)?;
        if by_time {
            slopes.t += self.table.motion(at.t.max(at.within.0).min(at.within.1), 0)[1];
        }
        Ok(slopes)
    }
}

/// A wall that moves as the first column of a table.
impl<E> WallMotion<E> for &TimeTable {
    fn at(&mut self, t: f64) -> Result<[f64; 3], E> {
        Ok(self.motion(t, 0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two values over unequal intervals: a quadratic and a line in each.
    fn table(ends: bool) -> TimeTable {
        let knots = vec![1.0, 1.5, 4.0, 4.25];
        let coefficients: Vec<f64> = (0..18).map(|k| f64::from(k % 7) - 2.5).collect();
        let ends = ends.then(|| [vec![-7.0, 7.0], vec![8.0, 9.0]]);
        TimeTable::new(knots, coefficients, (3, 2), ends).unwrap()
    }

    #[test]
    fn each_time_belongs_to_the_interval_that_it_lies_in() {
        let it = table(true);
        for (t, i, start) in [(1.0, 0, 1.0), (1.49, 0, 1.0), (1.5, 1, 1.5), (4.1, 2, 4.0)] {
            for column in 0..2 {
                let a: Vec<f64> = (0..3)
                    .map(|k| f64::from(((i * 2 + column) * 3 + k) as u32 % 7) - 2.5)
                    .collect();
                let s: f64 = t - start;
                let motion = it.motion(t, column);
                assert!((motion[0] - (a[0] + a[1] * s + a[2] * s * s)).abs() < 1e-13);
                assert!((motion[1] - (a[1] + 2.0 * a[2] * s)).abs() < 1e-13);
                assert_eq!((motion[2], motion[0]), (2.0 * a[2], it.value(t, column)));
                let mut powers = [0.0; 4];
                it.expansion(t, column, &mut powers);
                assert!((powers[0] - motion[0]).abs() < 1e-13 && powers[3] == 0.0);
                assert!((powers[1] - motion[1]).abs() < 1e-13);
                assert!((powers[2] - a[2]).abs() < 1e-15);
            }
        }
        assert_eq!((it.value(0.99, 0), it.value(4.25, 1)), (-7.0, 9.0));
        assert_eq!(it.motion(5.0, 0), [8.0, 0.0, 0.0]);
    }

    #[test]
    fn knots_of_later_periods_are_those_that_are_rounded() {
        let knots: Vec<f64> = (0..=7).map(|k| 0.1 * f64::from(k)).collect();
        let period = knots[7] - knots[0];
        let steps: Vec<f64> = (0..7).map(f64::from).collect();
        let it = TimeTable::new(knots.clone(), steps, (1, 1), None).unwrap();
        for n in -50..5000 {
            for (i, first) in knots[..7].iter().enumerate() {
                let knot = first + f64::from(n) * period;
                assert_eq!(it.value(knot, 0), i as f64, "{n} {i}");
                let before = if i == 0 { 6.0 } else { i as f64 - 1.0 };
                assert_eq!(it.value(knot.next_down(), 0), before, "{n} {i}");
            }
        }
    }

    #[test]
    fn what_does_not_fit_together_is_no_table() {
        let new = |knots: &[f64], count, order| {
            TimeTable::new(knots.to_vec(), vec![0.0; count], (order, 1), None)
        };
        assert!(new(&[0.0, 1.0], 2, 2).is_some());
        assert!(new(&[0.0, 0.0], 2, 2).is_none() && new(&[0.0], 0, 2).is_none());
        assert!(new(&[0.0, 1.0], 3, 2).is_none() && new(&[0.0, f64::NAN], 2, 2).is_none());
        assert!(new(&[0.0, 1.0], 9, 9).is_none() && new(&[], 0, 1).is_none());
    }
}
