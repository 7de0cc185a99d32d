//! Codes of errors.

pub(super) const START: i32 = -1;
pub(super) const EVALUATION: i32 = -2;
pub(super) const DEPENDENT: i32 = -3;
pub(super) const INDEFINITE: i32 = -4;
pub(super) const UNREACHED: i32 = -5;
pub(super) const REFUSED: i32 = -6;
pub(super) const MOTION: i32 = -7;
pub(super) const FAULT: i32 = -8;
