//! The scalar inclusion with two signs that a tracking step away from the wall reduces to.
//!
//! ```text
//! b in y + w1 sgn(y - p1) + w2 sgn(y - p2)
//! ```
//!
//! The right-hand side is strictly monotone with range R, so there is exactly one `y`; the signs
//! are unique unless `y = p1 = p2`.

/// A sign with its weight `w > 0` and the point `p` at which it switches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Switch {
    /// Where it switches.
    pub at: f64,
    /// What it weighs.
    pub weight: f64,
}

/// The solution and its two signs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Balance {
    /// The unknown.
    pub y: f64,
    /// A value of `sgn(y - p1)`.
    pub first: f64,
    /// A value of `sgn(y - p2)`.
    pub second: f64,
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
#[inline]
#[must_use]
pub fn balance(b: f64, first: Switch, second: Switch) -> Balance {
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
    if first.at < second.at {
        let (y, low, high) = ordered(b, first, second);
        Balance { y, first: low, second: high }
    } else {
        let (y, low, high) = ordered(b, second, first);
        Balance { y, first: high, second: low }
    }
}

/// The same with `low.at < high.at`: the five pieces of the graph from its upper end downwards.
#[inline]
fn ordered(b: f64, low: Switch, high: Switch) -> (f64, f64, f64) {
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
pub(super) fn cut(sign: f64) -> f64 {
    sign.clamp(-1.0, 1.0)
}
