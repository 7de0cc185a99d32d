//! Samples between the ends of steps, so that lines through all of them draw the motion.
//!
//! A step of high order spans a whole flight; a line between its ends shows none of it. The
//! polynomials of the dense output say how far they are from straight: over `n` equal parts of a
//! step a line is off by at most `max |p''|/(8 n^2)`. Bernstein coefficients bound `|p''|` of an
//! embedded pair; that of a power series follows from its values at three points, since steps are
//! short for the fastest wave that it consists of. Times and positions are found in one go, all
//! other quantities when they are asked for.

mod apexes;
mod contact;
mod merged;
mod outline;
mod scale;
mod tail;
#[cfg(test)]
mod tests;
mod times;

use std::collections::TryReserveError;

use pulp::{Simd, WithSimd};

use super::flight::series::TERMS;
use super::path::{Curve, DensePath, Kind};
use crate::record::columns::QUANTITIES;
use crate::PathPoint;

use apexes::Guesses;
use merged::Merged;
use outline::Outline;
use scale::{joined, Scale};
use tail::draw_tail;
use times::{divide, insert};

/// A line may be off by this part of the height of what it draws: of a step, and of those before
/// and after it in the same flight.
const FLATNESS: f64 = 1.0 / 200.0;
/// What is lower than this part of the highest is drawn as if it were so high.
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
    let scale = Scale::of(path);
    let (mut merged, mut apexes) = (Merged::new(steps, path.segments.len()), Vec::new());
    let mut guesses = Guesses::NONE;
    merged.make_room(0, 0)?;
    let (mut wanted, mut drawn, mut before) = (0.0, 0.0, None);
    let mut times = [0.0; MOST];
    let (mut of_block, mut of_apexes) = (0, 0);
    let (mut block, mut curves) = ([const { (Curve::NONE, Outline::NONE) }; BLOCK], 0);
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
        if let Kind::Tail(tail) = segment.kind {
            let row = merged.all.rows.len();
            draw_tail(&path.tails[tail], end, scale, &mut merged.all.rows)?;
            merged.make_room(merged.all.rows.len() - row, number)?;
            let PlotSamples { t, x, rows, .. } = &mut merged.all;
            t.extend(rows[row..].iter().map(|row| row[0]));
            x.extend(rows[row..].iter().map(|row| row[1]));
            merged.close(Source::Rows(row), first)?;
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
        merged.close(Source::Flight(number), first)?;
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
