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

#[cfg(test)]
mod tests;

use std::collections::TryReserveError;

use pulp::{Simd, WithSimd};

use super::flight::series::{derivative, polished, value, Series, TERMS};
use super::path::{DensePath, FlightCurve, Form, SegmentKind};
use crate::numeric::bernstein::Bernstein;
use crate::numeric::power_series::{all_slopes, all_values, LANES};
use crate::record::columns::QUANTITIES;
use crate::zeno::tail::Tail;
use crate::PathPoint;

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
pub(super) const TIMES_AT_ONCE: usize = 8;

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
        merged.make_room(count + TIMES_AT_ONCE, number)?;
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
    for (k, times) in
        times.chunks_exact_mut(TIMES_AT_ONCE).enumerate().take(count.div_ceil(TIMES_AT_ONCE))
    {
        for (l, t) in times.iter_mut().enumerate() {
            *t = start + (TIMES_AT_ONCE * k + l + 1) as f64 * part;
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
        let mut t = [end; TIMES_AT_ONCE];
        let count = TIMES_AT_ONCE.min(MOMENTS - first);
        t[..count].copy_from_slice(&moments[first..first + count]);
        let x = curve.positions(&t);
        for k in 0..count {
            if x[k] > 0.0 {
                return Some((t[k], x[k]));
            }
        }
        first += TIMES_AT_ONCE;
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

// The flights of an accumulation.

/// How many flights of a tail are drawn: those higher than this part of the highest.
const ARCS: usize = 64;
const FINEST: f64 = 1e-3;

fn draw_tail(
    tail: &Tail,
    end: f64,
    scale: Scale,
    rows: &mut Vec<Row>,
) -> Result<(), TryReserveError> {
    for arc in (0..ARCS).map_while(|m| tail.arc(m)) {
        // the height of a flight, u h/4
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

    /// Adds samples of a curve at the first `count` times; there must be room for [`TIMES_AT_ONCE`] more.
    #[inline(always)]
    fn push(&mut self, curve: &FlightCurve, times: &[f64; MOST], count: usize) {
        let PlotSamples { t, x, .. } = &mut self.all;
        let all = t.len() + count;
        for times in times.chunks_exact(TIMES_AT_ONCE).take(count.div_ceil(TIMES_AT_ONCE)) {
            let mut at = [0.0; TIMES_AT_ONCE];
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

// Drawing data of a step: ranges, deviation from a straight line, apexes.

/// Drawing data of a flight.
#[derive(Clone, Copy, Debug)]
struct Outline {
    /// Least and largest values.
    x: [f64; 2],
    xdot: [f64; 2],
    /// Bounds of the second derivatives of both by the part of the step.
    bends: [f64; 2],
    /// How many apexes it has.
    apexes: usize,
}

impl Outline {
    /// None yet.
    const NONE: Self = Self { x: [0.0; 2], xdot: [0.0; 2], bends: [0.0; 2], apexes: 0 };

    /// That of a curve, where the velocity changes its sign downwards being noted, or near where it
    /// does so, if it does so once.
    #[inline(always)]
    fn of<'a, S: Simd>(
        simd: S,
        curve: &'a FlightCurve,
        apexes: &mut Vec<f64>,
    ) -> (Self, Option<(&'a Series, f64)>) {
        match &curve.form {
            Form::Both(both) => (of_polynomials(curve, both, apexes), None),
            Form::Powers(a, ..) => {
                let (outline, guess) = of_powers(simd, curve, a, apexes);
                (outline, guess.map(|guess| (a, guess)))
            }
        }
    }
}

#[inline(always)]
fn of_polynomials(
    curve: &FlightCurve,
    [x, xdot]: &[Bernstein; 2],
    apexes: &mut Vec<f64>,
) -> Outline {
    /// Rounding threshold relative to the largest coefficient.
    const ROUNDING: f64 = 1e-12;
    let (x, xdot) = (x.coefficients(), xdot.coefficients());
    let n = x.len() as f64 - 1.0;
    let all = |c: &[f64]| range(c.iter().copied());
    let bend =
        |c: &[f64]| n * (n - 1.0) * largest(range(c.windows(3).map(|c| c[0] - 2.0 * c[1] + c[2])));
    let (x, velocity, bends) = (all(x), all(xdot), [bend(x), bend(xdot)]);
    let clear = ROUNDING * largest(velocity);
    if !(velocity[0] > clear || velocity[1] < -clear) {
        all_apexes(curve, apexes);
    }
    Outline { x, xdot: velocity, bends, apexes: 0 }
}

/// Evaluated orders of a series in the middle of a step and at its end: the series and its first
/// three derivatives.
const ORDERS: usize = 4;
const ASKED: usize = 2 * ORDERS;
/// Number of terms used: the truncation error is a millionth of a third derivative.
const ENOUGH: usize = 16;

/// Weights of each power.
const WEIGHTS: [[f64; ASKED]; TERMS] = {
    let (mut weights, mut at) = ([[0.0; ASKED]; TERMS], 0);
    while at < TERMS * ORDERS {
        let (n, order) = (at / ORDERS, at % ORDERS);
        let (mut factor, mut k) = (1.0, 0);
        while k < order {
            factor *= n as f64 - k as f64;
            k += 1;
        }
        weights[n][ORDERS + order] = factor;
        while k < n {
            factor *= 0.5;
            k += 1;
        }
        weights[n][order] = factor;
        at += 1;
    }
    weights
};

/// They, by vectors of the machine.
#[inline(always)]
fn asked_of<S: Simd>(simd: S, a: &Series) -> [f64; ASKED] {
    let mut asked = [0.0; ASKED];
    for (k, asked) in S::as_mut_simd_f64s(&mut asked).0.iter_mut().enumerate() {
        let term = |n: usize| {
            let weights = S::as_simd_f64s(&WEIGHTS[n]).0[k];
            simd.mul_f64s(simd.splat_f64s(a[n]), weights)
        };
        let (mut even, mut odd) = (term(0), term(1));
        for n in (2..ENOUGH).step_by(2) {
            even = simd.add_f64s(even, term(n));
            odd = simd.add_f64s(odd, term(n + 1));
        }
        *asked = simd.add_f64s(even, odd);
    }
    asked
}

/// Whether what has these values at the start, in the middle and at the end of a step certainly has
/// one sign: between two of them a wave of the fastest rate leaves the line by a tenth of its
/// height, of which twice as much is allowed for.
#[inline(always)]
fn is_one_sign([a, b, c]: [f64; 3]) -> bool {
    let [least, most] = [smaller(smaller(a, b), c), larger(larger(a, b), c)];
    let off = 0.2 * larger(least.abs(), most.abs());
    least > off || most < -off
}

/// From the values at the start, in the middle and at the end. A step is at most 1.75 of its
/// fastest rate long: what a wave of that rate has between them is a tenth more at most.
#[inline(always)]
fn of_powers<S: Simd>(
    simd: S,
    curve: &FlightCurve,
    a: &Series,
    apexes: &mut Vec<f64>,
) -> (Outline, Option<f64>) {
    const MORE: f64 = 1.1;
    let mut guess = None;
    let [x1, v1, b1, j1, x2, v2, b2, j2] = asked_of(simd, a);
    let [x0, v0, b0, j0] = [a[0], a[1], 2.0 * a[2], 6.0 * a[3]];
    let bend = MORE * larger(larger(b0.abs(), b1.abs()), b2.abs());
    let jerk = MORE * larger(larger(j0.abs(), j1.abs()), j2.abs());
    let mut x = [smaller(smaller(x0, x1), x2), larger(larger(x0, x1), x2)];
    let [least, most] = [smaller(smaller(v0, v1), v2), larger(larger(v0, v1), v2)];
    if !is_one_sign([v0, v1, v2]) {
        // a velocity whose slope changes its sign once has one root between ends of other signs
        let once = is_one_sign([b0, b1, b2]) || is_one_sign([j0, j1, j2]);
        if once && v0 > 0.0 && v2 < 0.0 {
            guess = Some(of_parabola(v0, b0, v2));
        } else if !(once && v0 < 0.0 && v2 > 0.0 || is_one_sign([b0, b1, b2]) && v0 * v2 > 0.0) {
            let known = apexes.len();
            all_apexes(curve, apexes);
            for &t in &apexes[known..] {
                x[1] = larger(curve.at(t).x, x[1]);
            }
        }
    }
    let xdot = [least / curve.h, most / curve.h];
    (Outline { x, xdot, bends: [bend, jerk / curve.h], apexes: 0 }, guess)
}

/// The root in `(0, 1)` of the parabola with two values at its ends, of opposite signs, and a slope
/// at its start.
fn of_parabola(first: f64, slope: f64, last: f64) -> f64 {
    let bend = last - first - slope;
    let root = 2.0 * first / ((slope * slope - 4.0 * bend * first).sqrt() - slope);
    // false for NaN, too
    if root > 0.0 && root < 1.0 {
        root
    } else {
        0.5
    }
}

/// Where the velocity changes its sign downwards, however often.
fn all_apexes(curve: &FlightCurve, apexes: &mut Vec<f64>) {
    let xdot = curve.velocity();
    // a step that falls has its first turn at the bottom
    let skipped = usize::from(xdot.starts_negative());
    let turns = xdot.crossings(0.0).into_iter().skip(skipped).step_by(2);
    apexes.extend(turns.map(|theta| curve.start + theta * curve.h));
}

// Apexes of power series, found side by side.

/// A step by Halley's formula towards an apex that is so short is the last.
const LAST: f64 = 1e-4;

/// Flights whose velocity has one root downwards: their powers, and near where that is.
struct Guesses {
    count: usize,
    /// Which of the curves each is, and which of all apexes.
    of: [(usize, usize); BLOCK],
    /// By the part of the step.
    theta: [f64; BLOCK],
    /// By powers: written long before vectors of them are read.
    powers: [[f64; BLOCK]; TERMS],
}

impl Guesses {
    const NONE: Self =
        Self { count: 0, of: [(0, 0); BLOCK], theta: [0.0; BLOCK], powers: [[0.0; BLOCK]; TERMS] };

    /// Takes note of one.
    #[inline(always)]
    fn push(&mut self, of: (usize, usize), a: &Series, theta: f64) {
        let k = self.count;
        (self.of[k], self.theta[k], self.count) = (of, theta, k + 1);
        for (powers, a) in self.powers.iter_mut().zip(a) {
            powers[k] = *a;
        }
    }

    /// Notes when they are and how high, each with the bits of [`polished`] and [`value`], and
    /// forgets them.
    #[inline(always)]
    fn polish<S: Simd>(
        &mut self,
        simd: S,
        block: &mut [(FlightCurve, Outline)],
        apexes: &mut [f64],
    ) {
        let [mut above, mut length, mut next] = [[0.0; BLOCK]; 3];
        let [mut later_above, mut later_length, mut theta, mut x] = [[0.0; BLOCK]; 4];
        for r in 0..self.count.div_ceil(S::F64_LANES) {
            let of = |lanes: &[f64; BLOCK]| S::as_simd_f64s(lanes).0[r];
            let to = |all: &mut [f64; BLOCK], it| S::as_mut_simd_f64s(all).0[r] = it;
            let a = self.powers.each_ref().map(of);
            // two steps end it nearly always
            let [value, step, s] = halley(simd, &a, of(&self.theta));
            to(&mut above, value);
            to(&mut length, step);
            to(&mut next, s);
            let [value, step, s] = halley(simd, &a, s);
            to(&mut later_above, value);
            to(&mut later_length, step);
            to(&mut theta, s);
            to(&mut x, all_values(simd, &a, s));
        }
        for k in 0..self.count {
            let ((curve, apex), s) = (self.of[k], self.theta[k]);
            let (curve, outline) = &mut block[curve];
            // as `polished` asks
            let (low, high) = if above[k] > 0.0 { (s, 1.0) } else { (0.0, s) };
            let enclosed = next[k] > low && next[k] < high && length[k] >= LAST;
            let (low, high) = if later_above[k] > 0.0 { (next[k], high) } else { (low, next[k]) };
            let last = later_length[k] < LAST && theta[k] >= low && theta[k] <= high;
            if !(enclosed && last) {
                (theta[k], x[k]) = alone(curve, s);
            }
            apexes[apex] = curve.start + theta[k] * curve.h;
            outline.x[1] = larger(x[k], outline.x[1]);
        }
        self.count = 0;
    }
}

/// One of them.
#[cold]
#[inline(never)]
fn alone(curve: &FlightCurve, guess: f64) -> (f64, f64) {
    let Form::Powers(a, ..) = &curve.form else { return (guess, 0.0) };
    let theta = polished(&derivative(a), guess, |step, _| step.abs() < LAST);
    (theta, value(a, theta))
}

/// The velocities at these places, and length and end of a step of Halley's formula.
#[inline(always)]
fn halley<S: Simd>(simd: S, a: &[S::f64s; TERMS], s: S::f64s) -> [S::f64s; 3] {
    let times = |factor: f64, a| simd.mul_f64s(simd.splat_f64s(factor), a);
    let of = |k: usize| -> [S::f64s; LANES] {
        std::array::from_fn(|i| match LANES * k + i + 1 {
            TERMS => simd.splat_f64s(0.0),
            n => times(n as f64, a[n]),
        })
    };
    let [value, first, second] = all_slopes(simd, of, s);
    let above = simd.mul_f64s(times(2.0, value), first);
    let below =
        simd.sub_f64s(simd.mul_f64s(value, second), simd.mul_f64s(times(2.0, first), first));
    let step = simd.div_f64s(above, below);
    [value, simd.abs_f64s(step), simd.add_f64s(s, step)]
}

#[cfg(test)]
mod apexes_tests {
    use super::*;

    /// A part of cos(rate theta - rate place), whose apex is at that place.
    fn curve(rate: f64, place: f64) -> FlightCurve {
        let mut term = 1.0;
        let a: Series = std::array::from_fn(|n| {
            let own = term * (n as f64 * std::f64::consts::FRAC_PI_2 - rate * place).cos();
            term *= rate / (n as f64 + 1.0);
            own
        });
        FlightCurve { start: 0.0, h: 1.0, sigma: 1.0, form: Form::Powers(a, a[1], false) }
    }

    struct Polished<'a>(&'a mut Guesses, &'a mut [(FlightCurve, Outline)], &'a mut [f64]);

    impl pulp::WithSimd for Polished<'_> {
        type Output = ();

        fn with_simd<S: Simd>(self, simd: S) {
            self.0.polish(simd, self.1, self.2);
        }
    }

    #[test]
    fn side_by_side_they_have_the_bits_of_one_by_one() {
        for count in 1..=BLOCK {
            for k in 0..60 {
                let place = 0.1 + 0.013 * f64::from(k);
                // guessed well, badly, and where a step leads outside
                let guess = |l: usize| match l % 4 {
                    0 => place + 1e-3,
                    1 => place - 0.05,
                    2 => 0.999,
                    _ => (place * (7.3 + l as f64)).fract(),
                };
                let mut guesses = Guesses::NONE;
                let mut block = [(FlightCurve::NONE, Outline::NONE); BLOCK];
                for (l, (own, _)) in block.iter_mut().enumerate().take(count) {
                    *own = curve(0.3 + 0.02 * f64::from(k) + 0.03 * l as f64, place);
                    let Form::Powers(a, ..) = &own.form else { unreachable!() };
                    guesses.push((l, count - 1 - l), a, guess(l));
                }
                let mut apexes = [0.0; BLOCK];
                pulp::Arch::new().dispatch(Polished(&mut guesses, &mut block, &mut apexes));
                assert_eq!(guesses.count, 0);
                for (l, (own, outline)) in block.iter().enumerate().take(count) {
                    let (theta, x) = alone(own, guess(l));
                    assert_eq!((apexes[count - 1 - l], outline.x[1]), (theta, x), "{k} {l}");
                    assert!((theta - place).abs() < 1e-12 && (x - 1.0).abs() < 1e-15, "{k} {l}");
                }
            }
        }
    }
}
