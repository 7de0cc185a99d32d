//! Flights of known length: where they start, where they end.

/// Where a flight starts and when it ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flight {
    /// Start (s).
    pub from: f64,
    /// Distance there (m).
    pub x: f64,
    /// Velocity there (m/s).
    pub xdot: f64,
    /// End (s).
    pub to: f64,
}

/// The end of a flight and its derivatives.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Flown {
    /// Distance at the end (m).
    pub x: f64,
    /// Velocity at the end (m/s).
    pub xdot: f64,
    /// Accelerations at both ends (m/s^2).
    pub pull: [f64; 2],
    /// Derivatives of the distance at the end by the initial distance, the initial velocity, and
    /// the parameters.
    pub dx: Vec<f64>,
    /// Those of the velocity.
    pub dv: Vec<f64>,
    /// The lowest minimum of the distance between the ends: when (s), and the distance (m), which
    /// is infinite where there is none.
    pub lowest: (f64, f64),
}
