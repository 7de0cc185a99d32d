//! Power series on `[0, 1]` that converge as that of an exponential of 2.

/// Coefficients: what is left out is `2^24/24! = 3e-17`.
pub(crate) const TERMS: usize = 24;

/// The coefficients, the constant first.
pub(crate) type Series = [f64; TERMS];
