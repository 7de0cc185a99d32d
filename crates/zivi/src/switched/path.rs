//! The whole motion as a function of time: polynomials in flight, tails, rest.

use std::collections::TryReserveError;
use std::sync::Arc;

use zivi_core::Restitution;

use super::flight::series::{derivative, value, FlightPart, Series, Table, TERMS};
use crate::numeric::bernstein::{Bernstein, Polynomial, MOST_DEGREE};
use crate::numeric::power_series::{sizes, values};
use crate::record::columns::Reserve;
use crate::record::recorder::is_sigma;
use crate::record::stored::{as_count, MotionError, Reader, StoredKind, Writer};
use crate::record::user_events::Level;
use crate::zeno::tail::Tail;
use crate::PathPoint;

/// The motion in free flight over one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FlightCurve {
    pub(super) start: f64,
    pub(super) h: f64,
    pub(super) sigma: f64,
    pub(super) form: Form,
}

/// Position and velocity by the part `theta` of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Form {
    /// Polynomials of both.
    Both([Bernstein; 2]),
    /// Powers of `theta` for the position, the velocity at the start; whether it ends at the wall.
    Powers(Series, f64, bool),
}

impl FlightCurve {
    /// None yet.
    pub(super) const NONE: Self =
        Self { start: 0.0, h: 1.0, sigma: 1.0, form: Form::Powers([0.0; TERMS], 0.0, false) };

    pub(super) fn polynomials(start: f64, h: f64, sigma: f64, both: [Bernstein; 2]) -> Self {
        Self { start, h, sigma, form: Form::Both(both) }
    }

    /// By powers of the part of the step, the second of which is `h xdot`.
    pub(super) fn powers(
        (start, h): (f64, f64),
        sigma: f64,
        mut a: Series,
        xdot: f64,
        lands: bool,
    ) -> Self {
        a[1] = h * xdot;
        Self { start, h, sigma, form: Form::Powers(a, xdot, lands) }
    }

    /// By what a step under a linear force starts from.
    #[inline(always)]
    pub(super) fn of_part(start: f64, sigma: f64, part: &FlightPart, table: &Table) -> Self {
        let step = (start, part.length * table.h());
        Self::powers(step, sigma, part.powers(table), part.xdot, part.lands)
    }

    /// When the step ends.
    pub(super) fn end(&self) -> f64 {
        self.start + self.h
    }

    #[inline]
    pub(super) fn at(&self, t: f64) -> PathPoint {
        self.with(&self.later(), t)
    }

    #[inline(always)]
    fn with(&self, later: &Series, t: f64) -> PathPoint {
        let FlightCurve { start, h, sigma, form } = self;
        let theta = theta(t, *start, *h);
        let (x, xdot) = match form {
            Form::Both([x, xdot]) => (x.at(theta), xdot.at(theta)),
            Form::Powers(a, xdot, _) => (value(a, theta), xdot + value(later, theta) / h),
        };
        PathPoint { x: x.max(0.0), xdot, sigma: *sigma }
    }

    /// The motion, for one time after the other.
    #[inline(always)]
    pub(super) fn moving(&self) -> MovingCurve {
        MovingCurve { curve: *self, later: self.later() }
    }

    /// Positions at several times together, with the bits of [`FlightCurve::at`] at each.
    #[inline(always)]
    pub(super) fn positions<const L: usize>(&self, t: &[f64; L]) -> [f64; L] {
        let theta = t.map(|t| theta(t, self.start, self.h));
        let x = match &self.form {
            Form::Both([x, _]) => x.values(&theta),
            Form::Powers(a, ..) => values(a, &theta),
        };
        x.map(|x| x.max(0.0))
    }

    /// The same of velocities.
    #[inline(always)]
    pub(super) fn velocities<const L: usize>(&self, t: &[f64; L]) -> [f64; L] {
        let theta = t.map(|t| theta(t, self.start, self.h));
        match &self.form {
            Form::Both([_, xdot]) => xdot.values(&theta),
            Form::Powers(_, xdot, _) => {
                values(&self.later(), &theta).map(|later| xdot + later / self.h)
            }
        }
    }

    /// The powers of the velocity minus the initial velocity, times the length of the step.
    #[inline(always)]
    fn later(&self) -> Series {
        match &self.form {
            Form::Both(_) => [0.0; TERMS],
            Form::Powers(a, ..) => {
                // exactly the state at the start
                let mut later = derivative(a);
                later[0] = 0.0;
                later
            }
        }
    }

    /// Whether it ends at the wall.
    pub(super) fn lands(&self) -> bool {
        match &self.form {
            Form::Both([x, _]) => x.coefficients().last() == Some(&0.0),
            Form::Powers(_, _, lands) => *lands,
        }
    }

    /// The position in Bernstein form.
    fn position(&self) -> Polynomial<TERMS> {
        match &self.form {
            Form::Both([x, _]) => Polynomial::new(x.coefficients()),
            Form::Powers(a, ..) => Polynomial::from_powers(*a),
        }
    }

    /// The velocity in Bernstein form.
    pub(super) fn velocity(&self) -> Polynomial<TERMS> {
        match &self.form {
            Form::Both([_, xdot]) => Polynomial::new(xdot.coefficients()),
            Form::Powers(a, start, _) => {
                let mut xdot = derivative(a).map(|a| a / self.h);
                xdot[0] = *start;
                Polynomial::from_powers(xdot)
            }
        }
    }

    /// When a level is crossed, up to `end`.
    pub(super) fn crossings(&self, level: Level, end: f64) -> Vec<f64> {
        let all = match level {
            Level::Position(c) => self.position().crossings(c),
            Level::Velocity(c) => self.velocity().crossings(c),
        };
        all.iter().map(|theta| (self.start + theta * self.h).min(end)).collect()
    }
}

/// A curve, and the powers of its velocity minus the initial one.
#[derive(Clone, Debug)]
pub(super) struct MovingCurve {
    curve: FlightCurve,
    later: Series,
}

impl MovingCurve {
    #[inline(always)]
    fn at(&self, t: f64) -> PathPoint {
        self.curve.with(&self.later, t)
    }
}

#[inline(always)]
pub(super) fn theta(t: f64, start: f64, h: f64) -> f64 {
    ((t - start) / h).clamp(0.0, 1.0)
}

/// Motion from the start of a segment to the start of the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum SegmentKind {
    /// Polynomials of this degree, their coefficients from here on, over a step of length `h`.
    Flight {
        first: usize,
        degree: usize,
        h: f64,
    },
    /// So many powers of the part of a step of length `h`, at least two, their coefficients from
    /// here on (the second, `h x'`, as the velocity `x'`), and whether it ends at the wall.
    Series {
        first: usize,
        terms: usize,
        h: f64,
        lands: bool,
    },
    /// A step under a linear force: that of this number.
    Linear(usize),
    /// The tail of this number.
    Tail(usize),
    Rest,
}

impl SegmentKind {
    pub(super) fn is_flight(self) -> bool {
        !matches!(self, SegmentKind::Tail(_) | SegmentKind::Rest)
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct MotionSegment {
    pub(super) start: f64,
    pub(super) sigma: f64,
    pub(super) kind: SegmentKind,
}

/// A step under a linear force by its initial data and the number of its table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LinearStep {
    part: FlightPart,
    table: usize,
}

/// Tables that a path keeps: where a law changes again and again, power series take less.
const MOST_TABLES: usize = 8;

/// How many of the coefficients are more than rounding, given the sums of their sizes: the rest of
/// them is none of it.
#[inline(always)]
fn significant(a: &Series, sizes: [f64; 4]) -> usize {
    const NOTHING: f64 = 1e-18;
    let whole: f64 = sizes.iter().sum();
    let mut terms = TERMS;
    while terms > 2 {
        if a[terms - 1].abs() > NOTHING * whole {
            break;
        }
        terms -= 1;
    }
    terms
}

/// The motion at any time of a run, across impacts, Zeno points, rest and lift-off.
///
/// A step of order 8 takes 18 numbers of memory, one of order 5 takes 12, one under a linear force
/// what it starts from. Within the tails the impacts are evaluated when they are requested.
///
/// ```
/// use zivi::{simulate_switched_rk, ConstantForce, Output, Physical, Restitution, Silent, SwitchedRk};
///
/// let restitution = Restitution::from_e(0.5)?;
/// let ball = Physical { x: 1.0, xdot: 0.0 };
/// let output = Output { dense: true, ..Output::default() };
/// let run = simulate_switched_rk(
///     SwitchedRk::default(), restitution, &mut ConstantForce(-2.0), (0.0, 4.0), ball, output,
///     &mut Silent,
/// )?;
/// let path = run.path.unwrap();
/// // 1 m at 2 m/s^2 takes 1 s; the ball bounces at half its speed and is up again at 1.5 s
/// let top = path.at(1.5).unwrap();
/// assert!((top.x - 0.25).abs() < 1e-12 && top.xdot.abs() < 1e-12);
/// assert_eq!(path.at(1.0).unwrap().sigma, -1.0);
/// assert!(path.at(4.5).is_none());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DensePath {
    pub(super) segments: Vec<MotionSegment>,
    pub(super) coefficients: Vec<f64>,
    pub(super) linear: Vec<LinearStep>,
    pub(super) tables: Vec<Arc<Table>>,
    pub(super) tails: Vec<Tail>,
    pub(super) end: Option<(f64, PathPoint)>,
}

impl DensePath {
    /// Makes room for one more segment of any kind.
    pub(super) fn make_room(&mut self, reserve: &mut Reserve) -> Result<(), TryReserveError> {
        reserve.room(&mut self.segments, 1, 0)?;
        reserve.room(&mut self.coefficients, TERMS.max(2 * (MOST_DEGREE + 1)), 0)?;
        reserve.room(&mut self.linear, 1, 0)?;
        reserve.room(&mut self.tails, 1, 0)
    }

    /// Adds a step under a linear force.
    #[inline]
    pub(super) fn push_part(
        &mut self,
        start: f64,
        sigma: f64,
        (part, table): (FlightPart, &Arc<Table>),
    ) {
        let known = self.tables.iter().rposition(|it| Arc::ptr_eq(it, table));
        let number = known.unwrap_or(self.tables.len());
        if number == MOST_TABLES {
            return self.push_flight(&FlightCurve::of_part(start, sigma, &part, table));
        }
        if known.is_none() {
            self.tables.push(Arc::clone(table));
        }
        let kind = SegmentKind::Linear(self.linear.len());
        self.linear.push(LinearStep { part, table: number });
        self.push(start, sigma, kind);
    }

    /// The same path without tables.
    pub(super) fn in_powers(&self) -> Self {
        let mut all = Self { tails: self.tails.clone(), end: self.end, ..Self::default() };
        for segment in &self.segments {
            match self.curve(segment) {
                Some(curve) => all.push_flight(&curve),
                None => all.segments.push(*segment),
            }
        }
        all
    }

    pub(super) fn push_flight(&mut self, curve: &FlightCurve) {
        let (first, h) = (self.coefficients.len(), curve.h);
        let kind = match &curve.form {
            Form::Both([x, xdot]) => {
                self.coefficients.extend_from_slice(x.coefficients());
                self.coefficients.extend_from_slice(xdot.coefficients());
                SegmentKind::Flight { first, degree: x.coefficients().len() - 1, h }
            }
            Form::Powers(a, xdot, lands) => {
                let terms = significant(a, sizes(a));
                self.coefficients.extend_from_slice(&a[..terms]);
                self.coefficients[first + 1] = *xdot;
                SegmentKind::Series { first, terms, h, lands: *lands }
            }
        };
        self.push(curve.start, curve.sigma, kind);
    }

    pub(super) fn push_tail(&mut self, tail: &Tail) {
        let kind = SegmentKind::Tail(self.tails.len());
        self.tails.push(tail.clone());
        self.push(tail.start(), 1.0, kind);
    }

    pub(super) fn push_rest(&mut self, start: f64, sigma: f64) {
        // windows of one rest are one segment
        if !matches!(self.segments.last(), Some(MotionSegment { kind: SegmentKind::Rest, .. })) {
            self.push(start, sigma, SegmentKind::Rest);
        }
    }

    fn push(&mut self, start: f64, sigma: f64, kind: SegmentKind) {
        // a segment without a length is over before it can be asked for
        if self.segments.last().is_some_and(|last| last.start == start) {
            self.segments.pop();
        }
        self.segments.push(MotionSegment { start, sigma, kind });
    }

    /// Forgets everything.
    pub(super) fn clear(&mut self) {
        self.segments.clear();
        self.coefficients.clear();
        self.linear.clear();
        self.tables.clear();
        self.tails.clear();
        self.end = None;
    }

    pub(super) fn finish(&mut self, t: f64, end: PathPoint) {
        self.end = Some((t, end));
    }

    /// Where a step, a tail or a rest begins, in order.
    pub fn starts(&self) -> impl Iterator<Item = f64> + '_ {
        self.segments.iter().map(|segment| segment.start)
    }

    /// The times between which the motion is known, unless the run made no step.
    #[must_use]
    pub fn span(&self) -> Option<(f64, f64)> {
        let (end, _) = self.end?;
        Some((self.segments.first().map_or(end, |first| first.start), end))
    }

    /// The accumulations that were extrapolated, in order.
    #[must_use]
    pub fn tails(&self) -> &[Tail] {
        &self.tails
    }

    /// Number of steps, tails and phases of rest that are stored.
    #[must_use]
    pub fn len(&self) -> usize {
        self.segments.len()
    }

    /// Whether the run made no step.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.segments.is_empty()
    }

    /// The position and the velocity, times the length of the step, with which a segment starts,
    /// and half of its second derivative there, by the part of the step.
    #[inline(always)]
    pub(super) fn first_powers(&self, segment: &MotionSegment) -> Option<[f64; 3]> {
        match segment.kind {
            SegmentKind::Flight { first, degree, .. } => {
                let n = degree as f64;
                let c = &self.coefficients[first..][..degree + 1];
                let at = |k: usize| c.get(k).copied().unwrap_or(c[0]);
                let bend = 0.5 * n * (n - 1.0) * (at(0) - 2.0 * at(1) + at(2));
                Some([at(0), n * (at(1) - at(0)), bend])
            }
            SegmentKind::Series { first, terms, h, .. } => {
                let a = &self.coefficients[first..][..terms];
                Some([a[0], h * a[1], a.get(2).copied().unwrap_or(0.0)])
            }
            SegmentKind::Linear(number) => {
                let LinearStep { part, table } = &self.linear[number];
                Some(part.first_powers(&self.tables[*table]))
            }
            SegmentKind::Tail(_) | SegmentKind::Rest => None,
        }
    }

    /// How long the step of a segment in flight is (s).
    #[inline(always)]
    pub(super) fn length_of(&self, segment: &MotionSegment) -> f64 {
        match segment.kind {
            SegmentKind::Flight { h, .. } | SegmentKind::Series { h, .. } => h,
            SegmentKind::Linear(number) => {
                let LinearStep { part, table } = &self.linear[number];
                part.length * self.tables[*table].h()
            }
            SegmentKind::Tail(_) | SegmentKind::Rest => f64::INFINITY,
        }
    }

    /// Writes the motion of a segment in flight to a curve; whether it is one.
    #[inline(always)]
    pub(super) fn write_curve(&self, segment: &MotionSegment, to: &mut FlightCurve) -> bool {
        let SegmentKind::Linear(number) = segment.kind else {
            let curve = self.curve(segment);
            curve.iter().for_each(|curve| to.clone_from(curve));
            return curve.is_some();
        };
        let LinearStep { part, table } = &self.linear[number];
        let table = &self.tables[*table];
        let h = part.length * table.h();
        (to.start, to.h, to.sigma) = (segment.start, h, segment.sigma);
        if let Form::Both(_) = to.form {
            to.form = FlightCurve::NONE.form;
        }
        if let Form::Powers(a, xdot, lands) = &mut to.form {
            (*xdot, *lands) = (part.xdot, part.lands);
            let sizes = part.write_powers(table, h * part.xdot, a);
            let terms = significant(a, sizes);
            a[terms..].fill(0.0);
        }
        true
    }

    /// The motion of a segment in flight.
    #[inline(always)]
    pub(super) fn curve(&self, segment: &MotionSegment) -> Option<FlightCurve> {
        let MotionSegment { start, sigma, kind } = *segment;
        match kind {
            SegmentKind::Flight { first, degree, h } => {
                let both = &self.coefficients[first..][..2 * degree + 2];
                let (x, xdot) = both.split_at(degree + 1);
                let both = [Bernstein::new(x), Bernstein::new(xdot)];
                Some(FlightCurve::polynomials(start, h, sigma, both))
            }
            SegmentKind::Series { first, terms, h, lands } => {
                let mut a = [0.0; TERMS];
                a[..terms].copy_from_slice(&self.coefficients[first..][..terms]);
                Some(FlightCurve::powers((start, h), sigma, a, a[1], lands))
            }
            SegmentKind::Linear(_) => {
                let mut curve = FlightCurve::NONE;
                self.write_curve(segment, &mut curve);
                Some(curve)
            }
            SegmentKind::Tail(_) | SegmentKind::Rest => None,
        }
    }

    /// The state at `t`; at an impact, the state after it; `None` outside of the span.
    #[must_use]
    pub fn at(&self, t: f64) -> Option<PathPoint> {
        let (end, last) = self.end?;
        if t == end {
            return Some(last);
        }
        let after = self.segments.partition_point(|segment| segment.start <= t);
        if after == 0 || t.is_nan() || t > end {
            return None;
        }
        let segment = &self.segments[after - 1];
        Some(match segment.kind {
            SegmentKind::Rest => PathPoint { x: 0.0, xdot: 0.0, sigma: segment.sigma },
            SegmentKind::Tail(number) => self.tails[number].at(t),
            _ => self.curve(segment)?.at(t),
        })
    }

    /// States at one time after the other, in whatever order: fastest if the times increase.
    #[must_use]
    pub fn reader(&self) -> PathReader<'_> {
        PathReader { path: self, span: (0.0, 0.0), piece: HeldSegment::Rest(1.0) }
    }
}

/// Reads a [`DensePath`]: what it made of the last step that it read is kept.
///
/// ```
/// use zivi::{
///     simulate_switched_rk, ConstantForce, Output, Physical, Restitution, Silent, SwitchedRk,
/// };
///
/// let ball = Physical { x: 1.0, xdot: 0.0 };
/// let output = Output { dense: true, ..Output::default() };
/// let run = simulate_switched_rk(
///     SwitchedRk::default(), Restitution::from_e(0.5)?, &mut ConstantForce(-2.0), (0.0, 4.0),
///     ball, output, &mut Silent,
/// )?;
/// let path = run.path.unwrap();
/// let mut reader = path.reader();
/// for t in [0.25, 0.5, 1.25] {
///     assert_eq!(reader.at(t), path.at(t));
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct PathReader<'a> {
    path: &'a DensePath,
    /// Time span of the segment, end excluded.
    span: (f64, f64),
    piece: HeldSegment<'a>,
}

/// Motion in a segment.
#[allow(clippy::large_enum_variant)] // there is one of a reader, and a box would be made a step
#[derive(Clone, Debug)]
enum HeldSegment<'a> {
    Flight(MovingCurve),
    Tail(&'a Tail),
    Rest(f64),
}

impl PathReader<'_> {
    /// The state at `t`, as [`DensePath::at`].
    pub fn at(&mut self, t: f64) -> Option<PathPoint> {
        let (end, last) = self.path.end?;
        if t == end {
            return Some(last);
        }
        if !(t >= self.span.0 && t < self.span.1) {
            if t.is_nan() || t > end {
                return None;
            }
            self.hold(t, end)?;
        }
        Some(match &self.piece {
            HeldSegment::Flight(moving) => moving.at(t),
            HeldSegment::Tail(tail) => tail.at(t),
            HeldSegment::Rest(sigma) => PathPoint { x: 0.0, xdot: 0.0, sigma: *sigma },
        })
    }

    /// Goes to the segment of a time.
    fn hold(&mut self, t: f64, end: f64) -> Option<()> {
        let path = self.path;
        let after = path.segments.partition_point(|segment| segment.start <= t);
        let segment = path.segments.get(after.checked_sub(1)?)?;
        let until = path.segments.get(after).map_or(end, |next| next.start);
        self.span = (segment.start, until);
        self.piece = match (segment.kind, path.curve(segment)) {
            (SegmentKind::Tail(number), _) => HeldSegment::Tail(&path.tails[number]),
            (_, Some(curve)) => HeldSegment::Flight(curve.moving()),
            _ => HeldSegment::Rest(segment.sigma),
        };
        Some(())
    }
}

// The motion of a mass as plain numbers, after the header of [`crate::record::stored`].
//
// ```text
// motion  [ e, kappa, tails, whether there is a path,  the tails,  the path ]
// path    [ segments, coefficients, tails, ended,  t, x, x', sigma of the end,
//           start, sigma, kind, first, degree, h  of each segment,  the coefficients,  the tails ]
// ```
//
// The `degree` of a power series is how many terms it has, its second coefficient the velocity at the
// start. Before format 4 tails had no accelerations, format 1 had no power series.

/// The motion of a run between its samples: the dense output, if stored, and the extrapolated
/// flights.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    /// The motion as a function of time.
    pub path: Option<DensePath>,
    /// The flights that jumps to rest skipped.
    pub tails: Vec<Tail>,
    /// The wall.
    pub restitution: Restitution,
}

impl Motion {
    /// All that it consists of.
    #[must_use]
    pub fn to_numbers(&self) -> Option<Vec<f64>> {
        let mut out = Writer::new(StoredKind::Point);
        out.numbers(&[self.restitution.e(), self.restitution.kappa()]);
        out.count(self.tails.len());
        out.flag(self.path.is_some());
        write_tails(&mut out, &self.tails);
        if let Some(path) = &self.path {
            path.write(&mut out);
        }
        out.finish()
    }

    /// Inverse of [`Motion::to_numbers`].
    ///
    /// # Errors
    /// [`MotionError`] for numbers that are none of a motion.
    pub fn from_numbers(numbers: &[f64]) -> Result<Self, MotionError> {
        Reader::read(StoredKind::Point, numbers, Self::read)
    }

    fn read(from: &mut Reader<'_>) -> Option<Self> {
        let [e, kappa] = from.row()?;
        let (tails, dense) = (from.count()?, from.flag()?);
        let tails = read_tails(from, tails)?;
        let path = if dense { Some(DensePath::read(from)?) } else { None };
        let restitution = Restitution::from_both(e, kappa).ok()?;
        Some(Self { path, tails, restitution })
    }
}

fn write_tails(out: &mut Writer, tails: &[Tail]) {
    tails.iter().for_each(|tail| out.numbers(&tail.to_numbers()));
}

fn read_tails(from: &mut Reader<'_>, n: usize) -> Option<Vec<Tail>> {
    (0..n).map(|_| Tail::read(from)).collect()
}

impl DensePath {
    fn write(&self, out: &mut Writer) {
        if !self.linear.is_empty() {
            // tables are not written
            return self.in_powers().write(out);
        }
        let (t, end) = self.end.unwrap_or((f64::NAN, PathPoint { x: 0.0, xdot: 0.0, sigma: 1.0 }));
        for count in [self.segments.len(), self.coefficients.len(), self.tails.len()] {
            out.count(count);
        }
        out.flag(self.end.is_some());
        out.numbers(&[t, end.x, end.xdot, end.sigma]);
        for MotionSegment { start, sigma, kind } in &self.segments {
            let (code, first, degree, h) = match *kind {
                SegmentKind::Rest => (0.0, 0, 0, 0.0),
                SegmentKind::Tail(number) => (1.0, number, 0, 0.0),
                SegmentKind::Flight { first, degree, h } => (2.0, first, degree, h),
                SegmentKind::Series { first, terms, h, lands: false } => (3.0, first, terms, h),
                SegmentKind::Series { first, terms, h, lands: true } => (4.0, first, terms, h),
                SegmentKind::Linear(_) => unreachable!("a path in powers has no tables"),
            };
            out.numbers(&[*start, *sigma, code, first as f64, degree as f64, h]);
        }
        out.numbers(&self.coefficients);
        write_tails(out, &self.tails);
    }

    /// Inverse of [`DensePath::write`]; `None` if the numbers do not fit together.
    fn read(from: &mut Reader<'_>) -> Option<Self> {
        let [segments, coefficients, tails] = from.counts()?;
        let ended = from.flag()?;
        let [t, x, xdot, sigma] = from.row()?;
        let segments = from.rows(segments)?.into_iter().map(segment).collect::<Option<_>>()?;
        let coefficients = from.take(coefficients)?.to_vec();
        let tails = read_tails(from, tails)?;
        let end = ended.then_some((t, PathPoint { x, xdot, sigma }));
        let path = Self { segments, coefficients, tails, end, ..Self::default() };
        path.fits_together().then_some(path)
    }

    /// Whether the segments are consecutive up to the end, and their references exist.
    fn fits_together(&self) -> bool {
        let starts = self.segments.iter().map(|segment| segment.start);
        let times: Vec<f64> = starts.chain(self.end.map(|(t, _)| t)).collect();
        let ended = match self.end {
            Some((_, PathPoint { x, xdot, sigma })) => {
                x >= 0.0 && x.is_finite() && xdot.is_finite() && is_sigma(sigma)
            }
            None => self.segments.is_empty(),
        };
        ended
            && times.iter().all(|t| t.is_finite())
            && times.windows(2).all(|pair| pair[0] <= pair[1])
            && self.coefficients.iter().all(|c| c.is_finite())
            && self.segments.iter().all(|segment| self.holds(segment))
    }

    /// Whether what a segment refers to is there.
    fn holds(&self, segment: &MotionSegment) -> bool {
        is_sigma(segment.sigma)
            && match segment.kind {
                SegmentKind::Rest => true,
                SegmentKind::Linear(number) => number < self.linear.len(),
                SegmentKind::Tail(number) => number < self.tails.len(),
                SegmentKind::Flight { first, degree, h } => {
                    // `first` is below 2^53: no overflow
                    degree <= MOST_DEGREE
                        && first + 2 * degree + 2 <= self.coefficients.len()
                        && h > 0.0
                        && h.is_finite()
                }
                SegmentKind::Series { first, terms, h, .. } => {
                    (2..=TERMS).contains(&terms)
                        && first + terms <= self.coefficients.len()
                        && h > 0.0
                        && h.is_finite()
                }
            }
    }
}

fn segment([start, sigma, code, first, degree, h]: [f64; 6]) -> Option<MotionSegment> {
    let kind = match as_count(code)? {
        0 => SegmentKind::Rest,
        1 => SegmentKind::Tail(as_count(first)?),
        2 => SegmentKind::Flight { first: as_count(first)?, degree: as_count(degree)?, h },
        code @ (3 | 4) => {
            let (first, terms) = (as_count(first)?, as_count(degree)?);
            SegmentKind::Series { first, terms, h, lands: code == 4 }
        }
        _ => return None,
    };
    Some(MotionSegment { start, sigma, kind })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::zeno::table::TAIL_NUMBERS;
    use crate::{
        simulate_switched_rk, Flights, LinearForce, Output, Physical, Restitution, Silent,
        SwitchedRk,
    };

    /// Numbers of the header, before the tails of a motion, of a path and of a segment.
    const HEADER: usize = 3;
    const MOTION_HEAD: usize = HEADER + 4;
    const HEAD: usize = 8;
    const OF_SEGMENT: usize = 6;

    const KINDS: [Flights; 2] = [Flights::RungeKutta, Flights::Series];

    fn path(flights: Flights) -> DensePath {
        let mut table = LinearForce {
            stiffness: 0.0,
            damping: 0.0,
            gravity: 9.81,
            amplitude: 14.7,
            omega: 6.3,
            phase: 0.0,
        };
        let (start, restitution) =
            (Physical { x: 0.2, xdot: 0.0 }, Restitution::from_e(0.5).unwrap());
        let output = Output { dense: true, ..Output::default() };
        let method = SwitchedRk { flights, ..SwitchedRk::default() };
        simulate_switched_rk(
            method,
            restitution,
            &mut table,
            (0.0, 3.0),
            start,
            output,
            &mut Silent,
        )
        .unwrap()
        .path
        .unwrap()
    }

    fn motion(flights: Flights) -> Motion {
        let path = path(flights);
        Motion {
            tails: path.tails.clone(),
            path: Some(path),
            restitution: Restitution::from_e(0.5).unwrap(),
        }
    }

    #[test]
    fn a_motion_comes_back_as_it_was() {
        for dense in KINDS.map(motion) {
            assert!(!dense.tails.is_empty());
            for path in [None, Some(DensePath::default()), dense.path.clone()] {
                for tails in [Vec::new(), dense.tails.clone()] {
                    let motion =
                        Motion { path: path.clone(), tails, restitution: dense.restitution };
                    let again = Motion::from_numbers(&motion.to_numbers().unwrap()).unwrap();
                    let bits = |motion: &Motion| {
                        motion
                            .to_numbers()
                            .unwrap()
                            .into_iter()
                            .map(f64::to_bits)
                            .collect::<Vec<u64>>()
                    };
                    assert_eq!(bits(&again), bits(&motion));
                    let in_powers = motion.path.as_ref().map(DensePath::in_powers);
                    assert_eq!(again, Motion { path: in_powers, ..motion.clone() });
                    let at = |motion: &Motion| {
                        let times = (0..=300).map(|k| 0.01 * f64::from(k));
                        let at = |t| motion.path.as_ref().and_then(|path| path.at(t));
                        times.map(at).collect::<Vec<_>>()
                    };
                    assert_eq!(at(&again), at(&motion));
                }
            }
        }
    }

    #[test]
    fn numbers_that_do_not_fit_together_are_refused() {
        refused(&motion(Flights::RungeKutta), 2.0, &[8.0, 9.0, 1e15]);
        refused(&motion(Flights::Series), 3.0, &[0.0, 1.0, 25.0, 1e15]);
    }

    /// Of a flight of this kind, which never has one of these degrees.
    fn refused(motion: &Motion, kind: f64, degrees: &[f64]) {
        let numbers = motion.to_numbers().unwrap();
        for n in 0..numbers.len() {
            assert_eq!(Motion::from_numbers(&numbers[..n]), Err(MotionError::Damaged), "{n}");
        }
        let path = MOTION_HEAD + TAIL_NUMBERS * motion.tails.len();
        let first = path + HEAD;
        let flight = (0..).find(|i| numbers[first + OF_SEGMENT * i + 2] == kind).unwrap();
        let flight = first + OF_SEGMENT * flight;
        let not_there = [numbers[path + 1] - 1.0, 1e6, 8e15];
        let wrong: Vec<(usize, &[f64])> = vec![
            (HEADER, &[-0.1, 1.1, f64::NAN]),           // e
            (HEADER + 1, &[-0.1, 0.4, f64::NAN]),       // kappa
            (HEADER + 2, &[1e9, -1.0, 0.25, f64::NAN]), // tails
            (HEADER + 3, &[0.0, 2.0]),                  // whether there is a path
            (MOTION_HEAD, &[0.0, 1.0, -1.0, f64::NAN]), // e of a tail
            (path, &[1e9, f64::INFINITY]),              // segments
            (path + 1, &[-1.0, 9e15]),                  // coefficients
            (path + 3, &[0.0, 0.5]),                    // ended
            (path + 4, &[f64::NAN, -1.0]),              // the time of the end
            (path + 5, &[-1.0, f64::NAN]),              // x there
            (first, &[f64::NAN, 1e9]),                  // start of a segment
            (first + 1, &[0.0, 2.0]),                   // its branch
            (first + 2, &[5.0, 7.0]),                   // its kind
            (flight + 3, &not_there),                   // coefficients that are not there
            (flight + 4, degrees),                      // a degree that no step has
            (flight + 5, &[0.0, -1.0, f64::INFINITY]),  // its length
        ];
        for (k, values) in wrong {
            for &value in values {
                let mut numbers = numbers.clone();
                numbers[k] = value;
                assert_eq!(
                    Motion::from_numbers(&numbers),
                    Err(MotionError::Damaged),
                    "{k}: {value}"
                );
            }
        }
        let mut later = numbers.clone();
        later[0] += 1.0;
        assert_eq!(Motion::from_numbers(&later), Err(MotionError::Format(later[0])));
    }

    /// A motion restored from arbitrary numbers supports all queries.
    #[test]
    fn numbers_changed_at_random_give_an_error_or_a_motion() {
        KINDS
            .into_iter()
            .for_each(|flights| changed_at_random(&motion(flights).to_numbers().unwrap()));
    }

    fn changed_at_random(whole: &[f64]) {
        const VALUES: [f64; 12] =
            [0.0, -0.0, 1.0, -1.0, 2.0, 0.5, 8.0, 1e9, 1e300, 5e-324, f64::INFINITY, f64::NAN];
        let mut draw = 5_u64;
        let mut below = |n: usize| {
            draw = draw.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (draw >> 33) as usize % n
        };
        let mut made = 0;
        for _ in 0..20_000 {
            let mut numbers = whole.to_vec();
            for _ in 0..=below(3) {
                // mostly in the counts, which are at the beginning
                let k = if below(2) == 0 { below(60) } else { below(whole.len()) };
                let near = numbers[k] + 1.0;
                numbers[k] = *VALUES.get(below(VALUES.len() + 1)).unwrap_or(&near);
            }
            let Ok(Motion { path, tails, .. }) = Motion::from_numbers(&numbers) else { continue };
            made += 1;
            let times = [-1.0, 0.0, 0.5, 0.83, 1.1, 1.7, 3.0, f64::NAN];
            let found = times.iter().filter_map(|&t| path.as_ref().and_then(|path| path.at(t)));
            assert!(found.count() <= times.len());
            for tail in &tails {
                assert!(tail.impacts_down_to(1e-3, 100).count() <= 100);
            }
        }
        assert!(made > 1000, "{made}");
    }
}
