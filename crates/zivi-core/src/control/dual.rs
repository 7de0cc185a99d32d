//! Numbers that carry their derivatives with respect to `N` unknowns: an equation is written once
//! and gives its Jacobian too.

use crate::Real;
use core::ops::{Add, Div, Mul, Sub};

/// A value and its gradient; `Dual<0>` is a plain number.
#[derive(Clone, Copy, Debug)]
pub(super) struct Dual<const N: usize> {
    pub(super) value: Real,
    pub(super) gradient: [Real; N],
}

impl<const N: usize> Dual<N> {
    /// A constant.
    pub(super) fn constant(value: Real) -> Self {
        Self { value, gradient: [0.0; N] }
    }

    /// The `index`-th unknown.
    pub(super) fn unknown(value: Real, index: usize) -> Self {
        let mut gradient = [0.0; N];
        if let Some(own) = gradient.get_mut(index) {
            *own = 1.0;
        }
        Self { value, gradient }
    }

    /// `value` with the gradient `p a' + q b'`.
    fn combined(value: Real, p: Real, a: [Real; N], q: Real, b: [Real; N]) -> Self {
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

impl<const N: usize> Mul<Real> for Dual<N> {
    type Output = Self;
    fn mul(self, factor: Real) -> Self {
        Self::combined(self.value * factor, factor, self.gradient, 0.0, [0.0; N])
    }
}

impl<const N: usize> Add<Real> for Dual<N> {
    type Output = Self;
    fn add(self, term: Real) -> Self {
        Self { value: self.value + term, ..self }
    }
}
