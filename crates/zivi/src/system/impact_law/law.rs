//! What an impact law is.

use zivi_core::setting::Setting;
use zivi_core::{Restitution, SettingError};

/// What an impact does to the speed.
pub trait ImpactLaw: Copy {
    /// Its parameters.
    const PARAMETERS: &'static [Setting];

    /// The law with these values of its parameters, in their order.
    ///
    /// # Errors
    /// [`SettingError`] names the first that is out of range.
    fn of(values: &[f64]) -> Result<Self, SettingError>;

    /// The speed after an impact at the speed `v > 0` (m/s): at most `v`, an impact adds no energy.
    fn after(&self, v: f64) -> f64;

    /// The derivative of the speed after by the one before.
    fn slope(&self, v: f64) -> f64;

    /// The derivative of the speed after by a parameter, by its number.
    fn by(&self, parameter: usize, v: f64) -> f64;

    /// The ratio `e` of the speeds in the limit `v -> 0`; nothing where there is none. Between 0 and
    /// 1 impacts accumulate as a geometric chain. With 1 they do not accumulate, with 0 faster than
    /// any such chain.
    fn limit(&self) -> Option<f64>;

    /// The derivative of that by a parameter.
    fn limit_by(&self, parameter: usize) -> f64;

    /// Up to which speed before an impact (m/s) the ratio is `e(0) + O(v)`, smoothly: from there on a
    /// chain of impacts is extrapolated. Everywhere, unless the law says otherwise.
    fn geometric_up_to(&self) -> f64 {
        f64::INFINITY
    }

    /// The coefficient of restitution where it is the same for all speeds.
    fn constant(&self) -> Option<Restitution> {
        None
    }

    /// What makes the coordinates `(s, v)` of samples. Where the coefficient depends on the speed no
    /// transform with one `kappa` removes the impacts: there `v = sigma x'`, with `kappa = 0`.
    #[inline]
    fn transform(&self) -> Restitution {
        self.constant().unwrap_or(Restitution::ELASTIC)
    }
}

/// The value of a parameter, not a number where it is missing.
pub(super) fn value(values: &[f64], parameter: usize) -> f64 {
    values.get(parameter).copied().unwrap_or(f64::NAN)
}
