//! Settings that several configurations share. A member that is zero has its default value, unless a bit
//! of `given` marks the zero as intended.

use zivi_core::control::{Gains, Landing, Port};
use zivi_core::{Real, Restitution};

use crate::code::{
    self, Code, ZIVI_E_AHEAD, ZIVI_E_E, ZIVI_E_E_REF, ZIVI_E_GIVEN, ZIVI_E_KAPPA, ZIVI_E_KAPPA_REF,
    ZIVI_E_QUIET, ZIVI_E_SIZE, ZIVI_E_TICK,
};

/// In `tick`: the control update that ends in exact rest, the default.
pub const ZIVI_TICK_LANDING: u32 = 0;
/// In `tick`: the control update of the paper.
pub const ZIVI_TICK_PAPER: u32 = 1;

/// In `given`: `e` is set, even if it is 0.
pub const ZIVI_GIVEN_E: u32 = 1;
/// In `given`: `kappa` is set, even if it is 0 (`e` = 1).
pub const ZIVI_GIVEN_KAPPA: u32 = 2;
/// In `given`: `e_ref` is set.
pub const ZIVI_GIVEN_E_REF: u32 = 4;
/// In `given`: `kappa_ref` is set.
pub const ZIVI_GIVEN_KAPPA_REF: u32 = 8;
/// In `given`: `ahead` is set.
pub const ZIVI_GIVEN_AHEAD: u32 = 16;
/// In `given`: `press` is set.
pub const ZIVI_GIVEN_PRESS: u32 = 32;
/// In `given`: `horizon` is set.
pub const ZIVI_GIVEN_HORIZON: u32 = 64;
/// In `given`: `depth` is set.
pub const ZIVI_GIVEN_DEPTH: u32 = 128;
/// In `given`: `u_min` and `u_max` are set.
pub const ZIVI_GIVEN_U_LIMITS: u32 = 256;
/// In `given`: `noise_x` is set.
pub const ZIVI_GIVEN_NOISE_X: u32 = 512;
/// In `given`: `noise_xdot` is set.
pub const ZIVI_GIVEN_NOISE_XDOT: u32 = 1024;
/// In `given`: `q_d` is set.
pub const ZIVI_GIVEN_Q_D: u32 = 2048;
/// In `given`: `dmax` is set.
pub const ZIVI_GIVEN_DMAX: u32 = 4096;

/// Bits of a configuration: the members whose value is zero on purpose.
#[derive(Clone, Copy)]
pub(crate) struct Given(u32);

impl Given {
    /// These bits, which are all of `possible`.
    pub(crate) fn checked(bits: u32, possible: u32) -> Result<Self, Code> {
        if bits & !possible == 0 {
            Ok(Self(bits))
        } else {
            Err(ZIVI_E_GIVEN)
        }
    }

    fn has(self, bit: u32) -> bool {
        self.0 & bit != 0
    }

    /// Value of a member; its default for zero without its bit.
    pub(crate) fn or(self, bit: u32, value: Real, default: Real) -> Real {
        self.said(bit, value).unwrap_or(default)
    }

    /// Value of a member; `None` for zero without its bit.
    pub(crate) fn said(self, bit: u32, value: Real) -> Option<Real> {
        (value != 0.0 || self.has(bit)).then_some(value)
    }
}

/// `e` and `kappa` of a wall.
pub(crate) const WALL: u32 = ZIVI_GIVEN_E | ZIVI_GIVEN_KAPPA;
/// Settings of both controllers.
pub(crate) const CONTROLLER: u32 = WALL | ZIVI_GIVEN_AHEAD | ZIVI_GIVEN_DEPTH | ZIVI_GIVEN_U_LIMITS;

/// The size that a configuration of this version states.
pub(crate) fn checked_size<T>(size: u32) -> Result<(), Code> {
    if size as usize == core::mem::size_of::<T>() {
        Ok(())
    } else {
        Err(ZIVI_E_SIZE)
    }
}

/// The restitution from the member that is set, `e` or `kappa`.
pub(crate) fn restitution(given: Given, e: Real, kappa: Real) -> Result<Restitution, Code> {
    of_either(given.said(ZIVI_GIVEN_E, e), given.said(ZIVI_GIVEN_KAPPA, kappa))
}

fn of_either(e: Option<Real>, kappa: Option<Real>) -> Result<Restitution, Code> {
    let restitution = match (e, kappa) {
        (Some(e), Some(kappa)) => Restitution::from_both(e, kappa),
        (None, Some(kappa)) => Restitution::from_kappa(kappa),
        (e, None) => Restitution::from_e(e.unwrap_or(0.0)),
    };
    let restitution = restitution.map_err(code::of_restitution)?;
    match restitution.kappa() < 1.0 {
        true => Ok(restitution),
        false if kappa.is_none() => Err(ZIVI_E_E),
        false => Err(ZIVI_E_KAPPA),
    }
}

/// The restitution of the reference's wall; the plant's if neither member is set.
pub(crate) fn restitution_ref(
    given: Given,
    e: Real,
    kappa: Real,
    plant: Restitution,
) -> Result<Restitution, Code> {
    let (e, kappa) = (given.said(ZIVI_GIVEN_E_REF, e), given.said(ZIVI_GIVEN_KAPPA_REF, kappa));
    if e.is_none() && kappa.is_none() {
        return Ok(plant);
    }
    of_either(e, kappa).map_err(|code| match code {
        ZIVI_E_KAPPA => ZIVI_E_KAPPA_REF,
        _ => ZIVI_E_E_REF,
    })
}

/// Which condition the gains have to meet for the `bound` of the unknown force.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum GainCondition {
    Regulate,
    Track,
}

/// The restitution and the horizon of the contact-establishing law in periods (0 for the update of the
/// paper) of a controller with valid settings. (One function for both controllers.)
#[inline(never)]
pub(crate) fn law(
    task: GainCondition,
    given: Given,
    (mu1, mu2): (Real, Real),
    bound: Real,
    h: Real,
    (e, kappa): (Real, Real),
    (tick, ahead, quiet): (u32, u32, Real),
) -> Result<(Restitution, u32), Code> {
    let ahead = match tick {
        ZIVI_TICK_LANDING if ahead == 0 && given.has(ZIVI_GIVEN_AHEAD) => return Err(ZIVI_E_AHEAD),
        ZIVI_TICK_LANDING => ahead.max(1),
        ZIVI_TICK_PAPER if ahead <= 1 => 0,
        ZIVI_TICK_PAPER => return Err(ZIVI_E_AHEAD),
        _ => return Err(ZIVI_E_TICK),
    };
    if ahead == 0 && quiet != 0.0 {
        return Err(ZIVI_E_QUIET);
    }
    let restitution = restitution(given, e, kappa)?;
    let gains = Gains::bounded(mu1, mu2, bound, restitution).and_then(|gains| match task {
        GainCondition::Regulate => gains.regulate(bound, restitution),
        GainCondition::Track => gains.track(bound, restitution),
    });
    gains.map_err(code::of_gain)?;
    let landing = Landing::new(1, h).map_err(code::of)?;
    landing.with_quiet(quiet).map_err(code::of)?;
    Landing::new(ahead.max(1), h).map_err(|_| ZIVI_E_AHEAD)?;
    Ok((restitution, ahead))
}

/// Limits of the sensor (by default 0.1 m) and of the actuator (by default none).
pub(crate) fn port(given: Given, depth: Real, u_min: Real, u_max: Real) -> Result<Port, Code> {
    let mut port = Port::default();
    if let Some(depth) = given.said(ZIVI_GIVEN_DEPTH, depth) {
        port = port.with_depth(depth).map_err(code::of)?;
    }
    if u_min != 0.0 || u_max != 0.0 || given.has(ZIVI_GIVEN_U_LIMITS) {
        port = port.with_actuator(u_min, u_max).map_err(code::of)?;
    }
    Ok(port)
}
