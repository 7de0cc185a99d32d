//! An impact of a mass on its wall.

/// One impact: when, and the velocities on both sides of it (their ratio is `-e`).
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)] // lists of impacts are handed out as numbers
pub struct Impact {
    /// Time (s): where `s` crosses zero, linear within the step.
    pub t: f64,
    /// Velocity before, `-(1 + kappa) |v|` (m/s).
    pub xdot_before: f64,
    /// Velocity after, `(1 - kappa) |v|` (m/s).
    pub xdot_after: f64,
}
