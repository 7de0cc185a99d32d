//! The gains of a twisting controller and the condition for its stability.

use crate::setting::require;
use crate::SettingError;

/// `mu1 > mu2 > 0`: the gains on the sign of the position and of the velocity (m/s^2).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gains {
    mu1: f64,
    mu2: f64,
}

impl Gains {
    /// Gains with `0 < mu2 < mu1`.
    ///
    /// # Errors
    /// [`SettingError`] names the gain that is out of range.
    pub fn new(mu1: f64, mu2: f64) -> Result<Self, SettingError> {
        require(mu1 > 0.0 && mu1.is_finite(), "mu1", mu1, "a finite gain > 0 (m/s^2)")?;
        require(mu2 > 0.0 && mu2 < mu1, "mu2", mu2, "a gain with 0 < mu2 < mu1 (m/s^2)")?;
        Ok(Self { mu1, mu2 })
    }

    /// Gains that stabilise whatever a force bounded by `bound` does:
    /// `bound < mu2 < mu1 - bound`.
    ///
    /// # Errors
    /// [`SettingError`] names the condition that is violated.
    ///
    /// ```
    /// use zivi_core::control::Gains;
    /// assert!(Gains::for_bound(30.0, 17.0, 9.81).is_ok());
    /// assert!(Gains::for_bound(30.0, 17.0, 19.81).is_err()); // not with the reference's force
    /// ```
    pub fn for_bound(mu1: f64, mu2: f64, bound: f64) -> Result<Self, SettingError> {
        let gains = Self::new(mu1, mu2)?;
        require(bound >= 0.0 && bound.is_finite(), "bound", bound, "a finite bound >= 0 of |F|")?;
        let condition = "greater than the bound of the force (bound < mu2 < mu1 - bound)";
        require(mu2 > bound, "mu2", mu2, condition)?;
        let condition = "greater than mu2 plus the bound of the force (bound < mu2 < mu1 - bound)";
        require(mu1 - bound > mu2, "mu1", mu1, condition)?;
        Ok(gains)
    }

    /// The gain on the sign of the position (m/s^2).
    #[inline]
    #[must_use]
    pub fn mu1(self) -> f64 {
        self.mu1
    }

    /// The gain on the sign of the velocity (m/s^2).
    #[inline]
    #[must_use]
    pub fn mu2(self) -> f64 {
        self.mu2
    }
}
