//! Interface of controllers: validation of samples, limits, delay lines.
//!
//! Where a controller meets the plant: what it accepts from a sensor, what an actuator can do.

use crate::setting::{require, Setting, SettingError, Value, Values};
use crate::{flight, Physical, Real, Restitution};
use core::ops::Bound;

/// Limits of the sensor and of the actuator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Port {
    depth: Real,
    low: Real,
    high: Real,
}

/// Status of the last update: treatment of sample and control.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TickStatus {
    /// The measured position was slightly negative and was taken as `0`.
    pub clamped: bool,
    /// The control was cut to the actuator's range.
    pub saturated: bool,
    /// The requested general solver failed; the signs of the exact solution were used.
    pub unsolved: bool,
}

impl TickStatus {
    /// As a bit set: 1 clamped, 2 saturated, 8 unsolved. (4 is a loop's, for a rejected sample.)
    #[must_use]
    pub fn bits(self) -> u8 {
        u8::from(self.clamped) | (u8::from(self.saturated) << 1) | (u8::from(self.unsolved) << 3)
    }

    /// From a bit set; bits without a meaning are ignored.
    #[must_use]
    pub fn from_bits(bits: u8) -> Self {
        Self { clamped: bits & 1 != 0, saturated: bits & 2 != 0, unsolved: bits & 8 != 0 }
    }
}

impl Default for Port {
    /// Penetration up to 10 cm counts as noise, the control is unlimited.
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl Port {
    const DEFAULT: Self = Self { depth: 0.1, low: Real::NEG_INFINITY, high: Real::INFINITY };

    /// Largest accepted penetration of a measurement.
    pub const DEPTH: Setting = Setting {
        name: "depth",
        meaning: "depth behind the wall to which measurements are taken as 0",
        unit: "m",
        values: Values::NOT_NEGATIVE,
        range: "a finite distance >= 0 behind the wall (m)",
        default: Value::Number(Self::DEFAULT.depth),
    };

    /// Measured positions down to `-depth` (m) are sensor noise and are taken as `0`; deeper ones
    /// are rejected.
    ///
    /// # Errors
    /// [`SettingError`] unless `depth >= 0` and finite.
    pub fn with_depth(self, depth: Real) -> Result<Self, SettingError> {
        Self::DEPTH.check(depth)?;
        Ok(Self { depth, ..self })
    }

    /// The actuator gives `low <= u <= high` (m/s^2).
    ///
    /// # Errors
    /// [`SettingError`] unless `low < high`.
    pub fn with_actuator(self, low: Real, high: Real) -> Result<Self, SettingError> {
        require(!low.is_nan(), "u_min", low, "a number (m/s^2)")?;
        require(high > low, "u_max", high, "greater than u_min (m/s^2)")?;
        Ok(Self { low, high, ..self })
    }

    /// Limits that were checked before and are not checked again.
    #[inline]
    #[must_use]
    pub fn trusted(depth: Real, (low, high): (Real, Real)) -> Self {
        Self { depth, low, high }
    }

    /// Largest accepted penetration of a measurement (m).
    #[must_use]
    pub fn depth(&self) -> Real {
        self.depth
    }

    /// The actuator's range (m/s^2).
    #[must_use]
    pub fn actuator(&self) -> (Real, Real) {
        (self.low, self.high)
    }

    /// The state of a measurement; true if clamped.
    #[inline]
    pub(super) fn sense(&self, measured: Physical) -> Result<(Physical, bool), SettingError> {
        let Physical { x, xdot } = measured;
        let range = "a finite position, at most `depth` behind the wall (m)";
        require((-self.depth..=Real::MAX).contains(&x), "x", x, range)?;
        require(xdot.is_finite(), "xdot", xdot, "a finite velocity (m/s)")?;
        if x < 0.0 {
            Ok((Physical { x: 0.0, xdot }, true))
        } else {
            Ok((measured, false))
        }
    }

    /// The actuator's control for a commanded one; true if clipped.
    #[inline]
    pub(super) fn actuate(&self, wanted: Real) -> Result<(Real, bool), SettingError> {
        require(
            wanted.is_finite(),
            "u",
            wanted,
            "finite: the sample is too large to compute with",
        )?;
        let u = self.clipped(wanted);
        Ok((u, u != wanted))
    }

    /// The feasible control closest to a given one.
    #[inline]
    #[must_use]
    pub fn clipped(&self, u: Real) -> Real {
        let above = if u < self.low { self.low } else { u };
        if above > self.high {
            self.high
        } else {
            above
        }
    }
}

/// A force handed to an update.
#[inline]
pub(super) fn checked_force(name: &'static str, force: Real) -> Result<(), SettingError> {
    require(force.is_finite(), name, force, "a finite force per unit mass (m/s^2)")
}

// Controls that act some periods late: the state in which that of this sample will act.
//
// ```text
// (x, x')(t_k + d h) from (x, x')(t_k) through u_{k-d}, ..., u_{k-1}, each for a period
// ```
//
// through impacts and into rest, exactly where the force is known. An update for that state, its
// reference `d` periods ahead, is an update without delay.

/// The longest delay (periods).
pub const MOST_DELAY: usize = 64;

/// The delay of a controller that predicts.
pub const DELAY: Setting = Setting {
    name: "delay",
    meaning: "periods from a measurement to the moment when its control acts",
    unit: "1",
    values: Values::Numbers(Bound::Included(0.0), Bound::Included(MOST_DELAY as Real)),
    range: "a whole number of periods from 0 to 64",
    default: Value::Count(0),
};

/// A delay line: values leave it after its length in periods.
///
/// ```
/// use zivi_core::control::DelayLine;
/// let mut line = DelayLine::new(2, 0.0)?;
/// assert_eq!([1.0, 2.0, 3.0].map(|it| line.push(it)), [0.0, 0.0, 1.0]);
/// assert!(line.held().eq([2.0, 3.0]));
/// # Ok::<(), zivi_core::SettingError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DelayLine<T> {
    periods: usize,
    /// Where the oldest is.
    first: usize,
    held: [T; MOST_DELAY],
}

impl<T: Copy> DelayLine<T> {
    /// One of this length, with the same in all its places.
    ///
    /// # Errors
    /// [`SettingError`] for more than [`MOST_DELAY`] periods.
    pub fn new(periods: usize, value: T) -> Result<Self, SettingError> {
        DELAY.check(periods as Real)?;
        Ok(Self { periods, first: 0, held: [value; MOST_DELAY] })
    }

    /// Its length.
    #[must_use]
    pub fn periods(&self) -> usize {
        self.periods
    }

    /// Puts one in and gives the oldest.
    pub fn push(&mut self, value: T) -> T {
        let oldest = self.oldest().unwrap_or(value);
        let last = (self.first + self.periods) % MOST_DELAY;
        if let Some(place) = self.held.get_mut(last) {
            *place = value;
        }
        self.first = (self.first + 1) % MOST_DELAY;
        oldest
    }

    /// The one that comes out next, `None` of a line without length.
    #[must_use]
    pub fn oldest(&self) -> Option<T> {
        self.held().next()
    }

    /// Those in it, the oldest first.
    pub fn held(&self) -> impl Iterator<Item = T> + '_ {
        self.held.iter().cycle().skip(self.first).take(self.periods).copied()
    }
}

impl DelayLine<Real> {
    /// The state after these controls, each for a period `h` (s), with the additional acceleration
    /// `force`.
    #[must_use]
    pub fn ahead(&self, state: Physical, wall: Restitution, force: Real, h: Real) -> Physical {
        self.held().fold(state, |at, u| flight::after(at, force + u, wall.e(), h))
    }
}

#[cfg(test)]
mod port_tests {
    use super::*;

    #[test]
    fn limits_that_are_trusted_are_those_that_were_checked() -> Result<(), SettingError> {
        let port = Port::default().with_depth(0.02)?.with_actuator(-3.0, 5.0)?;
        assert_eq!(Port::trusted(0.02, (-3.0, 5.0)), port);
        assert_eq!((port.depth(), port.actuator()), (0.02, (-3.0, 5.0)));
        Ok(())
    }
}
