//! The observer: position, velocity and an unknown force of a mass, through impacts.

use zivi_core::observer::{
    Covariance, Estimate, ImpactObserver, Measurement, ObserverSettings, ObserverState,
};
use zivi_core::{Physical, Restitution};

use crate::code::{self, Code, ZIVI_E_POSITION_ONLY, ZIVI_E_STATE, ZIVI_OK};
use crate::config;

/// Settings of an observer. A member that is zero takes its default.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ObserverConfig {
    /// `sizeof(zivi_observer_config)`.
    pub size: u32,
    /// 1: the velocity is not measured; 0: it is, where it is not NaN.
    pub position_only: u32,
    /// Sampling period (s), > 0.
    pub h: f64,
    /// Coefficient of restitution of the wall, in (0, 1]; or give `kappa`.
    pub e: f64,
    /// `(1 - e)/(1 + e)`, in (0, 1), in place of `e`.
    pub kappa: f64,
    /// Standard deviation of a measured position (m); by default 1e-4.
    pub noise_x: f64,
    /// Standard deviation of a measured velocity (m/s); by default 1e-2.
    pub noise_xdot: f64,
    /// Variance of what a period adds to the unknown force (m^2/s^4); by default 1e-3.
    pub q_d: f64,
    /// Standard deviation of `e`; by default 0.
    pub se: f64,
    /// Bound of the unknown force (m/s^2); by default 20.
    pub dmax: f64,
}

/// An observer. Everything in it may be read, copied and logged; it is changed by
/// `zivi_observer_*` alone.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Observer {
    /// The settings.
    pub config: ObserverConfig,
    /// Estimate of the distance from the wall (m).
    pub x: f64,
    /// Estimate of the velocity (m/s).
    pub xdot: f64,
    /// Estimate of the unknown force (m/s^2).
    pub d: f64,
    /// Covariance of the estimates.
    pub p_xx: f64,
    /// The same of position and velocity.
    pub p_xv: f64,
    /// The same of position and force.
    pub p_xd: f64,
    /// Variance of the velocity.
    pub p_vv: f64,
    /// Covariance of velocity and force.
    pub p_vd: f64,
    /// Variance of the force.
    pub p_dd: f64,
    /// Whether there was a measurement.
    pub started: u32,
    /// Measurements refused in a row.
    pub in_a_row: u32,
    /// Measurements refused so far.
    pub refused: u32,
    /// 0.
    pub reserved: u32,
    /// Marks an initialised object.
    pub mark: u64,
}

/// In `mark` of an observer that was initialised.
const MARK: u64 = 0x7a69_7669_6f62_7365;

impl ObserverConfig {
    /// The size, and everything else 0.
    #[must_use]
    pub fn defaults() -> Self {
        Self { size: size_of::<Self>() as u32, ..Self::default() }
    }

    fn settings(&self) -> Result<ObserverSettings, Code> {
        let or = |value: f64, default: f64| if value == 0.0 { default } else { value };
        let wall: Restitution = config::wall(self.e, self.kappa)?;
        let bare = ObserverSettings::new(wall, self.h).map_err(code::of)?;
        let (of_x, of_v) = (or(self.noise_x, 1e-4), or(self.noise_xdot, 1e-2));
        let heard = bare.with_noise(of_x, of_v).map_err(code::of)?;
        let pushed = heard.with_force(or(self.q_d, 1e-3), or(self.dmax, 20.0)).map_err(code::of)?;
        let settings = pushed.with_restitution_error(self.se).map_err(code::of)?;
        match self.position_only {
            0 => Ok(settings.with_position_only(false)),
            1 => Ok(settings.with_position_only(true)),
            _ => Err(ZIVI_E_POSITION_ONLY),
        }
    }
}

impl Observer {
    /// Checks the settings; nothing was measured yet.
    pub fn init(&mut self, config: &ObserverConfig) -> Code {
        let checked = config::checked_size::<ObserverConfig>(config.size);
        match checked.and_then(|()| config.settings()) {
            Ok(_) => {
                *self = Self { config: *config, mark: MARK, ..Self::default() };
                ZIVI_OK
            }
            Err(code) => code,
        }
    }

    /// Forgets all measurements.
    pub fn reset(&mut self) -> Code {
        if self.mark != MARK {
            return ZIVI_E_STATE;
        }
        self.remember(ObserverState::default());
        ZIVI_OK
    }

    /// Takes a measurement; `xdot` is NaN where it is not measured. `force` is the known force and
    /// `u` the control that acted over the period that ends now.
    pub fn step(&mut self, x: f64, xdot: f64, force: f64, u: f64) -> Code {
        let (true, Ok(settings)) = (self.mark == MARK, self.config.settings()) else {
            return ZIVI_E_STATE;
        };
        let mut core = ImpactObserver::new(settings);
        core.set_state(self.state());
        let measured = Measurement { x, xdot: (!xdot.is_nan()).then_some(xdot) };
        match core.tick(measured, force, u) {
            Ok(_) => {
                self.remember(core.state());
                ZIVI_OK
            }
            Err(error) => code::of(error),
        }
    }

    fn state(&self) -> ObserverState {
        let Self { x, xdot, d, p_xx, p_xv, p_xd, p_vv, p_vd, p_dd, .. } = *self;
        ObserverState {
            started: self.started != 0,
            estimate: Estimate { state: Physical { x, xdot }, d },
            covariance: Covariance { xx: p_xx, xv: p_xv, xd: p_xd, vv: p_vv, vd: p_vd, dd: p_dd },
            in_a_row: self.in_a_row,
            refused: self.refused,
        }
    }

    fn remember(&mut self, state: ObserverState) {
        let ObserverState { started, estimate, covariance, in_a_row, refused } = state;
        (self.x, self.xdot, self.d) = (estimate.state.x, estimate.state.xdot, estimate.d);
        let Covariance { xx, xv, xd, vv, vd, dd } = covariance;
        (self.p_xx, self.p_xv, self.p_xd) = (xx, xv, xd);
        (self.p_vv, self.p_vd, self.p_dd) = (vv, vd, dd);
        (self.started, self.in_a_row, self.refused) = (u32::from(started), in_a_row, refused);
    }
}
