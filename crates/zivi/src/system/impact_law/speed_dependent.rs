//! A coefficient of restitution that is a power of the speed of the impact.
//!
//! ```text
//! x'+ = e(v) v      e(v) = min(e0 (v/v0)^-k, e_max)      v = -x'- > 0                       (1)
//! ```
//!
//! `k = 1/4` is that of plastic contacts far above the yield point (Johnson, Contact Mechanics,
//! 1985, section 11.5); below it the contact is elastic, which the cap stands for. In `log v` the
//! power law alone is the line
//!
//! ```text
//! log v_(n+1) - log v* = (1 - k) (log v_n - log v*)      v* = v0 e0^(1/k)                   (2)
//! ```
//!
//! from one impact to the next. For `0 < k < 1` speeds decrease to `v*`, where `e = 1`: with `e_max
//! = 1` the mass keeps bouncing and never rests. With `e_max < 1` the cap is reached after a few
//! impacts; then the chain is geometric. For `k < 0` the point `v*` repels: speeds below it fall
//! faster than any geometric chain, to rest after a few impacts.

use super::law::{value, ImpactLaw, ParametricLaw};
use zivi_core::setting::{Setting, Value, Values};
use zivi_core::{Restitution, SettingError};

use std::ops::Bound;

/// The law (1).
///
/// ```
/// use zivi::system::impact_law::{ImpactLaw, ParametricLaw, SpeedDependentImpact};
/// let law = SpeedDependentImpact::of(&[0.5, 1.0, 0.25, 1.0])?;
/// assert!((law.after(16.0) - 4.0).abs() < 1e-15); // 0.5 * 16^(-1/4) = 0.25
/// assert_eq!((law.after(1e-3), law.limit()), (1e-3, Some(1.0)));
/// # Ok::<(), zivi_core::SettingError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpeedDependentImpact {
    e0: f64,
    v0: f64,
    k: f64,
    e_max: f64,
}

impl SpeedDependentImpact {
    const E0: Setting = Setting {
        name: "e0",
        meaning: "coefficient of restitution at the speed v0",
        unit: "1",
        values: Values::UNIT,
        range: "a number from 0 to 1",
        default: Value::Required,
    };
    const V0: Setting = Setting {
        name: "v0",
        meaning: "speed at which the coefficient is e0",
        unit: "m/s",
        values: Values::POSITIVE,
        range: "a finite number > 0",
        default: Value::Required,
    };
    /// From 1 on a faster impact would have no faster rebound.
    const K: Setting = Setting {
        name: "k",
        meaning: "exponent, e = e0 (v/v0)^-k",
        unit: "1",
        values: Values::Numbers(Bound::Excluded(f64::NEG_INFINITY), Bound::Excluded(1.0)),
        range: "a finite number below 1",
        default: Value::Required,
    };
    const E_MAX: Setting = Setting {
        name: "e_max",
        meaning: "largest coefficient, at low speeds for k > 0, at high ones for k < 0",
        unit: "1",
        values: Values::UNIT,
        range: "a number from e0 to 1",
        default: Value::Number(1.0),
    };

    /// The coefficient before the cap.
    fn power(&self, v: f64) -> f64 {
        if self.e0 == 0.0 {
            0.0
        } else {
            self.e0 * libm::pow(v / self.v0, -self.k)
        }
    }
}

impl ParametricLaw for SpeedDependentImpact {
    const PARAMETERS: &'static [Setting] = &[Self::E0, Self::V0, Self::K, Self::E_MAX];

    fn of(values: &[f64]) -> Result<Self, SettingError> {
        for (i, parameter) in Self::PARAMETERS.iter().enumerate() {
            parameter.check(value(values, i))?;
        }
        let [e0, v0, k, e_max] = [0, 1, 2, 3].map(|i| value(values, i));
        if e_max < e0 {
            let Setting { name, range, .. } = Self::E_MAX;
            return Err(SettingError { name, value: e_max, range });
        }
        Ok(Self { e0, v0, k, e_max })
    }
}

impl ImpactLaw for SpeedDependentImpact {
    fn after(&self, v: f64) -> f64 {
        self.power(v).min(self.e_max) * v
    }

    fn slope(&self, v: f64) -> f64 {
        let e = self.power(v);
        if e < self.e_max {
            (1.0 - self.k) * e
        } else {
            self.e_max
        }
    }

    fn by(&self, parameter: usize, v: f64) -> f64 {
        let e = self.power(v);
        if e >= self.e_max {
            return if parameter == 3 { v } else { 0.0 };
        }
        match parameter {
            0 => libm::pow(v / self.v0, -self.k) * v,
            1 => self.k * e * v / self.v0,
            2 => -libm::log(v / self.v0) * e * v,
            _ => 0.0,
        }
    }

    fn limit(&self) -> Option<f64> {
        Some(if self.e0 == 0.0 || self.k < 0.0 {
            0.0
        } else if self.k > 0.0 {
            self.e_max
        } else {
            self.e0
        })
    }

    fn limit_by(&self, parameter: usize) -> f64 {
        let (moves, of) = if self.k > 0.0 { (self.e0 > 0.0, 3) } else { (self.k == 0.0, 0) };
        f64::from(moves && parameter == of)
    }

    fn geometric_up_to(&self) -> f64 {
        if self.e0 == 0.0 || self.k == 0.0 {
            f64::INFINITY
        } else if self.k < 0.0 {
            0.0
        } else {
            // where the power law meets the cap
            self.v0 * libm::pow(self.e0 / self.e_max, 1.0 / self.k)
        }
    }

    fn constant(&self) -> Option<Restitution> {
        None
    }
}
