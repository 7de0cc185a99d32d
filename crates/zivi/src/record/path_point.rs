//! A point of a motion.

/// A state at some time, and on which branch of the transform it lies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathPoint {
    /// Distance from the wall, `>= 0` (m).
    pub x: f64,
    /// Velocity (m/s); at the time of an impact the one after it.
    pub xdot: f64,
    /// Branch, `+1` or `-1`: it changes at each impact, and `s = sigma x`.
    pub sigma: f64,
}

/// Whether a number is one of the two branches.
pub(crate) fn is_side(sigma: f64) -> bool {
    sigma.abs() == 1.0
}
