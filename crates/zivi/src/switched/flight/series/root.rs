//! The first root of a flight, certified.
//!
//! The coefficients in Bernstein form enclose the polynomial, and the number of their changes of
//! sign bounds that of its roots. Known roots at the start are divided out of the coefficients
//! first: their values would be rounding. Degree 11 decides nearly always, the terms beyond being a
//! slack; else the whole series is subdivided. A dip below rounding is none.

use super::table::{Series, TERMS};
use crate::numeric::bernstein::Polynomial;

/// Coefficients of the screen.
const SCREEN: usize = 12;

/// Rounding of a value, relative to the sum of the absolute values of the terms: in the screen,
/// and where a series is subdivided.
const ROUNDING: f64 = 2e-15;
const DIP: f64 = 1e-15;

/// A step by Halley's formula that is so short, relative to the abscissa, is the last.
const LAST: f64 = 3e-6;

/// Steps of the iteration for a root; bisection alone takes 53.
const MOST_STEPS: usize = 120;

/// A root within `[0, 1]`, and the derivative there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Root {
    pub(crate) at: f64,
    pub(crate) slope: f64,
}

/// What the screen says of a polynomial that starts positive.
enum Screen {
    /// It stays so over `[0, 1]`.
    Clear,
    /// It has one root, near here.
    One(f64),
    Open,
}

/// The first point of `[0, 1]` where the series becomes negative, its first `known` coefficients
/// being zero: a root of that order at 0 that the motion leaves.
pub(crate) fn first_root(a: &Series, known: usize) -> Option<Root> {
    let mut q = [0.0; TERMS];
    match known {
        0 => q = *a,
        1 => q[..TERMS - 1].copy_from_slice(&a[1..]),
        _ => q[..TERMS - known].copy_from_slice(&a[known..]),
    }
    let at = match screen(&q) {
        Screen::Clear => return None,
        Screen::One(guess) => polished(&q, guess),
        Screen::Open => subdivided(&q)?,
    };
    // a = s^known q: at a root of q the derivative is s^known q'
    let slope = slopes(&q)(at)[1] * at.powi(known as i32);
    Some(Root { at, slope })
}

/// The screen of degree 11.
fn screen(q: &Series) -> Screen {
    let mut low = [0.0; SCREEN];
    low.copy_from_slice(&q[..SCREEN]);
    let beyond: f64 = q[SCREEN..].iter().map(|a| a.abs()).sum();
    let within: f64 = low.iter().map(|a| a.abs()).sum();
    let slack = beyond + ROUNDING * (within + beyond);
    let p = Polynomial::<SCREEN>::from_powers(low);
    let b = p.coefficients();
    // written so that NaN and a negative zero never are a certificate
    if b.iter().all(|&b| b > slack) {
        return Screen::Clear;
    }
    let Some(first) = b.iter().position(|&b| b < 0.0) else { return Screen::Open };
    let one = b[..first].iter().all(|&b| b > slack) && b[first..].iter().all(|&b| b < -slack);
    if !one || first == 0 {
        return Screen::Open;
    }
    // where the control polygon crosses zero
    let (before, after) = (b[first - 1], b[first]);
    let crossing = (first - 1) as f64 + before / (before - after);
    Screen::One(crossing / (SCREEN - 1) as f64)
}

/// The only root in `[0, 1]` of a series that changes from positive to negative.
fn polished(q: &Series, guess: f64) -> f64 {
    let at = slopes(q);
    let (mut low, mut high, mut s) = (0.0, 1.0, guess);
    for _ in 0..MOST_STEPS {
        let [value, first, second] = at(s);
        if value > 0.0 {
            low = s;
        } else {
            high = s;
        }
        // Halley's formula
        let step = 2.0 * value * first / (value * second - 2.0 * first * first);
        let next = s + step;
        if step.abs() <= LAST * s && next >= low && next <= high {
            return next;
        }
        s = if next > low && next < high { next } else { 0.5 * (low + high) };
        if s <= low || s >= high {
            return s;
        }
    }
    s
}

/// The first root by subdivision of the whole series, rounding above zero.
fn subdivided(q: &Series) -> Option<f64> {
    let rounding: f64 = DIP * q.iter().map(|a| a.abs()).sum::<f64>();
    let mut p = Polynomial::<TERMS>::from_powers(*q);
    p.add(rounding);
    let found = p.first_negative()?;
    // that of the shifted one comes a little after the root itself
    let at = slopes(q);
    let (mut s, mut now) = (found, at(found));
    for _ in 0..8 {
        let next = (s - now[0] / now[1]).clamp(0.0, 1.0);
        let then = at(next);
        if then[0].abs() < now[0].abs() {
            (s, now) = (next, then);
        } else {
            break;
        }
    }
    Some(s)
}

/// The values of a series and of its first two derivatives.
fn slopes(q: &Series) -> impl Fn(f64) -> [f64; 3] {
    let q = *q;
    let first = derivative(&q);
    let second = derivative(&first);
    move |s| [value(&q, s), value(&first, s), value(&second, s)]
}

pub(crate) fn derivative(a: &Series) -> Series {
    let mut d = [0.0; TERMS];
    for (n, d) in d.iter_mut().enumerate().take(TERMS - 1) {
        *d = (n as f64 + 1.0) * a[n + 1];
    }
    d
}

/// The value of a series: four interleaved ones in `s^4`, which a processor sums side by side.
#[inline]
pub(crate) fn value(a: &Series, s: f64) -> f64 {
    let (s2, mut sums) = (s * s, [0.0; 4]);
    let s4 = s2 * s2;
    for k in (0..TERMS / 4).rev() {
        for (i, sum) in sums.iter_mut().enumerate() {
            *sum = *sum * s4 + a[4 * k + i];
        }
    }
    (sums[0] + s * sums[1]) + s2 * (sums[2] + s * sums[3])
}

#[cfg(test)]
mod tests {
    use super::*;

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
