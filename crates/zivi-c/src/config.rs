//! Settings that several configurations share. A member that is zero takes its default.

use zivi_core::control::{Landing, Port};
use zivi_core::Restitution;

use crate::code::{
    self, Code, ZIVI_E_AHEAD, ZIVI_E_E, ZIVI_E_E_REF, ZIVI_E_KAPPA, ZIVI_E_KAPPA_REF, ZIVI_E_SIZE,
    ZIVI_E_TICK,
};

/// In `tick`: the tick that ends in exact rest, the default.
pub const ZIVI_TICK_LANDING: u32 = 0;
/// In `tick`: the tick of the paper.
pub const ZIVI_TICK_PAPER: u32 = 1;

/// The size that a configuration of this version states.
pub(crate) fn checked_size<T>(size: u32) -> Result<(), Code> {
    if size as usize == core::mem::size_of::<T>() {
        Ok(())
    } else {
        Err(ZIVI_E_SIZE)
    }
}

/// The wall of `e` or of `kappa`, whichever is not zero.
pub(crate) fn restitution(e: f64, kappa: f64) -> Result<Restitution, Code> {
    if kappa == 0.0 {
        let restitution = Restitution::from_e(e).map_err(code::of_restitution)?;
        return if restitution.kappa() < 1.0 { Ok(restitution) } else { Err(ZIVI_E_E) };
    }
    let restitution =
        if e == 0.0 { Restitution::from_kappa(kappa) } else { Restitution::from_both(e, kappa) };
    let restitution = restitution.map_err(code::of_restitution)?;
    if restitution.kappa() < 1.0 {
        Ok(restitution)
    } else {
        Err(ZIVI_E_KAPPA)
    }
}

/// The same for the reference's wall; the plant's if both are zero.
pub(crate) fn restitution_ref(e: f64, kappa: f64, plant: Restitution) -> Result<Restitution, Code> {
    if e == 0.0 && kappa == 0.0 {
        return Ok(plant);
    }
    restitution(e, kappa).map_err(|code| match code {
        ZIVI_E_KAPPA => ZIVI_E_KAPPA_REF,
        _ => ZIVI_E_E_REF,
    })
}

/// The horizon of a landing in periods, at least 1; 0 for the tick of the paper.
pub(crate) fn ahead(tick: u32, ahead: u32) -> Result<u32, Code> {
    match tick {
        ZIVI_TICK_LANDING => Ok(ahead.max(1)),
        ZIVI_TICK_PAPER if ahead <= 1 => Ok(0),
        ZIVI_TICK_PAPER => Err(ZIVI_E_AHEAD),
        _ => Err(ZIVI_E_TICK),
    }
}

/// The landing with the horizon that [`ahead`] gave.
#[inline(always)]
pub(crate) fn landing(ahead: u32, h: f64) -> Result<Option<Landing>, Code> {
    match ahead {
        0 => Ok(None),
        _ => Landing::new(ahead, h).map(Some).map_err(|_| ZIVI_E_AHEAD),
    }
}

/// Limits of the sensor and of the actuator; `depth` 0 is 0.1 m, `u_min = u_max = 0` no limits.
pub(crate) fn port(depth: f64, u_min: f64, u_max: f64) -> Result<Port, Code> {
    let mut port = Port::default();
    if depth != 0.0 {
        port = port.with_depth(depth).map_err(code::of)?;
    }
    if u_min != 0.0 || u_max != 0.0 {
        port = port.with_actuator(u_min, u_max).map_err(code::of)?;
    }
    Ok(port)
}
