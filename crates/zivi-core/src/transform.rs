//! The Zhuravlev-Ivanov transform between the physical state `(x, x')` and `(s, v)`.
//!
//! ```text
//! x = |s|      x' = R v sgn s      R = 1 - kappa sgn s sgn v                         (1)
//! s' = R v     v' = sgn(s) f(t, |s|, R v sgn s) / R                                  (2)
//! ```
//!
//! `(s, v)` and `(-s, -v)` describe the same physical state: two branches. `s v > 0` is flight
//! away from the wall (`R = 1 - kappa`), `s v < 0` flight towards it (`R = 1 + kappa`).

use crate::Real;
use crate::{sgn, Restitution};

/// A state in the transform's coordinates: absolutely continuous through impacts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Lifted {
    /// Signed position, `x = |s|` (m).
    pub s: Real,
    /// Transformed velocity (m/s).
    pub v: Real,
}

impl Lifted {
    /// Whether the state and its projection (`|x'| <= 2 |v|`) are finite.
    #[inline(always)]
    #[must_use]
    pub fn is_finite(self) -> bool {
        (self.s + 2.0 * self.v).is_finite()
    }
}

/// A state in physical coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Physical {
    /// Distance from the wall, `x >= 0` (m).
    pub x: Real,
    /// Velocity `x'` (m/s).
    pub xdot: Real,
}

impl Physical {
    /// Whether this is the origin `x = x' = 0`, where the mass rests unless a force lifts it off.
    #[inline(always)]
    #[must_use]
    pub fn is_at_origin(self) -> bool {
        self.x == 0.0 && self.xdot == 0.0
    }

    /// Whether the mass arrives at the wall, `x = 0 > x'`: what comes next is an impact.
    #[inline(always)]
    #[must_use]
    pub fn arrives(self) -> bool {
        self.x == 0.0 && self.xdot < 0.0
    }
}

/// Which of the two preimages a lift takes: the sign of `s` (of `v`, when `x = 0`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Branch {
    /// `s >= 0`, the paper's choice.
    #[default]
    Positive,
    /// `s <= 0`.
    Negative,
}

impl Branch {
    /// `sigma`, which is `+1` or `-1`.
    #[inline]
    #[must_use]
    pub fn sigma(self) -> Real {
        match self {
            Branch::Positive => 1.0,
            Branch::Negative => -1.0,
        }
    }
}

/// The side of the wall on which a state lies: `sgn s`, at the wall `sgn v` (the side that the
/// mass is about to enter), and `last` at the origin, where nothing tells.
#[inline]
#[must_use]
pub fn side(z: Lifted, last: Real) -> Real {
    if z.s != 0.0 {
        Real::copysign(1.0, z.s)
    } else if z.v != 0.0 {
        Real::copysign(1.0, z.v)
    } else {
        last
    }
}

/// Lifts a physical state to the chosen branch.
///
/// ```text
/// s = sigma x      v = sigma x' / (1 - kappa sgn x')
/// ```
///
/// At the wall, an incoming velocity (`x = 0`, `x' < 0`) lifts to the state *at* the impact; its
/// projection is the velocity after it, `-e x'`. For `e = 0` a velocity away from the wall has no
/// finite image (`R = 0`).
///
/// ```
/// use zivi_core::{transform, Branch, Physical, Restitution};
/// let restitution = Restitution::from_kappa(0.41)?;
/// let z = transform::lift(Physical { x: 1.0, xdot: 6.0 }, Branch::Positive, restitution);
/// assert!((z.v - 6.0 / 0.59).abs() < 1e-14);
/// # Ok::<(), zivi_core::RestitutionError>(())
/// ```
#[inline]
#[must_use]
pub fn lift(state: Physical, branch: Branch, restitution: Restitution) -> Lifted {
    let sigma = branch.sigma();
    // x' = 0: R = 1, which includes the plastic wall
    let v = state.xdot / restitution.r(1.0, sgn(state.xdot));
    Lifted { s: sigma * state.x, v: sigma * v }
}

/// Projects back to physical coordinates, equation (1).
///
/// At the wall (`s = 0`, `v != 0`) the velocity after the impact is returned, `(1 - kappa) |v|`;
/// the velocity before it was `-(1 + kappa) |v|`, so their ratio is `-e`.
#[inline]
#[must_use]
pub fn project(z: Lifted, restitution: Restitution) -> Physical {
    let sigma = side(z, 0.0);
    // at v = 0 any R will do
    Physical { x: z.s.abs(), xdot: restitution.r(sigma, Real::copysign(1.0, z.v)) * z.v * sigma }
}

/// Velocities just before and just after the impact at `s = 0`: `-(1 + kappa) |v|` and
/// `(1 - kappa) |v|`, in the ratio `-e` to rounding.
#[must_use]
pub fn impact_velocities(v: Real, restitution: Restitution) -> (Real, Real) {
    let before = restitution.r(1.0, -1.0) * v.abs();
    // (1 - kappa)/(1 + kappa) = e; 1 - kappa would lose the digits of a small e
    (-before, restitution.e() * before)
}

/// The right-hand side of (2) for given values of the set-valued signs.
#[inline]
#[must_use]
pub fn field(v: Real, lambda_s: Real, lambda_v: Real, f: Real, restitution: Restitution) -> Lifted {
    let r = restitution.r(lambda_s, lambda_v);
    Lifted { s: r * v, v: lambda_s * f / r }
}

#[cfg(test)]
#[allow(clippy::expect_used)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn restitution(kappa: Real) -> Restitution {
        Restitution::from_kappa(kappa).expect("kappa in [0, 1]")
    }

    const BRANCHES: [Branch; 2] = [Branch::Positive, Branch::Negative];

    proptest! {
        #[test]
        fn project_undoes_lift(x in 0.0..1e3f64, xdot in -1e3..1e3f64, kappa in 0.0..0.99f64) {
            for branch in BRANCHES {
                let lifted = lift(Physical { x, xdot }, branch, restitution(kappa));
                let back = project(lifted, restitution(kappa));
                prop_assert_eq!(back.x, x);
                prop_assert!((back.xdot - xdot).abs() <= 4.0 * Real::EPSILON * xdot.abs());
            }
        }

        #[test]
        fn both_branches_project_to_one_state(s in -9.0..9.0f64, v in -9.0..9.0f64, kappa in 0.0..1.0f64) {
            let mirrored = project(Lifted { s: -s, v: -v }, restitution(kappa));
            prop_assert_eq!(project(Lifted { s, v }, restitution(kappa)), mirrored);
        }

        #[test]
        fn the_field_is_the_physical_one(s in 0.1..9.0f64, v in -9.0..9.0f64, f in -9.0..9.0f64, kappa in 0.0..0.9f64) {
            // away from switches: x' of the projection is s', and R v' sgn s is f
            let restitution = restitution(kappa);
            let rate = field(v, 1.0, sgn(v), f, restitution);
            let xdot = project(Lifted { s, v }, restitution).xdot;
            prop_assert!((rate.s - xdot).abs() < 1e-13);
            prop_assert!((restitution.r(1.0, sgn(v)) * rate.v - f).abs() < 1e-13);
        }
    }

    #[test]
    fn an_incoming_state_at_the_wall_projects_to_the_state_after_the_impact() {
        for branch in BRANCHES {
            let z = lift(Physical { x: 0.0, xdot: -3.0 }, branch, restitution(0.5));
            let after = project(z, restitution(0.5));
            assert_eq!(after.x, 0.0);
            assert!((after.xdot - 1.0).abs() < 1e-15); // e = 1/3
            assert_eq!(impact_velocities(z.v, restitution(0.5)), (-3.0, after.xdot));
        }
    }

    #[test]
    fn the_velocities_of_an_impact_keep_the_digits_of_e() {
        for e in [1e-3, 1e-9, 1e-15, 0.0] {
            let restitution = Restitution::from_e(e).expect("e in [0, 1]");
            let (before, after) = impact_velocities(2.0, restitution);
            assert!((after + e * before).abs() <= Real::EPSILON * after, "{e}");
        }
    }

    #[test]
    fn a_state_whose_velocity_overflows_is_not_finite() {
        let state = |v| Lifted { s: 0.0, v };
        // x' is up to 2 v
        assert!(state(0.4 * Real::MAX).is_finite() && !state(0.6 * Real::MAX).is_finite());
        assert!(!Lifted { s: Real::INFINITY, v: 0.0 }.is_finite());
    }

    #[test]
    fn rest_lifts_to_the_origin_for_every_restitution() {
        for kappa in [0.0, 0.41, 1.0] {
            assert_eq!(
                lift(Physical::default(), Branch::Positive, restitution(kappa)),
                Lifted::default()
            );
        }
    }
}
