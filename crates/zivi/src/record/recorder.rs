//! Recorder of a run, points of a motion, summaries.
//!
//! Fills the columns of a run.

use crate::record::columns::{Columns, Quantity, Sample};
use crate::record::gap_set::ContactMode;
use zivi_core::{sgn, transform, Lifted, Physical, Restitution};

/// Steps that are staged before they are appended.
const BLOCK: usize = 256;

/// Stages steps in a block that stays in the cache and appends whole blocks to the columns, so
/// that a step pays for no growth of a vector, and derived quantities (the projection, the
/// residual) are computed for many steps together.
pub(crate) struct Recorder {
    columns: Columns,
    /// Decimated copy of the columns, which are then a reused block.
    thinned: Option<StridedRecorder>,
    restitution: Restitution,
    staged: usize,
    /// The state before the staged steps.
    before: Lifted,
    t: [f64; BLOCK],
    s: [f64; BLOCK],
    v: [f64; BLOCK],
    lambda_s: [f64; BLOCK],
    lambda_v: [f64; BLOCK],
    f: [f64; BLOCK],
}

/// Every n-th sample, and a summary of all.
struct StridedRecorder {
    every: usize,
    /// Samples so far.
    seen: usize,
    kept: Columns,
    summary: Summary,
}

impl StridedRecorder {
    /// Extracts the requested samples of a block.
    fn absorb(&mut self, block: &Columns) {
        self.summary.absorb(block);
        if self.every == 0 {
            self.seen += block.len();
            return;
        }
        let first = self.seen.next_multiple_of(self.every) - self.seen;
        for k in (first..block.len()).step_by(self.every) {
            self.kept.push(Quantity::ALL.map(|quantity| block.of(quantity)[k]));
        }
        self.seen += block.len();
    }
}

/// The memory of a record of `n` steps of which `keep` is kept, or of a block if smaller.
pub(crate) fn memory(
    n: usize,
    keep: Keep,
    advise: impl FnOnce(*const f64, usize),
) -> Result<(Columns, Option<Columns>), std::collections::TryReserveError> {
    match keep {
        Keep::All => Ok((Columns::with_room(n + 1, advise)?, None)),
        Keep::Every(every) => {
            let kept = Columns::with_room(n.checked_div(every).map_or(1, |it| it + 1), advise)?;
            Ok((Columns::with_room(BLOCK + 1, |_, _| ())?, Some(kept)))
        }
    }
}

impl Recorder {
    /// Keeps only every n-th sample (none for `0`), in `kept`.
    pub(crate) fn thinned(mut self, every: usize, kept: Columns) -> Self {
        self.thinned = Some(StridedRecorder { every, seen: 0, kept, summary: Summary::default() });
        self
    }

    /// Fills `columns`, which have room for the initial state `z` and all steps; its signs are
    /// recorded as its multipliers.
    pub(crate) fn start(mut columns: Columns, t: f64, z: Lifted, restitution: Restitution) -> Self {
        let physical = transform::project(z, restitution);
        let (lambda_s, lambda_v) = (sgn(z.s), sgn(z.v));
        columns.push([t, physical.x, physical.xdot, z.s, z.v, lambda_s, lambda_v, 0.0]);
        let (t, s, v, f) = ([0.0; BLOCK], [0.0; BLOCK], [0.0; BLOCK], [0.0; BLOCK]);
        let (lambda_s, lambda_v) = ([0.0; BLOCK], [0.0; BLOCK]);
        let thinned = None;
        Self { columns, thinned, restitution, staged: 0, before: z, t, s, v, lambda_s, lambda_v, f }
    }

    /// Steps that can be staged before the block must be flushed.
    #[inline]
    pub(crate) fn room(&self) -> usize {
        BLOCK - self.staged
    }

    /// Whether the block must be flushed before the next [`Recorder::push`].
    #[inline]
    pub(crate) fn is_full(&self) -> bool {
        self.staged >= BLOCK
    }

    #[inline(always)]
    pub(crate) fn push(&mut self, t: f64, sample: Sample) {
        // the remainder changes nothing: it shows the compiler that the index is in range
        let k = self.staged % BLOCK;
        self.t[k] = t;
        self.s[k] = sample.z.s;
        self.v[k] = sample.z.v;
        self.lambda_s[k] = sample.lambda_s;
        self.lambda_v[k] = sample.lambda_v;
        self.f[k] = sample.f;
        self.staged = k + 1;
    }

    /// Appends the staged steps; `residual` of a step is evaluated for its start, its force and its
    /// multipliers.
    #[inline(never)]
    pub(crate) fn flush(&mut self, residual: impl Fn(Lifted, f64, [f64; 2]) -> f64) {
        let (n, restitution) = (self.staged, self.restitution);
        let (s, v, f) = (&self.s[..n], &self.v[..n], &self.f[..n]);
        let (lambda_s, lambda_v) = (&self.lambda_s[..n], &self.lambda_v[..n]);
        let [to_t, to_x, to_xdot, to_s, to_v, to_lambda_s, to_lambda_v, to_residual] =
            self.columns.extend(n);
        to_t.copy_from_slice(&self.t[..n]);
        to_s.copy_from_slice(s);
        to_v.copy_from_slice(v);
        to_lambda_s.copy_from_slice(lambda_s);
        to_lambda_v.copy_from_slice(lambda_v);
        let mut before = self.before;
        for k in 0..n {
            let z = Lifted { s: s[k], v: v[k] };
            let physical = transform::project(z, restitution);
            (to_x[k], to_xdot[k]) = (physical.x, physical.xdot);
            to_residual[k] = residual(before, f[k], [lambda_s[k], lambda_v[k]]);
            before = z;
        }
        self.before = before;
        self.staged = 0;
        if let Some(thinned) = &mut self.thinned {
            thinned.absorb(&self.columns);
            self.columns.clear();
        }
    }

    /// The stored samples, with a summary for decimated ones.
    pub(crate) fn finish(self) -> (Columns, Option<Summary>) {
        match self.thinned {
            Some(StridedRecorder { kept, summary, .. }) => (kept, Some(summary)),
            None => (self.columns, None),
        }
    }
}

// The states that runs record.

/// A state at some time with its branch of the transform.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathPoint {
    /// Distance from the wall, `>= 0` (m).
    pub x: f64,
    /// Velocity (m/s); at the time of an impact the one after it.
    pub xdot: f64,
    /// Branch, `+1` or `-1`: it changes at each impact, and `s = sigma x`.
    pub sigma: f64,
}

/// Whether a number is one of the two branches.
pub(crate) fn is_sigma(sigma: f64) -> bool {
    sigma.abs() == 1.0
}

/// A state of the motion: coordinates, gaps and slips, their rates, and the mode.
#[derive(Clone, Debug, PartialEq)]
pub struct MotionPoint {
    /// `q`, `g`; with friction, the slip distance of each channel and an unused number.
    pub x: Vec<f64>,
    /// `q'`, `g'`; with friction, the slip speeds and the dissipated work.
    pub v: Vec<f64>,
    /// The closed gaps, and the modes of friction.
    pub mode: ContactMode,
}

/// A state that is recorded.
pub(crate) trait Recorded: Clone {
    /// How many numbers it consists of.
    fn numbers(&self) -> usize;
}

impl Recorded for PathPoint {
    fn numbers(&self) -> usize {
        3
    }
}

impl Recorded for MotionPoint {
    fn numbers(&self) -> usize {
        self.x.len() + self.v.len()
    }
}

// Stored samples of a run, and the summary of all samples.

/// Which samples of a run are kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Keep {
    /// All of them.
    #[default]
    All,
    /// The first and every n-th after it; none for `0`.
    Every(usize),
}

/// The last sample, and the extremes of all.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Summary {
    /// Time of the last sample (s).
    pub t: f64,
    /// Last distance from the wall (m).
    pub x: f64,
    /// Last velocity (m/s).
    pub xdot: f64,
    /// Largest sampled distance from the wall (m).
    pub x_max: f64,
    /// Largest sampled speed (m/s).
    pub speed_max: f64,
}

impl Default for Summary {
    /// Of no sample.
    fn default() -> Self {
        Self { t: f64::NAN, x: f64::NAN, xdot: f64::NAN, x_max: 0.0, speed_max: 0.0 }
    }
}

impl Summary {
    /// Of all samples of a run.
    #[must_use]
    pub fn of(columns: &Columns) -> Self {
        let mut summary = Self::default();
        summary.absorb(columns);
        summary
    }

    /// Goes on with one sample.
    pub(crate) fn note(&mut self, t: f64, Physical { x, xdot }: Physical) {
        let (x_max, speed_max) = (self.x_max.max(x.abs()), self.speed_max.max(xdot.abs()));
        *self = Self { t, x, xdot, x_max, speed_max };
    }

    /// Goes on with further samples.
    pub(crate) fn absorb(&mut self, columns: &Columns) {
        let last = |quantity| columns.of(quantity).last().copied();
        let largest = |quantity, so_far: f64| {
            columns.of(quantity).iter().fold(so_far, |largest, value| largest.max(value.abs()))
        };
        if let (Some(t), Some(x), Some(xdot)) =
            (last(Quantity::T), last(Quantity::X), last(Quantity::Xdot))
        {
            (self.t, self.x, self.xdot) = (t, x, xdot);
        }
        self.x_max = largest(Quantity::X, self.x_max);
        self.speed_max = largest(Quantity::Xdot, self.speed_max);
    }
}

// A step of fixed length and the motion within it.

/// An end of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepEnd {
    /// Time (s).
    pub t: f64,
    /// The state.
    pub state: Physical,
    /// Its image.
    pub z: Lifted,
}

/// Quantity that is linear within a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Interpolation {
    /// `s` and `v`, which are projected.
    Lifted(Restitution),
    /// `x` and `x'`, for a scheme that may penetrate the wall.
    Physical,
}

/// A step and the motion within it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DenseStep {
    /// Its start.
    pub from: StepEnd,
    /// Its end.
    pub to: StepEnd,
    /// The motion between them.
    pub interpolation: Interpolation,
}

impl DenseStep {
    /// A quantity that goes linearly from `start` to `end`.
    fn linear(&self, t: f64, start: f64, end: f64) -> f64 {
        let (from, to) = (self.from.t, self.to.t);
        if t == from {
            start
        } else if t == to {
            end
        } else {
            (end - start) / (to - from) * (t - from) + start
        }
    }

    pub(crate) fn z(&self, t: f64) -> Lifted {
        let (from, to) = (self.from.z, self.to.z);
        Lifted { s: self.linear(t, from.s, to.s), v: self.linear(t, from.v, to.v) }
    }

    /// The state at a time within the step; at an impact, the state after it.
    pub(crate) fn at(&self, t: f64) -> Physical {
        let (from, to) = (self.from.state, self.to.state);
        match self.interpolation {
            Interpolation::Lifted(restitution) => transform::project(self.z(t), restitution),
            Interpolation::Physical => Physical {
                x: self.linear(t, from.x, to.x),
                xdot: self.linear(t, from.xdot, to.xdot),
            },
        }
    }

    /// Where `s` changes its sign within the step.
    pub(crate) fn crossing(&self) -> Option<f64> {
        let (start, end) = (self.from.z.s, self.to.z.s);
        let crosses = (start < 0.0 && end > 0.0) || (start > 0.0 && end < 0.0);
        let (from, to) = (self.from.t, self.to.t);
        crosses.then(|| from + (to - from) / (1.0 - end / start))
    }

    /// Time and state of a sample number, counted from 0: the ends of `looks` equal parts, plus the
    /// wall if met within the step (by rounding possibly at an end).
    pub(crate) fn nth_look(&self, number: usize, looks: usize) -> Option<(f64, Physical)> {
        let (from, to) = (self.from.t, self.to.t);
        let wall = self.crossing();
        let passed = wall.map(|t| ((t - from) / (to - from) * looks as f64) as usize);
        let passed = passed.map(|passed| passed.min(looks - 1));
        if let (Some(t), true) = (wall, passed == Some(number)) {
            return Some((t, Physical { x: 0.0, ..self.at(t) }));
        }
        let part = number + usize::from(passed.is_none_or(|passed| number < passed));
        match part {
            last if last == looks => Some((to, self.to.state)),
            beyond if beyond > looks => None,
            part => {
                let t = from + part as f64 / looks as f64 * (to - from);
                Some((t, self.at(t)))
            }
        }
    }
}

#[cfg(test)]
mod recorder_tests {
    use super::*;
    use crate::record::columns::Columns;

    const STEPS: usize = 700;

    /// Steps through blocks with restarts between them, and the record of them.
    fn recorded(keep: Keep) -> (Columns, Option<Summary>) {
        let (columns, kept) = memory(STEPS, keep, |_, _| ()).unwrap();
        let restitution = Restitution::from_kappa(0.5).unwrap();
        let at = |k: usize| Lifted { s: k as f64 + 0.5, v: -1.0 };
        let mut record = Recorder::start(columns, 0.0, at(0), restitution);
        if let (Keep::Every(every), Some(kept)) = (keep, kept) {
            record = record.thinned(every, kept);
        }
        // what tells the start of a step and its force
        let residual = |z: Lifted, f: f64, _: [f64; 2]| z.s + 1e4 * f;
        for k in 1..=STEPS {
            if record.is_full() || k == 300 {
                record.flush(residual);
            }
            let f = k as f64;
            record.push(k as f64, Sample { z: at(k), lambda_s: 1.0, lambda_v: -1.0, f });
        }
        record.flush(residual);
        record.finish()
    }

    #[test]
    fn each_residual_is_that_of_its_own_step() {
        let (columns, summary) = recorded(Keep::All);
        assert!(summary.is_none());
        assert_eq!(columns.len(), STEPS + 1);
        assert_eq!(columns.of(Quantity::Residual)[0], 0.0);
        for k in 1..=STEPS {
            let start = k as f64 - 0.5;
            assert_eq!(columns.of(Quantity::Residual)[k], start + 1e4 * k as f64, "{k}");
        }
    }

    #[test]
    fn every_so_many_samples_are_kept_across_blocks() {
        let (all, _) = recorded(Keep::All);
        for every in [1, 7, 256, 257] {
            let (kept, summary) = recorded(Keep::Every(every));
            for quantity in Quantity::ALL {
                let expected: Vec<f64> = all.of(quantity).iter().copied().step_by(every).collect();
                assert_eq!(kept.of(quantity), expected, "{every} {quantity:?}");
            }
            assert_eq!(summary, Some(Summary::of(&all)));
        }
        let (kept, summary) = recorded(Keep::Every(0));
        assert_eq!((kept.len(), summary), (0, Some(Summary::of(&all))));
    }
}
