//! The error of a step, and what is allowed of it.

/// What the local error of a step is kept below: `atol + rtol |y|`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Tolerances {
    pub(crate) rtol: f64,
    /// Of a coordinate and of its rate.
    pub(crate) atol: [f64; 2],
    /// What rounding does to the time, in units of `eps t`: no more can be asked.
    pub(crate) rounding: f64,
}

impl Tolerances {
    /// Those of a coordinate and its rate, with the larger of the values at both ends of a step.
    #[inline]
    pub(crate) fn scales(&self, one: (f64, f64), other: (f64, f64)) -> [f64; 2] {
        let [atol_x, atol_xdot] = self.atol;
        [
            atol_x + self.rtol * one.0.abs().max(other.0.abs()),
            atol_xdot + self.rtol * one.1.abs().max(other.1.abs()),
        ]
    }
}

/// Error of a coordinate and its rate in a step, before scaling.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct StepError {
    pub(crate) x: [f64; 2],
    pub(crate) xdot: [f64; 2],
    /// Whether there are two estimates, of orders 5 and 3.
    pub(crate) double: bool,
}

impl StepError {
    /// The larger of the two components, each by its scale.
    #[inline]
    pub(crate) fn norm(&self, [scale_x, scale_xdot]: [f64; 2]) -> f64 {
        let one = |[first, second]: [f64; 2], scale: f64| {
            let (first, second) = ((first / scale).abs(), second / scale);
            if !self.double || first == 0.0 {
                return first;
            }
            // of the orders 5 and 3, together of order 7: e5^2/sqrt(e5^2 + 0.01 e3^2)
            first * (first / first.hypot(0.1 * second))
        };
        worse(one(self.x, scale_x), one(self.xdot, scale_xdot))
    }
}

/// The larger of two errors; one that is not a number is the largest.
#[inline]
pub(crate) fn worse(one: f64, other: f64) -> f64 {
    // f64::max would drop NaN
    if one > other || one.is_nan() {
        one
    } else {
        other
    }
}
