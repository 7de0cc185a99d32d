//! The time grid `t_k = t0 + k h` of a fixed-step run.

use std::fmt;

/// Runs longer than this are rejected: the record alone would take 64 GB.
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
    /// [`GridError`] names the invalid argument.
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

    /// The size of the last step: `h`, or the rest of the span.
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

// Probes: evaluations of a function between the nodes of a polynomial that stands for it.
//
// A polynomial that fits says little about how fast the function may vary between its nodes. So
// over a span there are [`PROBES`] more evaluations in all, spread over the windows that are
// accepted, and when one shows something, as many before that, until nothing new is seen.

/// Probes between the start of a search and its farthest end; the most in one window, where the
/// function is known to vary fast.
const PROBES: f64 = 64.0;
const MOST_PROBES: f64 = 1024.0;

/// A deviation this part of a window after its start is not traced back further.
const SHORTEST: f64 = 1e-9;

/// `(sqrt(5) - 1)/2`
const GOLDEN: f64 = 0.618_033_988_749_895;

/// The search for features of a function, from one window to the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Probes {
    /// Up to here the probes showed nothing (s).
    clear: f64,
    /// Windows end at this time (s), at which a probe showed that the function varies.
    suspect: f64,
    /// Largest distance of two probes, once one of them showed something (s).
    spacing: f64,
}

impl Default for Probes {
    fn default() -> Self {
        let (clear, suspect, spacing) = (f64::NEG_INFINITY, f64::NEG_INFINITY, f64::INFINITY);
        Self { clear, suspect, spacing }
    }
}

impl Probes {
    /// Where a window from `t` to `until` at most ends at the latest.
    pub(crate) fn end(&self, t: f64, until: f64) -> f64 {
        if self.suspect > t {
            until.min(self.suspect)
        } else {
            until
        }
    }

    /// Whether there are probes of such a window: see [`Self::deviation`].
    pub(crate) fn wants(&self, horizon: f64, (t, end): (f64, f64), apart: f64) -> bool {
        t + end > self.clear && apart > (1.0 + GOLDEN) * self.spacing.min(horizon / PROBES)
    }

    /// Probes a window between the times `t` and `t + end`, where the farthest end of the search is
    /// `horizon` after its start and the nodes of the polynomial are at most `apart`. `conforms`
    /// returns whether the function agrees with the polynomial at a time after `t`.
    ///
    /// `None` if it agrees everywhere, otherwise the length of a window that ends at or before the
    /// deviation.
    pub(crate) fn deviation<E>(
        &mut self,
        horizon: f64,
        (t, end): (f64, f64),
        apart: f64,
        mut conforms: impl FnMut(f64) -> Result<bool, E>,
    ) -> Result<Option<f64>, E> {
        if t + end <= self.clear {
            return Ok(None);
        }
        let shortest = SHORTEST * end;
        let (mut end, mut shorter) = (end, None);
        while end > shortest {
            let spacing = self.spacing.min(horizon / PROBES);
            if apart <= (1.0 + GOLDEN) * spacing {
                break;
            }
            let n = (end / spacing).ceil().clamp(1.0, MOST_PROBES);
            let Some((before, at)) = first_deviation(end, n, &mut conforms)? else { break };
            // it varies: how it does before that, no probe so far was close enough to tell
            (end, shorter) = (at, Some(if before > 0.0 { before } else { at }));
            self.spacing = self.spacing.min(end / PROBES);
            self.suspect = t + at;
        }
        self.clear = t + end;
        Ok(shorter)
    }
}

/// Probes of flights for pulses of a force that may be any function of time, which the stages of long steps
/// may miss: the distance of evaluations is at most a hundredth of the run. Without a run there are none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PulseProbes {
    /// The largest distance of two evaluations (s).
    spacing: f64,
    /// Up to here the probes showed nothing (s).
    clear: f64,
    /// Steps end at this time (s), at which a probe showed a pulse.
    suspect: f64,
}

/// A part of a run in which a pulse is seen.
const SEEN: f64 = 0.01;

impl Default for PulseProbes {
    fn default() -> Self {
        let (clear, suspect) = (f64::NEG_INFINITY, f64::NEG_INFINITY);
        Self { spacing: f64::INFINITY, clear, suspect }
    }
}

impl PulseProbes {
    /// For a run of this length (s).
    pub(crate) fn of(span: f64) -> Self {
        Self { spacing: SEEN * span, ..Self::default() }
    }

    /// From here on the force is another one.
    pub(crate) fn restart(&mut self) {
        *self = Self { spacing: self.spacing, ..Self::default() };
    }

    /// Where a step from `t` to `until` at most ends at the latest.
    pub(crate) fn end(&self, t: f64, until: f64) -> f64 {
        if self.suspect > t {
            until.min(self.suspect)
        } else {
            until
        }
    }

    /// Whether a step of a length (s) may hide a pulse.
    pub(crate) fn is_long(&self, h: f64) -> bool {
        h > 2.0 * self.spacing
    }

    /// Probes a step of length `h` from `t` up to a part of it, `end` (s), between its evaluations at the
    /// `nodes`: the length of one that ends before a time at which the force does not conform.
    pub(crate) fn deviation<E>(
        &mut self,
        (t, end): (f64, f64),
        (h, nodes): (f64, &[f64]),
        mut conforms: impl FnMut(f64) -> Result<bool, E>,
    ) -> Result<Option<f64>, E> {
        let mut nodes = nodes.to_vec();
        nodes.sort_by(f64::total_cmp);
        let mut before = 0.0;
        for ends in nodes.windows(2) {
            let (from, gap) = (h * ends[0], h * (ends[1] - ends[0]));
            let parts = (gap / self.spacing).ceil().clamp(1.0, MOST_PROBES);
            for k in 1..parts as u32 {
                let at = from + gap * (f64::from(k) / parts);
                if at >= end {
                    break;
                }
                if t + at > self.clear && !conforms(at)? {
                    self.suspect = t + at;
                    return Ok(Some(if before > 0.0 { before } else { at }));
                }
                before = at;
            }
            before = from + gap;
        }
        self.clear = t + end;
        Ok(None)
    }
}

/// The first of `n` places from 0 to `end` where a function does not conform, and the place
/// before that.
fn first_deviation<E>(
    end: f64,
    n: f64,
    conforms: &mut impl FnMut(f64) -> Result<bool, E>,
) -> Result<Option<(f64, f64)>, E> {
    let mut before = 0.0;
    // at 0 there is a node
    for i in 1..n as u32 {
        // one in each part, not equidistant: a periodic function must not be probed in its period
        let i = f64::from(i);
        let at = (i + (i * GOLDEN).fract()) / n * end;
        if !conforms(at)? {
            return Ok(Some((before, at)));
        }
        before = at;
    }
    Ok(None)
}

#[cfg(test)]
mod grid_tests {
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

#[cfg(test)]
mod probes_tests {
    use super::*;
    use std::convert::Infallible;

    /// Pulse found by probes of a whole span, and the number of probes.
    fn found(span: f64, pulse: (f64, f64)) -> (Option<f64>, f64, usize) {
        let (mut probes, mut n) = (Probes::default(), 0);
        let shorter = probes.deviation(span, (0.0, span), span, |t| {
            n += 1;
            Ok::<bool, Infallible>(!(t > pulse.0 && t < pulse.1))
        });
        (shorter.unwrap_or(None), probes.end(0.0, span), n)
    }

    #[test]
    fn no_pulse_longer_than_a_golden_section_of_the_distance_is_overlooked() {
        let span = 10.0;
        let width = (1.0 + GOLDEN) * span / PROBES;
        for k in 0..2000 {
            let start = (span - width) * f64::from(k) / 2000.0;
            let (shorter, suspect, n) = found(span, (start, start + 1.001 * width));
            assert!(shorter.is_some_and(|shorter| shorter <= suspect), "{start}");
            assert!(suspect > start && suspect < start + 1.001 * width, "{start}");
            assert!(n < 2 * MOST_PROBES as usize, "{start} {n}");
        }
        assert_eq!(found(span, (20.0, 30.0)), (None, span, PROBES as usize - 1));
    }

    #[test]
    fn what_deviates_from_the_start_on_is_traced_back_to_it() {
        let (shorter, suspect, n) = found(10.0, (0.0, 0.26));
        assert!(shorter == Some(suspect) && suspect <= SHORTEST * 10.0 && n < 100, "{suspect} {n}");
    }

    #[test]
    fn what_was_clear_is_not_probed_again() {
        let mut probes = Probes::default();
        let all_conform = |probes: &mut Probes, t, end| {
            let mut n = 0;
            let found = probes.deviation(10.0, (t, end), end, |_| {
                n += 1;
                Ok::<bool, Infallible>(true)
            });
            assert_eq!(found, Ok(None));
            n
        };
        assert_eq!(all_conform(&mut probes, 0.0, 5.0), 31);
        assert_eq!(all_conform(&mut probes, 2.0, 3.0), 0);
        assert_eq!(all_conform(&mut probes, 5.0, 5.0), 31);
    }

    #[test]
    fn a_window_whose_nodes_are_as_close_as_probes_needs_none() {
        let apart = (1.0 + GOLDEN) * 10.0 / PROBES;
        for (apart, probed) in [(0.99 * apart, false), (1.01 * apart, true)] {
            let found =
                Probes::default().deviation(10.0, (0.0, 10.0), apart, |_| Ok::<_, ()>(false));
            assert_eq!(found.unwrap().is_some(), probed);
        }
    }
}
