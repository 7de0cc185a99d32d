//! Samples between the ends of steps, so that lines through all of them draw the motion.
//!
//! A step of high order spans a whole flight; a line between its ends shows none of it. The
//! polynomials of the dense output say how far they are from straight: over `n` equal parts of a
//! step a line is off by at most `max |p''|/(8 n^2)`. Bernstein coefficients bound `|p''|` of an
//! embedded pair; that of a power series follows from its values at three points, since steps are
//! short for the fastest wave that it consists of. Times and positions are found in one go, all
//! other quantities when they are asked for.

use std::collections::TryReserveError;

use pulp::{Simd, WithSimd};

use super::flight::series::{derivative, value, Series, TERMS};
use super::path::{Curve, DensePath, Form, Kind, Segment};
use crate::numeric::bernstein::Bernstein;
use crate::numeric::power_series::slopes;
use crate::record::columns::QUANTITIES;
use crate::zeno::tail::Tail;
use crate::PathPoint;

/// A line may be off by this part of the height of what it draws: of a step, and of those before
/// and after it in the same flight.
const FLATNESS: f64 = 1.0 / 200.0;
/// What is lower than this part of the highest is drawn as if it were so high.
const LOW: f64 = 0.05;
/// Most parts of a step.
const MOST_PARTS: f64 = 64.0;
/// How many arcs of a tail are drawn: those higher than this part of the highest.
const ARCS: usize = 64;
const FINEST: f64 = 1e-3;
/// Samples that are nearer to one another than so many units in the last place of the time are one.
const SAME: f64 = 4.0;
/// Samples of a whole run that are added at most, besides those at impacts and apexes: a run of
/// more steps is drawn by its steps.
const BUDGET: f64 = 1e5;
/// Moments before an impact that are looked at, each twice as far from it as the one before.
const MOMENTS: usize = 10;
/// Samples of a step: those that divide it, those at apexes and one before an impact.
const MOST: usize = MOST_PARTS as usize + TERMS;
/// Times that are evaluated at once.
pub(super) const LANES: usize = 8;

/// A row of the samples: `t`, `x`, `x'`, `sigma`.
pub(super) type Row = [f64; 4];

/// When there are samples that draw a motion, and what tells the other quantities there.
#[derive(Clone, Debug, Default)]
pub struct PlotSamples {
    pub(super) t: Vec<f64>,
    pub(super) x: Vec<f64>,
    pub(super) runs: Vec<Run>,
    /// Those within tails.
    pub(super) rows: Vec<Row>,
}

/// So many samples after one another, and what tells them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Run {
    pub(super) source: Source,
    pub(super) count: usize,
}

/// What tells samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Source {
    /// The samples at the ends of steps from this one on.
    Steps(usize),
    /// The segment of this number.
    Flight(usize),
    /// The rows from this one on.
    Rows(usize),
}

impl Source {
    /// That of the sample after so many.
    fn after(self, count: usize) -> Self {
        match self {
            Source::Steps(first) => Source::Steps(first + count),
            Source::Flight(number) => Source::Flight(number),
            Source::Rows(first) => Source::Rows(first + count),
        }
    }
}

impl PlotSamples {
    /// Those of a motion and of the ends of its steps: their times and positions.
    ///
    /// # Errors
    /// There is no room for them, or for the arrays that are made of them.
    pub(super) fn of(path: &DensePath, steps: [&[f64]; 2]) -> Result<Self, TryReserveError> {
        let mut share = 1.0;
        let all = loop {
            match pulp::Arch::new().dispatch(Planned { path, steps, share })? {
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

    /// The positions, which are evaluated again if they are asked for once more.
    pub fn take_positions(&mut self) -> Vec<f64> {
        std::mem::take(&mut self.x)
    }

    /// The last samples, so many, are told by this.
    #[inline(always)]
    fn note(&mut self, source: Source, count: usize) {
        match self.runs.last_mut() {
            Some(last) if last.source.after(last.count) == source => last.count += count,
            _ => self.runs.push(Run { source, count }),
        }
    }
}

/// [`planned`], compiled for the vectors that the machine has.
struct Planned<'a> {
    path: &'a DensePath,
    steps: [&'a [f64]; 2],
    share: f64,
}

impl WithSimd for Planned<'_> {
    type Output = Result<Result<PlotSamples, f64>, TryReserveError>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        planned(simd, self)
    }
}

/// The samples, or by what part of them a run of so many steps is drawn.
#[inline(always)]
fn planned<S: Simd>(
    simd: S,
    Planned { path, steps, share }: Planned<'_>,
) -> Result<Result<PlotSamples, f64>, TryReserveError> {
    /// Steps whose outlines are made one after the other.
    const BLOCK: usize = 8;
    let scale = Scale::of(path);
    let (mut merged, mut apexes) = (Merged::new(steps, path.segments.len()), Vec::new());
    merged.make_room(0, 0)?;
    let (mut wanted, mut drawn, mut before) = (0.0, 0.0, None);
    let (mut times, mut x) = ([0.0; MOST], [0.0; MOST]);
    let (mut of_block, mut of_apexes) = (0, 0);
    let mut block = Vec::<(Curve, Outline)>::new();
    block.try_reserve_exact(BLOCK)?;
    for (number, (segment, end)) in segments(path).enumerate() {
        if number % BLOCK == 0 {
            // one loop for each of both: a processor works on several steps at once
            let those = &path.segments[number..path.segments.len().min(number + BLOCK)];
            block.clear();
            for curve in those.iter().filter_map(|segment| path.curve(segment)) {
                block.push((curve, Outline::default()));
            }
            apexes.clear();
            apexes.try_reserve(TERMS * BLOCK)?;
            for (curve, outline) in &mut block {
                *outline = Outline::of(simd, curve, &mut apexes);
            }
            (of_block, of_apexes) = (0, 0);
        }
        merged.pass(segment.start);
        let first = merged.all.t.len();
        if let Kind::Tail(tail) = segment.kind {
            let row = merged.all.rows.len();
            draw_tail(&path.tails[tail], end, scale, &mut merged.all.rows)?;
            merged.make_room(merged.all.rows.len() - row, number)?;
            let PlotSamples { t, x, rows, .. } = &mut merged.all;
            t.extend(rows[row..].iter().map(|row| row[0]));
            x.extend(rows[row..].iter().map(|row| row[1]));
            merged.close(Source::Rows(row), first)?;
        }
        let Some((curve, outline)) = block.get(of_block).filter(|_| segment.kind.is_flight())
        else {
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
        if let Some(contact) = if lands { before_contact(curve, end) } else { None } {
            if count == 0 || times[count - 1] < contact {
                times[count] = contact;
                count += 1;
            }
        }
        for (t, x) in
            times.chunks_exact(LANES).zip(x.chunks_exact_mut(LANES)).take(count.div_ceil(LANES))
        {
            let mut at = [0.0; LANES];
            at.copy_from_slice(t);
            x.copy_from_slice(&curve.positions(&at));
        }
        merged.make_room(count, number)?;
        merged.all.t.extend_from_slice(&times[..count]);
        merged.all.x.extend_from_slice(&x[..count]);
        merged.close(Source::Flight(number), first)?;
        before = Some(*outline).filter(|_| !lands);
    }
    if wanted > BUDGET && share == 1.0 {
        return Ok(Err(BUDGET / wanted));
    }
    merged.finish().map(Ok)
}

/// The segments and where they end.
fn segments(path: &DensePath) -> impl Iterator<Item = (Segment, f64)> + '_ {
    let last = path.end.map_or(f64::NEG_INFINITY, |(t, _)| t);
    let starts = path.segments.iter().skip(1).map(|segment| segment.start);
    path.segments.iter().copied().zip(starts.chain(Some(last)))
}

/// Samples at the ends of steps and those between them, in the order of time: where there is one
/// already it stays.
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

    /// Makes room for so many more samples of a segment besides those of the steps.
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
                self.all.note(Source::Steps(self.next), 1);
            }
            self.next += 1;
        }
    }

    /// Takes the samples from this one on as those of a source.
    #[inline(always)]
    fn close(&mut self, source: Source, first: usize) -> Result<(), TryReserveError> {
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
    fn finish(mut self) -> Result<PlotSamples, TryReserveError> {
        self.make_room(0, self.segments)?;
        self.pass(f64::INFINITY);
        Ok(self.all)
    }
}

/// Notes the times that divide a span into so many parts, and says how many there are.
#[inline(always)]
fn divide((start, end): (f64, f64), parts: f64, times: &mut [f64; MOST]) -> usize {
    let length = end - start;
    // false for NaN, too
    let told_apart = length > SAME * parts * ulp(end);
    let (count, part) = if told_apart { (parts as usize - 1, length / parts) } else { (0, 0.0) };
    for (k, times) in times.chunks_exact_mut(LANES).enumerate().take(count.div_ceil(LANES)) {
        for (l, t) in times.iter_mut().enumerate() {
            *t = start + (LANES * k + l + 1) as f64 * part;
        }
    }
    count
}

/// Notes a time within a span unless there is one already, and says how many there are.
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

/// What a drawing needs to know of a flight.
#[derive(Clone, Copy, Debug, Default)]
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
    /// That of a curve, where the velocity changes its sign downwards being noted.
    #[inline(always)]
    fn of<S: Simd>(simd: S, curve: &Curve, apexes: &mut Vec<f64>) -> Self {
        let known = apexes.len();
        let outline = match &curve.form {
            Form::Both(both) => of_polynomials(curve, both, apexes),
            Form::Powers(a, ..) => of_powers(simd, curve, a, apexes),
        };
        Self { apexes: apexes.len() - known, ..outline }
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

#[inline(always)]
fn of_polynomials(curve: &Curve, [x, xdot]: &[Bernstein; 2], apexes: &mut Vec<f64>) -> Outline {
    /// What may be rounding, relative to the largest coefficient.
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

/// What is asked of a series in the middle of a step and at its end: the series and its first three
/// derivatives.
const ORDERS: usize = 4;
const ASKED: usize = 2 * ORDERS;
/// Terms of which they are made: beyond there is a millionth of a third derivative.
const ENOUGH: usize = 16;

/// What each power adds to them.
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
fn of_powers<S: Simd>(simd: S, curve: &Curve, a: &Series, apexes: &mut Vec<f64>) -> Outline {
    const MORE: f64 = 1.1;
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
            let theta = apex(a, of_parabola(v0, b0, v2));
            apexes.push(curve.start + theta * curve.h);
            x[1] = larger(value(a, theta), x[1]);
        } else if !(once && v0 < 0.0 && v2 > 0.0 || is_one_sign([b0, b1, b2]) && v0 * v2 > 0.0) {
            let known = apexes.len();
            all_apexes(curve, apexes);
            for &t in &apexes[known..] {
                x[1] = larger(curve.at(t).x, x[1]);
            }
        }
    }
    let xdot = [least / curve.h, most / curve.h];
    Outline { x, xdot, bends: [bend, jerk / curve.h], apexes: 0 }
}

/// Where the velocity of a series changes its sign, which falls all over the step, from near there.
#[inline(always)]
fn apex(a: &Series, mut theta: f64) -> f64 {
    /// A step by Halley's formula that is so short is the last: the next would be its cube.
    const LAST: f64 = 1e-4;
    const MOST_STEPS: usize = 60;
    let xdot = derivative(a);
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..MOST_STEPS {
        let [value, first, second] = slopes(&xdot, theta);
        if value > 0.0 {
            low = theta;
        } else {
            high = theta;
        }
        let step = 2.0 * value * first / (value * second - 2.0 * first * first);
        let next = theta + step;
        if next > low && next < high {
            theta = next;
            if step.abs() < LAST {
                break;
            }
        } else {
            let middle = 0.5 * (low + high);
            if !(middle > low && middle < high) {
                break;
            }
            theta = middle;
        }
    }
    theta
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
fn all_apexes(curve: &Curve, apexes: &mut Vec<f64>) {
    let xdot = curve.velocity();
    // a step that falls has its first turn at the bottom
    let skipped = usize::from(xdot.starts_negative());
    let turns = xdot.crossings(0.0).into_iter().skip(skipped).step_by(2);
    apexes.extend(turns.map(|theta| curve.start + theta * curve.h));
}

/// The last moment before an impact at the end of a step that can be told from it: above the wall.
#[inline(always)]
fn before_contact(curve: &Curve, end: f64) -> Option<f64> {
    let moments = moments(end);
    let mut first = 0;
    while first < MOMENTS {
        let mut t = [end; LANES];
        let count = LANES.min(MOMENTS - first);
        t[..count].copy_from_slice(&moments[first..first + count]);
        let x = curve.positions(&t);
        for k in 0..count {
            if x[k] > 0.0 {
                return Some(t[k]);
            }
        }
        first += LANES;
    }
    None
}

/// Moments before an impact that are looked at.
#[inline(always)]
fn moments(t: f64) -> [f64; MOMENTS] {
    let ulp = t - t.next_down();
    let mut moments = [t; MOMENTS];
    for (k, moment) in moments.iter_mut().enumerate() {
        *moment -= f64::from(1 << k) * ulp;
    }
    moments
}

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

/// The range of both.
#[inline(always)]
fn joined(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [smaller(a[0], b[0]), larger(a[1], b[1])]
}

/// The height of what is drawn, at least `low`.
#[inline(always)]
fn height([least, most]: [f64; 2], low: f64) -> f64 {
    larger(larger(most - least, low), f64::MIN_POSITIVE)
}

/// The unit in the last place.
fn ulp(t: f64) -> f64 {
    t.abs().next_up() - t.abs()
}

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

pub(super) fn row(t: f64, PathPoint { x, xdot, sigma }: PathPoint) -> Row {
    [t, x, xdot, sigma]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::columns::Quantity;
    use crate::zeno::bounce::Bounce;
    use crate::zeno::chain::Chain;
    use crate::{
        simulate_switched_rk, Flights, LinearForce, Output, Physical, Restitution, Silent,
        SwitchedRk,
    };
    use std::convert::Infallible;

    /// `x'' = -2`, `e = 1/2`: arcs of the heights 1/16, 1/64, ..., from 1 s on.
    #[test]
    fn a_tail_is_drawn_by_flat_lines_down_to_the_finest_arcs_and_up_to_its_end() {
        let mut chain = Chain::<f64>::new((), 0.5, 0, 4);
        for (t, u) in [(0.0, 1.0), (1.0, 0.5)] {
            assert!(chain.note(Bounce { t, u, g: 2.0 }, &[], &[]).is_ok());
        }
        let tail = chain.tail(2.0, 1.0);
        let drawn = |end: f64, largest: f64| {
            let mut rows = Vec::new();
            draw_tail(&tail, end, Scale { x: largest, xdot: 1.0 }, &mut rows).unwrap();
            assert!(rows.windows(2).all(|pair| pair[0][0] < pair[1][0] && pair[1][0] < end));
            let of_tail = |it: &Row| tail.at(it[0]).x == it[1] && tail.at(it[0]).xdot == it[2];
            assert!(rows.iter().all(of_tail));
            let inside = |it: &&Row| it[1] > 1e-9;
            rows.iter().filter(inside).map(|it| it[0]).collect::<Vec<f64>>()
        };
        // lines between equal parts of a second derivative of 2 are off by a quarter of their square
        for (highest, parts) in [(20.0, vec![4]), (15.0, vec![6, 4]), (1.0, vec![16, 8, 4])] {
            let (mut exact, mut start, mut length) = (Vec::new(), 1.0, 0.5);
            for n in parts {
                let part = length / f64::from(n);
                exact.extend((1..n).map(|k| start + f64::from(k) * part));
                let height = 0.25 * length * length;
                let flat = FLATNESS * height.max(LOW * highest);
                assert!(0.25 * part * part <= flat, "{highest} {n}");
                // with two parts less they are not
                let fewer = length / (f64::from(n) - 2.0);
                assert!(0.25 * fewer * fewer > flat, "{highest} {n}");
                (start, length) = (start + length, 0.5 * length);
            }
            let found = drawn(2.0, highest);
            assert_eq!(found.len(), exact.len(), "{highest} {found:?}");
            for (found, exact) in found.iter().zip(&exact) {
                assert!((found - exact).abs() < 1e-15, "{found} {exact}");
            }
        }
        assert_eq!(drawn(1.3, 1.0), drawn(2.0, 1.0)[..9]);
    }

    const SPRING: LinearForce = LinearForce {
        stiffness: 1.0,
        damping: 0.05,
        gravity: 0.2,
        amplitude: 0.6,
        omega: 0.9,
        phase: 0.0,
    };
    const TABLE: LinearForce = LinearForce {
        stiffness: 0.0,
        damping: 0.0,
        gravity: 9.81,
        amplitude: 20.0,
        omega: 6.0,
        phase: 1.0,
    };
    const PULL: LinearForce = LinearForce { gravity: 3.0, amplitude: 0.0, omega: 0.0, ..TABLE };
    /// Beats of two rates, and a spring that pushes away.
    const BEATS: LinearForce = LinearForce { stiffness: 4.0, damping: 0.0, omega: 1.9, ..SPRING };
    const AWAY: LinearForce = LinearForce { stiffness: -0.2, gravity: 1.0, omega: 2.0, ..SPRING };

    /// Runs of both kinds of flights: the samples, the path, times and positions of the steps.
    fn runs() -> impl Iterator<Item = (PlotSamples, DensePath, [Vec<f64>; 2])> {
        let kinds = [Flights::Series, Flights::RungeKutta];
        let forces = [SPRING, TABLE, PULL, BEATS, AWAY];
        let all = forces.into_iter().flat_map(move |force| kinds.map(|kind| (force, kind)));
        all.flat_map(|it| [0.0, 0.6, 1.0].map(|e| (it, e))).map(|((mut force, flights), e)| {
            let settings = SwitchedRk { flights, ..SwitchedRk::default() };
            let (start, e) = (Physical { x: 1.0, xdot: 0.7 }, Restitution::from_e(e).unwrap());
            let output = Output::<Infallible> { dense: true, ..Output::default() };
            let span = (0.0, 30.0);
            let run =
                simulate_switched_rk(settings, e, &mut force, span, start, output, &mut Silent)
                    .unwrap();
            let path = run.path.unwrap();
            let steps = [Quantity::T, Quantity::X].map(|it| run.trajectory.columns.of(it).to_vec());
            (path.plot_samples([&steps[0], &steps[1]]).unwrap(), path, steps)
        })
    }

    /// The arcs between impacts and turns upwards, by a fine grid: where each starts and ends, its
    /// height and the range of its velocity.
    fn arcs(path: &DensePath, curves: &[(Curve, f64)]) -> Vec<(f64, f64, [f64; 2])> {
        let (mut arcs, mut open) = (Vec::new(), None::<(f64, [f64; 4])>);
        for (curve, end) in curves {
            let grid = (0..=200).map(|k| curve.start + f64::from(k) / 200.0 * (end - curve.start));
            for t in grid {
                let at = curve.at(t);
                let all = [at.x, at.x, at.xdot, at.xdot];
                open = Some(open.map_or((t, all), |(from, [a, b, c, d])| {
                    (from, [a.min(at.x), b.max(at.x), c.min(at.xdot), d.max(at.xdot)])
                }));
            }
            if curve.lands() || path.end.is_some_and(|(t, _)| t == *end) {
                if let Some((from, [a, b, c, d])) = open.take() {
                    arcs.push((from, *end, [b - a, d - c]));
                }
            }
        }
        arcs
    }

    fn curves(path: &DensePath) -> Vec<(Curve, f64)> {
        segments(path).filter_map(|(it, end)| Some((path.curve(&it)?, end))).collect()
    }

    #[test]
    fn lines_through_the_samples_are_as_near_as_promised() {
        let (mut seen, mut worst) = (0, 0.0_f64);
        for (samples, path, _) in runs() {
            let curves = curves(&path);
            let arcs = arcs(&path, &curves);
            let high = arcs.iter().map(|arc| arc.2[0]).fold(0.0, f64::max);
            for pair in samples.t.windows(2) {
                let Some((curve, end)) =
                    curves.iter().find(|(it, end)| it.start <= pair[0] && pair[0] < *end)
                else {
                    continue;
                };
                let arc = arcs.iter().find(|arc| arc.0 <= pair[0] && pair[1] <= arc.1).unwrap();
                assert!(pair[0] < pair[1] && pair[1] <= *end);
                for k in 1..8 {
                    let part = f64::from(k) / 8.0;
                    let t = pair[0] + part * (pair[1] - pair[0]);
                    let line =
                        |of: &dyn Fn(f64) -> f64| (1.0 - part) * of(pair[0]) + part * of(pair[1]);
                    let off = (line(&|t| curve.at(t).x) - curve.at(t).x).abs();
                    // more than a parabola is hardly ever between two of them
                    let most = FLATNESS * arc.2[0].max(LOW * high);
                    worst = worst.max(off / most);
                    seen += 1;
                }
            }
        }
        assert!(seen > 50_000 && (0.8..1.05).contains(&worst), "{seen} {worst}");
    }

    #[test]
    fn every_apex_is_a_sample_and_so_is_the_last_moment_before_an_impact() {
        let (mut apexes, mut impacts) = (0, 0);
        for (samples, path, _) in runs() {
            for (curve, end) in curves(&path) {
                let mut all = Vec::new();
                // by subdivision of the whole velocity
                all_apexes(&curve, &mut all);
                for apex in all.into_iter().filter(|&t| t > curve.start + 1e-9 && t < end - 1e-9) {
                    let near = |t: &&f64| (**t - apex).abs() < 1e-10 * (1.0 + apex);
                    assert!(samples.t.iter().any(|t| near(&t)), "{curve:?} {apex}");
                    apexes += 1;
                }
                if curve.lands() {
                    let before = samples.t.partition_point(|&t| t < end);
                    let last = samples.t[before - 1];
                    let ulps = (end - last) / (end - end.next_down());
                    assert!(ulps <= 512.0 && curve.at(last).x > 0.0, "{end} {ulps}");
                    impacts += 1;
                }
            }
        }
        assert!(apexes > 200 && impacts > 200, "{apexes} {impacts}");
    }

    #[test]
    fn positions_are_those_of_the_path_and_steps_stay() {
        for (mut samples, path, [t, x]) in runs() {
            assert_eq!(samples.len(), samples.x.len());
            assert!(samples.len() > t.len() && !samples.is_empty());
            assert_eq!(samples.runs.iter().map(|run| run.count).sum::<usize>(), samples.len());
            for (t, x) in samples.t.iter().zip(&samples.x) {
                assert_eq!(path.at(*t).unwrap().x.to_bits(), x.to_bits(), "{t}");
            }
            for (t, x) in t.iter().zip(&x) {
                let at = samples.t.iter().position(|it| it == t).unwrap();
                assert_eq!(samples.x[at], *x);
            }
            let (all, steps) = (
                samples.x.clone(),
                Quantity::ALL.map(|it| match it {
                    Quantity::T => &t[..],
                    _ => &x[..],
                }),
            );
            let wall = Restitution::from_e(0.5).unwrap();
            assert_eq!(samples.column(Quantity::X, &path, steps, wall), Some(all.clone()));
            assert_eq!(samples.take_positions(), all);
            assert_eq!(samples.column(Quantity::X, &path, steps, wall), Some(all));
        }
    }

    /// As a run would have them that was told to sample there, too.
    #[test]
    fn steps_that_end_within_segments_are_sorted_in() {
        let (samples, path, [t, x]) = runs().next().unwrap();
        let between = |pair: &[f64]| pair[0] + 0.37 * (pair[1] - pair[0]);
        let mut more: Vec<f64> =
            samples.t.windows(2).map(between).chain(t.iter().copied()).collect();
        // one at a sample, and one twice
        more.extend([samples.t[3], t[1]]);
        more.sort_by(f64::total_cmp);
        let at: Vec<f64> = more.iter().map(|&t| path.at(t).unwrap().x).collect();
        let sorted = path.plot_samples([&more, &at]).unwrap();
        assert!(sorted.t.windows(2).all(|pair| pair[0] < pair[1]));
        let mut expected: Vec<f64> = more.iter().chain(&samples.t).copied().collect();
        expected.sort_by(f64::total_cmp);
        expected.dedup();
        assert_eq!(sorted.t, expected);
        assert!(x.iter().all(|x| sorted.x.contains(x)));
        assert!(sorted.t.iter().zip(&sorted.x).all(|(&t, &x)| path.at(t).unwrap().x == x));
    }

    #[test]
    fn a_run_of_many_steps_is_drawn_by_fewer_samples_of_each() {
        let mut force = SPRING;
        let e = Restitution::from_e(0.7).unwrap();
        let output = Output::<Infallible> { dense: true, ..Output::default() };
        let run = simulate_switched_rk(
            SwitchedRk { max_steps: usize::MAX, ..SwitchedRk::default() },
            e,
            &mut force,
            (0.0, 60_000.0),
            Physical { x: 1.0, xdot: 0.7 },
            output,
            &mut Silent,
        )
        .unwrap();
        let steps = [Quantity::T, Quantity::X].map(|it| run.trajectory.columns.of(it));
        let path = run.path.unwrap();
        let samples = path.plot_samples(steps).unwrap();
        let added = samples.len() - steps[0].len();
        // apexes and moments before impacts are beyond the budget
        let impacts = run.trajectory.events.impacts.len();
        assert!(steps[0].len() > 40_000 && impacts > 10_000);
        assert!((added as f64) < 2.0 * BUDGET + 3.0 * impacts as f64, "{added}");
        assert!((added as f64) > 0.3 * BUDGET, "{added}");
        // the end of the run as well as its beginning
        let first = samples.t.partition_point(|&t| t < 30_000.0) as f64;
        assert!((first / samples.len() as f64 - 0.5).abs() < 0.03, "{first}");
        assert!(samples.t.windows(2).all(|pair| pair[0] < pair[1]));
    }

    #[test]
    fn a_parabola_is_met_where_it_is_zero_and_else_in_the_middle() {
        // 1 - theta - theta^2, and one that bends the other way
        assert!((of_parabola(1.0, -1.0, -1.0) - 0.5 * (5.0_f64.sqrt() - 1.0)).abs() < 1e-15);
        // (1 - 2 theta)(1 - theta/4)
        assert!((of_parabola(1.0, -2.25, -0.75) - 0.5).abs() < 1e-15);
        assert_eq!(of_parabola(1.0, 1.0, 4.0), 0.5);
        assert_eq!(joined([0.0, 1.0], [-1.0, 0.5]), [-1.0, 1.0]);
        assert_eq!(Source::Rows(3).after(2), Source::Rows(5));
        assert_eq!(Source::Steps(3).after(2), Source::Steps(5));
    }

    /// `3 cos(1.75 theta + phase)`, over a step of half a second.
    #[test]
    fn bounds_are_little_more_than_what_they_bound() {
        const RATE: f64 = 1.75;
        for phase in (0..20).map(|k| 0.3 * f64::from(k)) {
            let (mut a, mut term) = ([0.0; TERMS], 3.0);
            for (n, a) in a.iter_mut().enumerate() {
                *a = term * (phase + n as f64 * std::f64::consts::FRAC_PI_2).cos();
                term *= RATE / (n as f64 + 1.0);
            }
            let curve = Curve::powers((1.0, 0.5), 1.0, a, a[1] / 0.5, false);
            let mut apexes = Vec::new();
            let Form::Powers(a, ..) = &curve.form else { panic!("no powers") };
            let outline = of_powers(pulp::Scalar::new(), &curve, a, &mut apexes);
            let grid = || (0..=1000).map(|k| phase + RATE * f64::from(k) / 1000.0);
            let largest = |of: fn(f64) -> f64| grid().map(|it| of(it).abs()).fold(0.0, f64::max);
            let bend = 3.0 * RATE * RATE * largest(f64::cos);
            let jerk = 3.0 * RATE * RATE * RATE * largest(f64::sin) / 0.5;
            for (bound, true_one) in outline.bends.into_iter().zip([bend, jerk]) {
                assert!(
                    (0.995..1.1001).contains(&(bound / true_one)),
                    "{phase} {bound} {true_one}"
                );
            }
            assert!(apexes.iter().all(|apex| {
                let turns = (phase + RATE * (apex - 1.0) / 0.5) / std::f64::consts::TAU;
                (turns - turns.round()).abs() < 1e-10
            }));
        }
    }
}
