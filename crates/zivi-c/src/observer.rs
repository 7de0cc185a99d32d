//! The observer: position, velocity and an unknown force of a mass, through impacts.

use zivi_core::observer::{
    Covariance, Estimate, Measurement, Memory, ObserverSettings, ObserverState, REMEMBERED,
};
use zivi_core::{Physical, Real, Restitution};

use crate::code::{self, Code, ZIVI_E_LEARN_E, ZIVI_E_POSITION_ONLY, ZIVI_OK};
use crate::code::{Sealed, Word};
use crate::config::{
    self, Given, ZIVI_GIVEN_DMAX, ZIVI_GIVEN_NOISE_X, ZIVI_GIVEN_NOISE_XDOT, ZIVI_GIVEN_Q_D,
};

/// The valid bits of an observer's `given`.
const GIVEN: u32 =
    config::WALL | ZIVI_GIVEN_NOISE_X | ZIVI_GIVEN_NOISE_XDOT | ZIVI_GIVEN_Q_D | ZIVI_GIVEN_DMAX;

/// Settings of an observer. A member that is zero has its default value, unless its bit
/// of `given` is set.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ObserverConfig {
    /// `sizeof(zivi_observer_config)`.
    pub size: u32,
    /// 1: the velocity is not measured; 0: it is measured unless it is NaN.
    pub position_only: u32,
    /// 1: `e` is estimated; `se` is then its initial standard deviation, by default 0.1.
    pub learn_e: u32,
    /// `ZIVI_GIVEN_...`: the members whose value 0 is intended and replaces the default.
    pub given: u32,
    /// Sampling period (s), > 0.
    pub h: Real,
    /// Coefficient of restitution of the wall, in (0, 1]; or set `kappa`.
    pub e: Real,
    /// `(1 - e)/(1 + e)`, in (0, 1), in place of `e`.
    pub kappa: Real,
    /// Standard deviation of a measured position (m); by default 1e-4.
    pub noise_x: Real,
    /// Standard deviation of a measured velocity (m/s); by default 1e-2.
    pub noise_xdot: Real,
    /// Variance of the change of the unknown force in a period (m^2/s^4); by default 1e-3.
    pub q_d: Real,
    /// Standard deviation of `e`; by default 0.
    pub se: Real,
    /// Bound of the unknown force (m/s^2); by default 20.
    pub dmax: Real,
    /// Variance that an impact adds to an estimated `e`; by default 0.
    pub q_e: Real,
}

/// An observer. Everything in it may be read, copied and logged; it is changed by
/// `zivi_observer_*` alone.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Observer {
    /// The settings, defaults filled in.
    pub config: ObserverConfig,
    /// Estimate of the distance from the wall (m).
    pub x: Real,
    /// Estimate of the velocity (m/s).
    pub xdot: Real,
    /// Estimate of the unknown force (m/s^2).
    pub d: Real,
    /// The coefficient of restitution, or its estimate.
    pub e: Real,
    /// Covariance of the estimates.
    pub p_xx: Real,
    /// Covariance of position and velocity.
    pub p_xv: Real,
    /// Covariance of position and force.
    pub p_xd: Real,
    /// Variance of the velocity.
    pub p_vv: Real,
    /// Covariance of velocity and force.
    pub p_vd: Real,
    /// Variance of the force.
    pub p_dd: Real,
    /// Covariance of position and `e`.
    pub p_xe: Real,
    /// Covariance of velocity and `e`.
    pub p_ve: Real,
    /// Covariance of force and `e`.
    pub p_de: Real,
    /// Variance of `e`, 0 if it is not estimated.
    pub p_ee: Real,
    /// The last measured positions, the newest first, minus the displacement by the acceleration
    /// since the measurement (m).
    pub seen_y: [Real; 6],
    /// Time since each measurement (s).
    pub seen_age: [Real; 6],
    /// Number of stored positions.
    pub seen: u32,
    /// Whether the velocity waits for a second position.
    pub waiting: u32,
    /// Whether there was a measurement.
    pub started: u32,
    /// Measurements rejected in a row.
    pub in_a_row: u32,
    /// Measurements rejected so far.
    pub refused: u32,
    /// 0.
    pub reserved: u32,
    /// Checksum of the settings, which reveals a damaged or uninitialised object.
    pub seal: u64,
}

// SAFETY: `config`
unsafe impl Sealed for Observer {
    const SETTINGS: usize = core::mem::offset_of!(Observer, x) / size_of::<Word>();
    const KIND: u64 = 0x7a69_7669_6f62_7365;

    fn seal(&self) -> u64 {
        self.seal
    }
}

const _: () = {
    use core::mem::offset_of;
    assert!(REMEMBERED == 6);
    #[cfg(not(feature = "single"))]
    assert!(size_of::<Observer>() == 328 && size_of::<ObserverConfig>() == 88);
    assert!(offset_of!(Observer, x) == size_of::<Word>() * <Observer as Sealed>::SETTINGS);
    #[cfg(not(feature = "single"))]
    assert!(offset_of!(Observer, started) == 304);
};

impl ObserverConfig {
    /// The size; all other members are 0.
    #[must_use]
    pub fn defaults() -> Self {
        Self { size: size_of::<Self>() as u32, ..Self::default() }
    }

    /// The settings with their defaults, checked.
    fn checked(&self) -> Result<Self, Code> {
        config::checked_size::<Self>(self.size)?;
        let given = Given::checked(self.given, GIVEN)?;
        let restitution: Restitution = config::restitution(given, self.e, self.kappa)?;
        let [noise_x, noise_xdot, q_d, _, dmax] = ObserverSettings::DEFAULTS;
        let noise_x = given.or(ZIVI_GIVEN_NOISE_X, self.noise_x, noise_x);
        let noise_xdot = given.or(ZIVI_GIVEN_NOISE_XDOT, self.noise_xdot, noise_xdot);
        let q_d = given.or(ZIVI_GIVEN_Q_D, self.q_d, q_d);
        let dmax = given.or(ZIVI_GIVEN_DMAX, self.dmax, dmax);
        let bare = ObserverSettings::new(restitution, self.h).map_err(code::of)?;
        let heard = bare.with_noise(noise_x, noise_xdot).map_err(code::of)?;
        let pushed = heard.with_force(q_d, dmax).map_err(code::of)?;
        let unsure = pushed.with_restitution_error(self.se).map_err(code::of)?;
        if self.position_only > 1 {
            return Err(ZIVI_E_POSITION_ONLY);
        }
        if self.learn_e > 1 {
            return Err(ZIVI_E_LEARN_E);
        }
        unsure.with_learning(self.learn_e != 0, self.q_e).map_err(code::of)?;
        let (e, kappa) = (restitution.e(), restitution.kappa());
        Ok(Self { e, kappa, noise_x, noise_xdot, q_d, dmax, ..*self })
    }
}

impl Observer {
    /// Checks the settings; there is no measurement yet.
    pub fn init(&mut self, config: &ObserverConfig) -> Code {
        match config.checked() {
            Ok(config) => {
                self.config = config;
                self.forget();
                self.seal = self.seal_of_settings();
                ZIVI_OK
            }
            Err(code) => code,
        }
    }

    /// Forgets all measurements.
    pub fn reset(&mut self) -> Code {
        if let Err(code) = self.intact() {
            return code;
        }
        self.forget();
        ZIVI_OK
    }

    /// Processes a measurement; `x` is NaN if it is missing, `xdot` if it is not measured. `force`
    /// is the known force and `u` the control that acted over the period that ends now.
    pub fn step(&mut self, x: Real, xdot: Real, force: Real, u: Real) -> Code {
        self.step_after(self.config.h, Measurement { x, xdot: Some(xdot) }, force, u)
    }

    /// Processes a measurement `dt` (s) after the last one.
    pub fn step_after(&mut self, dt: Real, measured: Measurement, force: Real, u: Real) -> Code {
        if let Err(code) = self.intact() {
            return code;
        }
        let mut state = self.state();
        match self.settings().advance(&mut state, dt, Some(measured), force, u) {
            Ok(()) => {
                self.remember(&state);
                ZIVI_OK
            }
            Err(error) => code::of(error),
        }
    }

    /// As before the first measurement.
    fn forget(&mut self) {
        (self.x, self.xdot, self.d, self.e) = (0.0, 0.0, 0.0, self.config.e);
        (self.p_xx, self.p_xv, self.p_xd) = (0.0, 0.0, 0.0);
        (self.p_vv, self.p_vd, self.p_dd) = (0.0, 0.0, 0.0);
        (self.p_xe, self.p_ve, self.p_de) = (0.0, 0.0, 0.0);
        self.p_ee = self.settings().prior();
        for column in [&mut self.seen_y, &mut self.seen_age] {
            for it in column {
                // SAFETY: a number of this object; a plain loop would be a call of `memset`
                unsafe { core::ptr::from_mut(it).write_volatile(0.0) };
            }
        }
        (self.seen, self.waiting, self.started) = (0, 0, 0);
        (self.in_a_row, self.refused, self.reserved) = (0, 0, 0);
    }

    /// The settings, which were checked.
    #[inline]
    fn settings(&self) -> ObserverSettings {
        let ObserverConfig { h, e, kappa, noise_x, noise_xdot, q_d, se, dmax, q_e, .. } =
            self.config;
        let restitution = Restitution::trusted(e, kappa);
        ObserverSettings::trusted(restitution, h, [noise_x, noise_xdot, q_d, se, dmax])
            .with_position_only(self.config.position_only != 0)
            .trusted_learning(self.config.learn_e != 0, q_e)
    }

    #[inline(always)]
    fn state(&self) -> ObserverState {
        let Self { x, xdot, d, e, p_xx, p_xv, p_xd, p_vv, p_vd, p_dd, .. } = *self;
        let Self { p_xe, p_ve, p_de, p_ee, .. } = *self;
        let mut state = ObserverState {
            started: self.started != 0,
            waiting: self.waiting != 0,
            estimate: Estimate { state: Physical { x, xdot }, d },
            e,
            covariance: Covariance {
                xx: p_xx,
                xv: p_xv,
                xd: p_xd,
                vv: p_vv,
                vd: p_vd,
                dd: p_dd,
                xe: p_xe,
                ve: p_ve,
                de: p_de,
                ee: p_ee,
            },
            memory: Memory { count: self.seen, ..Memory::default() },
            in_a_row: self.in_a_row,
            refused: self.refused,
        };
        // afterwards, or they would be copied twice, over the stack
        state.memory.y = self.seen_y;
        state.memory.age = self.seen_age;
        state
    }

    #[inline(always)]
    fn remember(&mut self, state: &ObserverState) {
        let ObserverState { started, waiting, estimate, e, covariance, memory, .. } = state;
        (self.x, self.xdot, self.d) = (estimate.state.x, estimate.state.xdot, estimate.d);
        self.e = *e;
        let Covariance { xx, xv, xd, vv, vd, dd, xe, ve, de, ee } = *covariance;
        (self.p_xx, self.p_xv, self.p_xd) = (xx, xv, xd);
        (self.p_vv, self.p_vd, self.p_dd) = (vv, vd, dd);
        (self.p_xe, self.p_ve, self.p_de, self.p_ee) = (xe, ve, de, ee);
        (self.seen_y, self.seen_age) = (memory.y, memory.age);
        self.seen = memory.count;
        (self.started, self.waiting) = (u32::from(*started), u32::from(*waiting));
        (self.in_a_row, self.refused) = (state.in_a_row, state.refused);
    }
}
