//! The gains of a twisting controller and the conditions for its stability.
//!
//! With `|d| <= M` the force that the controller does not know:
//!
//! ```text
//! tracker     M/R < mu2 < mu1 - M/R        R = 1 - kappa = 2e/(1 + e)
//! regulator   M - mu1 (1 - e^2)/(1 + e^2) < mu2 < mu1 - M
//! ```
//!
//! The tracker's gains act in the transform's coordinates, `e_s'' = R (..) + d`, and `R` is smallest
//! while the mass rises. The regulator falls with `D - M` at least (`D = mu1 - mu2`), and loses
//! energy from impact to impact if `e^2 (D + M)/(U - M) < 1` (`U = mu1 + mu2`): impacts help it.

use core::fmt;

use crate::setting::{is_not_negative, require};
use crate::{Real, Restitution, SettingError};

/// `mu1 > mu2 > 0`: the gains on the sign of the position and of the velocity (m/s^2).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gains {
    mu1: Real,
    mu2: Real,
}

/// A gain out of range, or too small for a bound of the unknown force.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum GainError {
    /// A setting is out of range.
    Setting(SettingError),
    /// A gain does not exceed what the bound asks for.
    TooSmall {
        /// Name of the gain.
        name: &'static str,
        /// Its value (m/s^2).
        value: Real,
        /// What it must exceed (m/s^2).
        least: Real,
        /// The same as a formula.
        formula: &'static str,
        /// The bound of the unknown force (m/s^2).
        bound: Real,
    },
    /// A mass at rest would not be pressed harder than the unknown force can pull.
    Press {
        /// The acceleration towards the wall (m/s^2).
        value: Real,
        /// The bound of the unknown force (m/s^2).
        bound: Real,
    },
}

impl GainError {
    /// Name of what was refused.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            GainError::Setting(error) => error.name,
            GainError::TooSmall { name, .. } => name,
            GainError::Press { .. } => "press",
        }
    }
}

impl From<SettingError> for GainError {
    fn from(error: SettingError) -> Self {
        GainError::Setting(error)
    }
}

impl fmt::Display for GainError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            GainError::Setting(error) => error.fmt(out),
            GainError::TooSmall { name, value, least, formula, bound } => write!(
                out,
                "{name} must be greater than {formula} = {least:?} m/s^2 for bound = {bound:?}, \
                 got {value:?}"
            ),
            GainError::Press { value, bound } => write!(
                out,
                "press must be at least the bound of the unknown force, {bound:?} m/s^2, got {value:?}"
            ),
        }
    }
}

impl core::error::Error for GainError {}

/// Gains beyond this overflow within a tick.
const LARGEST: Real = crate::real::LARGE;

impl Gains {
    /// Gains with `0 < mu2 < mu1`.
    ///
    /// # Errors
    /// [`SettingError`] names the gain that is out of range.
    pub fn new(mu1: Real, mu2: Real) -> Result<Self, SettingError> {
        let range = if cfg!(feature = "single") {
            "a gain > 0 and at most 1e18 (m/s^2)"
        } else {
            "a gain > 0 and at most 1e150 (m/s^2)"
        };
        require(mu1 > 0.0 && mu1 <= LARGEST, "mu1", mu1, range)?;
        require(mu2 > 0.0 && mu2 < mu1, "mu2", mu2, "a gain with 0 < mu2 < mu1 (m/s^2)")?;
        Ok(Self { mu1, mu2 })
    }

    /// Gains that were checked before and are not checked again.
    #[inline]
    #[must_use]
    pub fn trusted(mu1: Real, mu2: Real) -> Self {
        Self { mu1, mu2 }
    }

    /// Gains with which a tracker follows whatever an unknown force does that is bounded by `bound`:
    /// `M/R < mu2 < mu1 - M/R` with `R = 2e/(1 + e)`.
    ///
    /// # Errors
    /// [`GainError`] names the gain that is too small, and what it must exceed.
    ///
    /// ```
    /// use zivi_core::control::Gains;
    /// use zivi_core::Restitution;
    /// let restitution = Restitution::from_e(0.5)?; // R = 2/3
    /// assert!(Gains::for_tracking(30.0, 17.0, 8.6, restitution).is_ok());
    /// assert!(Gains::for_tracking(30.0, 17.0, 8.7, restitution).is_err()); // mu1 - mu2 < M/R
    /// # Ok::<(), zivi_core::RestitutionError>(())
    /// ```
    pub fn for_tracking(
        mu1: Real,
        mu2: Real,
        bound: Real,
        restitution: Restitution,
    ) -> Result<Self, GainError> {
        Self::bounded(mu1, mu2, bound, restitution)?.track(bound, restitution)
    }

    /// The same of [`Gains::bounded`] ones.
    ///
    /// # Errors
    /// [`GainError`] names the gain that is too small, and what it must exceed.
    #[inline]
    pub fn track(self, bound: Real, restitution: Restitution) -> Result<Self, GainError> {
        let image = bound * (1.0 + restitution.e()) / (2.0 * restitution.e());
        self.exceed(bound, ("mu2", "bound (1 + e)/(2 e)"), image)?;
        self.exceed(bound, ("mu1", "mu2 + bound (1 + e)/(2 e)"), self.mu2 + image)?;
        Ok(self)
    }

    /// Gains with which a regulator stops the mass whatever a force does that is bounded by `bound`:
    /// `M - mu1 (1 - e^2)/(1 + e^2) < mu2 < mu1 - M`.
    ///
    /// # Errors
    /// [`GainError`] names the gain that is too small, and what it must exceed.
    ///
    /// ```
    /// use zivi_core::control::Gains;
    /// use zivi_core::Restitution;
    /// let restitution = Restitution::from_e(0.5)?;
    /// assert!(Gains::for_regulation(3.0, 0.5, 2.2, restitution).is_ok()); // mu2 > 2.2 - 1.8
    /// assert!(Gains::for_regulation(3.0, 0.5, 2.2, Restitution::from_e(1.0)?).is_err());
    /// # Ok::<(), zivi_core::RestitutionError>(())
    /// ```
    pub fn for_regulation(
        mu1: Real,
        mu2: Real,
        bound: Real,
        restitution: Restitution,
    ) -> Result<Self, GainError> {
        Self::bounded(mu1, mu2, bound, restitution)?.regulate(bound, restitution)
    }

    /// The same of [`Gains::bounded`] ones.
    ///
    /// # Errors
    /// [`GainError`] names the gain that is too small, and what it must exceed.
    #[inline]
    pub fn regulate(self, bound: Real, restitution: Restitution) -> Result<Self, GainError> {
        let square = restitution.e() * restitution.e();
        let lost = self.mu1 * (1.0 - square) / (1.0 + square);
        self.exceed(bound, ("mu1", "mu2 + bound"), self.mu2 + bound)?;
        let formula = "bound - mu1 (1 - e^2)/(1 + e^2)";
        self.exceed(bound, ("mu2", formula), bound - lost)?;
        Ok(self)
    }

    /// Gains, a `bound` of the unknown force and a restitution, each in its range.
    ///
    /// # Errors
    /// [`GainError`] names what is out of range.
    #[inline]
    pub fn bounded(
        mu1: Real,
        mu2: Real,
        bound: Real,
        restitution: Restitution,
    ) -> Result<Self, GainError> {
        let gains = Self::new(mu1, mu2)?;
        super::checked_wall(restitution, "e")?;
        let range = "a finite bound >= 0 of the unknown force (m/s^2)";
        require(is_not_negative(bound), "bound", bound, range)?;
        Ok(gains)
    }

    /// `Ok` if the gain with this name exceeds `least`, which is this formula for the bound.
    fn exceed(
        self,
        bound: Real,
        (name, formula): (&'static str, &'static str),
        least: Real,
    ) -> Result<(), GainError> {
        let value = if name == "mu1" { self.mu1 } else { self.mu2 };
        if value > least {
            Ok(())
        } else {
            Err(GainError::TooSmall { name, value, least, formula, bound })
        }
    }

    /// The gain on the sign of the position (m/s^2).
    #[inline]
    #[must_use]
    pub fn mu1(self) -> Real {
        self.mu1
    }

    /// The gain on the sign of the velocity (m/s^2).
    #[inline]
    #[must_use]
    pub fn mu2(self) -> Real {
        self.mu2
    }
}
