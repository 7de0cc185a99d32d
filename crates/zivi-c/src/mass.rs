//! A mass above a wall, moved by the implicit Euler step through impacts and Zeno points.

use zivi_core::Real;
use zivi_core::{transform, Branch, Lifted, Physical, Restitution, StepFailure, ThetaGammaStep};

use crate::code::{
    self, Code, ZIVI_E_H, ZIVI_E_NO_SOLUTION, ZIVI_E_OVERFLOW, ZIVI_E_STATE, ZIVI_E_X, ZIVI_E_XDOT,
    ZIVI_OK,
};
use crate::code::{Sealed, Word};
use crate::config::{self, Given};

/// Settings of a mass. A member that is zero has its default value, unless its bit
/// of `given` is set.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MassConfig {
    /// `sizeof(zivi_mass_config)`.
    pub size: u32,
    /// `ZIVI_GIVEN_...`: the members whose value 0 is intended and replaces the default.
    pub given: u32,
    /// Step size (s), > 0.
    pub h: Real,
    /// Coefficient of restitution, in (0, 1]; or set `kappa`.
    pub e: Real,
    /// `(1 - e)/(1 + e)`, in (0, 1), in place of `e`.
    pub kappa: Real,
}

/// A mass above a wall. Everything in it may be read, copied and logged; it is changed by
/// `zivi_mass_*` alone.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Mass {
    /// Step size (s).
    pub h: Real,
    /// Coefficient of restitution.
    pub e: Real,
    /// `(1 - e)/(1 + e)`.
    pub kappa: Real,
    /// Transformed position, `x = |s|` (m).
    pub s: Real,
    /// Transformed velocity (m/s).
    pub v: Real,
    /// The side of the wall on which `s` was last, +1 or -1.
    pub side: Real,
    /// Distance from the wall (m).
    pub x: Real,
    /// Velocity; at the wall the one after the impact (m/s).
    pub xdot: Real,
    /// Selection of `sgn s` in the last step, in [-1, 1].
    pub lambda_s: Real,
    /// Selection of `sgn v` in the last step, in [-1, 1].
    pub lambda_v: Real,
    /// Steps since the start.
    pub steps: u64,
    /// Checksum of the settings, which reveals a damaged or uninitialised object.
    pub seal: u64,
}

// SAFETY: `h`, `e` and `kappa`
unsafe impl Sealed for Mass {
    const SETTINGS: usize = core::mem::offset_of!(Mass, s) / size_of::<Word>();
    const KIND: u64 = 0x7a69_7669_6d61_7373;

    fn seal(&self) -> u64 {
        self.seal
    }
}

const _: () = {
    use core::mem::offset_of;
    #[cfg(not(feature = "single"))]
    assert!(size_of::<Mass>() == 96 && size_of::<MassConfig>() == 32);
    assert!(offset_of!(Mass, s) == size_of::<Word>() * <Mass as Sealed>::SETTINGS);
    #[cfg(not(feature = "single"))]
    assert!(offset_of!(Mass, x) == 48 && offset_of!(Mass, steps) == 80);
};

impl MassConfig {
    /// The size; all other members are 0.
    #[must_use]
    pub fn defaults() -> Self {
        Self { size: size_of::<Self>() as u32, ..Self::default() }
    }
}

impl Mass {
    /// Checks the settings and starts at rest on the wall.
    pub fn init(&mut self, config: &MassConfig) -> Code {
        match Self::checked(config) {
            Ok((h, restitution)) => {
                let (e, kappa) = (restitution.e(), restitution.kappa());
                *self = Self { h, e, kappa, side: 1.0, ..Self::default() };
                self.seal = self.seal_of_settings();
                ZIVI_OK
            }
            Err(code) => code,
        }
    }

    fn checked(config: &MassConfig) -> Result<(Real, Restitution), Code> {
        config::checked_size::<MassConfig>(config.size)?;
        let given = Given::checked(config.given, config::WALL)?;
        let restitution = config::restitution(given, config.e, config.kappa)?;
        ThetaGammaStep::new(config.h, 1.0, 1.0, restitution).map_err(code::of)?;
        Ok((config.h, restitution))
    }

    /// Puts the mass at `x` with velocity `xdot`, on the branch `s >= 0`.
    pub fn reset(&mut self, x: Real, xdot: Real) -> Code {
        if let Err(code) = self.intact() {
            return code;
        }
        let restitution = Restitution::trusted(self.e, self.kappa);
        if !(x >= 0.0 && x.is_finite()) {
            return ZIVI_E_X;
        }
        let z = transform::lift(Physical { x, xdot }, Branch::Positive, restitution);
        if !z.is_finite() {
            return ZIVI_E_XDOT;
        }
        let Lifted { s, v } = z;
        let side = transform::side(z, 1.0);
        let Physical { x, xdot } = transform::project(z, restitution);
        *self = Self { s, v, side, x, xdot, lambda_s: 0.0, lambda_v: 0.0, steps: 0, ..*self };
        ZIVI_OK
    }

    /// One step of size `h` under this force per unit mass (m/s^2).
    pub fn step(&mut self, force: Real) -> Code {
        self.advance(self.h, force)
    }

    /// One step of another size.
    pub fn advance(&mut self, h: Real, force: Real) -> Code {
        if let Err(code) = self.intact() {
            return code;
        }
        if self.side.abs() != 1.0 {
            return ZIVI_E_STATE;
        }
        if !(h > 0.0 && h.is_finite()) {
            return ZIVI_E_H;
        }
        let step = ThetaGammaStep::trusted(h, 1.0, 1.0, Restitution::trusted(self.e, self.kappa));
        if !force.is_finite() {
            return code::ZIVI_E_FORCE;
        }
        let found = match step.solve(Lifted { s: self.s, v: self.v }, force, self.side) {
            Ok(found) => found,
            Err(StepFailure::NotFinite) => return ZIVI_E_OVERFLOW,
            Err(StepFailure::NoSolution) => return ZIVI_E_NO_SOLUTION,
        };
        let end = found.end();
        let Physical { x, xdot } = transform::project(end, step.restitution());
        self.side = transform::side(end, self.side);
        (self.s, self.v, self.x, self.xdot) = (end.s, end.v, x, xdot);
        (self.lambda_s, self.lambda_v) = (found.lambda_s, found.lambda_v);
        self.steps = self.steps.wrapping_add(1);
        ZIVI_OK
    }
}
