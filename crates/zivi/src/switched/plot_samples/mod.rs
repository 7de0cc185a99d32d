//! Samples for plots: outlines, apexes, contact, tails.
//!
//! Samples between the ends of steps, so that lines through all of them draw the motion.
//!
//! A step of high order spans a whole flight; a line between its ends shows none of it. The
//! polynomials of the dense output say how far they are from straight: over `n` equal parts of a
//! step a line is off by at most `max |p''|/(8 n^2)`. Bernstein coefficients bound `|p''|` of an
//! embedded pair; that of a power series follows from its values at three points, since steps are
//! short for the fastest wave that it consists of. Times and positions are found in one go, all
//! other quantities when they are asked for.

mod outline;
#[cfg(test)]
mod tests;

use crate::record::columns::QUANTITIES;
use crate::switched::flight::series::TERMS;
use crate::switched::path::{DensePath, FlightCurve, SegmentKind};
use crate::switched::plot_samples::outline::{Guesses, Outline};
use crate::zeno::tail::Tail;
use crate::PathPoint;
use pulp::{Simd, WithSimd};
use std::collections::TryReserveError;

/// Allowed error of a line relative to the height of the drawn motion: of a step and its neighbours
/// in the same flight.
const FLATNESS: f64 = 1.0 / 200.0;
/// Lower motions are drawn with the accuracy of this fraction of the highest.
const LOW: f64 = 0.05;
/// Most parts of a step.
const MOST_PARTS: f64 = 64.0;
/// Samples of a whole run that are added at most, besides those at impacts and apexes: a run of
/// more steps is drawn by its steps.
const BUDGET: f64 = 1e5;
/// Samples of a step: those that divide it, those at apexes and one before an impact.
const MOST: usize = MOST_PARTS as usize + TERMS;
/// Steps whose outlines are made one after the other.
const BLOCK: usize = 8;
/// Times that are evaluated together.
pub(super) const LANES: usize = 8;

/// A row of the samples: `t`, `x`, `x'`, `sigma`.
pub(super) type Row = [f64; 4];

/// Times of samples that draw a motion, with sources of the other quantities.
#[derive(Clone, Debug, Default)]
pub struct PlotSamples {
    pub(super) t: Vec<f64>,
    pub(super) x: Vec<f64>,
    pub(super) runs: Vec<SampleRun>,
    /// Those within tails.
    pub(super) rows: Vec<Row>,
}

/// Consecutive samples with their source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SampleRun {
    pub(super) source: SampleSource,
    pub(super) count: usize,
}

/// Source of samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum SampleSource {
    /// The samples at the ends of steps from this one on.
    Steps(usize),
    /// The segment of this number.
    Flight(usize),
    /// The rows from this one on.
    Rows(usize),
}

impl SampleSource {
    /// The source of the sample after `count` others.
    fn after(self, count: usize) -> Self {
        match self {
            SampleSource::Steps(first) => SampleSource::Steps(first + count),
            SampleSource::Flight(number) => SampleSource::Flight(number),
            SampleSource::Rows(first) => SampleSource::Rows(first + count),
        }
    }
}

impl PlotSamples {
    /// Those of a motion and of the ends of its steps: their times and positions.
    ///
    /// # Errors
    /// There is no room for them or for arrays made from them.
    pub(super) fn of(path: &DensePath, steps: [&[f64]; 2]) -> Result<Self, TryReserveError> {
        let mut share = 1.0;
        let all = loop {
            match pulp::Arch::new().dispatch(PlannedKernel { path, steps, share })? {
                Ok(all) => break all,
                // of so many parts of the steps the budget is what all of them get
                Err(part) => share = part,
            }
        };
        // one of the columns is there
        Vec::<[f64; QUANTITIES]>::new().try_reserve_exact(all.t.len())?;
        Ok(all)
    }

    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.t.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.t.is_empty()
    }

    /// The positions; they are evaluated again at the next call.
    pub fn take_positions(&mut self) -> Vec<f64> {
        std::mem::take(&mut self.x)
    }

    /// Sets the source of the last `count` samples.
    #[inline(always)]
    fn note(&mut self, source: SampleSource, count: usize) {
        match self.runs.last_mut() {
            Some(last) if last.source.after(last.count) == source => last.count += count,
            _ => self.runs.push(SampleRun { source, count }),
        }
    }
}

/// [`planned`], compiled for the vectors that the machine has.
struct PlannedKernel<'a> {
    path: &'a DensePath,
    steps: [&'a [f64]; 2],
    share: f64,
}

impl WithSimd for PlannedKernel<'_> {
    type Output = Result<Result<PlotSamples, f64>, TryReserveError>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        planned(simd, self)
    }
}

/// The samples, or the share of them that the budget allows.
#[inline(always)]
fn planned<S: Simd>(
    simd: S,
    PlannedKernel { path, steps, share }: PlannedKernel<'_>,
) -> Result<Result<PlotSamples, f64>, TryReserveError> {
    let scale = Scale::of(path);
    let (mut merged, mut apexes) = (Merged::new(steps, path.segments.len()), Vec::new());
    let mut guesses = Guesses::NONE;
    merged.make_room(0, 0)?;
    let (mut wanted, mut drawn, mut before) = (0.0, 0.0, None);
    let mut times = [0.0; MOST];
    let (mut of_block, mut of_apexes) = (0, 0);
    let (mut block, mut curves) = ([const { (FlightCurve::NONE, Outline::NONE) }; BLOCK], 0);
    let last = path.end.map_or(f64::NEG_INFINITY, |(t, _)| t);
    for (number, segment) in path.segments.iter().enumerate() {
        let end = path.segments.get(number + 1).map_or(last, |next| next.start);
        if number % BLOCK == 0 {
            // one loop for each of both: a processor works on several steps at once
            let those = &path.segments[number..path.segments.len().min(number + BLOCK)];
            curves = 0;
            for segment in those {
                curves += usize::from(path.write_curve(segment, &mut block[curves].0));
            }
            apexes.clear();
            apexes.try_reserve(TERMS * BLOCK)?;
            for (k, (curve, outline)) in block[..curves].iter_mut().enumerate() {
                let known = apexes.len();
                let guess;
                (*outline, guess) = Outline::of(simd, curve, &mut apexes);
                if let Some((a, theta)) = guess {
                    guesses.push((k, apexes.len()), a, theta);
                    apexes.push(curve.start);
                }
                outline.apexes = apexes.len() - known;
            }
            guesses.polish(simd, &mut block, &mut apexes);
            (of_block, of_apexes) = (0, 0);
        }
        merged.pass(segment.start);
        let first = merged.all.t.len();
        if let SegmentKind::Tail(tail) = segment.kind {
            let row = merged.all.rows.len();
            draw_tail(&path.tails[tail], end, scale, &mut merged.all.rows)?;
            merged.make_room(merged.all.rows.len() - row, number)?;
            let PlotSamples { t, x, rows, .. } = &mut merged.all;
            t.extend(rows[row..].iter().map(|row| row[0]));
            x.extend(rows[row..].iter().map(|row| row[1]));
            merged.close(SampleSource::Rows(row), first)?;
        }
        let flown = block[..curves].get(of_block).filter(|_| segment.kind.is_flight());
        let Some((curve, outline)) = flown else {
            before = None;
            continue;
        };
        of_block += 1;
        let (mut high, mut fast) = (outline.x, outline.xdot);
        if let Some(Outline { x, xdot, .. }) = before {
            (high, fast) = (joined(high, x), joined(fast, xdot));
        }
        let lands = curve.lands();
        if !lands {
            // where the next ends is where the one after it starts
            let next = path.segments.get(number + 2).and_then(|next| path.first_powers(next));
            if let Some([at, ..]) = next {
                high = joined(high, [at, at]);
            }
        }
        let part = ((end - curve.start) / curve.h).min(1.0);
        let parts = scale.parts(part, outline.bends, [high, fast]);
        wanted += parts;
        let parts = if drawn > 2.0 * BUDGET { 1.0 } else { (share * parts).ceil() };
        drawn += parts;
        let span = (segment.start, end);
        let mut count = divide(span, parts, &mut times);
        if before.is_some() && merged.all.t.last() != Some(&segment.start) {
            // one step of the method is several of these
            times.copy_within(..count, 1);
            times[0] = segment.start;
            count += 1;
        }
        for &apex in &apexes[of_apexes..of_apexes + outline.apexes] {
            count = insert(apex, span, (&mut times, count));
        }
        of_apexes += outline.apexes;
        let contact = end.next_down();
        let looks = lands && (count == 0 || times[count - 1] < contact);
        if looks {
            times[count] = contact;
            count += 1;
        }
        merged.make_room(count + LANES, number)?;
        merged.push(curve, &times, count);
        if looks {
            merged.last_before(curve, end, first);
        }
        merged.close(SampleSource::Flight(number), first)?;
        before = Some(*outline).filter(|_| !lands);
    }
    if wanted > BUDGET && share == 1.0 {
        return Ok(Err(BUDGET / wanted));
    }
    merged.finish().map(Ok)
}

pub(in crate::switched) fn row(t: f64, PathPoint { x, xdot, sigma }: PathPoint) -> Row {
    [t, x, xdot, sigma]
}

// How high and fast a run is, and into how many parts lines divide its steps.

/// The largest distance and speed of a run.
#[derive(Clone, Copy, Debug)]
struct Scale {
    x: f64,
    xdot: f64,
}

impl Scale {
    /// By what the steps start from, and how high a parabola goes from there.
    #[inline(always)]
    fn of(path: &DensePath) -> Self {
        let (mut highest, mut fastest) = (0.0, 0.0);
        for segment in &path.segments {
            let Some([x, v, bend]) = path.first_powers(segment) else { continue };
            let top = if bend < 0.0 && v < -2.0 * bend { -0.5 * v / bend } else { 1.0 };
            let above = if v > 0.0 { top * (v + bend * top) } else { 0.0 };
            highest = larger(x + above, highest);
            fastest = larger(v.abs() / path.length_of(segment), fastest);
        }
        Self { x: highest, xdot: fastest }
    }

    /// Into how many parts lines divide so much of a step.
    #[inline(always)]
    fn parts(&self, part: f64, bends: [f64; 2], [x, xdot]: [[f64; 2]; 2]) -> f64 {
        let of_x = bends[0] / height(x, LOW * self.x);
        let of_xdot = bends[1] / height(xdot, LOW * self.xdot);
        // sqrt(max |p''|/(8 FLATNESS height))
        let parts = (larger(of_x, of_xdot) * (0.125 / FLATNESS)).sqrt();
        (part * parts).ceil().clamp(1.0, MOST_PARTS)
    }
}

/// The largest absolute value in a range.
#[inline(always)]
fn largest([least, most]: [f64; 2]) -> f64 {
    larger(least.abs(), most.abs())
}

/// The smaller of two numbers, the second unless the first is smaller than it.
#[inline(always)]
fn smaller(a: f64, b: f64) -> f64 {
    if a < b {
        a
    } else {
        b
    }
}

#[inline(always)]
fn larger(a: f64, b: f64) -> f64 {
    if a > b {
        a
    } else {
        b
    }
}

/// The least and the largest of some numbers.
#[inline(always)]
fn range(all: impl Iterator<Item = f64>) -> [f64; 2] {
    all.fold([f64::INFINITY, f64::NEG_INFINITY], |[least, most], it| {
        [smaller(it, least), larger(it, most)]
    })
}

/// The range of both.
#[inline(always)]
fn joined(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [smaller(a[0], b[0]), larger(a[1], b[1])]
}

/// The height of the drawn motion, at least `low`.
#[inline(always)]
fn height([least, most]: [f64; 2], low: f64) -> f64 {
    larger(larger(most - least, low), f64::MIN_POSITIVE)
}

// When a step is sampled.

/// Samples closer than this number of units in the last place of the time coincide.
const SAME: f64 = 4.0;

/// Adds the times that divide a span into equal parts; returns their number.
#[inline(always)]
fn divide((start, end): (f64, f64), parts: f64, times: &mut [f64; MOST]) -> usize {
    let length = end - start;
    // false for NaN, too
    let told_apart = length > SAME * parts * ulp(end);
    let (count, part) = if told_apart { (parts as i32 - 1, length / parts) } else { (0, 0.0) };
    let count = count.max(0) as usize;
    for (k, times) in times.chunks_exact_mut(LANES).enumerate().take(count.div_ceil(LANES)) {
        for (l, t) in times.iter_mut().enumerate() {
            *t = start + (LANES * k + l + 1) as f64 * part;
        }
    }
    count
}

/// Adds a time within a span unless it exists; returns the number of times.
#[inline(always)]
fn insert(t: f64, (start, end): (f64, f64), (times, count): (&mut [f64; MOST], usize)) -> usize {
    let mut at = count;
    while at > 0 && times[at - 1] >= t {
        at -= 1;
    }
    let before = if at > 0 { times[at - 1] } else { start };
    let after = if at < count { times[at] } else { end };
    let least = SAME * ulp(t);
    if !(t - before > least && after - t > least) {
        return count;
    }
    times.copy_within(at..count, at + 1);
    times[at] = t;
    count + 1
}

/// The unit in the last place.
fn ulp(t: f64) -> f64 {
    t.abs().next_up() - t.abs()
}

// The last moment before an impact.

/// Number of tested instants before an impact, at doubling distances.
const MOMENTS: usize = 10;

/// The last instant before an impact at the end of a step that is distinguishable from it, and its
/// height above the wall.
#[cold]
fn before_contact(curve: &FlightCurve, end: f64) -> Option<(f64, f64)> {
    let moments = moments(end);
    let mut first = 0;
    while first < MOMENTS {
        let mut t = [end; LANES];
        let count = LANES.min(MOMENTS - first);
        t[..count].copy_from_slice(&moments[first..first + count]);
        let x = curve.positions(&t);
        for k in 0..count {
            if x[k] > 0.0 {
                return Some((t[k], x[k]));
            }
        }
        first += LANES;
    }
    None
}

/// Tested instants before an impact.
#[inline(always)]
fn moments(t: f64) -> [f64; MOMENTS] {
    let ulp = t - t.next_down();
    let mut moments = [t; MOMENTS];
    for (k, moment) in moments.iter_mut().enumerate() {
        *moment -= f64::from(1 << k) * ulp;
    }
    moments
}

// The arcs of an accumulation.

/// How many arcs of a tail are drawn: those higher than this part of the highest.
const ARCS: usize = 64;
const FINEST: f64 = 1e-3;

fn draw_tail(
    tail: &Tail,
    end: f64,
    scale: Scale,
    rows: &mut Vec<Row>,
) -> Result<(), TryReserveError> {
    for arc in (0..ARCS).map_while(|m| tail.arc(m)) {
        // the height of an arc, u h/4
        let height = 0.25 * arc.u * (arc.end - arc.start);
        if arc.start >= end || height < FINEST * scale.x {
            break;
        }
        // a line is off by the height over the square of them; the apex is in the middle
        let flat = FLATNESS * larger(height, LOW * scale.x);
        let parts = 2.0 * (0.5 * (height / flat).sqrt()).ceil();
        rows.try_reserve(parts as usize + 2)?;
        let mut push = |t: f64| rows.push(row(t, arc.at(t)));
        if arc.start > tail.start() {
            push(arc.start);
        }
        let mut last = arc.start;
        for k in 1..parts as usize {
            let t = arc.start + k as f64 / parts * (arc.end - arc.start);
            if arc.start < t && t < arc.end.min(end) {
                push(t);
                last = t;
            }
        }
        if arc.end < end {
            let before = moments(arc.end).into_iter().find(|&t| arc.at(t).x > 0.0);
            before.into_iter().filter(|&t| t > last).for_each(push);
        }
    }
    Ok(())
}

// Samples of steps and those between them, merged.

/// Samples at the ends of steps and those between them, in order of time; existing ones are kept.
struct Merged<'a> {
    all: PlotSamples,
    /// Times and positions.
    steps: [&'a [f64]; 2],
    next: usize,
    segments: usize,
}

impl<'a> Merged<'a> {
    fn new(steps: [&'a [f64]; 2], segments: usize) -> Self {
        Self { all: PlotSamples::default(), steps, next: 0, segments }
    }

    /// Makes room for additional samples of a segment.
    #[inline(always)]
    fn make_room(&mut self, count: usize, segment: usize) -> Result<(), TryReserveError> {
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
    fn pass(&mut self, t: f64) {
        while let Some(&step) = self.steps[0].get(self.next).filter(|&&step| step <= t) {
            if self.all.t.last() != Some(&step) {
                self.all.t.push(step);
                self.all.x.push(self.steps[1][self.next]);
                self.all.note(SampleSource::Steps(self.next), 1);
            }
            self.next += 1;
        }
    }

    /// Adds samples of a curve at the first `count` times; there must be room for [`LANES`] more.
    #[inline(always)]
    fn push(&mut self, curve: &FlightCurve, times: &[f64; MOST], count: usize) {
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

    /// Moves the last sample before an impact to an instant that is distinguishable from it.
    #[inline(always)]
    fn last_before(&mut self, curve: &FlightCurve, end: f64, first: usize) {
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
    fn close(&mut self, source: SampleSource, first: usize) -> Result<(), TryReserveError> {
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
    fn one_by_one(&mut self, source: SampleSource, first: usize) -> Result<(), TryReserveError> {
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
    fn finish(mut self) -> Result<PlotSamples, TryReserveError> {
        self.make_room(0, self.segments)?;
        self.pass(f64::INFINITY);
        Ok(self.all)
    }
}
