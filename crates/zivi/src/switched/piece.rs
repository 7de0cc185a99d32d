//! What one step of the integrator covers, and how much work it was.

use super::point::Point;
use crate::Impact;

/// How much work was done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Evaluations of the force.
    pub nfev: u64,
    /// Steps that were taken in flight.
    pub accepted: u64,
    /// Steps that were tried and given up for smaller ones.
    pub rejected: u64,
    /// Impacts that were computed; those that a jump to rest skips are not among them.
    pub impacts: u64,
}

/// A part of the motion that one step of the integrator covers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Piece {
    /// Free flight from a state, up to an impact if there is one.
    Flight { from: Point, sigma: f64, impact: Option<Impact> },
    /// Infinitely many impacts, of which the integrator knows more.
    Tail,
    /// Rest since a time, up to a lift-off or as far as the force was looked at.
    Rest { from: f64, lifted: bool },
}
