//! Numbers, plain or with a derivative: what is written once for both gives its derivatives too.

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
pub(crate) struct Dual {
    pub(crate) value: f64,
    pub(crate) slope: f64,
}

impl Add for Dual {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self { value: self.value + other.value, slope: self.slope + other.slope }
    }
}

impl Sub for Dual {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self { value: self.value - other.value, slope: self.slope - other.slope }
    }
}

impl Mul for Dual {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        let slope = self.slope * other.value + self.value * other.slope;
        Self { value: self.value * other.value, slope }
    }
}

impl Neg for Dual {
    type Output = Self;
    fn neg(self) -> Self {
        Self { value: -self.value, slope: -self.slope }
    }
}

impl Real for Dual {
    fn of(value: f64) -> Self {
        Self { value, slope: 0.0 }
    }

    fn sin_cos(self) -> (Self, Self) {
        let (sin, cos) = self.value.sin_cos();
        (
            Self { value: sin, slope: cos * self.slope },
            Self { value: cos, slope: -sin * self.slope },
        )
    }

    fn sqrt(self) -> Self {
        let value = self.value.sqrt();
        Self { value, slope: self.slope / (2.0 * value) }
    }

    fn inverse(self) -> Self {
        let value = 1.0 / self.value;
        Self { value, slope: -self.slope * value * value }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn f<T: Real>(x: T) -> T {
        let (sin, cos) = x.sin_cos();
        (T::of(2.0) + sin * cos).sqrt() * (x - T::of(9.0)).inverse() + -x
    }

    #[test]
    fn a_slope_is_the_difference_quotient() {
        let (x, h) = (0.7, 1e-3);
        let dual = f(Dual { value: x, slope: 1.0 });
        let odd = |k: f64| f(x + k * h) - f(x - k * h);
        let difference = (45.0 * odd(1.0) - 9.0 * odd(2.0) + odd(3.0)) / (60.0 * h);
        assert_eq!(dual.value, f(x));
        assert!((dual.slope - difference).abs() < 1e-12, "{} {difference}", dual.slope);
    }
}
