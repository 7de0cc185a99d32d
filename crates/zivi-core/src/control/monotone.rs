//! The scalar inclusion with two signs that a tracking step away from the wall reduces to.
//!
//! ```text
//! b in y + w1 sgn(y - p1) + w2 sgn(y - p2)
//! ```
//!
//! The right-hand side is strictly monotone with range R, so there is exactly one `y`; the signs
//! are unique unless `y = p1 = p2`.

use crate::Real;

/// A sign with its weight `w > 0` and the point `p` at which it switches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Switch {
    /// Where it switches.
    pub at: Real,
    /// What it weighs.
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

/// Solves `b in y + w1 sgn(y - p1) + w2 sgn(y - p2)`, in at most five comparisons. Where both
/// switches are met at once (`y = p1 = p2`) both signs take the same value.
///
/// ```
/// use zivi_core::control::monotone::{balance, Switch};
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
mod tests {
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
