//! Values of the settings of a method, by their names: how a program that does not know the method
//! hands them to it.

use zivi_core::setting::{Setting, Value};

use super::trajectory::SetupError;

/// Given values of some settings; the others have their defaults.
///
/// ```
/// use zivi::method::Values;
/// use zivi::MoreauJean;
/// use zivi_core::setting::Value;
/// let mut values = Values::default();
/// assert_eq!(values.number(&MoreauJean::THETA)?, 0.5);
/// values.set("theta", Value::Number(1.0));
/// assert_eq!(values.number(&MoreauJean::THETA)?, 1.0);
/// # Ok::<(), zivi::SetupError>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Values {
    given: Vec<(&'static str, Value)>,
}

impl Values {
    /// Gives a setting its value; of two the last counts.
    pub fn set(&mut self, name: &'static str, value: Value) {
        self.given.push((name, value));
    }

    fn of(&self, setting: &Setting) -> Value {
        let given = self.given.iter().rev().find(|(name, _)| *name == setting.name);
        given.map_or(setting.default, |&(_, value)| value)
    }

    /// A number.
    ///
    /// # Errors
    /// [`SetupError::Unset`] if the value is missing, here and below.
    pub fn number(&self, setting: &Setting) -> Result<f64, SetupError> {
        match self.of(setting) {
            Value::Number(value) => Ok(value),
            _ => Err(unset(setting)),
        }
    }

    /// A number; `None` if the run determines it.
    ///
    /// # Errors
    /// [`SetupError::Unset`].
    pub fn optional(&self, setting: &Setting) -> Result<Option<f64>, SetupError> {
        match self.of(setting) {
            Value::Open(_) => Ok(None),
            _ => self.number(setting).map(Some),
        }
    }

    /// A number for the distance and one for the velocity.
    ///
    /// # Errors
    /// [`SetupError::Unset`].
    pub fn pair(&self, setting: &Setting) -> Result<[f64; 2], SetupError> {
        match self.of(setting) {
            Value::Pair(values) => Ok(values),
            _ => self.number(setting).map(|both| [both; 2]),
        }
    }

    /// A whole number.
    ///
    /// # Errors
    /// [`SetupError::Unset`].
    pub fn count(&self, setting: &Setting) -> Result<usize, SetupError> {
        match self.of(setting) {
            Value::Count(value) => Ok(value),
            _ => Err(unset(setting)),
        }
    }

    /// The value of a name, read by `named`.
    ///
    /// # Errors
    /// [`SetupError::Unset`], which includes an unknown name.
    pub fn choice<T>(
        &self,
        setting: &Setting,
        named: impl FnOnce(&str) -> Option<T>,
    ) -> Result<T, SetupError> {
        let Value::Name(name) = self.of(setting) else { return Err(unset(setting)) };
        named(name).ok_or_else(|| unset(setting))
    }
}

fn unset(setting: &Setting) -> SetupError {
    SetupError::Unset(setting.name, setting.range)
}
