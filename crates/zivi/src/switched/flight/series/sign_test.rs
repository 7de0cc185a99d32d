//! Which steps have no root, or one: by Bernstein coefficients.
//!
//! The coefficients of degree 11 are linear in where the step starts, so a table has their columns.
//! They enclose the polynomial, and the number of their changes of sign bounds that of its roots;
//! the terms beyond are a slack, which is linear, too.

use super::columns::{Bound, Columns};
use super::terms::{Start, TERMS};
use crate::numeric::bernstein::Polynomial;

/// Coefficients of the screen.
pub(super) const SCREEN: usize = 12;

/// Rounding of a value, relative to the sum of the absolute values of the terms.
const ROUNDING: f64 = 2e-15;

/// What the screen says of a polynomial that starts positive.
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
    coefficients: Columns<SCREEN>,
    slack: Bound,
}

impl Screen {
    /// Of series that are divided by `s^known`.
    pub(super) fn new(series: &Columns<TERMS>, known: usize) -> Self {
        let coefficients = series.0.each_ref().map(|a| {
            let mut low = [0.0; SCREEN];
            low.copy_from_slice(&a[known..known + SCREEN]);
            bernstein(low)
        });
        let slack = Bound::sizes(|c| {
            let (low, high) = series.0[c].split_at(known + SCREEN);
            slack(low, high)
        });
        Self { coefficients: Columns(coefficients), slack }
    }

    #[inline(always)]
    pub(super) fn of<const W: usize>(&self, start: &Start) -> SignTest {
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
mod tests {
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
