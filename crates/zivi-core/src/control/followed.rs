//! The reference that a tracker follows: where it is, and where a period takes it.

use super::port::checked_force;
use super::tracking::Target;
use super::Waypoint;
use crate::{transform, Branch, Lifted, Physical, Restitution, SettingError, ThetaGammaStep};

/// Where the reference of a tick comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Guide<'a> {
    /// It is the tracker's own, under this force.
    Own {
        /// What acts on it (m/s^2).
        force: f64,
    },
    /// It is given: where it is at this sample and at the next one.
    Given {
        /// At these two.
        reference: &'a [Waypoint; 2],
        /// Its own acceleration over the period (m/s^2), if it is known.
        acceleration: Option<f64>,
    },
}

/// A reference: its state and the side of the wall on which it was last.
#[derive(Clone, Copy, Debug)]
pub(super) struct Followed {
    pub(super) z: Lifted,
    pub(super) side: f64,
}

impl Followed {
    /// At a physical state.
    #[inline(never)]
    pub(super) fn at(reference: Physical, restitution: Restitution) -> Result<Self, SettingError> {
        let Physical { x, xdot } = reference;
        let refused = |name, value, range| Err(SettingError { name, value, range });
        if !(x >= 0.0 && x.is_finite()) {
            return refused("x_ref", x, "a finite distance >= 0 from the wall (m)");
        }
        let z = transform::lift(reference, Branch::Positive, restitution);
        if !z.v.is_finite() {
            return refused("xdot_ref", xdot, "a finite velocity (m/s)");
        }
        Ok(Self { z, side: transform::side(z, 1.0) })
    }

    /// On the branch `+1`.
    #[inline]
    pub(super) fn folded(self) -> Self {
        let Lifted { s, v } = self.z;
        let z = if self.side < 0.0 { Lifted { s: 0.0 - s, v: 0.0 - v } } else { self.z };
        Self { z, side: 1.0 }
    }
}

/// A period of the reference: from where, under which force.
pub(super) struct Course {
    pub(super) now: Followed,
    pub(super) force: f64,
    /// What the measured velocity is taken back by (m/s).
    pub(super) back: f64,
    /// Where it ends, if that is given.
    pub(super) next: Option<Followed>,
}

/// A sample, and what the plant has to follow over the period that starts with it.
#[derive(Clone, Copy, Debug)]
pub struct Planned {
    pub(super) state: Physical,
    /// The same as an implicit step would have it: its velocity taken back.
    pub(super) measured: Physical,
    pub(super) clamped: bool,
    pub(super) force: f64,
    pub(super) now: Lifted,
    pub(super) next: Followed,
    /// The signs of the reference's step.
    pub(super) signs: [f64; 2],
    pub(super) target: Target,
}

/// The end of a step of the reference, its signs, and its acceleration (m/s^2).
pub(super) struct Advance {
    pub(super) next: Followed,
    pub(super) signs: [f64; 2],
    pub(super) acceleration: f64,
}

/// One implicit Euler step of the reference.
#[inline(always)]
pub(super) fn advanced(
    reference: &ThetaGammaStep,
    from: Followed,
    force_ref: f64,
) -> Result<Advance, SettingError> {
    checked_force("force_ref", force_ref)?;
    let Ok(found) = reference.implicit().solve(from.z, force_ref, from.side) else {
        let range = "small enough for the reference to stay finite (m/s^2)";
        return Err(SettingError { name: "force_ref", value: force_ref, range });
    };
    let r = reference.restitution().r(found.lambda_s, found.lambda_v);
    let acceleration = found.lambda_s * force_ref / r;
    let z = found.end();
    let next = Followed { z, side: transform::side(z, from.side) };
    Ok(Advance { next, signs: [found.lambda_s, found.lambda_v], acceleration })
}

/// The same, not a part of its caller: for what is seldom asked for.
#[cold]
#[inline(never)]
pub(super) fn advanced_apart(
    reference: &ThetaGammaStep,
    from: Followed,
    force_ref: f64,
) -> Result<Advance, SettingError> {
    advanced(reference, from, force_ref)
}
