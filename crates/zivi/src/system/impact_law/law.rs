//! Interface of impact laws.

use zivi_core::setting::{Setting, Value, Values};
use zivi_core::{Restitution, SettingError};

/// A law that has a name and parameters.
pub trait ParametricLaw: ImpactLaw {
    /// Its parameters.
    const PARAMETERS: &'static [Setting];

    /// The law with these values of its parameters, in their order.
    ///
    /// # Errors
    /// [`SettingError`] names the first that is out of range.
    fn of(values: &[f64]) -> Result<Self, SettingError>;
}

/// Speed after an impact.
pub trait ImpactLaw: Clone {
    /// The speed after an impact at the speed `v > 0` (m/s): at most `v`, an impact adds no energy.
    fn after(&self, v: f64) -> f64;

    /// The derivative of the speed after by the one before.
    fn slope(&self, v: f64) -> f64;

    /// The derivative of the speed after by a parameter, by its number.
    fn by(&self, _parameter: usize, _v: f64) -> f64 {
        0.0
    }

    /// The ratio `e` of the speeds in the limit `v -> 0`; `None` if undefined. Between 0 and
    /// 1 impacts accumulate as a geometric impact sequence. With 1 they do not accumulate, with 0 faster than
    /// any such impact sequence.
    fn limit(&self) -> Option<f64>;

    /// The derivative of that by a parameter.
    fn limit_by(&self, _parameter: usize) -> f64 {
        0.0
    }

    /// Up to which speed before an impact (m/s) the ratio is `e(0) + O(v)`, smoothly: from there on a
    /// chain of impacts is extrapolated. Everywhere, unless the law says otherwise.
    fn geometric_up_to(&self) -> f64 {
        f64::INFINITY
    }

    /// Whether the ratio is its limit, exactly, up to that speed.
    fn is_newton_when_slow(&self) -> bool {
        true
    }

    /// The sum of the speeds after an impact with the speed `u` after it (m/s) and after all that
    /// follow it under a constant acceleration `g`, which end `2/g` times the sum later. `None` if infinite
    /// or unknown.
    fn sum_of_speeds(&self, _u: f64) -> Option<f64> {
        None
    }

    /// The coefficient of restitution, if independent of the speed.
    fn constant(&self) -> Option<Restitution> {
        None
    }

    /// The transform of samples to the coordinates `(s, v)`. Where the coefficient depends on the
    /// speed no transform with one `kappa` removes the impacts: there `v = sigma x'`, with `kappa =
    /// 0`.
    #[inline]
    fn transform(&self) -> Restitution {
        self.constant().unwrap_or(Restitution::ELASTIC)
    }
}

/// The value of a parameter, NaN if missing.
pub(super) fn value(values: &[f64], parameter: usize) -> f64 {
    values.get(parameter).copied().unwrap_or(f64::NAN)
}

// Newton's impact law, `x'+ = -e x'-`.

const E: Setting = Setting {
    name: "e",
    meaning: "coefficient of restitution",
    unit: "1",
    values: Values::UNIT,
    range: "a number from 0 to 1",
    default: Value::Required,
};

impl ParametricLaw for Restitution {
    const PARAMETERS: &'static [Setting] = &[E];

    fn of(values: &[f64]) -> Result<Self, SettingError> {
        let e = value(values, 0);
        Self::from_e(e).map_err(|_| SettingError { name: E.name, value: e, range: E.range })
    }
}

impl ImpactLaw for Restitution {
    #[inline]
    fn after(&self, v: f64) -> f64 {
        self.e() * v
    }

    fn slope(&self, _: f64) -> f64 {
        self.e()
    }

    fn by(&self, parameter: usize, v: f64) -> f64 {
        self.limit_by(parameter) * v
    }

    #[inline]
    fn limit(&self) -> Option<f64> {
        Some(self.e())
    }

    fn limit_by(&self, parameter: usize) -> f64 {
        f64::from(parameter == 0)
    }

    #[inline]
    fn constant(&self) -> Option<Restitution> {
        Some(*self)
    }
}
