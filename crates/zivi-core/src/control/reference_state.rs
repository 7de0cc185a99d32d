//! The reference that a tracker follows: where it is, and where a period takes it.

use super::port::checked_force;
use super::tracking::Target;
use crate::setting::is_not_negative;
use crate::step::{thorough, ImplicitEuler, StepSolution};
use crate::Real;
use crate::{transform, Branch, Lifted, Physical, Restitution, SettingError, ThetaGammaStep};

/// A reference: its state and the side of the wall on which it was last.
#[derive(Clone, Copy, Debug)]
pub(super) struct ReferenceState {
    pub(super) z: Lifted,
    pub(super) side: Real,
}

impl ReferenceState {
    /// At a physical state, on a branch.
    #[inline(never)]
    pub(super) fn at(
        Waypoint { state, branch }: Waypoint,
        restitution: Restitution,
    ) -> Result<Self, SettingError> {
        let Physical { x, xdot } = state;
        let refused = |name, value, range| Err(SettingError { name, value, range });
        if !is_not_negative(x) {
            return refused("x_ref", x, "a finite distance >= 0 from the wall (m)");
        }
        let Lifted { s, v } = transform::lift(state, Branch::Positive, restitution);
        if !v.is_finite() {
            return refused("xdot_ref", xdot, "a finite velocity (m/s)");
        }
        let sigma = branch.sigma();
        // adding 0.0 turns -0.0 into 0.0
        let z = Lifted { s: sigma * s + 0.0, v: sigma * v + 0.0 };
        Ok(Self { z, side: transform::side(z, sigma) })
    }

    /// On the branch `+1`.
    #[inline]
    pub(super) fn folded(self) -> Self {
        let Lifted { s, v } = self.z;
        let z = if self.side < 0.0 { Lifted { s: 0.0 - s, v: 0.0 - v } } else { self.z };
        Self { z, side: 1.0 }
    }
}

/// A given reference at one sample: its state, and the side of the wall on which it is followed,
/// which changes with each of its impacts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Waypoint {
    /// Distance from the wall, `>= 0` (m), and velocity (m/s).
    pub state: Physical,
    /// The side.
    pub branch: Branch,
}

impl From<Physical> for Waypoint {
    /// On the side `+1`.
    fn from(state: Physical) -> Self {
        Self { state, branch: Branch::Positive }
    }
}

/// Where the reference of a tick comes from: it is the tracker's own, under this force, or it is given
/// at this sample and at the next one, with its acceleration if that is known.
pub(super) enum ReferenceSource<'a> {
    Own(Real),
    Given(&'a [Waypoint; 2], Option<Real>),
}

/// A period of the reference: from where, under which force.
#[derive(Clone, Copy, Debug)]
pub struct ReferencePeriod {
    pub(super) now: ReferenceState,
    pub(super) force: Real,
    /// What the measured velocity is taken back by (m/s).
    pub(super) back: Real,
    /// Where it ends, if that is given.
    pub(super) next: Option<ReferenceState>,
}

/// A sample, and what the plant has to follow over the period that starts with it.
#[derive(Clone, Copy, Debug)]
pub struct Planned {
    pub(super) state: Physical,
    /// The same as an implicit step would have it: its velocity taken back.
    pub(super) measured: Physical,
    pub(super) clamped: bool,
    pub(super) force: Real,
    pub(super) now: ReferenceState,
    pub(super) next: ReferenceState,
    /// The signs of the reference's step.
    pub(super) signs: [Real; 2],
    pub(super) target: Target,
    /// The multiplier of `sgn v_r+` at the end that is followed.
    pub(super) lambda_vr: Real,
    /// What acts on the reference (m/s^2).
    #[cfg_attr(feature = "single", allow(dead_code, reason = "only the VI asks for it"))]
    pub(super) force_ref: Real,
}

/// The reference after a period with the signs of its step; what the plant has to follow over the
/// horizon, and the multiplier of `sgn v_r+` there.
pub(super) struct Outlook {
    pub(super) next: ReferenceState,
    pub(super) signs: [Real; 2],
    pub(super) target: Target,
    pub(super) lambda_vr: Real,
}

/// The end of a step of the reference, its signs, and its acceleration (m/s^2).
pub(super) struct Advance {
    pub(super) next: ReferenceState,
    pub(super) signs: [Real; 2],
    pub(super) acceleration: Real,
}

/// One implicit Euler step of the reference.
#[inline(always)]
pub(super) fn advanced(
    reference: &ThetaGammaStep,
    from: ReferenceState,
    force_ref: Real,
) -> Result<Advance, SettingError> {
    checked_force("force_ref", force_ref)?;
    let found = reference.implicit().solve(from.z, force_ref, from.side);
    let found = found.map_err(|_| too_large(force_ref))?;
    let acceleration = pulled(&found, reference.restitution(), force_ref);
    let z = found.end();
    let next = ReferenceState { z, side: transform::side(z, from.side) };
    Ok(Advance { next, signs: [found.lambda_s, found.lambda_v], acceleration })
}

/// What the plant has to follow over `h`, where that is not a period of the reference, and the signs of
/// that step: seldom asked for, and not a part of its caller.
#[cold]
#[inline(never)]
pub(super) fn target_over(
    h: Real,
    restitution: Restitution,
    from: ReferenceState,
    force_ref: Real,
) -> Result<(Target, [Real; 2]), SettingError> {
    let found = thorough(h, restitution, ImplicitEuler, from.z, force_ref, from.side);
    let found = found.map_err(|_| too_large(force_ref))?;
    let target = Target { end: found.end(), acceleration: pulled(&found, restitution, force_ref) };
    Ok((target, [found.lambda_s, found.lambda_v]))
}

/// `A = lsr F_r/R_r` of a step of the reference (m/s^2).
#[inline(always)]
fn pulled(found: &StepSolution, restitution: Restitution, force_ref: Real) -> Real {
    found.lambda_s * force_ref / restitution.r(found.lambda_s, found.lambda_v)
}

fn too_large(force_ref: Real) -> SettingError {
    let range = "small enough for the reference to stay finite (m/s^2)";
    SettingError { name: "force_ref", value: force_ref, range }
}
