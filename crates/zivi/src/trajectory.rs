//! The record of a run.

use std::collections::TryReserveError;
use std::fmt;

use zivi_core::{Lifted, ThetaGammaError};

use crate::{Events, GridError, Status};

/// One state of a run with the multipliers of the step that led to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// The state.
    pub z: Lifted,
    /// `lambda_s` in `sgn s`.
    pub lambda_s: f64,
    /// `lambda_v` in `sgn v`.
    pub lambda_v: f64,
    /// The force of the step (m/s^2).
    pub f: f64,
}

/// The sampled quantities, one vector each, all of one length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Columns {
    /// Time (s).
    pub t: Vec<f64>,
    /// Distance from the wall (m).
    pub x: Vec<f64>,
    /// Velocity (m/s).
    pub xdot: Vec<f64>,
    /// Transformed position (m).
    pub s: Vec<f64>,
    /// Transformed velocity (m/s).
    pub v: Vec<f64>,
    /// Multiplier of the position's sign.
    pub lambda_s: Vec<f64>,
    /// Multiplier of the velocity's sign.
    pub lambda_v: Vec<f64>,
    /// Relative natural residual of the step that ends at the sample (0 at the first).
    pub residual: Vec<f64>,
}

impl Columns {
    pub(crate) fn with_capacity(n: usize) -> Result<Self, TryReserveError> {
        let column = || -> Result<Vec<f64>, TryReserveError> {
            let mut values = Vec::new();
            values.try_reserve_exact(n)?;
            Ok(values)
        };
        Ok(Self {
            t: column()?,
            x: column()?,
            xdot: column()?,
            s: column()?,
            v: column()?,
            lambda_s: column()?,
            lambda_v: column()?,
            residual: column()?,
        })
    }
}

/// A run as far as it went.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    /// The samples.
    pub columns: Columns,
    /// What happened at the wall.
    pub events: Events,
    /// Numbers of the samples whose step the chosen solver did not solve (the exact one took it).
    pub failed_steps: Vec<usize>,
    /// How the run ended.
    pub status: Status,
    /// Number of force evaluations.
    pub nfev: u64,
}

/// A trajectory, and what ended it early if that was an error from outside.
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
    Method(ThetaGammaError),
    /// The initial state or another setting: name, value and range.
    Setting(&'static str, f64, &'static str),
    /// The record does not fit into memory.
    Memory(usize),
}

impl fmt::Display for SetupError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            SetupError::Grid(error) => error.fmt(out),
            SetupError::Method(error) => error.fmt(out),
            SetupError::Setting(name, value, range) => {
                write!(out, "{name} must be {range}, got {value}")
            }
            SetupError::Memory(steps) => {
                write!(out, "the record of {steps} steps does not fit into memory: increase h")
            }
        }
    }
}

impl std::error::Error for SetupError {}

impl From<GridError> for SetupError {
    fn from(error: GridError) -> Self {
        SetupError::Grid(error)
    }
}

impl From<ThetaGammaError> for SetupError {
    fn from(error: ThetaGammaError) -> Self {
        SetupError::Method(error)
    }
}
