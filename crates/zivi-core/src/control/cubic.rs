//! Scalar equations of an update: cubic and piecewise linear monotone ones.
//!
//! The first root of a cubic that a bracket is known for: the only iteration of an update.

use crate::real::sqrt;
use crate::Real;

/// `((c3 z + c2) z + c1) z + c0`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cubic {
    /// Constant term.
    pub c0: Real,
    /// Coefficient of `z`.
    pub c1: Real,
    /// Coefficient of `z^2`.
    pub c2: Real,
    /// Coefficient of `z^3`.
    pub c3: Real,
}

/// Maximal number of evaluations for one root.
pub const MAX_ITERATIONS: u32 = 64;

impl Cubic {
    /// The value at `z`, by Horner's rule.
    #[inline]
    #[must_use]
    pub fn at(&self, z: Real) -> Real {
        ((self.c3 * z + self.c2) * z + self.c1) * z + self.c0
    }

    #[inline]
    fn slope(&self, z: Real) -> Real {
        (3.0 * self.c3 * z + 2.0 * self.c2) * z + self.c1
    }

    #[inline]
    fn curvature(&self, z: Real) -> Real {
        6.0 * self.c3 * z + 2.0 * self.c2
    }

    /// The root nearest to `from` between `from` and `to`, at which the cubic has different signs,
    /// and the number of Newton steps and bisections. Where rounding has left no change of sign the
    /// answer is `to`.
    ///
    /// ```
    /// use zivi_core::control::cubic::Cubic;
    /// let cubic = Cubic { c0: -0.006, c1: 0.11, c2: -0.6, c3: 1.0 }; // roots 0.1, 0.2, 0.3
    /// let (root, _) = cubic.first_root(1.0, -1.0);
    /// assert!((root - 0.3).abs() < 1e-15);
    /// ```
    #[must_use]
    pub fn first_root(&self, from: Real, to: Real) -> (Real, u32) {
        self.next_root(from, to).unwrap_or((to, 0))
    }

    /// The same where there need not be a root: none is found when the sign at `from` lasts up to
    /// `to`.
    #[must_use]
    pub fn next_root(&self, from: Real, to: Real) -> Option<(Real, u32)> {
        let start = self.at(from);
        if start == 0.0 {
            return Some((from, 0));
        }
        let (near, far) = self.piece(from, to, start);
        if start * self.at(far) > 0.0 {
            return None;
        }
        Some(self.newton(near, far, start > 0.0))
    }

    /// The first piece between `from` and `to` on which the sign changes: the pieces are bounded
    /// by the extrema and the inflection, so the cubic is monotone and bends one way on each.
    fn piece(&self, from: Real, to: Real, start: Real) -> (Real, Real) {
        let mut near = from;
        for bend in self.bends(from < to) {
            let ahead = if from < to { bend > near && bend < to } else { bend < near && bend > to };
            if ahead {
                if start * self.at(bend) <= 0.0 {
                    return (near, bend);
                }
                near = bend;
            }
        }
        (near, to)
    }

    /// Extremum, inflection, extremum, in the direction of travel (NaN if absent).
    fn bends(&self, rising: bool) -> [Real; 3] {
        let discriminant = self.c2 * self.c2 - 3.0 * self.c3 * self.c1;
        let root = sqrt(discriminant);
        // the larger numerator without cancellation, the other extremum from their product
        let q = -(self.c2 + if self.c2 < 0.0 { -root } else { root });
        let (a, b) = (q / (3.0 * self.c3), self.c1 / q);
        let middle = -self.c2 / (3.0 * self.c3);
        if (a < b) == rising {
            [a, middle, b]
        } else {
            [b, middle, a]
        }
    }

    /// Newton's method on a monotone interval of one curvature, from the end where it cannot
    /// overshoot (Fourier's condition): it approaches the root from one side; a reversal or an
    /// overshoot means that rounding has been reached. A flat end is left by bisection.
    fn newton(&self, near: Real, far: Real, near_positive: bool) -> (Real, u32) {
        let bends_up = self.curvature(0.5 * (near + far)) > 0.0;
        let (start, other) = if bends_up == near_positive { (near, far) } else { (far, near) };
        let way = Real::copysign(1.0, other - start); // a factor: cases would be there twice
        let (mut before, mut beyond) = (start, other);
        let (mut z, mut cannot_overshoot) = (start, false);
        for count in 1..=MAX_ITERATIONS {
            let value = self.at(z);
            let overshot = (value > 0.0) != bends_up;
            let next = z - value / self.slope(z);
            let onward = way * (next - z) > 0.0;
            if value == 0.0 || !overshot && !onward {
                return (z, count);
            }
            if overshot {
                beyond = z;
            } else {
                before = z;
            }
            let inside = way * (next - before) >= 0.0 && way * (beyond - next) >= 0.0;
            if overshot && cannot_overshoot {
                // what is left is the rounding of the step that led here: one from here is finer
                return (if inside { next } else { z }, count);
            }
            cannot_overshoot = inside && !overshot;
            z = if inside { next } else { 0.5 * (before + beyond) };
        }
        (z, MAX_ITERATIONS)
    }
}

// The scalar inclusion with two signs that a tracking step away from the wall reduces to.
//
// ```text
// b in y + w1 sgn(y - p1) + w2 sgn(y - p2)
// ```
//
// The right-hand side is strictly monotone with range R, so there is exactly one `y`; the signs
// are unique unless `y = p1 = p2`.

/// A sign with its weight `w > 0` and the point `p` at which it switches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Switch {
    /// Where it switches.
    pub at: Real,
    /// Its weight.
    pub weight: Real,
}

/// The solution and its two signs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Balance {
    /// The unknown.
    pub y: Real,
    /// A value of `sgn(y - p1)`.
    pub first: Real,
    /// A value of `sgn(y - p2)`.
    pub second: Real,
}

/// Solves `b in y + w1 sgn(y - p1) + w2 sgn(y - p2)`, in at most five comparisons. If both switches
/// are met simultaneously (`y = p1 = p2`) both signs take the same value.
///
/// ```
/// use zivi_core::control::cubic::{balance, Switch};
/// let slow = Switch { at: 0.0, weight: 3.0 };
/// let fast = Switch { at: 1.0, weight: 2.0 };
/// let found = balance(4.5, slow, fast); // y stays at the second switch
/// assert_eq!((found.y, found.first, found.second), (1.0, 1.0, 0.25));
/// ```
#[inline(never)]
#[must_use]
pub fn balance(b: Real, first: Switch, second: Switch) -> Balance {
    if first.at == second.at {
        let weight = first.weight + second.weight;
        let share = (b - first.at) / weight;
        return if share > 1.0 {
            Balance { y: b - weight, first: 1.0, second: 1.0 }
        } else if share < -1.0 {
            Balance { y: b + weight, first: -1.0, second: -1.0 }
        } else {
            Balance { y: first.at, first: share, second: share }
        };
    }
    let in_order = first.at < second.at;
    let (low, high) = if in_order { (first, second) } else { (second, first) };
    let (y, low, high) = ordered(b, low, high);
    let (first, second) = if in_order { (low, high) } else { (high, low) };
    Balance { y, first, second }
}

/// The same with `low.at < high.at`: the five pieces of the graph from its upper end downwards.
#[inline]
fn ordered(b: Real, low: Switch, high: Switch) -> (Real, Real, Real) {
    let (sum, difference) = (low.weight + high.weight, low.weight - high.weight);
    let (over_high, over_low) = (b - high.at, b - low.at);
    if over_high > sum {
        (b - sum, 1.0, 1.0)
    } else if over_high >= difference {
        (high.at, 1.0, cut((over_high - low.weight) / high.weight))
    } else if over_low > difference {
        (b - difference, 1.0, -1.0)
    } else if over_low >= -sum {
        (low.at, cut((over_low + high.weight) / low.weight), -1.0)
    } else {
        (b + sum, -1.0, -1.0)
    }
}

/// Cuts to `[-1, 1]`.
#[inline]
pub(super) fn cut(sign: Real) -> Real {
    sign.clamp(-1.0, 1.0)
}

#[cfg(test)]
mod cubic_tests {
    use super::*;
    use proptest::prelude::*;

    /// `scale (z - a)(z - b)(z - c)`.
    fn with_roots([a, b, c]: [f64; 3], scale: f64) -> Cubic {
        Cubic {
            c0: -scale * a * b * c,
            c1: scale * (a * b + b * c + c * a),
            c2: -scale * (a + b + c),
            c3: scale,
        }
    }

    /// Rounding error of a zero at `z`.
    fn rounding(it: &Cubic, z: f64) -> f64 {
        let z = z.abs();
        8.0 * f64::EPSILON * (((it.c3.abs() * z + it.c2.abs()) * z + it.c1.abs()) * z + it.c0.abs())
    }

    /// The answer is a root to within rounding, in the interval, and a scan meets no other before.
    fn check(it: &Cubic, from: f64, to: f64) -> Result<(), TestCaseError> {
        let Some((root, count)) = it.next_root(from, to) else {
            return nothing_between(it, from, to);
        };
        prop_assert!(from.min(to) <= root && root <= from.max(to), "{} outside", root);
        prop_assert!(count <= MAX_ITERATIONS);
        // an exact triple root at zero is approached by a third each time, relative accuracy never
        let size = it.c0.abs() + it.c1.abs() + it.c2.abs() + it.c3.abs();
        let allowed = if count < MAX_ITERATIONS { 0.0 } else { 1e-30 * size };
        let value = it.at(root).abs();
        prop_assert!(value <= rounding(it, root) + allowed, "{} at {}", value, root);
        nothing_between(it, from, root)
    }

    fn nothing_between(it: &Cubic, from: f64, to: f64) -> Result<(), TestCaseError> {
        let start = it.at(from);
        for part in 0..1000 {
            let z = from + (to - from) * f64::from(part) / 1000.0;
            let value = it.at(z);
            let passed = value * start.signum() < -rounding(it, z);
            prop_assert!(!passed, "{:?}: a root before {} is missed", it, z);
        }
        Ok(())
    }

    /// In both directions between the ends and from an interior point.
    fn check_everywhere(it: Cubic, inside: f64) -> Result<(), TestCaseError> {
        for (from, to) in [(-1.0, 1.0), (1.0, -1.0), (inside, 1.0), (inside, -1.0)] {
            check(&it, from, to)?;
        }
        Ok(())
    }

    proptest! {
        #[test]
        fn the_first_of_three_roots_is_found(
            a in -1.2..1.2f64, b in -1.2..1.2f64, c in -1.2..1.2f64, scale in -9.0..9.0f64, z in -1.0..1.0f64,
        ) {
            check_everywhere(with_roots([a, b, c], scale), z)?;
        }

        #[test]
        fn double_and_triple_roots_and_roots_at_the_ends_are_found(
            a in -1.0..1.0f64, b in -1.0..1.0f64, scale in -9.0..9.0f64, z in -1.0..1.0f64,
        ) {
            let kinds = [[a, a, b], [a, a, a], [1.0, a, b], [-1.0, 1.0, a], [1.0, 1.0, a], [0.0, 0.0, 0.0]];
            for roots in kinds {
                check_everywhere(with_roots(roots, scale), z)?;
            }
        }

        #[test]
        fn any_coefficients_will_do(
            c in prop::array::uniform4(-1.0..1.0f64), size in prop::array::uniform4(-12..3i32), z in -1.0..1.0f64,
        ) {
            let mut c = c;
            for (c, size) in c.iter_mut().zip(size) {
                *c *= libm::pow(10.0, f64::from(size));
            }
            let [c0, c1, c2, c3] = c;
            check_everywhere(Cubic { c0, c1, c2, c3 }, z)?;
            check_everywhere(Cubic { c0, c1, c2, c3: 0.0 }, z)?;
            check_everywhere(Cubic { c0, c1, c2: 0.0, c3: 0.0 }, z)?;
            check_everywhere(Cubic { c0, c1: 0.0, c2, c3 }, z)?;
            check_everywhere(Cubic { c0, c1: 0.0, c2: 0.0, c3 }, z)?;
        }

        #[test]
        fn a_change_of_sign_is_a_root(c in prop::array::uniform4(-1.0..1.0f64)) {
            let [c0, c1, c2, c3] = c;
            let it = Cubic { c0, c1, c2, c3 };
            prop_assert_eq!(it.next_root(1.0, -1.0).is_some() || it.at(1.0) * it.at(-1.0) > 0.0, true);
            let (root, _) = it.first_root(-1.0, 1.0);
            prop_assert_eq!(it.next_root(-1.0, 1.0).map_or(1.0, |(root, _)| root), root);
        }
    }
}

#[cfg(test)]
mod monotone_tests {
    use super::*;
    use crate::sgn;
    use proptest::prelude::*;

    /// The graph jumps from below to above `b` at the solution: found by bisection.
    fn bisected(b: f64, first: Switch, second: Switch) -> f64 {
        let at = |y: f64| y + first.weight * sgn(y - first.at) + second.weight * sgn(y - second.at);
        let reach = first.weight + second.weight;
        let (mut low, mut high) = (b - reach - 1.0, b + reach + 1.0);
        for _ in 0..80 {
            let middle = 0.5 * (low + high);
            if at(middle) > b {
                high = middle;
            } else {
                low = middle;
            }
        }
        0.5 * (low + high)
    }

    fn check(b: f64, first: Switch, second: Switch) -> Result<(), TestCaseError> {
        let found = balance(b, first, second);
        let scale = b.abs() + first.weight + second.weight + first.at.abs() + second.at.abs();
        let tiny = 1e-14 * scale;
        prop_assert!((found.y - bisected(b, first, second)).abs() <= tiny, "{:?}", found);
        let sum = found.y + first.weight * found.first + second.weight * found.second;
        prop_assert!((sum - b).abs() <= tiny, "{:?}: {} for {}", found, sum, b);
        for (sign, switch) in [(found.first, first), (found.second, second)] {
            let fits = sign.abs() <= 1.0 && (found.y == switch.at || sign.abs() == 1.0);
            prop_assert!(fits && sign * (found.y - switch.at) >= -tiny, "{:?}", found);
        }
        Ok(())
    }

    proptest! {
        #[test]
        fn it_is_the_root_that_bisection_finds(
            b in -9.0..9.0f64, p in prop::array::uniform2(-5.0..5.0f64), w in prop::array::uniform2(1e-6..5.0f64),
        ) {
            let [first, second] =
                [Switch { at: p[0], weight: w[0] }, Switch { at: p[1], weight: w[1] }];
            check(b, first, second)?;
            check(b, second, first)?;
            let together = Switch { at: first.at, ..second };
            check(b, first, together)?;
            // on the corners of the graph
            for corner in [first.at, second.at] {
                for sum in [w[0] + w[1], w[0] - w[1]] {
                    check(corner + sum, first, second)?;
                    check(corner - sum, first, together)?;
                }
            }
        }
    }
}
