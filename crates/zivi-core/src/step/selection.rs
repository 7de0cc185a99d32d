//! Which solution is taken when the step has several.
//!
//! * `f <= 0` (pressed to the wall): the solution is unique when `theta >= gamma`. Numerically
//!   coincident candidates, and the distinct ones that `theta < gamma` allows, are taken in the
//!   order origin, wall, apex, regular. The order keeps exact rest exact.
//! * `f > 0` (pulled off the wall): 1, 3 or 5 solutions, three of them at the origin (stay, leave,
//!   leave on the other side). The candidate nearest to the exact motion over `h` under the frozen
//!   force is taken, in the distance
//!
//!   ```text
//!   |s+ - s_exact| / (h^2 f)  +  |v+ - v_exact| / (h f)
//!   ```
//!
//!   At the origin it always leaves, on the side where the mass was last.

use super::StepSolution;
use crate::real::sqrt;
use crate::transform::impact_velocities;
use crate::Real;
use crate::{sgn, Lifted, Restitution};

/// The exact motion over `h` under a constant force `f > 0`, from a state on the side `+1`
/// (`s > 0`, or `s = 0` and `v >= 0`).
///
/// In free flight `x(h) = x + x' h + f h^2/2`. Before it turns, the mass can reach the wall once
/// (when `x'^2 >= 2 f x`); afterwards it only moves away. `v = x'/(1 - kappa sgn x')`, on the
/// other side with the opposite sign.
///
/// ```
/// use zivi_core::{step::selection, Lifted, Restitution};
/// let restitution = Restitution::from_e(0.5)?;
/// let up = selection::exact_motion(Lifted::default(), 2.0, 0.1, restitution);
/// assert!((up.s - 0.01).abs() < 1e-15); // f h^2/2
/// # Ok::<(), zivi_core::RestitutionError>(())
/// ```
#[must_use]
pub fn exact_motion(z: Lifted, f: Real, h: Real, restitution: Restitution) -> Lifted {
    let xdot = restitution.r(1.0, sgn(z.v)) * z.v;
    let (side, x, xdot, time) = match time_of_impact(z.s, xdot, f).filter(|&t| t <= h) {
        Some(t) => {
            let (_, after) =
                impact_velocities((xdot + f * t) / restitution.r(1.0, -1.0), restitution);
            (-1.0, 0.0, after, h - t)
        }
        None => (1.0, z.s, xdot, h),
    };
    let Lifted { s, v } = flight(x, xdot, f, time, restitution);
    Lifted { s: side * s, v: side * v }
}

/// First root of `x + x' t + f t^2/2`, for a mass that approaches (`x' < 0`).
fn time_of_impact(x: Real, xdot: Real, f: Real) -> Option<Real> {
    let discriminant = xdot * xdot - 2.0 * f * x;
    // 2x/(|x'| + sqrt(..)) is the smaller root (|x'| - sqrt(..))/f without cancellation
    (xdot < 0.0 && discriminant >= 0.0).then(|| 2.0 * x / (sqrt(discriminant) - xdot))
}

fn flight(x: Real, xdot: Real, f: Real, t: Real, restitution: Restitution) -> Lifted {
    let end = xdot + f * t;
    Lifted { s: x + t * (xdot + 0.5 * f * t), v: end / restitution.r(1.0, sgn(end)) }
}

/// `h^2 f` times the distance between a candidate and the exact motion (the common factor does
/// not matter to the order and could underflow).
#[inline]
pub(super) fn distance(candidate: &StepSolution, exact: Lifted, h: Real) -> Real {
    (candidate.s - exact.s).abs() + h * (candidate.v - exact.v).abs()
}

#[cfg(test)]
#[allow(clippy::expect_used)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Independent route: the physical motion by many small exact parabolas with the reset.
    fn fine_motion(x: Real, xdot: Real, f: Real, h: Real, e: Real) -> (Real, Real, bool) {
        let (n, mut x, mut w, mut hit) = (20_000, x, xdot, false);
        let dt = h / (n as Real);
        for _ in 0..n {
            x += dt * (w + 0.5 * f * dt);
            w += f * dt;
            if x < 0.0 && w < 0.0 {
                (x, w, hit) = (-x * e, -e * w, true);
            }
        }
        (x, w, hit)
    }

    proptest! {
        #[test]
        fn exact_motion_agrees_with_a_fine_simulation(
            x in 0.0..2.0f64, xdot in -4.0..4.0f64, f in 0.1..5.0f64, h in 0.1..1.0f64, e in 0.1..1.0f64,
        ) {
            let restitution = Restitution::from_e(e).expect("e in [0, 1]");
            let v = xdot / restitution.r(1.0, sgn(xdot));
            prop_assume!(x > 1e-3);
            let end = exact_motion(Lifted { s: x, v }, f, h, restitution);
            let (x_fine, xdot_fine, hit) = fine_motion(x, xdot, f, h, e);
            let physical = crate::transform::project(end, restitution);
            prop_assume!(physical.x > 2e-3); // not within a fine step of an impact
            prop_assert_eq!(hit, end.s < 0.0);
            prop_assert!((physical.x - x_fine).abs() < 2e-3);
            prop_assert!((physical.xdot - xdot_fine).abs() < 2e-3);
        }
    }
}
