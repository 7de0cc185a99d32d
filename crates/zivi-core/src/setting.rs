//! Settings: their meaning, admissible values, and errors.

use crate::Real;
use core::fmt;
use core::ops::{Bound, RangeBounds};

/// A rejected value and the admissible ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SettingError {
    /// Name of the setting.
    pub name: &'static str,
    /// The value that was rejected.
    pub value: Real,
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
    value: Real,
    range: &'static str,
) -> Result<(), SettingError> {
    if ok {
        Ok(())
    } else {
        Err(SettingError { name, value, range })
    }
}

/// Whether `x` is finite and `> 0`. (Compared with the largest number and not with infinity: of that
/// the compiler makes a longer test of the number's class.)
#[inline]
pub(crate) fn is_positive(x: Real) -> bool {
    x > 0.0 && x <= Real::MAX
}

/// Whether `x` is finite and `>= 0`.
#[inline]
pub(crate) fn is_not_negative(x: Real) -> bool {
    (0.0..=Real::MAX).contains(&x)
}

/// A setting: meaning, admissible values and default.
///
/// ```
/// use zivi_core::setting::{Setting, Value, Values};
/// let theta = Setting {
///     name: "theta",
///     meaning: "weight of the end of the step",
///     unit: "1",
///     values: Values::UNIT,
///     range: "a number from 0 to 1",
///     default: Value::Number(0.5),
/// };
/// assert!(theta.check(1.0).is_ok());
/// let rejected = theta.check(1.5).unwrap_err();
/// assert_eq!(rejected.to_string(), "theta must be a number from 0 to 1, got 1.5");
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setting {
    /// Its name.
    pub name: &'static str,
    /// Its meaning.
    pub meaning: &'static str,
    /// Its unit, empty for a pure number.
    pub unit: &'static str,
    /// The values it may have.
    pub values: Values,
    /// The range in words, for messages such as "... must be a number from 0 to 1".
    pub range: &'static str,
    /// Its default.
    pub default: Value,
}

/// The values that a setting may have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Values {
    /// The numbers between two bounds.
    Numbers(Bound<Real>, Bound<Real>),
    /// The same, one for distance and velocity each, or one for both.
    Pairs(Bound<Real>, Bound<Real>),
    /// The whole numbers between two that are among them.
    Counts(usize, usize),
    /// Some numbers or names.
    Choice(&'static [Value]),
}

/// A value of a setting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Value {
    /// None: it must be given.
    Required,
    /// None: it is found when it is needed, as the words say.
    Open(&'static str),
    /// A number.
    Number(Real),
    /// A number for the distance, and one for the velocity.
    Pair([Real; 2]),
    /// A whole number.
    Count(usize),
    /// A name.
    Name(&'static str),
}

impl Values {
    /// Finite numbers above 0.
    pub const POSITIVE: Self =
        Values::Numbers(Bound::Excluded(0.0), Bound::Excluded(Real::INFINITY));
    /// Finite numbers from 0 on.
    pub const NOT_NEGATIVE: Self =
        Values::Numbers(Bound::Included(0.0), Bound::Excluded(Real::INFINITY));
    /// Numbers from 0 to 1.
    pub const UNIT: Self = Values::Numbers(Bound::Included(0.0), Bound::Included(1.0));

    /// Whether a number, or each of a pair, is among them.
    #[inline]
    #[must_use]
    pub fn hold(&self, value: Real) -> bool {
        match *self {
            // as in `is_positive`
            Values::Numbers(from, Bound::Excluded(Real::INFINITY))
            | Values::Pairs(from, Bound::Excluded(Real::INFINITY)) => {
                (from, Bound::Included(Real::MAX)).contains(&value)
            }
            Values::Numbers(from, to) | Values::Pairs(from, to) => (from, to).contains(&value),
            Values::Counts(..) | Values::Choice(_) => false,
        }
    }

    /// Whether a whole number is among them.
    #[must_use]
    pub fn hold_count(&self, value: usize) -> bool {
        match *self {
            Values::Counts(from, to) => (from..=to).contains(&value),
            Values::Choice(values) => values.contains(&Value::Count(value)),
            Values::Numbers(..) | Values::Pairs(..) => false,
        }
    }
}

impl Setting {
    /// Rejects a number out of range.
    ///
    /// # Errors
    /// [`SettingError`].
    #[inline(always)] // what a setting means needs no room on a target then
    pub fn check(&self, value: Real) -> Result<(), SettingError> {
        require(self.values.hold(value), self.name, value, self.range)
    }
}
