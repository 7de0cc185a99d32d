//! The twisting regulator: brings the mass to rest at the wall.

use zivi_core::control::{Gains, Port, RegulatorState, TwistingRegulator};
use zivi_core::{Physical, Restitution};

use crate::code::{self, Code, ZIVI_E_STATE, ZIVI_OK};
use crate::config;

/// Settings of a regulator. A member that is zero takes its default.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RegulatorConfig {
    /// `sizeof(zivi_regulator_config)`.
    pub size: u32,
    /// `ZIVI_TICK_LANDING` or `ZIVI_TICK_PAPER`.
    pub tick: u32,
    /// Horizon of the landing in periods, 1 + the periods of delay; by default 1.
    pub ahead: u32,
    /// 0.
    pub reserved: u32,
    /// Gain on the sign of the position (m/s^2).
    pub mu1: f64,
    /// Gain on the sign of the velocity, 0 < mu2 < mu1 (m/s^2).
    pub mu2: f64,
    /// Sampling period (s), > 0.
    pub h: f64,
    /// Coefficient of restitution of the wall, in (0, 1]; or give `kappa`.
    pub e: f64,
    /// `(1 - e)/(1 + e)`, in (0, 1), in place of `e`.
    pub kappa: f64,
    /// A bound of the unknown force that the gains are checked against (m/s^2); by default none.
    pub bound: f64,
    /// Measurements down to `-depth` are taken as 0, deeper ones refused (m); by default 0.1.
    pub depth: f64,
    /// Least control of the actuator (m/s^2); no limits while both are 0.
    pub u_min: f64,
    /// Largest control of the actuator (m/s^2).
    pub u_max: f64,
}

/// A regulator. Everything in it may be read, copied and logged; it is changed by
/// `zivi_regulator_*` alone.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Regulator {
    /// Gain on the sign of the position (m/s^2).
    pub mu1: f64,
    /// Gain on the sign of the velocity (m/s^2).
    pub mu2: f64,
    /// Sampling period (s).
    pub h: f64,
    /// Coefficient of restitution.
    pub e: f64,
    /// `(1 - e)/(1 + e)`.
    pub kappa: f64,
    /// How far behind the wall a measurement may lie (m).
    pub depth: f64,
    /// Least control (m/s^2).
    pub u_min: f64,
    /// Largest control (m/s^2).
    pub u_max: f64,
    /// The last control (m/s^2).
    pub u: f64,
    /// Multiplier in `sgn s` of the last tick.
    pub lambda_s: f64,
    /// Multiplier in `sgn v` of the last tick.
    pub lambda_v: f64,
    /// Ticks since the start.
    pub ticks: u64,
    /// Bits of what was done to the last sample and control.
    pub status: u32,
    /// Horizon of the landing in periods, 0 for the tick of the paper.
    pub ahead: u32,
    /// Marks an initialised object.
    pub mark: u64,
}

/// In `mark` of a regulator that was initialised.
const MARK: u64 = 0x7a69_7669_7265_6775;

impl RegulatorConfig {
    /// The size, and everything else 0.
    #[must_use]
    pub fn defaults() -> Self {
        Self { size: size_of::<Self>() as u32, ..Self::default() }
    }
}

impl Regulator {
    /// Checks the settings; nothing is remembered yet.
    pub fn init(&mut self, config: &RegulatorConfig) -> Code {
        match self.configured(config) {
            Ok(()) => ZIVI_OK,
            Err(code) => code,
        }
    }

    fn configured(&mut self, config: &RegulatorConfig) -> Result<(), Code> {
        config::checked_size::<RegulatorConfig>(config.size)?;
        let ahead = config::ahead(config.tick, config.ahead)?;
        let RegulatorConfig { mu1, mu2, bound, .. } = *config;
        let wall = config::wall(config.e, config.kappa)?;
        Gains::new(mu1, mu2).map_err(code::of)?;
        if bound != 0.0 {
            Gains::for_regulation(mu1, mu2, bound, wall).map_err(code::of_gain)?;
        }
        let port = config::port(config.depth, config.u_min, config.u_max)?;
        match Self::fresh(config, wall, port, ahead).call(None) {
            ZIVI_OK => *self = Self::fresh(config, wall, port, ahead),
            code => return Err(code),
        }
        Ok(())
    }

    /// With these settings, nothing remembered. (Made twice and never copied: a copy would be a call
    /// of memcpy.)
    #[inline(always)]
    fn fresh(config: &RegulatorConfig, wall: Restitution, port: Port, ahead: u32) -> Self {
        let RegulatorConfig { mu1, mu2, h, .. } = *config;
        let (e, kappa, depth) = (wall.e(), wall.kappa(), port.depth());
        let (u_min, u_max) = port.actuator();
        let fresh = Self { ahead, mark: MARK, ..Self::default() };
        Self { mu1, mu2, h, e, kappa, depth, u_min, u_max, ..fresh }
    }

    /// Forgets the last tick.
    pub fn reset(&mut self) -> Code {
        if self.mark != MARK {
            return ZIVI_E_STATE;
        }
        (self.u, self.lambda_s, self.lambda_v) = (0.0, 0.0, 0.0);
        (self.ticks, self.status) = (0, 0);
        ZIVI_OK
    }

    /// The control for the period that starts with this measurement: [`Regulator::u`].
    pub fn step(&mut self, x: f64, xdot: f64, force: f64) -> Code {
        self.call(Some((Physical { x, xdot }, force)))
    }

    /// The one place where the controller of the core is made: checks the settings, and ticks.
    fn call(&mut self, sample: Option<(Physical, f64)>) -> Code {
        match self.called(sample) {
            Ok(code) | Err(code) => code,
        }
    }

    #[inline(always)]
    fn called(&mut self, sample: Option<(Physical, f64)>) -> Result<Code, Code> {
        let mut core = self.core()?;
        let Some((measured, force)) = sample else { return Ok(ZIVI_OK) };
        core.tick(measured, force).map_err(code::of)?;
        let RegulatorState { u, signs: [lambda_s, lambda_v], status } = core.state();
        (self.u, self.lambda_s, self.lambda_v) = (u, lambda_s, lambda_v);
        self.ticks = self.ticks.wrapping_add(1);
        self.status = u32::from(status.bits());
        Ok(code::of_status(status))
    }

    #[inline(always)] // taken apart: no copy of it is ever made
    fn core(&self) -> Result<TwistingRegulator, Code> {
        if self.mark != MARK {
            return Err(ZIVI_E_STATE);
        }
        let wall = Restitution::from_both(self.e, self.kappa).map_err(code::of_restitution)?;
        let gains = Gains::new(self.mu1, self.mu2).map_err(code::of)?;
        let port = config::port(self.depth, self.u_min, self.u_max)?;
        let bare = TwistingRegulator::new(gains, self.h, wall).map_err(code::of)?;
        let landing = config::landing(self.ahead, self.h)?;
        Ok(bare.with_landing(landing).with_port(port))
    }
}
