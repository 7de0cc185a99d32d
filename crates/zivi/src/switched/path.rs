//! The whole motion as a function of time: polynomials in flight, tails, rest.

use std::collections::TryReserveError;

use super::flight::series::{derivative, value, Series, TERMS};
use crate::numeric::bernstein::{evaluate, Bernstein, Polynomial, MOST_DEGREE};
use crate::record::reserve::Reserve;
use crate::record::user_events::Level;
use crate::zeno::tail::Tail;
use crate::PathPoint;

/// The motion in free flight over one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Curve {
    pub(super) start: f64,
    pub(super) h: f64,
    pub(super) sigma: f64,
    form: Form,
}

/// Position and velocity by the part `theta` of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Form {
    /// Polynomials of both.
    Both([Bernstein; 2]),
    /// Powers of `theta` for the position, the velocity at the start; whether it ends at the wall.
    Powers(Series, f64, bool),
}

impl Curve {
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

    /// When the step ends.
    pub(super) fn end(&self) -> f64 {
        self.start + self.h
    }

    #[inline]
    pub(super) fn at(&self, t: f64) -> PathPoint {
        self.moving().at(t)
    }

    /// The motion, for one time after the other.
    #[inline(always)]
    pub(super) fn moving(&self) -> Moving<'_> {
        let later = match &self.form {
            Form::Both(_) => [0.0; TERMS],
            Form::Powers(a, ..) => {
                // exactly the state at the start
                let mut later = derivative(a);
                later[0] = 0.0;
                later
            }
        };
        Moving { curve: self, later }
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

    /// The way from the start and the velocity in Bernstein form, the velocity by differences of
    /// the way where it is not known apart from that: for a drawing.
    #[inline(always)]
    pub(super) fn outline(&self) -> (f64, [Polynomial<TERMS>; 2]) {
        match &self.form {
            Form::Both(_) => (0.0, [self.position(), self.velocity()]),
            Form::Powers(a, ..) => {
                let mut way = *a;
                way[0] = 0.0;
                let way = Polynomial::from_powers(way);
                (a[0], [way, way.derivative().times(1.0 / self.h)])
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

/// A curve, and the powers of its velocity beyond that at the start.
pub(super) struct Moving<'a> {
    curve: &'a Curve,
    later: Series,
}

impl Moving<'_> {
    #[inline(always)]
    pub(super) fn at(&self, t: f64) -> PathPoint {
        let Curve { start, h, sigma, form } = self.curve;
        let theta = theta(t, *start, *h);
        let (x, xdot) = match form {
            Form::Both([x, xdot]) => (x.at(theta), xdot.at(theta)),
            Form::Powers(a, xdot, _) => (value(a, theta), xdot + value(&self.later, theta) / h),
        };
        PathPoint { x: x.max(0.0), xdot, sigma: *sigma }
    }
}

#[inline(always)]
fn theta(t: f64, start: f64, h: f64) -> f64 {
    ((t - start) / h).clamp(0.0, 1.0)
}

/// What happens from the start of a segment to that of the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Kind {
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
    /// The tail of this number.
    Tail(usize),
    Rest,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Segment {
    pub(super) start: f64,
    pub(super) sigma: f64,
    pub(super) kind: Kind,
}

/// How many of the coefficients are more than rounding: the rest of them is none of it.
fn significant(a: &Series) -> usize {
    const NOTHING: f64 = 1e-18;
    let whole: f64 = a.iter().map(|a| a.abs()).sum();
    a.iter().rposition(|a| a.abs() > NOTHING * whole).map_or(2, |last| (last + 1).max(2))
}

/// The motion at any time of a run, across impacts, Zeno points, rest and lift-off.
///
/// A step of order 8 takes 18 numbers of memory, one of order 5 takes 12, a power series at most 24. Within the tails the
/// impacts are evaluated when they are requested.
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
    pub(super) segments: Vec<Segment>,
    pub(super) coefficients: Vec<f64>,
    pub(super) tails: Vec<Tail>,
    pub(super) end: Option<(f64, PathPoint)>,
}

impl DensePath {
    /// Makes room for one more segment of any kind.
    pub(super) fn make_room(&mut self, reserve: &mut Reserve) -> Result<(), TryReserveError> {
        reserve.room(&mut self.segments, 1, 0)?;
        reserve.room(&mut self.coefficients, TERMS.max(2 * (MOST_DEGREE + 1)), 0)?;
        reserve.room(&mut self.tails, 1, 0)
    }

    pub(super) fn push_flight(&mut self, curve: &Curve) {
        let (first, h) = (self.coefficients.len(), curve.h);
        let kind = match &curve.form {
            Form::Both([x, xdot]) => {
                self.coefficients.extend_from_slice(x.coefficients());
                self.coefficients.extend_from_slice(xdot.coefficients());
                Kind::Flight { first, degree: x.coefficients().len() - 1, h }
            }
            Form::Powers(a, xdot, lands) => {
                let terms = significant(a);
                self.coefficients.extend_from_slice(&a[..terms]);
                self.coefficients[first + 1] = *xdot;
                Kind::Series { first, terms, h, lands: *lands }
            }
        };
        self.push(curve.start, curve.sigma, kind);
    }

    pub(super) fn push_tail(&mut self, tail: &Tail) {
        let kind = Kind::Tail(self.tails.len());
        self.tails.push(tail.clone());
        self.push(tail.start(), 1.0, kind);
    }

    pub(super) fn push_rest(&mut self, start: f64, sigma: f64) {
        // windows of one rest are one segment
        if !matches!(self.segments.last(), Some(Segment { kind: Kind::Rest, .. })) {
            self.push(start, sigma, Kind::Rest);
        }
    }

    fn push(&mut self, start: f64, sigma: f64, kind: Kind) {
        // a segment without a length is over before it can be asked for
        if self.segments.last().is_some_and(|last| last.start == start) {
            self.segments.pop();
        }
        self.segments.push(Segment { start, sigma, kind });
    }

    /// Forgets everything.
    pub(super) fn clear(&mut self) {
        self.segments.clear();
        self.coefficients.clear();
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

    /// The motion of a segment in flight.
    #[inline]
    pub(super) fn curve(&self, segment: &Segment) -> Option<Curve> {
        let (form, h) = match segment.kind {
            Kind::Flight { first, degree, h } => {
                let both = &self.coefficients[first..][..2 * degree + 2];
                let (x, xdot) = both.split_at(degree + 1);
                (Form::Both([Bernstein::new(x), Bernstein::new(xdot)]), h)
            }
            Kind::Series { first, terms, h, lands } => {
                let mut a = [0.0; TERMS];
                a[..terms].copy_from_slice(&self.coefficients[first..][..terms]);
                let (step, xdot) = ((segment.start, h), a[1]);
                return Some(Curve::powers(step, segment.sigma, a, xdot, lands));
            }
            Kind::Tail(_) | Kind::Rest => return None,
        };
        Some(Curve { start: segment.start, h, sigma: segment.sigma, form })
    }

    /// The state at `t`, and after the impact if there is one at `t`; `None` outside of the span.
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
        let segment = self.segments[after - 1];
        let Segment { start, sigma, kind } = segment;
        Some(match kind {
            Kind::Rest => PathPoint { x: 0.0, xdot: 0.0, sigma },
            Kind::Tail(number) => self.tails[number].at(t),
            Kind::Flight { first, degree, h } => {
                let theta = theta(t, start, h);
                let (x, xdot) = self.coefficients[first..][..2 * degree + 2].split_at(degree + 1);
                PathPoint { x: evaluate(x, theta).max(0.0), xdot: evaluate(xdot, theta), sigma }
            }
            Kind::Series { .. } => self.curve(&segment)?.at(t),
        })
    }
}
