//! The pairs of signs that a step can have.

use crate::Real;

/// Which signs are interior, and the ends that the others take, seen from the side of the state
/// (`lambda_s = 1` is the side where the mass is).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pattern {
    /// `s_gamma = v_gamma = 0`.
    Origin,
    /// `s_gamma = 0`, with this `lambda_v`.
    Wall(Real),
    /// `v_gamma = 0`, with this `lambda_s`.
    Apex(Real),
    /// These `lambda_s` and `lambda_v`.
    Regular(Real, Real),
}

/// All patterns, the most degenerate first: the order of [`super::selection`].
pub const PATTERNS: [Pattern; 9] = [
    Pattern::Origin,
    Pattern::Wall(1.0),
    Pattern::Wall(-1.0),
    Pattern::Apex(1.0),
    Pattern::Apex(-1.0),
    Pattern::Regular(1.0, 1.0),
    Pattern::Regular(1.0, -1.0),
    Pattern::Regular(-1.0, 1.0),
    Pattern::Regular(-1.0, -1.0),
];
