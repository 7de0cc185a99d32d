//! Several steps of a flight together.

use crate::numeric::bernstein::Polynomial;
use crate::numeric::root::sin_cos;
use crate::switched::flight::series::law::{
    length, sum_by, Bound, Law, LinearColumns, SeriesStart, COLUMNS, TERMS, WAVES,
};

/// Doublings of a step; a larger one is never needed.
pub(super) const LEVELS: usize = 20;

/// A level whose numbers are larger than this is of no use.
const LARGEST: f64 = 1e100;

/// How the end of `2^j` steps depends on their start.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct DoublingLevel {
    /// `x` and `V`.
    ends: LinearColumns<2>,
    /// `e^(i W 2^j)` as cosine and sine.
    turn: [[f64; 2]; WAVES],
    /// Of `h^2 |x''|` in between.
    bend: Bound,
}

impl DoublingLevel {
    /// One step.
    pub(super) fn first(
        series: &LinearColumns<TERMS>,
        law: Law,
        h: f64,
        turns: [f64; WAVES],
    ) -> Self {
        let ends = series.0.each_ref().map(|a| [sum_by(a, |_, a| a), sum_by(a, |n, a| n * a)]);
        let bends = |n: f64| n * (n - 1.0).max(0.0);
        let bend = |c: usize| sum_by(&series.0[c], |n, a| bends(n) * a.abs());
        // without a spring and a damper the force is the acceleration
        let free = law.stiffness == 0.0 && law.damping == 0.0;
        let wave = |m: usize| {
            let [cos, sin] = [&series.0[3 + 2 * m], &series.0[4 + 2 * m]];
            let size = |n: usize| length(cos[n], sin[n]);
            if free {
                h * h
            } else {
                (0..TERMS).map(|n| bends(n as f64) * size(n)).sum()
            }
        };
        let bend = Bound([bend(0), bend(1), bend(2), wave(0), wave(1)]);
        Self { ends: LinearColumns(ends), turn: turns.map(turn), bend }
    }

    /// Position and velocity, times the length of a step, at the end.
    #[inline(always)]
    pub(super) fn ends<const W: usize>(&self, start: &SeriesStart) -> [f64; 2] {
        self.ends.of::<W, 2>(start)
    }

    /// The waves at the end.
    #[inline(always)]
    pub(super) fn turned<const W: usize>(&self, mut waves: [[f64; 2]; WAVES]) -> [[f64; 2]; WAVES] {
        for (z, [cos, sin]) in waves.iter_mut().zip(self.turn).take(W) {
            *z = [z[0] * cos - z[1] * sin, z[1] * cos + z[0] * sin];
        }
        waves
    }

    /// Whether the motion certainly stays above the wall for `length` steps, no more than those of
    /// the level: `x + s V - s^2 B/2 > 0` at their end implies it in between.
    #[inline(always)]
    pub(super) fn is_clear<const W: usize>(&self, start: &SeriesStart, length: f64) -> bool {
        let bend = self.bend.of::<W>(start);
        let lowest = start.x + length * (start.v - 0.5 * length * bend);
        // false for NaN too
        lowest > 1e-9 * (start.x + length * start.v.abs())
    }

    /// Whether a start is thinkable from which a step is clear by its bound: from a height, or away
    /// from the wall.
    pub(super) fn leaps(&self) -> bool {
        let Bound([x, v, ..]) = self.bend;
        x.min(v) < 2.0
    }

    /// Twice as many steps, in which the waves turn by so much.
    pub(super) fn doubled(&self, turns: [f64; WAVES]) -> Self {
        let by = &self.ends.0;
        let after = |[x, v]: [f64; 2], row: usize| x * by[0][row] + v * by[1][row];
        // what the second half adds: the constant again, the waves turned
        let own = |c: usize, row: usize| match c {
            0 | 1 => 0.0,
            2 => by[2][row],
            _ => {
                let [cos, sin] = self.turn[(c - 3) / 2];
                let [re, im] = [by[(c - 1) / 2 * 2 + 1][row], by[(c - 1) / 2 * 2 + 2][row]];
                if c % 2 == 1 {
                    re * cos + im * sin
                } else {
                    im * cos - re * sin
                }
            }
        };
        let ends: [[f64; 2]; COLUMNS] =
            std::array::from_fn(|c| [0, 1].map(|row| after(by[c], row) + own(c, row)));
        let Bound([x, v, force, of_waves @ ..]) = self.bend;
        let later = |by_x: f64, by_v: f64| x * by_x.abs() + v * by_v.abs();
        let size = |m: usize, row: usize| length(by[3 + 2 * m][row], by[4 + 2 * m][row]);
        let wave = |m: usize| of_waves[m].max(later(size(m, 0), size(m, 1)) + of_waves[m]);
        let bend = Bound([
            x.max(later(by[0][0], by[0][1])),
            v.max(later(by[1][0], by[1][1])),
            force.max(later(by[2][0], by[2][1]) + force),
            wave(0),
            wave(1),
        ]);
        Self { ends: LinearColumns(ends), turn: turns.map(turn), bend }
    }

    pub(super) fn is_tame(&self) -> bool {
        let numbers = self.ends.0.iter().flatten().chain(&self.bend.0);
        // not so for NaN
        numbers.into_iter().all(|number| number.abs() < LARGEST)
    }
}

/// Cosine and sine of an angle in turns.
fn turn(turns: f64) -> [f64; 2] {
    let (sin, cos) = sin_cos(turns);
    [cos, sin]
}

// Which steps have no root, or one: by Bernstein coefficients.
//
// The coefficients of degree 11 are linear in where the step starts, so a table has their columns.
// They enclose the polynomial, and the number of their changes of sign bounds that of its roots;
// the remaining terms are a slack, which is also linear.

/// Coefficients of the screen.
pub(super) const SCREEN: usize = 12;

/// Rounding of a value, relative to the sum of the absolute values of the terms.
const ROUNDING: f64 = 2e-15;

/// Result of the screen for a polynomial that starts positive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum SignTest {
    /// It stays so over `[0, 1]`.
    Clear,
    /// It has one root, near here.
    One(f64),
    Open,
}

/// Columns of Bernstein coefficients, and the slack.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Screen {
    coefficients: LinearColumns<SCREEN>,
    slack: Bound,
}

impl Screen {
    /// Of series that are divided by `s^known`.
    pub(super) fn new(series: &LinearColumns<TERMS>, known: usize) -> Self {
        let coefficients = series.0.each_ref().map(|a| {
            let mut low = [0.0; SCREEN];
            low.copy_from_slice(&a[known..known + SCREEN]);
            bernstein(low)
        });
        let slack = Bound::sizes(|c| {
            let (low, high) = series.0[c].split_at(known + SCREEN);
            slack(low, high)
        });
        Self { coefficients: LinearColumns(coefficients), slack }
    }

    #[inline(always)]
    pub(super) fn of<const W: usize>(&self, start: &SeriesStart) -> SignTest {
        verdict(&self.coefficients.of::<W, SCREEN>(start), self.slack.of::<W>(start))
    }
}

/// The same of a series, a root of whose has been divided out.
#[inline(always)]
pub(super) fn screened(q: &[f64; TERMS]) -> SignTest {
    let mut low = [0.0; SCREEN];
    low.copy_from_slice(&q[..SCREEN]);
    verdict(&bernstein(low), slack(&low, &q[SCREEN..]))
}

#[inline(always)]
fn bernstein(low: [f64; SCREEN]) -> [f64; SCREEN] {
    let mut b = [0.0; SCREEN];
    b.copy_from_slice(Polynomial::<SCREEN>::from_powers(low).coefficients());
    b
}

#[inline(always)]
fn slack(low: &[f64], high: &[f64]) -> f64 {
    let size = |a: &[f64]| a.iter().map(|a| a.abs()).sum::<f64>();
    size(high) + ROUNDING * (size(low) + size(high))
}

#[inline(always)]
fn verdict(b: &[f64; SCREEN], slack: f64) -> SignTest {
    // written so that NaN and a negative zero never are a certificate
    if b.iter().fold(true, |all, &b| all & (b > slack)) {
        return SignTest::Clear;
    }
    let Some(first) = b.iter().position(|&b| b < 0.0) else { return SignTest::Open };
    let one = b[..first].iter().all(|&b| b > slack) && b[first..].iter().all(|&b| b < -slack);
    if !one || first == 0 {
        return SignTest::Open;
    }
    // where the control polygon crosses zero
    let (before, after) = (b[first - 1], b[first]);
    let crossing = (first - 1) as f64 + before / (before - after);
    SignTest::One(crossing / (SCREEN - 1) as f64)
}

#[cfg(test)]
mod level_tests {
    use super::super::table::Table;
    use super::*;

    #[test]
    fn a_step_is_clear_that_ends_above_a_billionth_of_the_way() {
        let law = Law { stiffness: 0.0, damping: 0.0, omega: [0.0; 2] };
        let table = Table::new(law, 1.0);
        let level = DoublingLevel::first(&LinearColumns(table.columns()), law, table.h(), [0.0; 2]);
        // from 1 m down by 1 m, all but a part
        let is_clear = |left: f64, length: f64| {
            let start = SeriesStart { x: 1.0, v: -(1.0 - left) / length, ..SeriesStart::default() };
            level.is_clear::<0>(&start, length)
        };
        for length in [0.25, 1.0] {
            assert!(is_clear(2.1e-9, length) && is_clear(0.5, length));
            for left in [1.9e-9, 1e-10, 0.0, -1.0] {
                assert!(!is_clear(left, length), "{left:e}");
            }
        }
    }

    #[test]
    fn a_free_mass_is_accelerated_by_its_waves_alone() {
        let omega = [0.4, 0.0];
        let law = Law { stiffness: 0.0, damping: 0.0, omega };
        let table = Table::new(law, f64::INFINITY);
        let h = table.h();
        assert!(h > 2.0);
        let turns = omega.map(|omega| omega * h / std::f64::consts::TAU);
        let level = DoublingLevel::first(&LinearColumns(table.columns()), law, h, turns);
        let Bound(bend) = level.bend;
        assert!((bend[3] / (h * h) - 1.0).abs() < 1e-15, "{bend:?} {h}");
    }
}

#[cfg(test)]
mod sign_test_tests {
    use super::*;

    #[test]
    fn only_what_is_beyond_the_slack_is_certain() {
        let all = |b: f64| verdict(&[b; SCREEN], 1.0);
        assert_eq!(all(1.5), SignTest::Clear);
        for b in [1.0, 0.5, -0.5, -1.5, f64::NAN] {
            assert_eq!(all(b), SignTest::Open, "{b}");
        }
        assert_eq!(verdict(&[0.0; SCREEN], 0.0), SignTest::Open);
        // the polygon of 2, ..., 2, -2, ..., -2 crosses zero in the middle of the change
        for first in 1..SCREEN {
            let b: [f64; SCREEN] = std::array::from_fn(|k| if k < first { 2.0 } else { -2.0 });
            let place = (first as f64 - 0.5) / (SCREEN - 1) as f64;
            assert_eq!(verdict(&b, 1.0), SignTest::One(place), "{first}");
            assert_eq!(verdict(&b, 2.0), SignTest::Open, "{first}");
        }
    }
}
