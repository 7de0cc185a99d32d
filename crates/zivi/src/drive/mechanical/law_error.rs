//! Why a law gives no controls.

use std::fmt;

use zivi_core::SettingError;

use crate::SetupError;

/// Why a law gives no controls.
#[derive(Debug)]
pub enum LawError<E> {
    /// The model or a force raised it.
    Raised(E),
    /// The Delassus matrix `N M^-1 N^T` is singular: the gaps are not independent.
    Dependent,
    /// `M` is not positive definite.
    Indefinite,
    /// The controls do not reach all of this number of gaps: the singular values of `W^-1/2 N M^-1
    /// B`.
    Unreached(usize, Vec<f64>),
    /// The state that was put back is of a system with other coordinates or controls.
    Foreign,
    /// The tracker of a gap refuses its reference or its settings.
    Refused(SettingError),
    /// The motion over the delay cannot begin.
    Setup(SetupError),
}

impl<E> LawError<E> {
    /// The raised error, or otherwise the text.
    ///
    /// # Errors
    /// The text.
    pub fn raised(self) -> Result<E, String>
    where
        E: fmt::Debug,
    {
        Err(match self {
            Self::Raised(error) => return Ok(error),
            Self::Dependent => "the gaps must be independent: N M^-1 N^T is singular here".into(),
            Self::Indefinite => "mass must be positive definite at every tick".into(),
            Self::Unreached(gaps, values) => format!(
                "the controls do not reach all of the {gaps} gaps: N M^-1 B has the singular \
                 values {values:?} here, in the metric of the masses"
            ),
            Self::Foreign => "state must be what a controller of this system gave".into(),
            Self::Refused(error) => error.to_string(),
            Self::Setup(error) => error.to_string(),
        })
    }
}

impl<E> From<SettingError> for LawError<E> {
    fn from(error: SettingError) -> Self {
        Self::Refused(error)
    }
}
