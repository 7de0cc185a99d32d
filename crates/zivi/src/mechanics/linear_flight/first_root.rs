//! Where a power series on `[0, 1]` that begins above zero first falls below it.

use pulp::{Simd, WithSimd};

use crate::numeric::power_series::{value_and_slope, Series, TERMS};
use crate::switched::flight::series;

/// Largest relative change of the slope of a steadily decreasing function.
const CHANGE: f64 = 0.5;
/// Up to so many times the fall of the line: beyond `1/(1 - CHANGE)`.
const REACH: f64 = 2.2;
/// An arc is looked at up to so many times the length of its parabola.
const ARC: f64 = 1.5;
/// Newton iterations of a root.
const ITERATIONS: usize = 16;

/// The first root of `p` after so many at zero, which are divided out of its coefficients.
pub(super) fn first_root(p: &Series, at_zero: usize) -> Option<f64> {
    let mut a = [0.0; TERMS];
    a[..TERMS - at_zero].copy_from_slice(&p[at_zero..]);
    pulp::Arch::new().dispatch(Search(&a))
}

/// The search for the first root, by the widest registers of the processor.
struct Search<'a>(&'a Series);

impl WithSimd for Search<'_> {
    type Output = Option<f64>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Option<f64> {
        let Self(a) = self;
        if a[0] < 0.0 {
            return Some(0.0);
        }
        if let Some(root) = steady_fall(a) {
            return Some(root);
        }
        let rest: f64 = a[1..].iter().map(|a| a.abs()).sum();
        if a[0] > rest {
            return None;
        }
        // a short arc is far below what rounding leaves of the whole step
        let arc = ARC * fall_of_parabola(a);
        if arc < 1.0 {
            let mut part = *a;
            let mut power = 1.0;
            for a in &mut part {
                *a *= power;
                power *= arc;
            }
            if let Some(root) = series::first_fall(&part) {
                return Some(polished(a, root * arc));
            }
        }
        series::first_fall(a).map(|root| polished(a, root))
    }
}

/// When `a_0 + a_1 s + a_2 s^2` comes to zero, infinite if it never does.
#[inline(always)]
fn fall_of_parabola(a: &Series) -> f64 {
    let root = a[1] * a[1] - 4.0 * a[0] * a[2];
    if a[2] >= 0.0 || root.is_nan() {
        return f64::INFINITY;
    }
    let (root, pull) = (root.sqrt(), -2.0 * a[2]);
    if a[1] >= 0.0 {
        (a[1] + root) / pull
    } else {
        2.0 * a[0] / (root - a[1])
    }
}

/// The root of one that falls from its start as a line does to within half of its slope: up to
/// [`REACH`] times where that line comes to zero it falls at least half as fast, and is below zero there.
#[inline(always)]
fn steady_fall(a: &Series) -> Option<f64> {
    let first = -a[0] / a[1];
    if !(a[1] < 0.0 && REACH * first <= 1.0) {
        return None;
    }
    let sizes: Series = std::array::from_fn(|k| if k < 2 { 0.0 } else { a[k].abs() });
    let [_, change] = value_and_slope(&sizes, REACH * first);
    (change <= CHANGE * -a[1]).then(|| polished(a, first))
}

/// The root that is near, to rounding.
#[inline(always)]
fn polished(a: &Series, near: f64) -> f64 {
    let (mut s, mut last) = (near, f64::INFINITY);
    for _ in 0..ITERATIONS {
        let [p, slope] = value_and_slope(a, s);
        let step = p / slope;
        let next = s - step;
        // where it touches zero rounding decides
        if !(step.abs() < last && (0.0..=1.0).contains(&next)) {
            break;
        }
        (s, last) = (next, step.abs());
        if step.abs() <= f64::EPSILON * s {
            break;
        }
    }
    s
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `scale prod (1 - s/root)` times `s^zeros`.
    fn with_roots(roots: &[f64], zeros: usize) -> Series {
        let mut a = [0.0; TERMS];
        a[zeros] = 1.0;
        for root in roots {
            for k in (1..TERMS).rev() {
                a[k] -= a[k - 1] / root;
            }
        }
        a
    }

    #[test]
    fn the_first_root_is_found_whatever_comes_after_it() {
        for first in [1e-12, 1e-5, 0.013, 0.3, 0.77, 0.999] {
            for more in [&[][..], &[1.7], &[1.0 + 1e-3, 3.0], &[-0.5, 1.5, 9.0]] {
                for zeros in 0..4 {
                    let roots: Vec<f64> = more.iter().copied().chain([first]).collect();
                    let a = with_roots(&roots, zeros);
                    let root = first_root(&a, zeros).unwrap();
                    // what rounding of the terms moves it by
                    let (mut size, mut power) = (0.0, 1.0);
                    for a in &a {
                        size += a.abs() * power;
                        power *= first;
                    }
                    let noise =
                        4.0 * f64::EPSILON * (size / value_and_slope(&a, first)[1].abs() + first);
                    assert!((root - first).abs() <= noise, "{first} {more:?} {root}");
                }
            }
        }
    }

    #[test]
    fn a_parabola_falls_to_its_root_whichever_way_it_starts() {
        // 2 (1 + s/a)(1 - s/b): rising first where b > a
        for (a, b) in [(0.2, 0.7), (3.0, 1.1), (1e9, 0.4), (0.5, 0.5)] {
            let mut p = [0.0; TERMS];
            (p[0], p[1], p[2]) = (2.0, 2.0 / a - 2.0 / b, -2.0 / (a * b));
            assert!((fall_of_parabola(&p) - b).abs() < 1e-14, "{a} {b}");
        }
        let mut p = [0.0; TERMS];
        for (a, b, c) in [(1.0, 1.0, 1.0), (1.0, -2.0, 0.5), (1.0, 0.3, f64::NAN)] {
            (p[0], p[1], p[2]) = (a, b, c);
            assert_eq!(fall_of_parabola(&p), f64::INFINITY);
        }
    }

    #[test]
    fn short_arcs_from_above_zero_have_their_own_scale() {
        for length in [1e-11, 1e-8, 1e-4, 0.1] {
            // 3e-20 above zero, upwards first, beside coefficients of one
            let mut a = with_roots(&[length, -1e-3 * length, 1.9, -4.0], 0);
            a.iter_mut().for_each(|a| *a *= length * length);
            let root = first_root(&a, 0).unwrap();
            assert!((root - length).abs() <= 1e-12 * length, "{length} {root}");
        }
    }

    #[test]
    fn what_stays_above_zero_has_none() {
        assert_eq!(first_root(&with_roots(&[1.001], 0), 0), None);
        assert_eq!(first_root(&with_roots(&[-0.3, 2.0], 1), 1), None);
        // a minimum of 1e-9 at one half, and one of -1e-9
        let mut a = [0.0; TERMS];
        (a[0], a[1], a[2]) = (0.25 + 1e-9, -1.0, 1.0);
        assert_eq!(first_root(&a, 0), None);
        a[0] -= 2e-9;
        let root = first_root(&a, 0).unwrap();
        assert!((root - (0.5 - 1e-9_f64.sqrt())).abs() < 1e-10);
        a[0] = -1.0;
        assert_eq!(first_root(&a, 0), Some(0.0));
    }
}
