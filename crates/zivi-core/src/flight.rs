//! A parabola above the wall.

use crate::real::sqrt;
use crate::{Physical, Real};

/// Time until a mass under the constant acceleration `f` meets the wall, from `x = 0` the next time,
/// if it does; written so that nothing cancels.
///
/// ```
/// use zivi_core::{flight, Physical};
/// let t = flight::time_to_wall(Physical { x: 2.0, xdot: 0.0 }, -4.0);
/// assert_eq!(t, Some(1.0));
/// assert_eq!(flight::time_to_wall(Physical { x: 2.0, xdot: 0.0 }, 4.0), None);
/// ```
#[inline]
#[must_use]
pub fn time_to_wall(Physical { x, xdot }: Physical, f: Real) -> Option<Real> {
    if x == 0.0 {
        return (xdot > 0.0 && f < 0.0).then(|| 2.0 * xdot / -f);
    }
    let discriminant = xdot * xdot - 2.0 * f * x;
    if xdot < 0.0 {
        (discriminant >= 0.0).then(|| 2.0 * x / (sqrt(discriminant) - xdot))
    } else {
        (f < 0.0).then(|| (xdot + sqrt(discriminant)) / -f)
    }
}

/// Speed with which it does: from the energy, where nothing cancels; from the wall that of the start.
#[inline]
#[must_use]
pub fn speed_at_wall(Physical { x, xdot }: Physical, f: Real) -> Real {
    if x == 0.0 {
        xdot.abs()
    } else {
        sqrt((xdot * xdot - 2.0 * f * x).max(0.0))
    }
}
