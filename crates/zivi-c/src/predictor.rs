//! The state in which a late control will act.

use zivi_core::control::port::MOST_DELAY;
use zivi_core::{flight, Physical, Real};

use crate::code::{
    Code, ZIVI_CLAMPED, ZIVI_E_DELAY, ZIVI_E_FORCE, ZIVI_E_H, ZIVI_E_OVERFLOW, ZIVI_E_U, ZIVI_E_X,
    ZIVI_E_XDOT, ZIVI_OK,
};
use crate::code::{Sealed, Word};
use crate::config::{self, Given, ZIVI_GIVEN_DEPTH};

/// The valid bits of a predictor's `given`.
const GIVEN: u32 = config::WALL | ZIVI_GIVEN_DEPTH;

/// Settings of a predictor. A member that is zero has its default value, unless its bit
/// of `given` is set.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PredictorConfig {
    /// `sizeof(zivi_predictor_config)`.
    pub size: u32,
    /// `ZIVI_GIVEN_...`: the members whose value 0 is intended and replaces the default.
    pub given: u32,
    /// Periods from a measurement to the moment when its control acts, 0 to 64.
    pub delay: u32,
    /// 0.
    pub reserved: u32,
    /// Sampling period (s), > 0.
    pub h: Real,
    /// Coefficient of restitution, in (0, 1]; or set `kappa`.
    pub e: Real,
    /// `(1 - e)/(1 + e)`, in (0, 1), in place of `e`.
    pub kappa: Real,
    /// Measurements down to `-depth` are replaced by 0, deeper ones are rejected (m); by default 0.1.
    pub depth: Real,
}

/// A predictor with the controls that do not act yet. Everything in it may be read, copied and logged;
/// it is changed by `zivi_predictor_*` alone.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Predictor {
    /// Sampling period (s).
    pub h: Real,
    /// Coefficient of restitution.
    pub e: Real,
    /// `(1 - e)/(1 + e)`.
    pub kappa: Real,
    /// Largest penetration of a valid measurement (m).
    pub depth: Real,
    /// Periods from a measurement to the moment when its control acts.
    pub delay: u32,
    /// 0.
    pub reserved: u32,
    /// Predicted distance from the wall at the time when the control acts (m).
    pub x: Real,
    /// Predicted velocity at that time (m/s).
    pub xdot: Real,
    /// The controls that do not act yet (m/s^2): `sent[(first + k) % 64]`, k = 0 ... `delay` - 1.
    pub sent: [Real; 64],
    /// Index of the oldest.
    pub first: u32,
    /// 0.
    pub reserved_too: u32,
    /// Checksum of the settings, which reveals a damaged or uninitialised object.
    pub seal: u64,
}

// SAFETY: `h` to `reserved`
unsafe impl Sealed for Predictor {
    const SETTINGS: usize = core::mem::offset_of!(Predictor, x) / size_of::<Word>();
    const KIND: u64 = 0x7a69_7669_7072_6564;

    fn seal(&self) -> u64 {
        self.seal
    }
}

const _: () = {
    use core::mem::offset_of;
    assert!(MOST_DELAY == 64);
    assert!(offset_of!(Predictor, x) == size_of::<Word>() * <Predictor as Sealed>::SETTINGS);
    #[cfg(not(feature = "single"))]
    assert!(size_of::<Predictor>() == 584 && size_of::<PredictorConfig>() == 48);
};

impl PredictorConfig {
    /// The size; all other members are 0.
    #[must_use]
    pub fn defaults() -> Self {
        Self { size: size_of::<Self>() as u32, ..Self::default() }
    }
}

impl Predictor {
    /// Checks the settings; no control is pending.
    pub fn init(&mut self, config: &PredictorConfig) -> Code {
        match self.configured(config) {
            Ok(()) => ZIVI_OK,
            Err(code) => code,
        }
    }

    fn configured(&mut self, config: &PredictorConfig) -> Result<(), Code> {
        config::checked_size::<PredictorConfig>(config.size)?;
        let PredictorConfig { delay, h, e, kappa, depth, .. } = *config;
        let given = Given::checked(config.given, GIVEN)?;
        let restitution = config::restitution(given, e, kappa)?;
        if !(h > 0.0 && h <= Real::MAX) {
            return Err(ZIVI_E_H);
        }
        let depth = config::port(given, depth, 0.0, 0.0)?.depth();
        if delay as usize > MOST_DELAY {
            return Err(ZIVI_E_DELAY);
        }
        (self.h, self.e, self.kappa) = (h, restitution.e(), restitution.kappa());
        (self.depth, self.delay, self.reserved) = (depth, delay, 0);
        self.forget();
        self.seal = self.seal_of_settings();
        Ok(())
    }

    /// Forgets pending controls: a control of 0 acts until the first one that is sent does.
    pub fn reset(&mut self) -> Code {
        if let Err(code) = self.intact() {
            return code;
        }
        self.forget();
        ZIVI_OK
    }

    fn forget(&mut self) {
        (self.x, self.xdot, self.first, self.reserved_too) = (0.0, 0.0, 0, 0);
        for it in &mut self.sent {
            // SAFETY: a number of this object; a plain loop would be a call of `memset`
            unsafe { core::ptr::from_mut(it).write_volatile(0.0) };
        }
    }

    /// The state in which the control of this sample will act: `x` and `xdot`.
    pub fn step(&mut self, x: Real, xdot: Real, force: Real) -> Code {
        if let Err(code) = self.intact() {
            return code;
        }
        if !(-self.depth..=Real::MAX).contains(&x) {
            return ZIVI_E_X;
        }
        if !xdot.is_finite() {
            return ZIVI_E_XDOT;
        }
        if !force.is_finite() {
            return ZIVI_E_FORCE;
        }
        let mut at = Physical { x: if x < 0.0 { 0.0 } else { x }, xdot };
        for k in 0..self.delay {
            let place = (self.first.wrapping_add(k)) as usize % MOST_DELAY;
            let u = self.sent.get(place).copied().unwrap_or(0.0);
            at = flight::after(at, force + u, self.e, self.h);
        }
        if !(at.x.is_finite() && at.xdot.is_finite()) {
            return ZIVI_E_OVERFLOW;
        }
        (self.x, self.xdot) = (at.x, at.xdot);
        if x < 0.0 {
            ZIVI_CLAMPED
        } else {
            ZIVI_OK
        }
    }

    /// Stores the control that is sent.
    pub fn send(&mut self, u: Real) -> Code {
        if let Err(code) = self.intact() {
            return code;
        }
        if !u.is_finite() {
            return ZIVI_E_U;
        }
        let place = (self.first.wrapping_add(self.delay)) as usize % MOST_DELAY;
        if let Some(it) = self.sent.get_mut(place) {
            *it = u;
        }
        self.first = self.first.wrapping_add(1) % MOST_DELAY as u32;
        ZIVI_OK
    }
}
