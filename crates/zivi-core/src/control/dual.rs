//! Numbers that carry their derivatives with respect to `N` unknowns: an equation is written once
//! and gives its Jacobian too.

use core::ops::{Add, Div, Mul, Sub};

/// A value and its gradient; `Dual<0>` is a plain number.
#[derive(Clone, Copy, Debug)]
pub(super) struct Dual<const N: usize> {
    pub(super) value: f64,
    pub(super) gradient: [f64; N],
}

impl<const N: usize> Dual<N> {
    /// A constant.
    pub(super) fn constant(value: f64) -> Self {
        Self { value, gradient: [0.0; N] }
    }

    /// The `index`-th unknown.
    pub(super) fn unknown(value: f64, index: usize) -> Self {
        let mut gradient = [0.0; N];
        if let Some(own) = gradient.get_mut(index) {
            *own = 1.0;
        }
        Self { value, gradient }
    }

    /// `value` with the gradient `p a' + q b'`.
    fn combined(value: f64, p: f64, a: [f64; N], q: f64, b: [f64; N]) -> Self {
        let mut gradient = [0.0; N];
        for ((g, a), b) in gradient.iter_mut().zip(a).zip(b) {
            *g = p * a + q * b;
        }
        Self { value, gradient }
    }
}

impl<const N: usize> Add for Dual<N> {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self::combined(self.value + other.value, 1.0, self.gradient, 1.0, other.gradient)
    }
}

impl<const N: usize> Sub for Dual<N> {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self::combined(self.value - other.value, 1.0, self.gradient, -1.0, other.gradient)
    }
}

impl<const N: usize> Mul for Dual<N> {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        let value = self.value * other.value;
        Self::combined(value, other.value, self.gradient, self.value, other.gradient)
    }
}

impl<const N: usize> Div for Dual<N> {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let value = self.value / other.value;
        let inverse = 1.0 / other.value;
        Self::combined(value, inverse, self.gradient, -value * inverse, other.gradient)
    }
}

impl<const N: usize> Mul<f64> for Dual<N> {
    type Output = Self;
    fn mul(self, factor: f64) -> Self {
        Self::combined(self.value * factor, factor, self.gradient, 0.0, [0.0; N])
    }
}

impl<const N: usize> Add<f64> for Dual<N> {
    type Output = Self;
    fn add(self, term: f64) -> Self {
        Self { value: self.value + term, ..self }
    }
}
