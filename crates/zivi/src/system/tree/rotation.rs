//! Rotations in space: three coordinates with two charts.
//!
//! ```text
//! s = p / (1 + p_0)      R = 1 + c ((1 - s.s) S + 2 S S)      omega = c ((1 - s.s) s' + 2 s x s' + 2 s (s.s'))
//! c = 4 / (1 + s.s)^2    omega' = ... + 2 c (s'.s') s - 4 (s.s') / (1 + s.s) omega
//! ```
//!
//! is the stereographic projection of the unit quaternion `(p_0, p)`, in axes of the frame that carries the rotation;
//! `S` is the matrix of `s x`. `-p` is the same rotation, with the coordinates `-s / s.s`: one of both is at most one. The
//! matrix of `omega` is orthogonal but for its factor, so that no chart is singular before `|s|` is infinite, a whole
//! turn (J. Stuelpnagel, On the parametrization of the three-dimensional rotation group, SIAM Review 6, 1964).

use super::frame::{add, cross, dot, place, read, scaled, turned, zero, Columns, Frame, Vector};
use crate::numeric::power_series::Real;

/// A rotation and how it turns, in axes of the frame that carries it.
struct Turning<T> {
    s: Vector<T>,
    square: T,
    factor: T,
}

impl<T: Real> Turning<T> {
    fn of(s: Vector<T>) -> Self {
        let square = dot(s, s);
        let part = (square + T::of(1.0)).inverse();
        Self { s, square, factor: T::of(4.0) * part * part }
    }

    /// `1 - s.s`.
    fn rest(&self) -> T {
        T::of(1.0) - self.square
    }

    /// The axes of the body, `R`.
    fn axes(&self) -> Columns<T> {
        std::array::from_fn(|k| {
            let mut axis = zero();
            axis[k] = T::of(1.0);
            let once = cross(self.s, axis);
            let twice = cross(self.s, once);
            let more = add(scaled(once, self.rest()), scaled(twice, T::of(2.0)));
            add(axis, scaled(more, self.factor))
        })
    }

    /// `omega` for the rates `v`.
    fn omega(&self, v: Vector<T>) -> Vector<T> {
        let along = dot(self.s, v);
        let across = add(scaled(cross(self.s, v), T::of(2.0)), scaled(self.s, along + along));
        scaled(add(scaled(v, self.rest()), across), self.factor)
    }

    /// The rates for `omega`: its matrix is orthogonal but for a factor.
    fn rates(&self, omega: Vector<T>) -> Vector<T> {
        let along = dot(self.s, omega);
        let across = add(scaled(cross(self.s, omega), T::of(-2.0)), scaled(self.s, along + along));
        scaled(add(scaled(omega, self.rest()), across), T::of(0.25))
    }

    /// `omega'` without `s''`.
    fn bias(&self, v: Vector<T>) -> Vector<T> {
        let two = self.factor * T::of(2.0) * dot(v, v);
        let part = (self.square + T::of(1.0)).inverse();
        let back = T::of(-4.0) * dot(self.s, v) * part;
        add(scaled(self.s, two), scaled(self.omega(v), back))
    }
}

impl<T: Real> Frame<T> {
    /// The frame of the coordinate `k` of a rotation, which is that of joint `i`, on this one: that of the last turns.
    pub(super) fn next_in_rotation(
        &self,
        k: u8,
        numbers: &[T],
        (i, q, w): (usize, &[T], &[T]),
    ) -> Self {
        let k = usize::from(k);
        let first = i - k;
        let turning = Turning::of(read(q, first));
        let axes = [0, 1, 2].map(|k| turned(&self.axes, read(numbers, place::AXES + 3 * k)));
        let arm = turned(&self.axes, read(numbers, place::POSITION));
        let mut unit = zero();
        unit[k] = T::of(1.0);
        let still = Self {
            axes,
            along: turned(&axes, turning.omega(unit)),
            origin: add(self.origin, arm),
            arm,
            omega: self.omega,
            velocity: self.velocity_at(arm),
            alpha: self.alpha,
            acceleration: self.acceleration_at(arm),
        };
        if k < 2 {
            return still;
        }
        let v = read(w, first);
        let [omega, bias] = [turning.omega(v), turning.bias(v)].map(|it| turned(&axes, it));
        Self {
            axes: turning.axes().map(|axis| turned(&axes, axis)),
            omega: add(self.omega, omega),
            alpha: add(self.alpha, add(cross(self.omega, omega), bias)),
            ..still
        }
    }
}

/// Takes a rotation with `|s| > far` into its other chart; whether that was so.
pub(super) fn change_chart(far: f64, s: &mut [f64], v: &mut [f64]) -> bool {
    let here = Turning::of(read(s, 0));
    if here.square.is_nan() || here.square <= far * far {
        return false;
    }
    let omega = here.omega(read(v, 0));
    let there = Turning::of(scaled(here.s, -here.square.recip()));
    v.copy_from_slice(&there.rates(omega));
    s.copy_from_slice(&there.s);
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::power_series::DualNumber;

    const S: Vector<f64> = [0.7, -1.1, 0.4];
    const V: Vector<f64> = [0.3, 0.9, -0.5];

    fn dual(s: Vector<f64>, v: Vector<f64>) -> Vector<DualNumber> {
        std::array::from_fn(|k| DualNumber { value: s[k], slope: v[k] })
    }

    fn near(a: Vector<f64>, b: Vector<f64>) {
        assert!((0..3).all(|k| (a[k] - b[k]).abs() < 1e-14), "{a:?} {b:?}");
    }

    #[test]
    fn axes_turn_with_omega_and_omega_changes_by_the_bias() {
        let (here, moved) = (Turning::of(S), Turning::of(dual(S, V)));
        let omega = here.omega(V);
        for (axis, moved) in here.axes().into_iter().zip(moved.axes()) {
            near(moved.map(|it| it.slope), cross(omega, axis));
        }
        let steady = V.map(DualNumber::of);
        near(moved.omega(steady).map(|it| it.slope), here.bias(V));
        near(here.rates(omega), V);
    }

    #[test]
    fn both_charts_have_one_rotation_and_one_angular_velocity() {
        let (mut s, mut v) = (S, V);
        assert!(!change_chart(2.0, &mut s, &mut v) && s == S);
        assert!(change_chart(1.0, &mut s, &mut v) && dot(s, s) < 1.0);
        let (one, other) = (Turning::of(S), Turning::of(s));
        near(one.omega(V), other.omega(v));
        for (a, b) in one.axes().into_iter().zip(other.axes()) {
            near(a, b);
        }
        assert!(!change_chart(1.0, &mut s, &mut v));
    }
}
