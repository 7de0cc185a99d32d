//! Why a solve ends from outside.

use core::fmt;

/// The caller could not evaluate `F` or its Jacobian and wants the solver to stop.
///
/// A point where `F` is merely undefined is reported by a value that is not finite instead: the
/// solver then backs off and continues.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EvaluationError;

impl fmt::Display for EvaluationError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str("the map or its Jacobian could not be evaluated")
    }
}

impl core::error::Error for EvaluationError {}

/// Why a solve is broken off from outside. The best point so far is kept either way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interruption {
    /// The caller cannot go on: `F` is not asked again.
    Failed,
    /// The caller has had enough: `F` is evaluated once more at the best point.
    Stopped,
}

impl From<EvaluationError> for Interruption {
    fn from(_: EvaluationError) -> Self {
        Self::Failed
    }
}
