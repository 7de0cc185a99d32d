//! What an observer is told of the plant and of its sensor.

use crate::setting::{is_not_negative, is_positive, require};
use crate::{Restitution, SettingError};

/// Settings of an [`super::ImpactObserver`], all in range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObserverSettings {
    pub(super) restitution: Restitution,
    pub(super) h: f64,
    /// Variances of a measured position and velocity.
    pub(super) noise: [f64; 2],
    pub(super) q_d: f64,
    pub(super) se: f64,
    pub(super) dmax: f64,
    pub(super) position_only: bool,
}

/// Largest and smallest deviations whose squares are numbers.
const RANGE: [f64; 2] = [1e-150, 1e150];

impl ObserverSettings {
    /// Settings for a mass that is measured every `h` (s), with noise of 1e-4 m and 1e-2
    /// m/s, an exact `e`, and an unknown force of at most 20 m/s^2 whose change per period has the
    /// variance 1e-3 (m/s^2)^2.
    ///
    /// # Errors
    /// [`SettingError`] unless `h` is positive and finite.
    pub fn new(restitution: Restitution, h: f64) -> Result<Self, SettingError> {
        require(is_positive(h), "h", h, "a finite sampling period > 0")?;
        let noise = [1e-4 * 1e-4, 1e-2 * 1e-2];
        Ok(Self { restitution, h, noise, q_d: 1e-3, se: 0.0, dmax: 20.0, position_only: false })
    }

    /// The settings of numbers that were checked before and are not checked again: the standard
    /// deviations of position and velocity, `q_d`, `se` and `dmax`.
    #[inline]
    #[must_use]
    pub fn trusted(restitution: Restitution, h: f64, [x, xdot, q_d, se, dmax]: [f64; 5]) -> Self {
        Self { restitution, h, noise: [x * x, xdot * xdot], q_d, se, dmax, position_only: false }
    }

    /// The same with these standard deviations of a measured position (m) and velocity (m/s).
    ///
    /// # Errors
    /// [`SettingError`] unless both lie in 1e-150 to 1e150.
    pub fn with_noise(self, x: f64, xdot: f64) -> Result<Self, SettingError> {
        let [least, most] = RANGE;
        for value in [x, xdot] {
            let range = "a standard deviation > 0, from 1e-150 to 1e150 (m, m/s)";
            require(value >= least && value <= most, "noise", value, range)?;
        }
        Ok(Self { noise: [x * x, xdot * xdot], ..self })
    }

    /// The same with an unknown force of at most `dmax` (m/s^2) whose change per period has the
    /// variance `q_d`, 5 to 10 times `(h max |d'|)^2`.
    ///
    /// # Errors
    /// [`SettingError`] unless `q_d >= 0` and `dmax` lies in 0 to 1e150.
    pub fn with_force(self, q_d: f64, dmax: f64) -> Result<Self, SettingError> {
        let [_, most] = RANGE;
        require(is_not_negative(q_d), "q_d", q_d, "a finite variance >= 0 (m^2/s^4)")?;
        let range = "a bound from 0 to 1e150 (m/s^2)";
        require(dmax >= 0.0 && dmax <= most, "dmax", dmax, range)?;
        Ok(Self { q_d, dmax, ..self })
    }

    /// The same with a restitution that is `e` up to the standard deviation `se`.
    ///
    /// # Errors
    /// [`SettingError`] unless `se` lies in 0 to 1.
    pub fn with_restitution_error(self, se: f64) -> Result<Self, SettingError> {
        require((0.0..=1.0).contains(&se), "se", se, "a standard deviation of e, in [0, 1]")?;
        Ok(Self { se, ..self })
    }

    /// The same with velocities taken into account or not.
    #[must_use]
    pub fn with_position_only(self, position_only: bool) -> Self {
        Self { position_only, ..self }
    }

    /// The wall.
    #[must_use]
    pub fn restitution(&self) -> Restitution {
        self.restitution
    }

    /// The sampling period (s).
    #[must_use]
    pub fn h(&self) -> f64 {
        self.h
    }

    /// The largest unknown force (m/s^2).
    #[must_use]
    pub fn dmax(&self) -> f64 {
        self.dmax
    }
}
