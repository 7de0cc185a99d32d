//! The record of a run.

pub use crate::record::columns::{Columns, Quantity, Sample, QUANTITIES};

use std::fmt;

use crate::{Events, GridError, Status, Summary};
use zivi_core::setting::{Setting, Value};
use zivi_core::SettingError;

/// A run as far as it went.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    /// The samples, or those that were to be kept.
    pub columns: Columns,
    /// Of all samples, where not all were to be kept.
    pub summary: Option<Summary>,
    /// Events at the wall.
    pub events: Events,
    /// Numbers of the samples whose step the chosen solver did not solve (the exact one took it).
    pub failed_steps: Vec<usize>,
    /// How the run ended.
    pub status: Status,
    /// Number of force evaluations.
    pub nfev: u64,
}

/// A trajectory, and the external error that ended it early, if any.
#[derive(Clone, Debug, PartialEq)]
pub struct Run<E> {
    /// All that was computed.
    pub trajectory: Trajectory,
    /// The error that the force or the monitor raised (then the status is [`Status::Raised`]).
    pub raised: Option<E>,
}

/// Why a run could not start.
#[derive(Clone, Debug, PartialEq)]
pub enum SetupError {
    /// The span or the step size.
    Grid(GridError),
    /// A setting of the method.
    Method(SettingError),
    /// The initial state or another setting: name, value and range.
    Setting(&'static str, f64, &'static str),
    /// A number of things: name, value and range.
    Count(&'static str, usize, &'static str),
    /// A setting that has no value, or one of another kind: name and range.
    Unset(&'static str, &'static str),
    /// An unsupported option, with the supported one.
    Refused(&'static str),
    /// The record does not fit into memory.
    Memory(usize),
    /// The data of a batch do not fit into memory.
    BatchMemory {
        /// Number of runs.
        runs: usize,
        /// Samples that are kept of each.
        samples: usize,
        /// Required memory (bytes).
        bytes: f64,
    },
    /// None of the threads could be started.
    Threads(usize),
}

impl fmt::Display for SetupError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            SetupError::Grid(error) => error.fmt(out),
            SetupError::Method(error) => error.fmt(out),
            SetupError::Setting(name, value, range) => {
                write!(out, "{name} must be {range}, got {value:?}")
            }
            SetupError::Count(name, value, range) => {
                write!(out, "{name} must be {range}, got {value}")
            }
            SetupError::Unset(name, range) => write!(out, "{name} must be given, {range}"),
            SetupError::Refused(wanted) => out.write_str(wanted),
            SetupError::Memory(steps) => {
                write!(out, "the record of {steps} steps does not fit into memory: increase h")
            }
            SetupError::BatchMemory { runs, samples, bytes } => {
                let gigabytes = bytes / 1e9;
                write!(
                    out,
                    "y0 gives {runs} runs, save and h keep {samples} samples of each: \
                     {gigabytes:.3} GB do not fit into memory; increase save or h, or compute \
                     fewer runs at a time"
                )
            }
            SetupError::Threads(threads) => {
                write!(out, "none of threads={threads} could be started: the memory is not enough")
            }
        }
    }
}

impl std::error::Error for SetupError {}

/// Rejects a whole number that a setting may not be.
pub(crate) fn checked_count(setting: &Setting, value: usize) -> Result<(), SetupError> {
    if setting.values.hold_count(value) {
        Ok(())
    } else {
        Err(SetupError::Count(setting.name, value, setting.range))
    }
}

impl From<GridError> for SetupError {
    fn from(error: GridError) -> Self {
        SetupError::Grid(error)
    }
}

impl From<SettingError> for SetupError {
    fn from(error: SettingError) -> Self {
        SetupError::Method(error)
    }
}

// Values of the settings of a method, by their names: how a program that does not know the method
// hands them to it.

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
