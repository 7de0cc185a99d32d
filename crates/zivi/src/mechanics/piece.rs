//! Result of one step of the integrator.

use super::path::Curve;
use super::tail::SkippedArcs;
use crate::record::gap_set::ContactMode;

/// A part of the motion that one step of the machine covers.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Piece {
    /// The last step, up to an event at `length` if that is not its end; the event is yet to come.
    Motion,
    /// Infinitely many impacts of one gap.
    Skipped(SkippedArcs),
    /// Impacts that alternate between several gaps, down to a corner.
    Descent(Vec<Flight>),
    /// Nothing but an event at the present time.
    Instant,
    /// Not even that: rotations have other coordinates.
    Charts,
}

/// A part of the way into a corner, and the mode in it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Flight {
    pub(super) curve: Curve,
    pub(super) mode: ContactMode,
}
