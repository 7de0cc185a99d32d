//! Settings of an observer: plant and sensor.

use core::ops::Bound;

use crate::real::{LARGE, SMALL};
use crate::setting::{is_positive, require, Setting, Value, Values};
use crate::{Real, Restitution, SettingError};

/// Settings of an [`super::ImpactObserver`], all in range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObserverSettings {
    pub(super) restitution: Restitution,
    pub(super) h: Real,
    /// Variances of a measured position and velocity.
    pub(super) noise: [Real; 2],
    pub(super) q_d: Real,
    pub(super) se: Real,
    pub(super) dmax: Real,
    pub(super) position_only: bool,
    pub(super) learn_e: bool,
    pub(super) q_e: Real,
}

/// Deviations whose squares are numbers.
const DEVIATION: Values = Values::Numbers(Bound::Included(SMALL), Bound::Included(LARGE));

impl ObserverSettings {
    /// Standard deviations of a measured position and velocity, `q_d`, `se` and `dmax`, unless told
    /// otherwise.
    pub const DEFAULTS: [Real; 5] = [1e-4, 1e-2, 1e-3, 0.0, 20.0];

    /// Standard deviation of a measured position.
    pub const NOISE_X: Setting = Setting {
        name: "noise",
        meaning: "standard deviation of a measured position",
        unit: "m",
        values: DEVIATION,
        range: if cfg!(feature = "single") {
            "a standard deviation > 0, from 1e-18 to 1e18 (m, m/s)"
        } else {
            "a standard deviation > 0, from 1e-150 to 1e150 (m, m/s)"
        },
        default: Value::Number(Self::DEFAULTS[0]),
    };
    /// Standard deviation of a measured velocity.
    pub const NOISE_XDOT: Setting = Setting {
        meaning: "standard deviation of a measured velocity",
        unit: "m/s",
        default: Value::Number(Self::DEFAULTS[1]),
        ..Self::NOISE_X
    };
    /// Variance of the change of the unknown force per period.
    pub const Q_D: Setting = Setting {
        name: "q_d",
        meaning: "variance of the change of the unknown force per period",
        unit: "m^2/s^4",
        values: Values::NOT_NEGATIVE,
        range: "a finite variance >= 0 (m^2/s^4)",
        default: Value::Number(Self::DEFAULTS[2]),
    };
    /// Standard deviation of the restitution.
    pub const SE: Setting = Setting {
        name: "se",
        meaning: "standard deviation of e",
        unit: "1",
        values: Values::UNIT,
        range: "a standard deviation of e, in [0, 1]",
        default: Value::Number(Self::DEFAULTS[3]),
    };
    /// The largest unknown force.
    pub const DMAX: Setting = Setting {
        name: "dmax",
        meaning: "bound of the unknown force",
        unit: "m/s^2",
        values: Values::Numbers(Bound::Included(0.0), Bound::Included(LARGE)),
        range: if cfg!(feature = "single") {
            "a bound from 0 to 1e18 (m/s^2)"
        } else {
            "a bound from 0 to 1e150 (m/s^2)"
        },
        default: Value::Number(Self::DEFAULTS[4]),
    };

    /// Variance of the change of a restitution that is learnt, per impact.
    pub const Q_E: Setting = Setting {
        name: "q_e",
        meaning: "variance of the change of e per impact",
        unit: "1",
        values: Values::UNIT,
        range: "a variance of e, in [0, 1]",
        default: Value::Number(0.0),
    };

    /// Default standard deviation of a learnt restitution.
    pub const UNSAID: Real = 0.1;

    /// Settings for a mass that is measured every `h` (s), the others as in
    /// [`ObserverSettings::DEFAULTS`].
    ///
    /// # Errors
    /// [`SettingError`] unless `h` is positive and finite.
    pub fn new(restitution: Restitution, h: Real) -> Result<Self, SettingError> {
        require(is_positive(h), "h", h, "a finite sampling period > 0")?;
        Ok(Self::trusted(restitution, h, Self::DEFAULTS))
    }

    /// The settings of numbers that were checked before and are not checked again: the standard
    /// deviations of position and velocity, `q_d`, `se` and `dmax`.
    #[inline]
    #[must_use]
    pub fn trusted(restitution: Restitution, h: Real, [x, xdot, q_d, se, dmax]: [Real; 5]) -> Self {
        let noise = [x * x, xdot * xdot];
        let (position_only, learn_e, q_e) = (false, false, 0.0);
        Self { restitution, h, noise, q_d, se, dmax, position_only, learn_e, q_e }
    }

    /// The same with these standard deviations of a measured position (m) and velocity (m/s).
    ///
    /// # Errors
    /// [`SettingError`] unless both lie in 1e-150 to 1e150.
    pub fn with_noise(self, x: Real, xdot: Real) -> Result<Self, SettingError> {
        Self::NOISE_X.check(x)?;
        Self::NOISE_XDOT.check(xdot)?;
        Ok(Self { noise: [x * x, xdot * xdot], ..self })
    }

    /// The same with an unknown force of at most `dmax` (m/s^2) whose change per period has the
    /// variance `q_d`, 5 to 10 times `(h max |d'|)^2`.
    ///
    /// # Errors
    /// [`SettingError`] unless `q_d >= 0` and `dmax` lies in 0 to 1e150.
    pub fn with_force(self, q_d: Real, dmax: Real) -> Result<Self, SettingError> {
        Self::Q_D.check(q_d)?;
        Self::DMAX.check(dmax)?;
        Ok(Self { q_d, dmax, ..self })
    }

    /// The same with a restitution that is `e` up to the standard deviation `se`.
    ///
    /// # Errors
    /// [`SettingError`] unless `se` lies in 0 to 1.
    pub fn with_restitution_error(self, se: Real) -> Result<Self, SettingError> {
        Self::SE.check(se)?;
        Ok(Self { se, ..self })
    }

    /// The same with velocities taken into account or not.
    #[must_use]
    pub fn with_position_only(self, position_only: bool) -> Self {
        Self { position_only, ..self }
    }

    /// The same with a restitution that is learnt, or not. If it is learnt, `se` is the initial
    /// standard deviation ([`ObserverSettings::UNSAID`] for 0) and `q_e` the variance added by each
    /// impact, 0 for a constant wall.
    ///
    /// # Errors
    /// [`SettingError`] unless `q_e` lies in 0 to 1.
    pub fn with_learning(self, learn_e: bool, q_e: Real) -> Result<Self, SettingError> {
        Self::Q_E.check(q_e)?;
        Ok(self.trusted_learning(learn_e, q_e))
    }

    /// The same of a number that was checked before.
    #[inline]
    #[must_use]
    pub fn trusted_learning(self, learn_e: bool, q_e: Real) -> Self {
        Self { learn_e, q_e: if learn_e { q_e } else { 0.0 }, ..self }
    }

    /// Variance of a restitution that is learnt, before anything was seen; 0 of one that is not.
    #[inline]
    #[must_use]
    pub fn prior(&self) -> Real {
        let se = if self.se > 0.0 { self.se } else { Self::UNSAID };
        if self.learn_e {
            se * se
        } else {
            0.0
        }
    }

    /// Whether the restitution is learnt.
    #[must_use]
    pub fn learns_e(&self) -> bool {
        self.learn_e
    }

    /// The wall.
    #[must_use]
    pub fn restitution(&self) -> Restitution {
        self.restitution
    }

    /// The sampling period (s).
    #[must_use]
    pub fn h(&self) -> Real {
        self.h
    }

    /// The largest unknown force (m/s^2).
    #[must_use]
    pub fn dmax(&self) -> Real {
        self.dmax
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trusted_deviations_are_squared_as_those_that_are_checked() -> Result<(), SettingError> {
        let restitution = Restitution::trusted(0.5, 1.0 / 3.0);
        let [_, _, q_d, se, dmax] = ObserverSettings::DEFAULTS;
        let trusted = ObserverSettings::trusted(restitution, 1e-3, [0.5, 0.25, q_d, se, dmax]);
        assert_eq!(trusted, ObserverSettings::new(restitution, 1e-3)?.with_noise(0.5, 0.25)?);
        assert_eq!(trusted.noise, [0.25, 0.0625]);
        Ok(())
    }
}
