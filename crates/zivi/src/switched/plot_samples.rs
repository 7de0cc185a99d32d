//! Samples between the ends of steps, so that lines through all of them draw the motion.
//!
//! A step of high order spans a whole flight; a line between its ends shows none of it. The
//! polynomials of the dense output say how far they are from straight: over `n` equal parts of a
//! step a line is off by at most `max |p''|/(8 n^2)`, and the second differences of the Bernstein
//! coefficients bound `|p''|`.

use std::collections::TryReserveError;

use pulp::{Simd, WithSimd};

use super::flight::series::TERMS;
use super::path::{Curve, DensePath, Kind, Segment};
use crate::numeric::bernstein::Polynomial;
use crate::zeno::tail::Tail;
use crate::PathPoint;

type Form = Polynomial<TERMS>;

/// A line may be off by this part of the height of what it draws.
const FLATNESS: f64 = 1.0 / 200.0;
/// What is lower than this part of the highest is drawn as if it were so high.
const LOW: f64 = 0.05;
/// Most parts of a step.
const MOST_PARTS: f64 = 64.0;
/// Parts of an arc in a tail, and how many arcs of one are drawn: those higher than this part of
/// the highest.
const ARC_PARTS: usize = 6;
const ARCS: usize = 64;
const FINEST: f64 = 1e-3;
/// An apex is drawn by a sample that is at most so many units in the last place of the time away.
const SAME: f64 = 4.0;
/// Samples of a whole run that are added at most, besides those at impacts and apexes: a run of
/// more steps is drawn by its steps.
const BUDGET: f64 = 1e5;

/// A row of the samples: `t`, `x`, `x'`, `sigma`.
pub(super) type Row = [f64; 4];

/// The samples that draw a motion between those at the ends of its steps, in the order of time.
///
/// # Errors
/// There is no room for them.
pub(super) fn between_steps(path: &DensePath) -> Result<Vec<Row>, TryReserveError> {
    pulp::Arch::new().dispatch(Between(path))
}

/// [`between_steps`], compiled for the vectors that the machine has.
struct Between<'a>(&'a DensePath);

impl WithSimd for Between<'_> {
    type Output = Result<Vec<Row>, TryReserveError>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Self::Output {
        draw(self.0)
    }
}

#[inline(always)]
fn draw(path: &DensePath) -> Result<Vec<Row>, TryReserveError> {
    let mut outlines = Vec::new();
    outlines.try_reserve_exact(path.segments.len())?;
    for (segment, end) in segments(path) {
        if let Some(curve) = path.curve(&segment) {
            outlines.push(Polyline::of(&curve, end));
        }
    }
    let scale = Scale::of(&outlines);
    let wanted: f64 = outlines.iter().map(|it| scale.parts(it)).sum();
    let share = (BUDGET / wanted).min(1.0);
    let mut rows = Vec::new();
    rows.try_reserve_exact((share * wanted) as usize + path.segments.len())?;
    let mut outlines = outlines.iter();
    for (segment, end) in segments(path) {
        match segment.kind {
            Kind::Rest => (),
            Kind::Tail(number) => draw_tail(&path.tails[number], end, scale, &mut rows)?,
            Kind::Flight { .. } | Kind::Series { .. } => {
                let (Some(curve), Some(outline)) = (path.curve(&segment), outlines.next()) else {
                    continue;
                };
                let parts = (share * scale.parts(outline)).ceil();
                draw_flight(&curve, end, (parts, outline.turns), &mut rows)?;
            }
        }
    }
    Ok(rows)
}

/// The segments and where they end.
fn segments(path: &DensePath) -> impl Iterator<Item = (Segment, f64)> + '_ {
    let last = path.end.map_or(f64::NEG_INFINITY, |(t, _)| t);
    let starts = path.segments.iter().skip(1).map(|segment| segment.start);
    path.segments.iter().copied().zip(starts.chain(Some(last)))
}

/// What a drawing needs to know of a flight.
#[derive(Clone, Copy)]
struct Polyline {
    x: Bend,
    xdot: Bend,
    /// How much of the step it is.
    part: f64,
    /// Whether the velocity may change its sign.
    turns: bool,
}

impl Polyline {
    #[inline(always)]
    fn of(curve: &Curve, end: f64) -> Self {
        /// What may be rounding, relative to the largest coefficient.
        const ROUNDING: f64 = 1e-12;
        let (x0, [x, xdot]) = curve.outline();
        let part = ((end - curve.start) / curve.h).min(1.0);
        let (x, velocity) = (Bend::of(&x).above(x0), Bend::of(&xdot));
        let clear = ROUNDING * velocity.largest();
        let turns = !(velocity.least > clear || velocity.most < -clear);
        Self { x, xdot: velocity, part, turns }
    }
}

/// How far a polynomial is from straight, and its coefficients.
#[derive(Clone, Copy)]
struct Bend {
    least: f64,
    most: f64,
    /// A bound of the second derivative.
    second: f64,
}

impl Bend {
    #[inline(always)]
    fn of(p: &Form) -> Self {
        // comparisons that drop NaN
        let smaller = |a: f64, b: f64| if b < a { b } else { a };
        let larger = |a: f64, b: f64| if b > a { b } else { a };
        let c = p.coefficients();
        let least = c.iter().copied().fold(f64::INFINITY, smaller);
        let most = c.iter().copied().fold(f64::NEG_INFINITY, larger);
        let n = c.len() as f64 - 1.0;
        let second = c.windows(3).map(|c| (c[0] - 2.0 * c[1] + c[2]).abs()).fold(0.0, larger);
        Self { least, most, second: n * (n - 1.0) * second }
    }

    /// The same of the polynomial and a constant.
    fn above(self, constant: f64) -> Self {
        Self { least: self.least + constant, most: self.most + constant, ..self }
    }

    /// The largest absolute value.
    fn largest(&self) -> f64 {
        self.least.abs().max(self.most.abs())
    }

    /// `sqrt(max |p''|/(8 FLATNESS height))` with the height of the polynomial, at least `low`.
    fn parts(&self, low: f64) -> f64 {
        let height = (self.most - self.least).max(low).max(f64::MIN_POSITIVE);
        (self.second / (8.0 * FLATNESS * height)).sqrt()
    }
}

/// The largest distance and speed of a run.
#[derive(Clone, Copy)]
struct Scale {
    x: f64,
    xdot: f64,
}

impl Scale {
    fn of(outlines: &[Polyline]) -> Self {
        outlines.iter().fold(Self { x: 0.0, xdot: 0.0 }, |scale, it| Self {
            x: scale.x.max(it.x.largest()),
            xdot: scale.xdot.max(it.xdot.largest()),
        })
    }

    /// Into how many parts lines divide a flight.
    fn parts(&self, Polyline { x, xdot, part, .. }: &Polyline) -> f64 {
        let (of_x, of_xdot) = (x.parts(LOW * self.x), xdot.parts(LOW * self.xdot));
        (part * of_x.max(of_xdot)).ceil().clamp(1.0, MOST_PARTS)
    }
}

#[inline(always)]
fn draw_flight(
    curve: &Curve,
    end: f64,
    (parts, turns): (f64, bool),
    rows: &mut Vec<Row>,
) -> Result<(), TryReserveError> {
    let first = rows.len();
    rows.try_reserve(parts as usize + TERMS)?;
    let length = end - curve.start;
    let moving = curve.moving();
    for k in 1..parts as usize {
        let t = curve.start + k as f64 / parts * length;
        if curve.start < t && t < end {
            rows.push(row(t, moving.at(t)));
        }
    }
    let apexes = if turns { apexes(curve) } else { Vec::new() };
    for apex in apexes.into_iter().filter(|&t| curve.start < t && t < end) {
        let at = first + rows[first..].partition_point(|row| row[0] < apex);
        let beside = &rows[at.saturating_sub(1).max(first)..rows.len().min(at + 1)];
        let mut samples = beside.iter().map(|row| row[0]).chain([curve.start, end]);
        if samples.all(|t| (t - apex).abs() > SAME * ulp(apex)) {
            rows.insert(at, row(apex, curve.at(apex)));
        }
    }
    if curve.lands() {
        draw_contact(end, |t| curve.at(t), rows);
    }
    Ok(())
}

/// The last moment before an impact at `t` that can be told from it: above the wall.
fn draw_contact(t: f64, motion: impl Fn(f64) -> PathPoint, rows: &mut Vec<Row>) {
    let ulp = t - t.next_down();
    let moments = (0..10).map(|k| t - f64::from(1 << k) * ulp);
    let above = moments.map(|t| row(t, motion(t))).find(|row| row[1] > 0.0);
    if let Some(before) = above.filter(|it| rows.last().is_none_or(|last| last[0] < it[0])) {
        rows.push(before);
    }
}

/// The unit in the last place.
fn ulp(t: f64) -> f64 {
    t.abs().next_up() - t.abs()
}

/// Where the velocity changes its sign downwards.
fn apexes(curve: &Curve) -> Vec<f64> {
    let xdot = curve.velocity();
    // a step that falls has its first turn at the bottom
    let skipped = usize::from(xdot.starts_negative());
    let turns = xdot.crossings(0.0).into_iter().skip(skipped).step_by(2);
    turns.map(|theta| curve.start + theta * curve.h).collect()
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
        rows.try_reserve(ARC_PARTS + 2)?;
        if arc.start > tail.start() {
            rows.push(row(arc.start, arc.at(arc.start)));
        }
        for k in 1..ARC_PARTS {
            let t = arc.start + k as f64 / ARC_PARTS as f64 * (arc.end - arc.start);
            if arc.start < t && t < arc.end.min(end) {
                rows.push(row(t, arc.at(t)));
            }
        }
        if arc.end < end {
            draw_contact(arc.end, |t| arc.at(t), rows);
        }
    }
    Ok(())
}

fn row(t: f64, PathPoint { x, xdot, sigma }: PathPoint) -> Row {
    [t, x, xdot, sigma]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::bernstein::Bernstein;
    use crate::zeno::bounce::Bounce;
    use crate::zeno::chain::Chain;

    /// `x'' = -2`, `e = 1/2`: arcs of the heights 1/16, 1/64, ..., from 1 s on.
    #[test]
    fn a_tail_is_drawn_at_sixths_of_its_arcs_down_to_the_finest_and_up_to_its_end() {
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
        // the heights of two, and of three, are above a thousandth
        let sixths =
            |start: f64, length: f64| (1..6).map(move |k| start + f64::from(k) / 6.0 * length);
        let two: Vec<f64> = sixths(1.0, 0.5).chain(sixths(1.5, 0.25)).collect();
        for (found, exact) in drawn(2.0, 1e3 / 65.0).iter().zip(&two) {
            assert!((found - exact).abs() < 1e-15, "{found} {exact}");
        }
        assert_eq!([20.0, 15.0, 3.0].map(|x| drawn(2.0, x).len()), [5, 10, 15]);
        assert_eq!(drawn(1.3, 3.0), drawn(2.0, 3.0)[..3]);
    }

    #[test]
    fn lines_through_the_parts_are_flat_enough() {
        // x = 4 (theta - theta^2): the arc of a ball, and a polynomial that bends at its end
        let arcs = [vec![0.0, 2.0, 0.0], vec![0.0, 0.0, 0.0, 0.0, 0.0, 3.0, 1.0, 0.0]];
        for c in arcs {
            let p = Form::new(&c);
            let n = Bend::of(&p).parts(0.0).ceil();
            let line = |theta: f64| {
                let k = (theta * n).floor().min(n - 1.0);
                let (a, b) = (p.at(k / n), p.at((k + 1.0) / n));
                a + (theta * n - k) * (b - a)
            };
            let worst = (0..=1000)
                .map(|i| f64::from(i) / 1000.0)
                .map(|theta| (line(theta) - p.at(theta)).abs())
                .fold(0.0, f64::max);
            assert!(worst <= FLATNESS * 3.0 && worst > 1e-4, "{c:?}: {n} parts, {worst}");
        }
    }

    #[test]
    fn a_flight_is_drawn_up_to_its_end() {
        // x = 1 + 2 tau - 5 tau^2 over the step from 3 on, up to an impact within it
        let (start, h) = (3.0, 0.4);
        let x = Bernstein::new(&[1.0, 1.0 + h, 1.0 + 2.0 * h - 5.0 * h * h]);
        let xdot = Bernstein::new(&[2.0, 2.0 - 10.0 * h]);
        let curve = Curve::polynomials(start, h, 1.0, [x, xdot]);
        for (end, part) in [(3.1, 0.25), (3.4, 1.0), (3.5, 1.0)] {
            let polyline = Polyline::of(&curve, end);
            assert!((polyline.part - part).abs() < 1e-14, "{end}: {}", polyline.part);
            assert!(polyline.turns);
        }
    }
}
