//! The states that runs record.

use super::contact_mode::ContactMode;

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
pub(crate) fn is_sigma(sigma: f64) -> bool {
    sigma.abs() == 1.0
}

/// A state of the motion: coordinates, gaps and slips, their rates, and the mode.
#[derive(Clone, Debug, PartialEq)]
pub struct MotionPoint {
    /// `q`, then `g`, then with friction how far each channel has slipped, and a number without meaning.
    pub x: Vec<f64>,
    /// `q'`, then `g'`, then with friction the slip speeds, and the work that friction has dissipated.
    pub v: Vec<f64>,
    /// The gaps that are closed, and what friction does.
    pub mode: ContactMode,
}

/// A state that is recorded.
pub(crate) trait Recorded: Clone {
    /// How many numbers it consists of.
    fn numbers(&self) -> usize;
}

impl Recorded for PathPoint {
    fn numbers(&self) -> usize {
        3
    }
}

impl Recorded for MotionPoint {
    fn numbers(&self) -> usize {
        self.x.len() + self.v.len()
    }
}
