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
//! and `r` the line.

use super::mode::Key;
use crate::numeric::bernstein::{quintic, Bernstein};
use crate::zeno::chain::Chain;
use crate::zeno::tail::Tail;

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
}

impl SkippedArcs {
    /// The arcs of a chain that ends at `zeno`.
    pub(super) fn of_chain(chain: &Chain<Vec<f64>, Key>, zeno: f64, ends: [EndOfArcs; 2]) -> Self {
        let arcs = chain.tail(zeno, 1.0);
        let start = arcs.start();
        Self { arcs: Some(Box::new(arcs)), ..Self::between(start, zeno, ends) }
    }

    /// Those of so many components that nobody looks along: their impacts alone.
    pub(super) fn undrawn(chain: &Chain<Vec<f64>, Key>, zeno: f64, size: usize) -> Self {
        let arcs = chain.tail(zeno, 1.0);
        Self {
            start: arcs.start(),
            end: zeno,
            arcs: Some(Box::new(arcs)),
            rows: vec![[0.0; 8]; size],
        }
    }

    /// The motion in contact between two times.
    pub(super) fn between(start: f64, end: f64, [first, last]: [EndOfArcs; 2]) -> Self {
        let h = end - start;
        let row = |c: usize| {
            let at = |end: &EndOfArcs| [end.x[c], end.v[c], end.acceleration[c]];
            let [c0, c1, c2, c3, c4, c5] = quintic(at(&first), at(&last), h);
            [c0, c1, c2, c3, c4, c5, first.way[c], last.way[c]]
        };
        Self { start, end, arcs: None, rows: (0..first.x.len()).map(row).collect() }
    }

    /// Start and end of an arc, unless it is too short to be told from its ends.
    pub(super) fn arc(&self, m: usize) -> Option<(f64, f64)> {
        self.arcs.as_ref()?.arc(m).map(|arc| (arc.start, arc.end))
    }

    /// Equations (1) at `t`, after the impact if there is one.
    pub(super) fn at(&self, t: f64, x: &mut [f64], v: &mut [f64]) {
        let bounce = self.arcs.as_ref().map_or((0.0, 0.0), |arcs| {
            let at = arcs.at(t);
            (at.x, at.xdot)
        });
        self.combine(t, bounce, x, v);
    }

    /// The same on the arc `m`, before the impact at its end.
    pub(super) fn at_before(&self, t: f64, m: usize, x: &mut [f64], v: &mut [f64]) {
        let arc = self.arcs.as_ref().and_then(|arcs| arcs.arc(m));
        let bounce = arc.map_or((0.0, 0.0), |arc| {
            let at = arc.at(t);
            (at.x, at.xdot)
        });
        self.combine(t, bounce, x, v);
    }

    /// Equations (1) with `Y` and `Y'` given.
    pub(super) fn combine(&self, t: f64, (y, u): (f64, f64), x: &mut [f64], v: &mut [f64]) {
        let h = self.end - self.start;
        let theta = if h > 0.0 { ((t - self.start) / h).clamp(0.0, 1.0) } else { 1.0 };
        for (c, row) in self.rows.iter().enumerate() {
            let (motion, [.., r0, r1]) = (Bernstein::new(&row[..6]), *row);
            let way = r0 + theta * (r1 - r0);
            x[c] = motion.at(theta) + way * y;
            let rate = if h > 0.0 { (motion.slope(theta) + (r1 - r0) * y) / h } else { 0.0 };
            v[c] = rate + way * u;
        }
    }
}
