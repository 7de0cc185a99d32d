//! Where the mass is.

use crate::numeric::coordinates::State;
use crate::Physical;

/// The state of the mass at a time.
pub(crate) type Point = State<f64>;

impl Point {
    /// Without the time.
    #[inline(always)]
    pub(super) fn physical(self) -> Physical {
        Physical { x: self.x, xdot: self.xdot }
    }
}
