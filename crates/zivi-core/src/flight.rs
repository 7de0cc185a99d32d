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

/// Impacts of one call that are followed; a mass that has more is taken to rest.
const MAX_IMPACTS: u32 = 64;

/// The state `left` (s) later under the constant acceleration `f`, through impacts with the coefficient
/// of restitution `e` and into rest.
///
/// ```
/// use zivi_core::{flight, Physical};
/// let (down, up) = (Physical { x: 2.0, xdot: 0.0 }, Physical { x: 1.0, xdot: 0.0 });
/// // falls for 1 s, rises with 2 m/s for .5 s, rests after 2 s more
/// assert_eq!(flight::after(down, -4.0, 0.5, 1.5), Physical { x: 0.5, xdot: 0.0 });
/// assert_eq!(flight::after(down, -4.0, 0.5, 3.1), Physical::default());
/// assert_eq!(flight::after(up, 2.0, 0.5, 1.0), Physical { x: 2.0, xdot: 2.0 });
/// ```
#[must_use]
pub fn after(state: Physical, f: Real, e: Real, mut left: Real) -> Physical {
    let mut at = state;
    if at.arrives() {
        at.xdot = 0.0 - e * at.xdot;
    }
    for _ in 0..MAX_IMPACTS {
        // flights 2v/g, 2ev/g, ... take 2v/(g (1 - e)) in all
        if at.x == 0.0 && f <= 0.0 && 2.0 * at.xdot <= left * (1.0 - e) * -f {
            break;
        }
        match time_to_wall(at, f) {
            Some(t) if t <= left => {
                at = Physical { x: 0.0, xdot: e * speed_at_wall(at, f) };
                left -= t;
            }
            _ => {
                let x = at.x + left * (at.xdot + 0.5 * f * left);
                return Physical { x: x.max(0.0), xdot: at.xdot + f * left };
            }
        }
    }
    Physical::default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_falls_meets_the_wall() {
        for (x, xdot, f) in [(2.0, 1.0, 0.0), (2.0, 0.0, 0.0), (2.0, 1.0, 4.0), (0.0, 1.0, 0.0)] {
            assert_eq!(time_to_wall(Physical { x, xdot }, f), None, "{x} {xdot} {f}");
        }
        // x + xdot t + f t^2/2 = 0
        for (x, xdot, f, t) in [(2.0, -1.0, 0.0, 2.0), (6.0, 1.0, -4.0, 2.0), (1.0, -3.0, 4.0, 0.5)]
        {
            assert_eq!(time_to_wall(Physical { x, xdot }, f), Some(t), "{x} {xdot} {f}");
        }
    }

    #[test]
    fn a_flight_ends_between_its_impacts() {
        // down from 2 in 1 s, up with 2 m/s for 1 s, with 1 m/s for .5 s, ..., at rest after 3 s
        let down = Physical { x: 2.0, xdot: 0.0 };
        for (left, x, xdot) in
            [(0.5, 1.5, -2.0), (1.5, 0.5, 0.0), (1.75, 0.375, -1.0), (2.25, 0.125, 0.0)]
        {
            assert_eq!(after(down, -4.0, 0.5, left), Physical { x, xdot }, "{left}");
        }
        assert_eq!(after(down, -4.0, 0.5, 3.0), Physical::default());
    }
}
