//! Samples of steps and those between them, merged.

use std::collections::TryReserveError;

use super::contact::before_contact;
use super::{PlotSamples, Source, BUDGET, LANES, MOST};
use crate::switched::path::Curve;

/// Samples at the ends of steps and those between them, in the order of time: where there is one
/// already it stays.
pub(super) struct Merged<'a> {
    pub(super) all: PlotSamples,
    /// Times and positions.
    steps: [&'a [f64]; 2],
    next: usize,
    segments: usize,
}

impl<'a> Merged<'a> {
    pub(super) fn new(steps: [&'a [f64]; 2], segments: usize) -> Self {
        Self { all: PlotSamples::default(), steps, next: 0, segments }
    }

    /// Makes room for so many more samples of a segment besides those of the steps.
    #[inline(always)]
    pub(super) fn make_room(
        &mut self,
        count: usize,
        segment: usize,
    ) -> Result<(), TryReserveError> {
        let PlotSamples { t, x, runs, .. } = &self.all;
        let left = self.steps[0].len() - self.next;
        let room = (t.capacity() - t.len()).min(x.capacity() - x.len());
        if room >= count + left && runs.capacity() - runs.len() > left + 1 {
            return Ok(());
        }
        self.grow(count, segment)
    }

    /// As far as the segments so far lead to expect.
    #[cold]
    fn grow(&mut self, count: usize, segment: usize) -> Result<(), TryReserveError> {
        /// Segments after which that is known, and samples of one before.
        const KNOWN: usize = 40;
        const USUAL: f64 = 16.0;
        let PlotSamples { t, x, runs, .. } = &mut self.all;
        let left = self.steps[0].len() - self.next;
        let (each, ahead) = match segment {
            0..KNOWN => (USUAL, (self.segments - segment).min(2 * KNOWN)),
            _ => (1.05 * t.len() as f64 / segment as f64, self.segments - segment),
        };
        let expected = (each * ahead as f64).min(BUDGET) as usize;
        let count = (count + left).max(expected).max(t.len() / 8);
        for list in [t, x] {
            list.try_reserve_exact(count)?;
        }
        runs.try_reserve(2 * left + 2)
    }

    /// Those of the steps up to a time.
    #[inline(always)]
    pub(super) fn pass(&mut self, t: f64) {
        while let Some(&step) = self.steps[0].get(self.next).filter(|&&step| step <= t) {
            if self.all.t.last() != Some(&step) {
                self.all.t.push(step);
                self.all.x.push(self.steps[1][self.next]);
                self.all.note(Source::Steps(self.next), 1);
            }
            self.next += 1;
        }
    }

    /// Adds those of a curve at the first of these times, so many, for which there is room, and for
    /// [`LANES`] more.
    #[inline(always)]
    pub(super) fn push(&mut self, curve: &Curve, times: &[f64; MOST], count: usize) {
        let PlotSamples { t, x, .. } = &mut self.all;
        let all = t.len() + count;
        for times in times.chunks_exact(LANES).take(count.div_ceil(LANES)) {
            let mut at = [0.0; LANES];
            at.copy_from_slice(times);
            t.extend_from_slice(&at);
            x.extend_from_slice(&curve.positions(&at));
        }
        t.truncate(all);
        x.truncate(all);
    }

    /// Moves the last sample, just before an impact, back to where it can be told from it, if it
    /// cannot: one of those from this one on, or none.
    #[inline(always)]
    pub(super) fn last_before(&mut self, curve: &Curve, end: f64, first: usize) {
        if self.all.x.last().is_none_or(|&x| x > 0.0) {
            return;
        }
        let PlotSamples { t, x, .. } = &mut self.all;
        t.pop();
        x.pop();
        if let Some((contact, above)) = before_contact(curve, end) {
            if t.len() == first || t.last().is_some_and(|&last| last < contact) {
                t.push(contact);
                x.push(above);
            }
        }
    }

    /// Takes the samples from this one on as those of a source.
    #[inline(always)]
    pub(super) fn close(&mut self, source: Source, first: usize) -> Result<(), TryReserveError> {
        let t = &self.all.t;
        let Some(&last) = t[first..].last() else { return Ok(()) };
        let alone = self.steps[0].get(self.next).is_none_or(|&step| step > last);
        if alone && (first == 0 || t[first - 1] < t[first]) {
            self.all.note(source, t.len() - first);
            return Ok(());
        }
        self.one_by_one(source, first)
    }

    /// The same where steps end among them.
    #[cold]
    fn one_by_one(&mut self, source: Source, first: usize) -> Result<(), TryReserveError> {
        let (times, x) = (self.all.t.split_off(first), self.all.x.split_off(first));
        self.grow(times.len(), self.segments)?;
        self.all.runs.try_reserve(2 * times.len() + self.steps[0].len() - self.next)?;
        for (k, (&t, x)) in times.iter().zip(x).enumerate() {
            self.pass(t);
            if self.all.t.last().is_none_or(|&last| last < t) {
                self.all.t.push(t);
                self.all.x.push(x);
                self.all.note(source.after(k), 1);
            }
        }
        Ok(())
    }

    /// The rest of the steps.
    pub(super) fn finish(mut self) -> Result<PlotSamples, TryReserveError> {
        self.make_room(0, self.segments)?;
        self.pass(f64::INFINITY);
        Ok(self.all)
    }
}
