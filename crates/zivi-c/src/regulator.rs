//! The twisting regulator: brings the mass to rest at the wall.

use zivi_core::control::regulation::RegulationStep;
use zivi_core::control::{Gains, Landing, Port, RegulatorState, TwistingRegulator};
use zivi_core::{Physical, Real, Restitution};

use crate::code::{self, Code, ZIVI_OK};
use crate::code::{Sealed, Word};
use crate::config::{self, GainCondition, Given};

/// Settings of a regulator. A member that is zero has its default value, unless its bit
/// of `given` is set.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RegulatorConfig {
    /// `sizeof(zivi_regulator_config)`.
    pub size: u32,
    /// `ZIVI_TICK_LANDING` or `ZIVI_TICK_PAPER`.
    pub tick: u32,
    /// Horizon of the contact-establishing law in periods, 1 + the periods of delay; by default 1.
    pub ahead: u32,
    /// `ZIVI_GIVEN_...`: the members whose value 0 is intended and replaces the default.
    pub given: u32,
    /// Gain on the sign of the position (m/s^2).
    pub mu1: Real,
    /// Gain on the sign of the velocity, 0 < mu2 < mu1 (m/s^2).
    pub mu2: Real,
    /// Sampling period (s), > 0.
    pub h: Real,
    /// Coefficient of restitution of the wall, in (0, 1]; or set `kappa`.
    pub e: Real,
    /// `(1 - e)/(1 + e)`, in (0, 1), in place of `e`.
    pub kappa: Real,
    /// A bound of the unknown force that the gains are checked against (m/s^2); by default none.
    pub bound: Real,
    /// Dead zone of the contact-establishing law, a bound of the velocity error (m/s); by default 0.
    pub quiet: Real,
    /// Measurements down to `-depth` are replaced by 0, deeper ones are rejected (m); by default 0.1.
    pub depth: Real,
    /// Least control of the actuator (m/s^2); unlimited while both are 0.
    pub u_min: Real,
    /// Largest control of the actuator (m/s^2).
    pub u_max: Real,
}

/// A regulator. Everything in it may be read, copied and logged; it is changed by
/// `zivi_regulator_*` alone.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Regulator {
    /// Gain on the sign of the position (m/s^2).
    pub mu1: Real,
    /// Gain on the sign of the velocity (m/s^2).
    pub mu2: Real,
    /// Sampling period (s).
    pub h: Real,
    /// Coefficient of restitution.
    pub e: Real,
    /// `(1 - e)/(1 + e)`.
    pub kappa: Real,
    /// Dead zone of the contact-establishing law (m/s).
    pub quiet: Real,
    /// Largest penetration of a valid measurement (m).
    pub depth: Real,
    /// Least control (m/s^2).
    pub u_min: Real,
    /// Largest control (m/s^2).
    pub u_max: Real,
    /// Horizon of the contact-establishing law in periods, 0 for the update of the paper.
    pub ahead: u32,
    /// 0.
    pub reserved: u32,
    /// The last control (m/s^2).
    pub u: Real,
    /// Selection of `sgn s` in the last update, in [-1, 1].
    pub lambda_s: Real,
    /// Selection of `sgn v` in the last update, in [-1, 1].
    pub lambda_v: Real,
    /// Updates since the start.
    pub ticks: u64,
    /// Bits of the changes to the last sample (clamped) and control (saturated).
    pub status: u32,
    /// 0.
    pub unused: u32,
    /// Checksum of the settings, which reveals a damaged or uninitialised object.
    pub seal: u64,
}

// SAFETY: `mu1` to `reserved`
unsafe impl Sealed for Regulator {
    const SETTINGS: usize = core::mem::offset_of!(Regulator, u) / size_of::<Word>();
    const KIND: u64 = 0x7a69_7669_7265_6775;

    fn seal(&self) -> u64 {
        self.seal
    }
}

const _: () = {
    use core::mem::offset_of;
    #[cfg(not(feature = "single"))]
    assert!(size_of::<Regulator>() == 128 && size_of::<RegulatorConfig>() == 96);
    assert!(offset_of!(Regulator, u) == size_of::<Word>() * <Regulator as Sealed>::SETTINGS);
    #[cfg(not(feature = "single"))]
    assert!(offset_of!(Regulator, ticks) == 104 && offset_of!(Regulator, status) == 112);
};

impl RegulatorConfig {
    /// The size; all other members are 0.
    #[must_use]
    pub fn defaults() -> Self {
        Self { size: size_of::<Self>() as u32, ..Self::default() }
    }
}

impl Regulator {
    /// Checks the settings; there is no previous control.
    pub fn init(&mut self, config: &RegulatorConfig) -> Code {
        match self.configured(config) {
            Ok(()) => ZIVI_OK,
            Err(code) => code,
        }
    }

    fn configured(&mut self, config: &RegulatorConfig) -> Result<(), Code> {
        config::checked_size::<RegulatorConfig>(config.size)?;
        let RegulatorConfig { mu1, mu2, h, bound, e, kappa, tick, ahead, quiet, .. } = *config;
        let given = Given::checked(config.given, config::CONTROLLER)?;
        let (landing, walls) = ((tick, ahead, quiet), (e, kappa));
        let (restitution, ahead) =
            config::law(GainCondition::Regulate, given, (mu1, mu2), bound, h, walls, landing)?;
        let port = config::port(given, config.depth, config.u_min, config.u_max)?;
        let (e, kappa, depth) = (restitution.e(), restitution.kappa(), port.depth());
        let (u_min, u_max) = port.actuator();
        let none = Self::default();
        let u = port.clipped(0.0);
        *self = Self { mu1, mu2, h, e, kappa, quiet, depth, u_min, u_max, ahead, u, ..none };
        self.seal = self.seal_of_settings();
        Ok(())
    }

    /// Forgets the last update.
    pub fn reset(&mut self) -> Code {
        if let Err(code) = self.intact() {
            return code;
        }
        let port = Port::trusted(self.depth, (self.u_min, self.u_max));
        (self.u, self.lambda_s, self.lambda_v) = (port.clipped(0.0), 0.0, 0.0);
        (self.ticks, self.status) = (0, 0);
        ZIVI_OK
    }

    /// The control for the period that starts with this measurement: [`Regulator::u`].
    #[inline]
    pub fn step(&mut self, x: Real, xdot: Real, force: Real) -> Code {
        match self.call(Physical { x, xdot }, force) {
            Ok(code) | Err(code) => code,
        }
    }

    #[inline(always)] // a call of its own would be a tenth of it
    fn call(&mut self, measured: Physical, force: Real) -> Result<Code, Code> {
        self.intact()?;
        let mut core = self.core();
        core.tick(measured, force).map_err(code::of)?;
        let RegulatorState { u, signs: [lambda_s, lambda_v], status } = core.state();
        (self.u, self.lambda_s, self.lambda_v) = (u, lambda_s, lambda_v);
        self.ticks = self.ticks.wrapping_add(1);
        self.status = u32::from(status.bits());
        Ok(code::of_status(status))
    }

    /// The controller of the core with the settings that were checked.
    #[inline(always)] // taken apart: no copy of it is ever made
    fn core(&self) -> TwistingRegulator {
        let Self { mu1, mu2, h, e, kappa, quiet, depth, u_min, u_max, ahead, .. } = *self;
        let (gains, restitution) = (Gains::trusted(mu1, mu2), Restitution::trusted(e, kappa));
        let landing = (ahead > 0).then(|| Landing::trusted(ahead, h, quiet));
        let port = Port::trusted(depth, (u_min, u_max));
        TwistingRegulator::trusted(RegulationStep { h, restitution, gains }, landing, port)
    }
}
