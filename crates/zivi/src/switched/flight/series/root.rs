//! The first root of a flight, certified.
//!
//! The coefficients in Bernstein form enclose the polynomial, and the number of their changes of
//! sign bounds that of its roots. Known roots at the start are divided out of the coefficients
//! first: their values would be rounding. Degree 11 nearly always decides, with the remaining terms
//! as a slack; otherwise the whole series is subdivided. A dip below rounding is none.

use super::table::{PART, SHORT};
use crate::numeric::bernstein::Polynomial;
use crate::numeric::power_series::{of_few, slopes, value_and_slope, Series, TERMS};
use crate::switched::flight::series::level::{screened, SignTest};

/// Rounding of a value, relative to the sum of the absolute values of the terms, where a series is
/// subdivided.
const DIP: f64 = 1e-15;

/// A step by Halley's formula that is so short, relative to the abscissa, is the last.
const LAST: f64 = 3e-6;

/// Steps of the iteration for a root; bisection alone takes 53.
const MOST_STEPS: usize = 120;

/// A root within `[0, 1]`, and the derivative there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SeriesRoot {
    pub(crate) at: f64,
    pub(crate) slope: f64,
}

/// The first point of `[0, 1]` where the series becomes negative, its first `known` coefficients
/// being zero: a root of that order at 0 that the motion leaves.
pub(crate) fn first_root(a: &Series, known: usize) -> Option<SeriesRoot> {
    let mut q = [0.0; TERMS];
    match known {
        0 => q = *a,
        1 => q[..TERMS - 1].copy_from_slice(&a[1..]),
        _ => q[..TERMS - known].copy_from_slice(&a[known..]),
    }
    let at = first_fall(&q)?;
    // a = s^known q: at a root of q the derivative is s^known q'
    let slope = value_and_slope(&q, at)[1] * at.powi(known as i32);
    Some(SeriesRoot { at, slope })
}

/// The same where a root at 0 has been divided out: the point alone.
#[inline(always)]
pub(crate) fn first_fall(q: &Series) -> Option<f64> {
    match screened(q) {
        SignTest::Clear => None,
        SignTest::One(guess) => Some(polished(q, guess, is_near)),
        SignTest::Open => subdivided(q),
    }
}

/// The only root in `(0, 1]` of a series that changes there from positive to negative, near a
/// guess.
#[inline(always)]
pub(super) fn only_root(a: &Series, guess: f64) -> SeriesRoot {
    let at = polished(a, guess, is_near);
    SeriesRoot { at, slope: value_and_slope(a, at)[1] }
}

/// Whether a step is short enough, relative to the abscissa, to be the last.
#[inline(always)]
fn is_near(step: f64, s: f64) -> bool {
    step.abs() <= LAST * s
}

/// The abscissa of such a root; `is_last(step, start)` returns whether a step is the last: the next
/// would be its cube.
#[inline(always)]
pub(crate) fn polished(q: &Series, guess: f64, is_last: impl Fn(f64, f64) -> bool) -> f64 {
    let (mut low, mut high, mut s) = (0.0, 1.0, guess);
    for _ in 0..MOST_STEPS {
        let [value, first, second] = slopes(q, s);
        if value > 0.0 {
            low = s;
        } else {
            high = s;
        }
        // Halley's formula
        let step = 2.0 * value * first / (value * second - 2.0 * first * first);
        let next = s + step;
        if is_last(step, s) && next >= low && next <= high {
            return next;
        }
        s = if next > low && next < high { next } else { 0.5 * (low + high) };
        if s <= low || s >= high {
            return s;
        }
    }
    s
}

/// The only root after 0 of a short flight from the wall, if proved unique, from the first
/// coefficients and a bound of `sum (n - 1) |a_n|` over the others.
///
/// ```text
/// q = a/s = a_1 + a_2 s + ...,    s (sum_(n>=3) (n - 1) |a_n| s^(n-3)) <= |a_2|/5 at 1.3 s_0
/// ```
///
/// with `s_0 = -a_1/a_2`: `q` decreases by at least `0.8 |a_2|` up to this point, at which `q < 0`.
#[inline(always)]
pub(super) fn of_short_arc(a: &[f64; SHORT], beyond: f64) -> Option<SeriesRoot> {
    const FARTHER: f64 = 1.3;
    /// A step by Newton's formula that is so short is the last.
    const NEAR: f64 = 1e-8;
    let mut s = -a[1] / a[2];
    // false for NaN too
    let short = s > 0.0 && FARTHER * s <= PART && a[2] < 0.0;
    let (far, mut sum) = (FARTHER * s, beyond);
    for n in (3..SHORT).rev() {
        sum = sum * far + (n as f64 - 1.0) * a[n].abs();
    }
    if !(short && far * sum <= -0.2 * a[2]) {
        return None;
    }
    let mut q = [0.0; SHORT - 1];
    q.copy_from_slice(&a[1..]);
    for _ in 0..MOST_STEPS {
        let [value, slope] = of_few(&q, s);
        let step = value / slope;
        s -= step;
        if step.abs() <= NEAR * s {
            break;
        }
    }
    Some(SeriesRoot { at: s, slope: s * of_few(&q, s)[1] })
}

/// The first root by subdivision of the whole series, rounding above zero.
#[cold]
fn subdivided(q: &Series) -> Option<f64> {
    let rounding: f64 = DIP * q.iter().map(|a| a.abs()).sum::<f64>();
    let mut p = Polynomial::<TERMS>::from_powers(*q);
    p.add(rounding);
    let found = p.first_negative()?;
    // that of the shifted one comes a little after the root itself
    let (mut s, mut now) = (found, slopes(q, found));
    for _ in 0..8 {
        let next = (s - now[0] / now[1]).clamp(0.0, 1.0);
        let then = slopes(q, next);
        if then[0].abs() < now[0].abs() {
            (s, now) = (next, then);
        } else {
            break;
        }
    }
    Some(s)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::power_series::{derivative, value};

    /// The powers of `+- prod (s - root)`, positive at the start, after `known` roots at 0.
    fn through(roots: &[f64], known: usize) -> Series {
        let mut a = [0.0; TERMS];
        a[0] = roots.iter().map(|root| -root).product::<f64>().signum();
        for (n, &root) in roots.iter().enumerate() {
            for i in (0..=n).rev() {
                a[i + 1] += a[i];
                a[i] *= -root;
            }
        }
        a.rotate_right(known);
        a
    }

    #[test]
    fn the_first_of_several_roots_is_found() {
        let cases: [&[f64]; 5] = [
            &[0.3],
            &[0.3, 0.300_001, 0.9],
            &[0.9, 0.2, 0.6, 0.7, 0.95],
            &[0.001, 2.0, 3.0],
            &[0.5, 0.75, -2.0, 1.5],
        ];
        for roots in cases {
            for known in 0..4 {
                let a = through(roots, known);
                let first = roots.iter().copied().filter(|&r| r > 0.0).fold(1.0, f64::min);
                let found = first_root(&a, known).unwrap();
                // a pair of roots that is this close is known to the root of rounding
                let tol = if roots.contains(&0.300_001) { 1e-8 } else { 1e-14 };
                assert!((found.at - first).abs() < tol, "{roots:?} {known}: {found:?}");
                let slope = value(&derivative(&a), found.at);
                assert!((found.slope - slope).abs() < tol.max(1e-13) && found.slope < 0.0);
            }
        }
    }

    #[test]
    fn a_step_onto_the_start_of_the_interval_is_halved() {
        // from .5 Halley's formula leads to 0 exactly: 2 (-1/4) (-1)/((-1/4) (-4) - 2) = -1/2
        let mut q = [0.0; TERMS];
        // -1/4 - r - 2 r^2 - 8 r^3 with r = s - 1/2
        (q[0], q[1], q[2], q[3]) = (0.75, -5.0, 10.0, -8.0);
        let root = polished(&q, 0.5, is_near);
        let (mut low, mut high) = (0.0, 0.5);
        while high - low > 1e-15 {
            let s: f64 = 0.5 * (low + high);
            let r = s - 0.5;
            if -0.25 - r - 2.0 * r * r - 8.0 * r * r * r > 0.0 {
                low = s;
            } else {
                high = s;
            }
        }
        assert!((root - low).abs() < 1e-14, "{root} {low}");
    }

    #[test]
    fn a_short_arc_is_certified() {
        // s (u - g s/2 + c s^2)
        let (u, g, c): (f64, f64, f64) = (1e-3, 2.0, 0.3);
        let mut a = [0.0; SHORT];
        (a[1], a[2], a[3]) = (u, -0.5 * g, c);
        let exact = 2.0 * u / (0.5 * g + (0.25 * g * g - 4.0 * u * c).sqrt());
        let found = of_short_arc(&a, 0.0).unwrap();
        assert!((found.at / exact - 1.0).abs() < 1e-15, "{found:?} {exact}");
        let slope = u - g * exact + 3.0 * c * exact * exact;
        assert!((found.slope / slope - 1.0).abs() < 1e-14, "{found:?} {slope}");
        // terms beyond that may bring it back, and one that does not fall
        assert_eq!(of_short_arc(&a, f64::INFINITY), None);
        a[2] = 0.5 * g;
        assert_eq!(of_short_arc(&a, 0.0), None);
    }

    #[test]
    fn touches_and_dips_below_rounding_are_none() {
        for roots in [&[0.5, 0.5][..], &[0.3, 0.3, 0.8, 0.8], &[-0.5, 1.5], &[1.0 + 1e-9]] {
            assert_eq!(first_root(&through(roots, 0), 0), None, "{roots:?}");
        }
        // a dip of depth w^2 between two roots
        for (w, seen) in [(1e-3, true), (1e-6, true), (3e-7, true), (1e-9, false)] {
            let found = first_root(&through(&[0.4 - w, 0.4 + w], 0), 0);
            assert_eq!(found.is_some(), seen, "{w}");
            assert!(found.is_none_or(|found| (found.at - 0.4 + w).abs() < 0.02 * w));
        }
    }

    #[test]
    fn numbers_that_are_none_give_no_certificate() {
        let mut a = through(&[0.3], 0);
        a[5] = f64::NAN;
        // whatever is found, it is not lost in a loop
        let found = first_root(&a, 0);
        assert!(found.is_none_or(|found| found.at.is_nan() || found.at <= 1.0));
        assert_eq!(first_root(&[-0.0; TERMS], 0), None);
    }
}
