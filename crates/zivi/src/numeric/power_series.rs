//! Real numbers with derivatives, and power series.
//!
//! Numbers, plain or with a derivative: what is written once for both gives its derivatives too.

use pulp::{Scalar, Simd, WithSimd};
use std::ops::{Add, Mul, Neg, Sub};

/// A real number, or one with a derivative.
pub(crate) trait Real:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Neg<Output = Self>
{
    /// A constant.
    fn of(value: f64) -> Self;

    /// Sine and cosine.
    fn sin_cos(self) -> (Self, Self);

    /// Square root.
    fn sqrt(self) -> Self;

    /// `1/x`.
    fn inverse(self) -> Self;
}

impl Real for f64 {
    #[inline(always)]
    fn of(value: f64) -> Self {
        value
    }

    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        f64::sin_cos(self)
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }

    #[inline(always)]
    fn inverse(self) -> Self {
        1.0 / self
    }
}

/// A number and its derivative.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct DualNumber {
    pub(crate) value: f64,
    pub(crate) slope: f64,
}

impl Add for DualNumber {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self { value: self.value + other.value, slope: self.slope + other.slope }
    }
}

impl Sub for DualNumber {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self { value: self.value - other.value, slope: self.slope - other.slope }
    }
}

impl Mul for DualNumber {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        let slope = self.slope * other.value + self.value * other.slope;
        Self { value: self.value * other.value, slope }
    }
}

impl Neg for DualNumber {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self { value: -self.value, slope: -self.slope }
    }
}

impl Real for DualNumber {
    #[inline(always)]
    fn of(value: f64) -> Self {
        Self { value, slope: 0.0 }
    }

    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        let (sin, cos) = self.value.sin_cos();
        (
            Self { value: sin, slope: cos * self.slope },
            Self { value: cos, slope: -sin * self.slope },
        )
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        let value = self.value.sqrt();
        Self { value, slope: self.slope / (2.0 * value) }
    }

    #[inline(always)]
    fn inverse(self) -> Self {
        let value = 1.0 / self.value;
        Self { value, slope: -self.slope * value * value }
    }
}

// Power series on `[0, 1]` that converge as that of an exponential of 2, and their values.

/// Coefficients: what is left out is `2^24/24! = 3e-17`.
pub(crate) const TERMS: usize = 24;

/// The coefficients, the constant first.
pub(crate) type Series = [f64; TERMS];

/// Series are summed as four interleaved ones in `s^4`, which a processor does side by side.
pub(crate) const LANES: usize = 4;
const ROUNDS: usize = TERMS / LANES;
type Lanes = [f64; LANES];

/// `sum_i s^i p_i`.
#[inline(always)]
fn joined(p: Lanes, s: f64) -> f64 {
    all_joined(Scalar::new(), p, s)
}

/// The same of several series, each at its own place.
#[inline(always)]
fn all_joined<S: Simd>(simd: S, [p0, p1, p2, p3]: [S::f64s; LANES], s: S::f64s) -> S::f64s {
    let line = |a, b| simd.add_f64s(a, simd.mul_f64s(s, b));
    simd.add_f64s(line(p0, p1), simd.mul_f64s(simd.mul_f64s(s, s), line(p2, p3)))
}

/// The value of a series.
#[inline(always)]
pub(crate) fn value(a: &Series, s: f64) -> f64 {
    let (s2, mut sums) = (s * s, [0.0; LANES]);
    let s4 = s2 * s2;
    for k in (0..TERMS / LANES).rev() {
        for (i, sum) in sums.iter_mut().enumerate() {
            *sum = *sum * s4 + a[LANES * k + i];
        }
    }
    (sums[0] + s * sums[1]) + s2 * (sums[2] + s * sums[3])
}

/// The values at several places together, with the bits of [`value`] at each.
#[inline(always)]
pub(crate) fn values<const L: usize>(a: &Series, s: &[f64; L]) -> [f64; L] {
    let s2: [f64; L] = std::array::from_fn(|l| s[l] * s[l]);
    let s4: [f64; L] = std::array::from_fn(|l| s2[l] * s2[l]);
    let mut sums = [[0.0; L]; LANES];
    for k in (0..ROUNDS).rev() {
        for (i, sums) in sums.iter_mut().enumerate() {
            for l in 0..L {
                sums[l] = sums[l] * s4[l] + a[LANES * k + i];
            }
        }
    }
    let [p0, p1, p2, p3] = sums;
    std::array::from_fn(|l| (p0[l] + s[l] * p1[l]) + s2[l] * (p2[l] + s[l] * p3[l]))
}

/// The values of a series and of its first two derivatives.
#[inline(always)]
pub(crate) fn slopes(a: &Series, s: f64) -> [f64; 3] {
    all_slopes(Scalar::new(), |k| std::array::from_fn(|i| a[LANES * k + i]), s)
}

/// The same of several series, each at its own place; `of` gives four coefficients of each.
///
/// With `p_i(s^4)` the interleaved ones, `p = sum_i s^i p_i`,
///
/// ```text
/// p'  = sum_i (i s^(i-1) p_i + 4 s^(i+3) p_i')
/// p'' = sum_i (i (i-1) s^(i-2) p_i + (8 i + 12) s^(i+2) p_i' + 16 s^(i+6) p_i'').
/// ```
#[inline(always)]
pub(crate) fn all_slopes<S: Simd>(
    simd: S,
    of: impl Fn(usize) -> [S::f64s; LANES],
    s: S::f64s,
) -> [S::f64s; 3] {
    let mul = |a, b| simd.mul_f64s(a, b);
    let add = |a, b| simd.add_f64s(a, b);
    let times = |factor: f64, a| mul(simd.splat_f64s(factor), a);
    let s2 = mul(s, s);
    let (s3, s4) = (mul(s2, s), mul(s2, s2));
    // values, first derivatives and half of the second ones, in place
    let next = |sum: [S::f64s; LANES], plus: [S::f64s; LANES]| -> [S::f64s; LANES] {
        std::array::from_fn(|i| add(mul(sum[i], s4), plus[i]))
    };
    let mut p = of(ROUNDS - 1);
    let mut d = p;
    p = next(p, of(ROUNDS - 2));
    let mut e = d;
    d = next(d, p);
    p = next(p, of(ROUNDS - 3));
    for k in (0..ROUNDS - 3).rev() {
        e = next(e, d);
        d = next(d, p);
        p = next(p, of(k));
    }
    let outer = [times(12.0, d[0]), times(20.0, d[1]), times(28.0, d[2]), times(36.0, d[3])];
    let (twice, thrice) = (times(2.0, p[2]), mul(times(3.0, s), p[3]));
    let of_d = mul(times(4.0, s3), all_joined(simd, d, s));
    let first = add(add(p[1], mul(s, add(twice, thrice))), of_d);
    let of_e = mul(mul(times(32.0, s2), s4), all_joined(simd, e, s));
    let of_p = add(twice, mul(times(6.0, s), p[3]));
    let second = add(add(of_p, mul(s2, all_joined(simd, outer, s))), of_e);
    [all_joined(simd, p, s), first, second]
}

/// The values of several series, each at its own place, with the bits of [`value`].
#[inline(always)]
pub(crate) fn all_values<S: Simd>(simd: S, a: &[S::f64s; TERMS], s: S::f64s) -> S::f64s {
    let s2 = simd.mul_f64s(s, s);
    let s4 = simd.mul_f64s(s2, s2);
    let mut sums: [S::f64s; LANES] = std::array::from_fn(|i| a[TERMS - LANES + i]);
    for k in (0..ROUNDS - 1).rev() {
        sums = std::array::from_fn(|i| simd.add_f64s(simd.mul_f64s(sums[i], s4), a[LANES * k + i]));
    }
    all_joined(simd, sums, s)
}

/// The values of a series and of its derivative; the number of terms is a multiple of four.
#[inline(always)]
pub(crate) fn value_and_slope<const N: usize>(a: &[f64; N], s: f64) -> [f64; 2] {
    let s2 = s * s;
    let (s3, s4) = (s2 * s, s2 * s2);
    let of = |k: usize| -> Lanes { std::array::from_fn(|i| a[LANES * k + i]) };
    let next = |sum: Lanes, add: Lanes| -> Lanes { std::array::from_fn(|i| sum[i] * s4 + add[i]) };
    let rounds = N / LANES;
    let mut p = of(rounds - 1);
    let mut d = p;
    p = next(p, of(rounds - 2));
    for k in (0..rounds - 2).rev() {
        d = next(d, p);
        p = next(p, of(k));
    }
    let slope = (p[1] + s * (2.0 * p[2] + 3.0 * s * p[3])) + 4.0 * s3 * joined(d, s);
    [joined(p, s), slope]
}

/// The same for several series, vectorised.
pub(crate) fn values_and_slopes(all: &[Series], s: f64, out: &mut [[f64; 2]]) {
    pulp::Arch::new().dispatch(SeriesValues { all, s, out });
}

struct SeriesValues<'a> {
    all: &'a [Series],
    s: f64,
    out: &'a mut [[f64; 2]],
}

impl WithSimd for SeriesValues<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { all, s, out } = self;
        out.iter_mut().zip(all).for_each(|(out, a)| *out = value_and_slope(a, s));
    }
}

/// The same of a short series, as two in `s^2`.
#[inline(always)]
pub(crate) fn of_few<const N: usize>(a: &[f64; N], s: f64) -> [f64; 2] {
    let (s2, mut p, mut d) = (s * s, [0.0; 2], [0.0; 2]);
    for k in (0..N.div_ceil(2)).rev() {
        for i in 0..2 {
            d[i] = d[i] * s2 + p[i];
            p[i] = p[i] * s2 + if 2 * k + i < N { a[2 * k + i] } else { 0.0 };
        }
    }
    [p[0] + s * p[1], p[1] + 2.0 * s * (d[0] + s * d[1])]
}

#[inline(always)]
pub(crate) fn derivative(a: &Series) -> Series {
    let mut d = [0.0; TERMS];
    for (n, d) in d.iter_mut().enumerate().take(TERMS - 1) {
        *d = (n as f64 + 1.0) * a[n + 1];
    }
    d
}

/// The sums of the sizes of every fourth coefficient, from each of the first four on.
#[inline(always)]
pub(crate) fn sizes(a: &Series) -> [f64; LANES] {
    let mut sums = [0.0; LANES];
    for a in a.chunks_exact(LANES) {
        sums = std::array::from_fn(|i| sums[i] + a[i].abs());
    }
    sums
}

/// [`stretch`] with a more accurate second coefficient of the result, and its [`sizes`]: in one
/// loop, since vector loads right after scalar stores are slow.
#[inline(always)]
pub(crate) fn stretch_and_size(a: &mut Series, part: f64, second: f64) -> [f64; LANES] {
    if part == 1.0 {
        a[1] = second;
        return sizes(a);
    }
    let (mut power, mut sums) = (1.0, [0.0; LANES]);
    for (n, a) in a.iter_mut().enumerate() {
        let stretched = if n == 1 { second } else { *a * power };
        *a = stretched;
        sums[n % LANES] += stretched.abs();
        power *= part;
    }
    sums
}

/// The series on a part of its interval.
#[inline]
pub(crate) fn stretch(a: &mut Series, part: f64) {
    if part == 1.0 {
        return;
    }
    let mut power = 1.0;
    for a in a.iter_mut() {
        *a *= power;
        power *= part;
    }
}

#[cfg(test)]
mod real_tests {
    use super::*;

    fn f<T: Real>(x: T) -> T {
        let (sin, cos) = x.sin_cos();
        (T::of(2.0) + sin * cos).sqrt() * (x - T::of(9.0)).inverse() + -x
    }

    #[test]
    fn a_slope_is_the_difference_quotient() {
        let (x, h) = (0.7, 1e-3);
        let dual = f(DualNumber { value: x, slope: 1.0 });
        let odd = |k: f64| f(x + k * h) - f(x - k * h);
        let difference = (45.0 * odd(1.0) - 9.0 * odd(2.0) + odd(3.0)) / (60.0 * h);
        assert_eq!(dual.value, f(x));
        assert!((dual.slope - difference).abs() < 1e-12, "{} {difference}", dual.slope);
    }
}

#[cfg(test)]
mod power_series_tests {
    use super::*;

    #[test]
    fn derivatives_are_those_term_by_term() {
        let a: Series =
            std::array::from_fn(|n| (1.7 * n as f64 + 0.3).sin() * 0.8f64.powi(n as i32));
        let first = derivative(&a);
        let second = derivative(&first);
        for s in [0.0, 0.13, 0.5, 0.97, 1.0] {
            let plain = |a: &Series| a.iter().rev().fold(0.0, |sum, a| sum * s + a);
            let found = slopes(&a, s);
            for (found, a) in found.iter().zip([&a, &first, &second]) {
                let size = a.iter().map(|a| a.abs()).sum::<f64>();
                assert!((found - plain(a)).abs() < 4e-16 * size, "{s}");
            }
            assert_eq!(value(&a, s), found[0]);
            assert_eq!(values(&a, &[s, 0.3])[0], found[0]);
            assert!((of_few(&a, s)[1] - found[1]).abs() < 1e-13);
        }
    }
}
