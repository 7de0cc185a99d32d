//! Newton's impact law, `x'+ = -e x'-`.

use super::law::{value, ImpactLaw, ParametricLaw};
use zivi_core::setting::{Setting, Value, Values};
use zivi_core::{Restitution, SettingError};

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
