//! The coefficient of restitution `e` and its image `kappa = (1 - e)/(1 + e)`.

use crate::Real;
use core::fmt;

/// A coefficient of restitution, held both as `e` and as `kappa`.
///
/// ```text
/// kappa = (1 - e)/(1 + e)      e = (1 - kappa)/(1 + kappa)      e, kappa in [0, 1]
/// ```
///
/// `e = 1` (`kappa = 0`) is the elastic wall, `e = 0` (`kappa = 1`) the plastic one.
///
/// ```
/// use zivi_core::Restitution;
/// let restitution = Restitution::from_kappa(0.5)?;
/// assert!((restitution.e() - 1.0 / 3.0).abs() < 1e-16);
/// assert!(Restitution::from_e(1.2).is_err());
/// # Ok::<(), zivi_core::RestitutionError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Restitution {
    e: Real,
    kappa: Real,
}

/// A coefficient outside `[0, 1]` (or not a number).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RestitutionError {
    /// Name of the coefficient, `"e"` or `"kappa"`.
    pub name: &'static str,
    /// The value that was rejected.
    pub value: Real,
}

impl fmt::Display for RestitutionError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{} must lie in [0, 1], got {:?}", self.name, self.value)
    }
}

impl core::error::Error for RestitutionError {}

/// The map `z -> (1 - z)/(1 + z)`, its own inverse.
fn conjugate(z: Real) -> Real {
    (1.0 - z) / (1.0 + z)
}

impl Restitution {
    /// `e = 1`: no loss.
    pub const ELASTIC: Self = Self { e: 1.0, kappa: 0.0 };

    /// From the coefficient of restitution `e`.
    ///
    /// # Errors
    /// [`RestitutionError`] when `e` is not in `[0, 1]`.
    pub fn from_e(e: Real) -> Result<Self, RestitutionError> {
        let e = in_unit_interval("e", e)?;
        Ok(Self { e, kappa: conjugate(e) })
    }

    /// From the parameter `kappa` of the transform.
    ///
    /// # Errors
    /// [`RestitutionError`] when `kappa` is not in `[0, 1]`.
    pub fn from_kappa(kappa: Real) -> Result<Self, RestitutionError> {
        let kappa = in_unit_interval("kappa", kappa)?;
        Ok(Self { e: conjugate(kappa), kappa })
    }

    /// From both, where each is the number that was given or the image of it: for `e` near 0 its
    /// digits are lost in `kappa`, and the other way round.
    ///
    /// # Errors
    /// [`RestitutionError`] when one is not in `[0, 1]`, or when they are not each other's image to
    /// rounding.
    pub fn from_both(e: Real, kappa: Real) -> Result<Self, RestitutionError> {
        const ROUNDING: Real = 4.0 * Real::EPSILON;
        let given = Self { e: in_unit_interval("e", e)?, kappa: in_unit_interval("kappa", kappa)? };
        if (kappa - conjugate(e)).abs() > ROUNDING {
            return Err(RestitutionError { name: "kappa", value: kappa });
        }
        Ok(given)
    }

    /// From both, which were checked before and are not checked again.
    #[inline]
    #[must_use]
    pub fn trusted(e: Real, kappa: Real) -> Self {
        Self { e, kappa }
    }

    /// The coefficient of restitution `e = (1 - kappa)/(1 + kappa)`.
    #[inline]
    #[must_use]
    pub fn e(self) -> Real {
        self.e
    }

    /// The parameter `kappa = (1 - e)/(1 + e)` of the transform.
    #[inline]
    #[must_use]
    pub fn kappa(self) -> Real {
        self.kappa
    }

    /// `R = 1 - kappa lambda_s lambda_v`, which lies in `[1 - kappa, 1 + kappa]`.
    #[inline]
    #[must_use]
    pub fn r(self, lambda_s: Real, lambda_v: Real) -> Real {
        1.0 - self.kappa * lambda_s * lambda_v
    }
}

fn in_unit_interval(name: &'static str, value: Real) -> Result<Real, RestitutionError> {
    if (0.0..=1.0).contains(&value) {
        Ok(value)
    } else {
        Err(RestitutionError { name, value })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_of_the_range_are_exact() {
        for (e, kappa) in [(0.0, 1.0), (1.0, 0.0)] {
            assert_eq!(Restitution::from_e(e).map(Restitution::kappa), Ok(kappa));
            assert_eq!(Restitution::from_kappa(kappa).map(Restitution::e), Ok(e));
        }
    }

    #[test]
    fn both_are_kept_to_the_last_bit() {
        for e in [0.0, 1e-300, 1e-15, 1e-9, 0.3, 1.0 - 1e-12, 1.0] {
            let restitution =
                Restitution::from_e(e).and_then(|it| Restitution::from_both(e, it.kappa()));
            assert_eq!(restitution, Restitution::from_e(e));
        }
        for (e, kappa) in [(0.5, 0.5), (0.5, f64::NAN), (1.1, 0.0), (0.0, 1.0 - 1e-12)] {
            assert!(Restitution::from_both(e, kappa).is_err(), "{e} {kappa}");
        }
    }

    #[test]
    fn images_to_rounding_are_taken() {
        let image = conjugate(0.3) + 2.0 * f64::EPSILON;
        assert_eq!(Restitution::from_both(0.3, image).map(Restitution::kappa), Ok(image));
        assert!(Restitution::from_both(0.3, conjugate(0.3) + 8.0 * f64::EPSILON).is_err());
    }

    #[test]
    fn outside_is_refused_with_name_and_value() {
        for bad in [-0.1, 1.0 + 1e-15, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let error = Restitution::from_e(bad).err().map(|it| it.name);
            assert_eq!(error, Some("e"), "{bad}");
            assert!(Restitution::from_kappa(bad).is_err(), "{bad}");
        }
    }
}
