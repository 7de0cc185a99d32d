//! Dense output of mechanical systems, its stored form, and the segments of motion that it consists of.
//!
//! The motion of a system as a function of time.

use std::cell::OnceCell;
use std::collections::TryReserveError;

use crate::kinetics::mode::{Stages, State};
use crate::motion::tail::{Correction, SkippedArcs, StoppedSlip};
use crate::numeric::bernstein::{evaluate, Bernstein, Polynomial};
use crate::numeric::power_series::{Series, TERMS};
use crate::record::columns::Reserve;
use crate::record::gap_set::{ContactMode, GapSet};
use crate::record::recorder::MotionPoint;
use crate::record::stored::{as_count, MotionError, Reader, StoredKind, Writer};
use crate::system::dynamics::{Layout, MOST};
use crate::zeno::tail::Tail;
use crate::Impact;

/// Largest degree of the polynomials of a segment.
pub(crate) const MOST_SEGMENT_DEGREE: usize = TERMS - 1;

/// A part of the motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Segment {
    pub(crate) start: f64,
    pub(crate) mode: ContactMode,
    pub(crate) kind: Kind,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Kind {
    /// Polynomials of this degree over a time `h`, from this number on.
    Motion { first: usize, degree: usize, h: f64 },
    /// The skipped flights of this number.
    Skipped(usize),
}

/// The motion as a function of time, through skipped flights and contact.
#[derive(Clone, Debug, PartialEq)]
pub struct MechanicalPath {
    pub(crate) layout: Layout,
    pub(crate) segments: Vec<Segment>,
    pub(crate) coefficients: Vec<f64>,
    pub(crate) skipped: Vec<SkippedArcs>,
    pub(crate) end: Option<(f64, MotionPoint)>,
}

/// Polynomials of coordinates and gaps over a time, such as the last step up to an event.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Curve {
    pub(crate) start: f64,
    pub(crate) h: f64,
    pub(crate) rows: Vec<[Bernstein; 2]>,
    /// Instead of them the coefficients of power series of the positions in `(t - start)/h`,
    powers: Vec<f64>,
    /// the state at the start, if that is known better,
    first: Vec<[f64; 2]>,
    /// and the polynomials of these: a sample has the bits of the path.
    of_powers: OnceCell<Vec<[Polynomial<TERMS>; 2]>>,
}

impl Curve {
    /// The polynomials of the last step, which is complete, up to `end` after `length`.
    pub(crate) fn new(stages: &Stages, end: &State, length: f64) -> Self {
        let part = length / stages.h;
        let whole = length == stages.h;
        let row = |c: usize| {
            let [x, v] = stages.polynomials_of(c);
            if whole {
                return [x, v];
            }
            let cut = |p: Bernstein, first: f64, last: f64| p.split(part).0.with_ends(first, last);
            [cut(x, stages.from.x[c], end.x[c]), cut(v, stages.from.xdot[c], end.xdot[c])]
        };
        let rows = (0..stages.from.x.len()).map(row).collect();
        Self::of_rows(stages.from.t, length, rows)
    }

    pub(crate) fn of_rows(start: f64, h: f64, rows: Vec<[Bernstein; 2]>) -> Self {
        Self { start, h, rows, powers: Vec::new(), first: Vec::new(), of_powers: OnceCell::new() }
    }

    /// Power series of all positions, one after the other.
    pub(crate) fn of_powers(start: f64, h: f64, powers: Vec<f64>) -> Self {
        Self { start, h, rows: Vec::new(), powers, first: Vec::new(), of_powers: OnceCell::new() }
    }

    /// Begins at a state to the last bit.
    pub(crate) fn begin_at(&mut self, MotionPoint { x, v, .. }: &MotionPoint) {
        if !self.powers.is_empty() {
            self.first = x.iter().zip(v).map(|(x, v)| [*x, *v]).collect();
        }
    }

    /// The polynomials of the power series, of the positions and of the velocities.
    fn series(&self) -> &[[Polynomial<TERMS>; 2]] {
        let polynomials = |(c, powers): (usize, &[f64])| {
            let [mut x, mut v]: [Series; 2] = [[0.0; TERMS]; 2];
            x.copy_from_slice(powers);
            for (k, v) in v.iter_mut().enumerate().take(TERMS - 1) {
                *v = (k + 1) as f64 * x[k + 1] / self.h;
            }
            let [x, v] = [x, v].map(Polynomial::from_powers);
            match self.first.get(c) {
                Some(&[of_x, of_v]) => [x.starting_at(of_x), v.starting_at(of_v)],
                None => [x, v],
            }
        };
        let rows = || self.powers.chunks_exact(TERMS).enumerate().map(polynomials).collect();
        self.of_powers.get_or_init(rows)
    }

    pub(crate) fn at(&self, t: f64, x: &mut [f64], v: &mut [f64]) {
        let theta = ((t - self.start) / self.h).clamp(0.0, 1.0);
        for (c, [of_x, of_v]) in self.rows.iter().enumerate() {
            (x[c], v[c]) = (of_x.at(theta), of_v.at(theta));
        }
        for (c, [of_x, of_v]) in self.series().iter().enumerate() {
            (x[c], v[c]) = (of_x.at(theta), of_v.at(theta));
        }
    }
}

impl MechanicalPath {
    pub(crate) fn new(layout: Layout) -> Self {
        let (segments, coefficients, skipped) = (Vec::new(), Vec::new(), Vec::new());
        Self { layout, segments, coefficients, skipped, end: None }
    }

    /// Makes room for one more segment of any kind.
    pub(crate) fn make_room(&mut self, reserve: &mut Reserve) -> Result<(), TryReserveError> {
        let size = self.layout.size();
        reserve.room(&mut self.segments, 1, 0)?;
        reserve.room(&mut self.coefficients, 2 * size * (MOST_SEGMENT_DEGREE + 1), 0)?;
        reserve.room(&mut self.skipped, 1, 0)
    }

    pub(crate) fn push_motion(&mut self, curve: &Curve, mode: ContactMode) {
        let first = self.coefficients.len();
        let mut degree = 0;
        for p in curve.rows.iter().flatten() {
            degree = p.coefficients().len() - 1;
            self.coefficients.extend_from_slice(p.coefficients());
        }
        for p in curve.series().iter().flatten() {
            degree = TERMS - 1;
            self.coefficients.extend_from_slice(p.coefficients());
        }
        let kind = Kind::Motion { first, degree, h: curve.h };
        self.push(Segment { start: curve.start, mode, kind });
    }

    pub(crate) fn push_skipped(&mut self, arcs: &SkippedArcs, mode: ContactMode) {
        let kind = Kind::Skipped(self.skipped.len());
        self.skipped.push(arcs.clone());
        self.push(Segment { start: arcs.start, mode, kind });
    }

    fn push(&mut self, segment: Segment) {
        // a segment without a length is over before it can be asked for
        if self.segments.last().is_some_and(|last| last.start == segment.start) {
            self.segments.pop();
        }
        self.segments.push(segment);
    }

    /// The impacts of one gap that each jump to a Zeno point skipped, down to a speed after them;
    /// at most `at_most` of each, with the time of the Zeno point (s).
    pub fn skipped_impacts(
        &self,
        speed: f64,
        at_most: usize,
    ) -> impl Iterator<Item = (Impact, f64)> + '_ {
        self.skipped.iter().flat_map(move |it| {
            let impacts = it.arcs.iter().flat_map(move |arcs| arcs.impacts_down_to(speed, at_most));
            impacts.map(|impact| (impact, it.end))
        })
    }

    /// How many coordinates and gaps there are.
    #[must_use]
    pub fn layout(&self) -> Layout {
        self.layout
    }

    /// The times between which the motion is known, unless the run made no step.
    #[must_use]
    pub fn span(&self) -> Option<(f64, f64)> {
        let end = self.end.as_ref()?.0;
        Some((self.segments.first().map_or(end, |first| first.start), end))
    }

    /// The state at `t`; at an impact, the state after it; `None` outside of the span.
    #[must_use]
    pub fn at(&self, t: f64) -> Option<MotionPoint> {
        let (end, last) = self.end.as_ref()?;
        if t == *end {
            return Some(last.clone());
        }
        let after = self.segments.partition_point(|segment| segment.start <= t);
        if after == 0 || t.is_nan() || t > *end {
            return None;
        }
        let Segment { start, mode, kind } = self.segments[after - 1];
        let (Layout { n, m, .. }, size) = (self.layout, self.layout.size());
        let mut point = MotionPoint { x: vec![0.0; size], v: vec![0.0; size], mode };
        match kind {
            Kind::Skipped(number) => self.skipped[number].at(t, &mut point.x, &mut point.v),
            Kind::Motion { first, degree, h } => {
                let theta = ((t - start) / h).clamp(0.0, 1.0);
                let rows = self.coefficients[first..].chunks_exact(degree + 1);
                for (k, row) in rows.take(2 * size).enumerate() {
                    let of = if k % 2 == 0 { &mut point.x } else { &mut point.v };
                    of[k / 2] = evaluate(row, theta);
                }
            }
        }
        for gap in (0..m).filter(|&gap| !mode.is_deep(gap)) {
            point.x[n + gap] = point.x[n + gap].max(0.0);
        }
        Some(point)
    }
}

// The motion of a mechanical system as plain numbers, after the header of
// [`crate::record::stored`].
//
// ```text
// path     [ n, m, p, segments, coefficients, skipped flights, sets,  the segments,  the coefficients,
//            the skipped flights,  t, closed, x, v of the end, if there is one ]
// segment  [ start, mode, kind (0 motion, 1 skipped), first, degree, h ]
// flights     [ start, end, whether a tail follows,  the tail,  8 numbers of each component,
//            how many slips that impacts stop, 2 numbers of each component and 10 of each of them,
//            how many corrections, the component and 25 numbers of each ]
// mode     [ closed, slipping up, slipping down, sticking (numbers of 32 gaps each, two at least),
//            with 6 sets the compliant gaps that are pressed, and those that are unloaded ]
// ```
//
// Before format 7 there were 4 sets. Before format 6 flights had neither slips nor corrections. Before format 5 there was no friction, nor `p`, before format 4 tails had no accelerations.

fn numbers_of(mode: ContactMode, rows: usize, sets: usize) -> impl Iterator<Item = f64> {
    let ContactMode { closed, slip_plus, slip_minus, stick, pressed, unloaded } = mode;
    let all = [closed, slip_plus, slip_minus, stick, pressed, unloaded];
    all.into_iter().take(sets).flat_map(move |set| set.halves(rows))
}

fn read_mode(from: &mut Reader<'_>, rows: usize, sets: usize) -> Option<ContactMode> {
    let half = |&value: &f64| as_count(value).and_then(|bits| u32::try_from(bits).ok());
    let mut set = || {
        let halves = from.take(GapSet::n_halves(rows))?;
        let halves: Option<Vec<u32>> = halves.iter().map(half).collect();
        halves.map(|halves| GapSet::of_halves(&halves))
    };
    let closed = set()?;
    if sets == 1 {
        return Some(closed.into());
    }
    let (slip_plus, slip_minus, stick) = (set()?, set()?, set()?);
    let (pressed, unloaded) = match sets {
        6 => (set()?, set()?),
        _ => (GapSet::EMPTY, GapSet::EMPTY),
    };
    Some(ContactMode { closed, slip_plus, slip_minus, stick, pressed, unloaded })
}

impl MechanicalPath {
    /// All that it consists of.
    #[must_use]
    pub fn to_numbers(&self) -> Option<Vec<f64>> {
        let mut out = Writer::new(StoredKind::Mechanism);
        let Layout { n, m, p, .. } = self.layout;
        for count in [n, m, p, self.segments.len(), self.coefficients.len(), self.skipped.len()] {
            out.count(count);
        }
        let is_deep = |mode: ContactMode| !mode.pressed.with(mode.unloaded).is_empty();
        let end = self.end.iter().map(|it| it.1.mode);
        let soft = self.segments.iter().map(|it| it.mode).chain(end).any(is_deep);
        let sets = if soft { 6 } else { 4 };
        out.count(sets);
        for Segment { start, mode, kind } in &self.segments {
            out.number(*start);
            out.numbers(&numbers_of(*mode, m + p, sets).collect::<Vec<_>>());
            out.numbers(&match *kind {
                Kind::Motion { first, degree, h } => [0.0, first as f64, degree as f64, h],
                Kind::Skipped(number) => [1.0, number as f64, 0.0, 0.0],
            });
        }
        out.numbers(&self.coefficients);
        for SkippedArcs { start, end, arcs, rows, slips, corrections } in &self.skipped {
            out.numbers(&[*start, *end]);
            out.flag(arcs.is_some());
            arcs.iter().for_each(|tail| out.numbers(&tail.to_numbers()));
            out.numbers(rows.iter().flatten());
            out.count(slips.len());
            for StoppedSlip { ways, accelerations } in slips {
                out.numbers(ways.iter().flatten());
                out.numbers(accelerations.iter().flatten());
            }
            out.count(corrections.len());
            for Correction { component, accelerations, jumps, .. } in corrections {
                out.count(*component);
                out.numbers(accelerations.iter().flatten().chain(jumps));
            }
        }
        if let Some((t, point)) = &self.end {
            out.number(*t);
            out.numbers(&numbers_of(point.mode, m + p, sets).collect::<Vec<_>>());
            out.numbers(point.x.iter().chain(&point.v));
        }
        out.finish()
    }

    /// Inverse of [`MechanicalPath::to_numbers`].
    ///
    /// # Errors
    /// [`MotionError`] for numbers that are none of a motion.
    pub fn from_numbers(numbers: &[f64]) -> Result<Self, MotionError> {
        Reader::read(StoredKind::Mechanism, numbers, Self::read)
    }

    fn read(from: &mut Reader<'_>) -> Option<Self> {
        let finite = from.is_finite();
        let old = from.format() < 5.0;
        let [n, m] = from.counts()?;
        let [p] = if old { [0] } else { from.counts()? };
        let [segments, coefficients, skipped] = from.counts()?;
        let sets = match from.format() {
            format if format >= 7.0 => from.counts::<1>()?[0],
            _ => 4 - 3 * usize::from(old),
        };
        if !finite
            || ![1, 4, 6].contains(&sets)
            || n == 0
            || n > MOST
            || m > MOST
            || p > MOST
            || m + p > MOST
        {
            return None;
        }
        let layout = Layout { n, m, p, k: 0 };
        let size = layout.size();
        let mut path = Self::new(layout);
        for _ in 0..segments {
            let [start] = from.row()?;
            let mode = read_mode(from, m + p, sets)?;
            path.segments.push(segment_of(
                (start, mode),
                from.row()?,
                size,
                coefficients,
                skipped,
            )?);
        }
        path.coefficients = from.take(coefficients)?.to_vec();
        for _ in 0..skipped {
            let [start, end] = from.row()?;
            let arcs = match from.flag()? {
                false => None,
                true => Some(Box::new(Tail::read(from)?)),
            };
            let bare = SkippedArcs::of_rows(start, end, from.rows(size)?);
            let mut it = SkippedArcs { arcs, ..bare };
            if from.format() >= 6.0 {
                read_additions(from, size, &mut it)?;
            }
            path.skipped.push(it);
        }
        if !from.is_empty() {
            let [t] = from.row()?;
            let mode = read_mode(from, m + p, sets)?;
            let (x, v) = (from.take(size)?.to_vec(), from.take(size)?.to_vec());
            path.end = Some((t, MotionPoint { x, v, mode }));
        }
        let ordered = path.segments.windows(2).all(|pair| pair[0].start < pair[1].start);
        ordered.then_some(path)
    }
}

/// Reads the additions along flights.
fn read_additions(from: &mut Reader<'_>, size: usize, to: &mut SkippedArcs) -> Option<()> {
    let [slips] = from.counts()?;
    for _ in 0..slips {
        let ways = [from.take(size)?.to_vec(), from.take(size)?.to_vec()];
        to.slips.push(StoppedSlip { ways, accelerations: [from.row()?, from.row()?] });
    }
    let [corrections] = from.counts()?;
    for _ in 0..corrections {
        let [component] = from.counts()?;
        let of = ([from.row()?, from.row()?, from.row()?, from.row()?], from.row()?);
        let tail = to.arcs.as_ref().filter(|_| component < size)?;
        to.corrections.push(Correction::new(component, of, tail));
    }
    Some(())
}

fn segment_of(
    (start, mode): (f64, ContactMode),
    [kind, first, degree, h]: [f64; 4],
    size: usize,
    coefficients: usize,
    skipped: usize,
) -> Option<Segment> {
    let first = as_count(first)?;
    let kind = if kind == 0.0 {
        let degree =
            as_count(degree).filter(|degree| (1..=MOST_SEGMENT_DEGREE).contains(degree))?;
        let end = first.checked_add(2 * size * (degree + 1))?;
        (end <= coefficients && h > 0.0).then_some(Kind::Motion { first, degree, h })?
    } else {
        (kind == 1.0 && first < skipped).then_some(Kind::Skipped(first))?
    };
    Some(Segment { start, mode, kind })
}

// Result of one step of the integrator.

/// A part of the motion that one step of the machine covers.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Piece {
    /// The last step, up to an event at `length` if that is not its end; the event is yet to come.
    Motion,
    /// Infinitely many impacts of one gap.
    Skipped(SkippedArcs),
    /// Impacts that alternate between several gaps, down to a corner.
    Descent(Vec<Flight>),
    /// Nothing but an event at the present time.
    Instant,
    /// Not even that: rotations have other coordinates.
    Charts,
}

/// A part of the way into a corner, and the mode in it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Flight {
    pub(crate) curve: Curve,
    pub(crate) mode: ContactMode,
}
