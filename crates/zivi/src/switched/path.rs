//! The whole motion as a function of time: polynomials in flight, tails, rest.

use std::collections::TryReserveError;

use super::tail::Tail;
use super::user_events::Level;
use crate::numeric::bernstein::{evaluate, Bernstein, MOST_DEGREE};
use crate::record::reserve::Reserve;

/// A state at some time, and on which branch of the transform it lies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathPoint {
    /// Distance from the wall, `>= 0` (m).
    pub x: f64,
    /// Velocity (m/s); at the time of an impact the one after it.
    pub xdot: f64,
    /// Branch, `+1` or `-1`: it changes at each impact, and `s = sigma x`.
    pub sigma: f64,
}

/// The motion in free flight over one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Curve {
    pub(super) start: f64,
    pub(super) h: f64,
    pub(super) sigma: f64,
    pub(super) x: Bernstein,
    pub(super) xdot: Bernstein,
}

impl Curve {
    pub(super) fn at(&self, t: f64) -> PathPoint {
        let theta = theta(t, self.start, self.h);
        let (x, xdot) = (self.x.at(theta).max(0.0), self.xdot.at(theta));
        PathPoint { x, xdot, sigma: self.sigma }
    }
}

impl Curve {
    /// When a level is crossed, up to `end`.
    pub(super) fn crossings(&self, level: Level, end: f64) -> Vec<f64> {
        let all = match level {
            Level::Position(c) => self.x.crossings(c),
            Level::Velocity(c) => self.xdot.crossings(c),
        };
        all.iter().map(|theta| (self.start + theta * self.h).min(end)).collect()
    }
}

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

/// The motion at any time of a run, across impacts, Zeno points, rest and lift-off.
///
/// A step of order 8 takes 18 numbers of memory, one of order 5 takes 12. Within the tails the
/// impacts are evaluated when they are asked for.
///
/// ```
/// use zivi::{simulate_switched_rk, ConstantForce, Output, Physical, Restitution, Silent, SwitchedRk};
///
/// let wall = Restitution::from_e(0.5)?;
/// let ball = Physical { x: 1.0, xdot: 0.0 };
/// let output = Output { dense: true, ..Output::default() };
/// let run = simulate_switched_rk(
///     SwitchedRk::default(), wall, &mut ConstantForce(-2.0), (0.0, 4.0), ball, output, &mut Silent,
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
        reserve.room(&mut self.coefficients, 2 * (MOST_DEGREE + 1), 0)?;
        reserve.room(&mut self.tails, 1, 0)
    }

    pub(super) fn push_flight(&mut self, curve: &Curve) {
        let first = self.coefficients.len();
        let degree = curve.x.coefficients().len() - 1;
        self.coefficients.extend_from_slice(curve.x.coefficients());
        self.coefficients.extend_from_slice(curve.xdot.coefficients());
        self.push(curve.start, curve.sigma, Kind::Flight { first, degree, h: curve.h });
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

    /// The polynomials of a segment in flight.
    pub(super) fn curve(&self, segment: &Segment) -> Option<Curve> {
        let Kind::Flight { first, degree, h } = segment.kind else { return None };
        let (x, xdot) = self.coefficients[first..][..2 * degree + 2].split_at(degree + 1);
        let (x, xdot) = (Bernstein::new(x), Bernstein::new(xdot));
        Some(Curve { start: segment.start, h, sigma: segment.sigma, x, xdot })
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
        let Segment { start, sigma, kind } = self.segments[after - 1];
        Some(match kind {
            Kind::Rest => PathPoint { x: 0.0, xdot: 0.0, sigma },
            Kind::Tail(number) => self.tails[number].at(t),
            Kind::Flight { first, degree, h } => {
                let theta = theta(t, start, h);
                let (x, xdot) = self.coefficients[first..][..2 * degree + 2].split_at(degree + 1);
                PathPoint { x: evaluate(x, theta).max(0.0), xdot: evaluate(xdot, theta), sigma }
            }
        })
    }
}
