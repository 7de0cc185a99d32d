//! The time grid `t_k = t0 + k h` of a fixed-step run.

use std::fmt;

/// Runs longer than this are refused: the record alone would take 64 GB.
pub const MAX_STEPS: f64 = 1e9;

/// `t_0, t_0 + h, ...`, ending exactly at the end of the span (the last step may be shorter).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    t0: f64,
    t1: f64,
    h: f64,
    n: usize,
}

/// A span or a step size that gives no grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum GridError {
    /// An end of the span is not finite.
    SpanNotFinite(f64, f64),
    /// The span is empty or reversed.
    SpanEmpty(f64, f64),
    /// The step size is not positive and finite.
    StepNotPositive(f64),
    /// `t + h` rounds to `t`.
    StepBelowRounding(f64, f64),
    /// More than [`MAX_STEPS`] steps.
    TooManySteps(f64, f64),
}

impl fmt::Display for GridError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            GridError::SpanNotFinite(t0, t1) => {
                write!(out, "t_span must be finite, got ({t0:?}, {t1:?})")
            }
            GridError::SpanEmpty(t0, t1) => {
                write!(out, "t_span must run forward, t0 < t1, got ({t0:?}, {t1:?})")
            }
            GridError::StepNotPositive(h) => {
                write!(out, "h must be a finite step size > 0, got {h:?}")
            }
            GridError::StepBelowRounding(h, t) => {
                write!(
                    out,
                    "h must be large enough to advance the time: {t:?} + {h:?} rounds to {t:?}"
                )
            }
            GridError::TooManySteps(h, steps) => {
                write!(
                    out,
                    "h must give at most {MAX_STEPS:e} steps over t_span, {h:?} gives {steps:.3e}"
                )
            }
        }
    }
}

impl std::error::Error for GridError {}

impl Grid {
    /// The grid of step `h` over `[t0, t1]`; a step longer than the span becomes the span.
    ///
    /// # Errors
    /// [`GridError`] says which argument gives no grid.
    pub fn new(t0: f64, t1: f64, h: f64) -> Result<Self, GridError> {
        if !(t0.is_finite() && t1.is_finite() && (t1 - t0).is_finite()) {
            return Err(GridError::SpanNotFinite(t0, t1));
        }
        if t1 <= t0 {
            return Err(GridError::SpanEmpty(t0, t1));
        }
        if !(h > 0.0 && h.is_finite()) {
            return Err(GridError::StepNotPositive(h));
        }
        let steps = (t1 - t0) / h;
        if steps > MAX_STEPS {
            return Err(GridError::TooManySteps(h, steps));
        }
        let farthest = if t0.abs() > t1.abs() { t0 } else { t1 };
        if steps > 1.0 && farthest.abs() + h == farthest.abs() {
            return Err(GridError::StepBelowRounding(h, farthest));
        }
        // a span of "n steps" is rarely so to the last bit: a remainder at rounding is no step
        let whole = steps.round();
        let divides = (steps - whole).abs() <= 1e-9 * whole;
        let n = if divides { whole } else { steps.ceil() };
        // far from zero, rounding may put the last step's start at its end
        let n = if n > 1.0 && t0 + (n - 1.0) * h >= t1 { n - 1.0 } else { n };
        Ok(Self { t0, t1, h, n: n as usize })
    }

    /// Number of steps, at least one.
    #[must_use]
    pub fn n_steps(&self) -> usize {
        self.n
    }

    /// `t_k`, with `t_n` the end of the span exactly.
    #[inline]
    #[must_use]
    pub fn t(&self, k: usize) -> f64 {
        if k < self.n {
            // k <= MAX_STEPS; a signed integer converts in one instruction
            self.t0 + k as i64 as f64 * self.h
        } else {
            self.t1
        }
    }

    /// The regular step size.
    #[must_use]
    pub fn h(&self) -> f64 {
        self.h
    }

    /// The size of the last step: `h`, or what is left of the span.
    #[must_use]
    pub fn last_h(&self) -> f64 {
        let rest = self.t1 - self.t(self.n - 1);
        if (rest - self.h).abs() <= 1e-6 * self.h {
            self.h
        } else {
            rest
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_exactly_at_the_end_of_the_span() {
        for (t1, h, n) in [(4.0, 1e-3, 4000), (0.3, 0.1, 3), (1.0, 0.3, 4), (1.0, 5.0, 1)] {
            let grid = Grid::new(0.0, t1, h).unwrap();
            assert_eq!((grid.n_steps(), grid.t(n)), (n, t1));
        }
        // a remainder at rounding is no step
        assert_eq!(Grid::new(0.0, 1.0 + 1e-11, 0.1).unwrap().n_steps(), 10);
        assert_eq!(Grid::new(0.0, 1.0 + 1e-7, 0.1).unwrap().n_steps(), 11);
        assert_eq!(Grid::new(0.0, 0.3, 0.1).unwrap().last_h(), 0.1);
        assert!((Grid::new(0.0, 1.0, 0.3).unwrap().last_h() - 0.1).abs() < 1e-15);
        assert_eq!(Grid::new(0.0, 1.0, 5.0).unwrap().last_h(), 1.0);
    }

    #[test]
    fn every_step_has_a_length_far_from_zero_too() {
        for t0 in [0.0, 1e3, -7e8, 1e15, -1e15] {
            for k in 1..2000 {
                let (h, span) = (0.37 + 1e-3 * f64::from(k), 3.0 + 0.01 * f64::from(k));
                let grid = Grid::new(t0, t0 + span, h).unwrap();
                assert!(grid.last_h() > 0.0 && grid.last_h() <= 1.5 * h + t0.abs() * 1e-15);
                assert!((0..grid.n_steps()).all(|k| grid.t(k) < grid.t(k + 1)));
            }
        }
    }

    #[test]
    fn refuses_what_gives_no_grid() {
        use GridError::{
            SpanEmpty, SpanNotFinite, StepBelowRounding, StepNotPositive, TooManySteps,
        };
        assert!(matches!(Grid::new(0.0, f64::NAN, 0.1), Err(SpanNotFinite(..))));
        assert!(matches!(Grid::new(-1e308, 1e308, 0.1), Err(SpanNotFinite(..))));
        assert!(matches!(Grid::new(1.0, 1.0, 0.1), Err(SpanEmpty(..))));
        assert!(matches!(Grid::new(1.0, 0.0, 0.1), Err(SpanEmpty(..))));
        for h in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(matches!(Grid::new(0.0, 1.0, h), Err(StepNotPositive(_))), "{h}");
        }
        assert!(matches!(Grid::new(0.0, 1.0, 1e-300), Err(TooManySteps(..))));
        assert!(matches!(Grid::new(0.0, 1.0, 0.5e-9), Err(TooManySteps(..))));
        assert_eq!(Grid::new(0.0, MAX_STEPS, 1.0).unwrap().n_steps(), MAX_STEPS as usize);
        assert!(matches!(Grid::new(1e16, 1e16 + 8.0, 0.5), Err(StepBelowRounding(..))));
        assert!(Grid::new(9e15, 1.8e16, 1e8).is_ok());
        assert!(matches!(
            Grid::new(2f64.powi(54) - 16.0, 2f64.powi(54) + 32.0, 1.5),
            Err(StepBelowRounding(..))
        ));
    }
}
