//! Why a step failed.

use std::collections::TryReserveError;

use zivi_core::StepFailure;

use crate::Status;

/// Why a step failed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Failure<E> {
    /// For a reason that has a status.
    Status(Status),
    /// The force raised an error.
    Raised(E),
}

impl<E> From<StepFailure> for Failure<E> {
    fn from(failure: StepFailure) -> Self {
        Failure::Status(match failure {
            StepFailure::NotFinite => Status::StateNotFinite,
            StepFailure::NoSolution => Status::StepNotSolved,
        })
    }
}

impl<E> From<TryReserveError> for Failure<E> {
    fn from(_: TryReserveError) -> Self {
        Failure::Status(Status::OutOfMemory)
    }
}
