//! The infinitely many arcs that a jump skips, evaluated when they are requested.
//!
//! The bouncing gap follows the arcs `Y(t)` of [`crate::Tail`]. The system follows the motion
//! `c(t)` that it would have in contact, and is moved out of it along the direction `r(t)` in which
//! the impulses act,
//!
//! ```text
//! x = c(t) + r(t) Y(t)      x' = c'(t) + r'(t) Y(t) + r(t) Y'(t)                         (1)
//! ```
//!
//! with `c` the polynomial of degree 5 through position, velocity and acceleration at both ends,
//! and `r` the line. A channel that every impact stops slips along each arc, from rest. With its slip
//! `S(t)` and the directions `p(t)` in which the impulses that stop it act, (1) has the terms `p S` and
//! `p' S + p S'` more, and `c` ends where these leave it. The work of friction is counted from arc to arc.
//! Accelerations of `S`, and what friction works along arcs and in impacts, are polynomials in `e^m`.

use super::mode::Key;
use crate::numeric::bernstein::{quintic, Bernstein};
use crate::zeno::arc::TailArc;
use crate::zeno::chain::Chain;
use crate::zeno::tail::Tail;

/// At most so many arcs make a polynomial in `e^m`.
pub(super) const FRICTION_TERMS: usize = 3;

/// Coefficients of a polynomial in `q = e^m`, the constant first.
pub(super) type InPowers = [f64; FRICTION_TERMS];

/// The polynomial with so many values at `q`.
pub(super) fn through(q: &[f64], values: &[f64]) -> InPowers {
    let mut d = values.to_vec();
    for level in 1..q.len() {
        for i in (level..q.len()).rev() {
            d[i] = (d[i] - d[i - 1]) / (q[i] - q[i - level]);
        }
    }
    // from the Newton form to powers
    let mut a = [0.0; FRICTION_TERMS];
    for (q, d) in q.iter().zip(&d).rev() {
        for k in (1..FRICTION_TERMS).rev() {
            a[k] = a[k - 1] - q * a[k];
        }
        a[0] = d - q * a[0];
    }
    a
}

fn value(a: &InPowers, q: f64) -> f64 {
    a.iter().rev().fold(0.0, |sum, a| sum * q + a)
}

/// A part of an arc: its number, `e^m`, its length and the part that is over.
type PartOfArc = (usize, f64, f64, f64);

/// A channel that every impact of the arcs stops.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct StoppedSlip {
    /// How a unit of it moves the components, at both ends.
    pub(super) ways: [Vec<f64>; 2],
    /// Its acceleration at the starts of arcs, and at their ends.
    pub(super) accelerations: [InPowers; 2],
}

impl StoppedSlip {
    /// How far it is, and its speed.
    fn at(&self, tail: &Tail, part: Option<PartOfArc>) -> (f64, f64) {
        let [a, b] = &self.accelerations;
        let mean: Vec<f64> = a.iter().zip(b).map(|(a, b)| a / 3.0 + b / 6.0).collect();
        let before = tail.sum_over_arcs(&mean, 2, part.map(|part| part.0));
        let Some((_, q, h, theta)) = part else { return (before, 0.0) };
        let [a, b] = [value(a, q), value(b, q) - value(a, q)];
        let along = h * h * theta * theta * (a / 2.0 + b * theta / 6.0);
        (before + along, h * theta * (a + b * theta / 2.0))
    }
}

/// The work of friction since the first of the arcs.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct FrictionWork {
    pub(super) before: f64,
    /// What it works per time at the starts of arcs, and at their ends.
    pub(super) powers: [InPowers; 2],
    /// What it works in the impacts at their ends, divided by `e^m`.
    pub(super) impacts: InPowers,
}

impl FrictionWork {
    fn at(&self, tail: &Tail, part: Option<PartOfArc>) -> f64 {
        let ([a, b], number) = (&self.powers, part.map(|part| part.0));
        let mean: Vec<f64> = a.iter().zip(b).map(|(a, b)| (a + b) / 2.0).collect();
        let impacts: Vec<f64> = [0.0].into_iter().chain(self.impacts).collect();
        let before = self.before
            + tail.sum_over_arcs(&mean, 1, number)
            + tail.sum_over_arcs(&impacts, 0, number);
        let Some((_, q, h, theta)) = part else { return before };
        let [a, b] = [value(a, q), value(b, q) - value(a, q)];
        before + h * theta * (a + b * theta / 2.0)
    }
}

/// One end of the skipped arcs: coordinates and gaps in contact, their rates and accelerations,
/// and which way the bounces move them.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct EndOfArcs {
    pub(super) x: Vec<f64>,
    pub(super) v: Vec<f64>,
    pub(super) acceleration: Vec<f64>,
    pub(super) way: Vec<f64>,
}

/// The motion between the last computed impact and a Zeno point.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct SkippedArcs {
    pub(super) start: f64,
    pub(super) end: f64,
    /// The arcs of the bouncing gap; none for the motion in contact alone.
    pub(super) arcs: Option<Box<Tail>>,
    /// By component: the coefficients of `c`, then both ends of `r`.
    pub(super) rows: Vec<[f64; 8]>,
    /// The channels that slip along the arcs.
    pub(super) slips: Vec<StoppedSlip>,
    pub(super) work: Option<FrictionWork>,
}

impl SkippedArcs {
    /// Where the system does not move any more but for its arcs.
    pub(super) fn of_rows(start: f64, end: f64, rows: Vec<[f64; 8]>) -> Self {
        Self { start, end, arcs: None, rows, slips: vec![], work: None }
    }

    /// The arcs of a chain that ends at `zeno`.
    pub(super) fn of_chain(chain: &Chain<Vec<f64>, Key>, zeno: f64, ends: [EndOfArcs; 2]) -> Self {
        let arcs = chain.tail(zeno, 1.0);
        let start = arcs.start();
        Self { arcs: Some(Box::new(arcs)), ..Self::between(start, zeno, ends) }
    }

    /// Those of so many components that nobody looks along: their impacts alone.
    pub(super) fn undrawn(chain: &Chain<Vec<f64>, Key>, zeno: f64, size: usize) -> Self {
        let arcs = chain.tail(zeno, 1.0);
        let rest = Self::of_rows(arcs.start(), zeno, vec![[0.0; 8]; size]);
        Self { arcs: Some(Box::new(arcs)), ..rest }
    }

    /// The motion in contact between two times.
    pub(super) fn between(start: f64, end: f64, [first, last]: [EndOfArcs; 2]) -> Self {
        Self::of_rows(start, end, rows_between(end - start, &first, &last))
    }

    /// Takes the motion in contact from its ends, with the slips along the arcs.
    pub(super) fn end_at(&mut self, first: &EndOfArcs, last: &EndOfArcs) {
        let (h, mut last) = (self.end - self.start, last.clone());
        let Some(tail) = &self.arcs else { return };
        for slip in &self.slips {
            let (way, [from, to]) = (slip.at(tail, None).0, &slip.ways);
            for (c, (from, to)) in from.iter().zip(to).enumerate() {
                last.x[c] -= to * way;
                last.v[c] -= (to - from) / h * way;
            }
        }
        self.rows = rows_between(h, first, &last);
    }

    /// Start and end of an arc, unless it is too short to be told from its ends.
    pub(super) fn arc(&self, m: usize) -> Option<(f64, f64)> {
        self.arcs.as_ref()?.arc(m).map(|arc| (arc.start, arc.end))
    }

    /// Equations (1) at `t`, after the impact if there is one.
    pub(super) fn at(&self, t: f64, x: &mut [f64], v: &mut [f64]) {
        self.on(t, self.arcs.as_ref().and_then(|arcs| arcs.numbered_arc_at(t)), x, v);
    }

    /// The same on the arc `m`, before the impact at its end.
    pub(super) fn at_before(&self, t: f64, m: usize, x: &mut [f64], v: &mut [f64]) {
        let arc = self.arcs.as_ref().and_then(|arcs| arcs.arc(m));
        self.on(t, arc.map(|arc| (m, arc)), x, v);
    }

    fn on(&self, t: f64, arc: Option<(usize, TailArc)>, x: &mut [f64], v: &mut [f64]) {
        let bounce = arc.map_or((0.0, 0.0), |(_, arc)| {
            let at = arc.at(t);
            (at.x, at.xdot)
        });
        self.combine(t, bounce, x, v);
        let part = arc.map(|(m, arc)| (m, (t - arc.start) / (arc.end - arc.start)));
        self.rub(t, part, x, v);
    }

    /// Adds what friction does after a part of an arc, after all of them where there is none.
    pub(super) fn rub(&self, t: f64, arc: Option<(usize, f64)>, x: &mut [f64], v: &mut [f64]) {
        let Some(tail) =
            self.arcs.as_ref().filter(|_| !self.slips.is_empty() || self.work.is_some())
        else {
            return;
        };
        let part = arc.and_then(|(m, theta)| {
            tail.arc(m).map(|arc| (m, tail.power(m), arc.length, theta.clamp(0.0, 1.0)))
        });
        let (h, theta) = (self.end - self.start, self.part(t));
        for slip in &self.slips {
            let ((s, rate), [from, to]) = (slip.at(tail, part), &slip.ways);
            for (c, (from, to)) in from.iter().zip(to).enumerate() {
                let way = from + theta * (to - from);
                x[c] += way * s;
                v[c] += way * rate + if h > 0.0 { (to - from) / h * s } else { 0.0 };
            }
        }
        if let (Some(work), Some(of)) = (&self.work, v.last_mut()) {
            *of = work.at(tail, part);
        }
    }

    /// The part of the time that is over.
    fn part(&self, t: f64) -> f64 {
        let h = self.end - self.start;
        if h > 0.0 {
            ((t - self.start) / h).clamp(0.0, 1.0)
        } else {
            1.0
        }
    }

    /// Equations (1) with `Y` and `Y'` given.
    pub(super) fn combine(&self, t: f64, (y, u): (f64, f64), x: &mut [f64], v: &mut [f64]) {
        let (h, theta) = (self.end - self.start, self.part(t));
        for (c, row) in self.rows.iter().enumerate() {
            let (motion, [.., r0, r1]) = (Bernstein::new(&row[..6]), *row);
            let way = r0 + theta * (r1 - r0);
            x[c] = motion.at(theta) + way * y;
            let rate = if h > 0.0 { (motion.slope(theta) + (r1 - r0) * y) / h } else { 0.0 };
            v[c] = rate + way * u;
        }
    }
}

/// The rows of the motion in contact between two ends, after a time `h`.
fn rows_between(h: f64, first: &EndOfArcs, last: &EndOfArcs) -> Vec<[f64; 8]> {
    let row = |c: usize| {
        let at = |end: &EndOfArcs| [end.x[c], end.v[c], end.acceleration[c]];
        let [c0, c1, c2, c3, c4, c5] = quintic(at(first), at(last), h);
        [c0, c1, c2, c3, c4, c5, first.way[c], last.way[c]]
    };
    (0..first.x.len()).map(row).collect()
}
