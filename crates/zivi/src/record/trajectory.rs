//! The record of a run.

pub use super::columns::{Columns, Quantity, Sample, QUANTITIES};
use std::fmt;

use zivi_core::setting::Setting;
use zivi_core::SettingError;

use crate::{Events, GridError, Status, Summary};

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
