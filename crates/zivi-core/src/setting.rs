//! A setting, or a sample, outside its admissible range.

use core::fmt;

/// Which value was refused, and what it should have been.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SettingError {
    /// Name of the setting.
    pub name: &'static str,
    /// The value that was refused.
    pub value: f64,
    /// The admissible range, in words.
    pub range: &'static str,
}

impl fmt::Display for SettingError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{} must be {}, got {:?}", self.name, self.range, self.value)
    }
}

impl core::error::Error for SettingError {}

/// `Ok` if `ok`, else the error that names the setting, its value and its range.
pub(crate) fn require(
    ok: bool,
    name: &'static str,
    value: f64,
    range: &'static str,
) -> Result<(), SettingError> {
    if ok {
        Ok(())
    } else {
        Err(SettingError { name, value, range })
    }
}
