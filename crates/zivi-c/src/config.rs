//! Settings that several configurations share. A member that is zero takes its default.

use zivi_core::control::{Gains, Landing, Port};
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

/// The restitution of `e` or of `kappa`, whichever is not zero.
pub(crate) fn restitution(e: f64, kappa: f64) -> Result<Restitution, Code> {
    let restitution = match (e == 0.0, kappa == 0.0) {
        (_, true) => Restitution::from_e(e),
        (true, false) => Restitution::from_kappa(kappa),
        (false, false) => Restitution::from_both(e, kappa),
    };
    let restitution = restitution.map_err(code::of_restitution)?;
    match restitution.kappa() < 1.0 {
        true => Ok(restitution),
        false if kappa == 0.0 => Err(ZIVI_E_E),
        false => Err(ZIVI_E_KAPPA),
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

/// Which condition the gains have to meet for the `bound` of the unknown force.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Task {
    Regulate,
    Track,
}

/// The restitution, and the horizon of the landing in periods (0 for the tick of the paper), of a
/// controller whose settings are good ones. (Once for both controllers.)
#[inline(never)]
pub(crate) fn law(
    task: Task,
    (mu1, mu2): (f64, f64),
    bound: f64,
    h: f64,
    (e, kappa): (f64, f64),
    (tick, ahead): (u32, u32),
) -> Result<(Restitution, u32), Code> {
    let ahead = match tick {
        ZIVI_TICK_LANDING => ahead.max(1),
        ZIVI_TICK_PAPER if ahead <= 1 => 0,
        ZIVI_TICK_PAPER => return Err(ZIVI_E_AHEAD),
        _ => return Err(ZIVI_E_TICK),
    };
    let restitution = restitution(e, kappa)?;
    let gains = Gains::bounded(mu1, mu2, bound, restitution).and_then(|gains| match task {
        Task::Regulate => gains.regulate(bound, restitution),
        Task::Track => gains.track(bound, restitution),
    });
    gains.map_err(code::of_gain)?;
    Landing::new(1, h).map_err(code::of)?;
    Landing::new(ahead.max(1), h).map_err(|_| ZIVI_E_AHEAD)?;
    Ok((restitution, ahead))
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
