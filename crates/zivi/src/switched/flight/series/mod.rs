//! Flights under linear forces, to rounding: power series over steps, their first roots certified.
//!
//! A step evaluates no force and has no error to control. The clock of the first wave counts whole
//! turns and the part of one, and the time is read from it: phase and time cannot drift apart.

mod law;
mod root;
mod table;

pub(crate) use law::Linear;
pub(crate) use root::{derivative, first_root, value};
pub(crate) use table::{Series, Start, Table, TERMS};

use std::sync::Arc;

use crate::numeric::turns::Phase;
use crate::switched::stages::Point;
use crate::LinearLaw;

/// A step that ends at most this part of it after its end is no longer: what rounding makes of it.
const OVER: f64 = 1.0 + 1e-9;

/// By how much a step near the wall is longer than the arc under a constant force.
const ARC: f64 = 1.3;

/// Flights under one linear force.
#[derive(Clone, Debug)]
pub(in crate::switched) struct SeriesFlight {
    law: LinearLaw,
    linear: Linear,
    table: Arc<Table>,
    /// The clock of the first wave, and the time that it stands for.
    phase: Phase,
    at: (f64, f64),
    /// The last piece.
    piece: Flown,
}

/// A piece of flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::switched) struct Flown {
    from: Point,
    start: Start,
    /// The position by powers of a part of it, unless it is several whole steps.
    series: Series,
    /// Its length, in steps.
    length: f64,
    /// `2^j` whole steps.
    doublings: Option<usize>,
    /// Where it ends.
    pub(in crate::switched) end: Point,
    /// Whether that is at the wall.
    pub(in crate::switched) lands: bool,
}

impl SeriesFlight {
    /// The flights under a law, unless its numbers are beyond what can be computed with.
    pub(in crate::switched) fn new(law: LinearLaw) -> Option<Self> {
        let linear = Linear::new(&law);
        let table = Table::new(linear.table_law(), f64::INFINITY);
        Self::with_table(law, linear, Arc::new(table))
    }

    fn with_table(law: LinearLaw, linear: Linear, table: Arc<Table>) -> Option<Self> {
        let usable = table.h() > 1e-100 && table.h() < 1e100;
        let from = Point::default();
        let start = Start { x: 0.0, v: 0.0, force: 0.0, waves: [[0.0; 2]; 2] };
        let piece = Flown {
            from,
            start,
            series: [0.0; TERMS],
            length: 0.0,
            doublings: None,
            end: from,
            lands: false,
        };
        let (phase, at) = (Phase::default(), (f64::NAN, f64::NAN));
        usable.then_some(Self { law, linear, table, phase, at, piece })
    }

    /// Goes over to another law: with the same table if that serves. None as for `new`.
    pub(in crate::switched) fn under(&mut self, law: LinearLaw) -> Option<()> {
        if law == self.law {
            return Some(());
        }
        let linear = Linear::new(&law);
        *self = if linear.table_law() == self.table.law() {
            Self::with_table(law, linear, Arc::clone(&self.table))?
        } else {
            Self::new(law)?
        };
        Some(())
    }

    /// The force.
    pub(in crate::switched) fn linear(&self) -> Linear {
        self.linear
    }

    /// Sets the clock.
    #[inline]
    fn look_at_clock(&mut self, now: Point) {
        if let Some(wave) = self.linear.first() {
            if self.at != (now.t, now.late) {
                self.phase = wave.clock.phase(now.t, now.late);
                self.at = (now.t, now.late);
            }
        }
    }

    #[inline]
    fn start(&mut self, now: Point) -> Start {
        self.look_at_clock(now);
        let first = self.linear.first().map_or([0.0; 2], |wave| wave.at(self.phase));
        let second = self
            .linear
            .second()
            .map_or([0.0; 2], |wave| wave.at(wave.clock.phase(now.t, now.late)));
        let (x, v) = (now.x, now.xdot * self.table.h());
        Start { x, v, force: self.linear.constant, waves: [first, second] }
    }

    /// The state `x`, `xdot` after so many steps from `now`.
    #[inline]
    fn after(&mut self, now: Point, steps: f64, x: f64, xdot: f64) -> Point {
        match self.linear.first() {
            Some(wave) => {
                self.phase = self.phase.after(steps * self.table.turns()[0]);
                let (t, late) = wave.clock.time(self.phase);
                self.at = (t, late);
                Point { t, late, x, xdot }
            }
            None => now.after(steps * self.table.h(), x, xdot),
        }
    }

    /// The next piece of flight, up to the wall, a whole number of steps or `t_end`. The first
    /// `known` derivatives of the position are zero at its start.
    pub(in crate::switched) fn next(&mut self, now: Point, known: usize, t_end: f64) -> &Flown {
        let start = self.start(now);
        let h = self.table.h();
        let left = ((t_end - now.t) - now.late) / h;
        (self.piece.from, self.piece.start, self.piece.doublings) = (now, start, None);
        self.piece.lands = false;
        if known == 0 && !self.table.is_parabola() {
            if let Some(j) = self.table.far(&start, left) {
                return self.jumped(now, j, left, t_end);
            }
        }
        let mut a = self.table.series(&start);
        a[..known].fill(0.0);
        let width = self.width(&a, known, left);
        stretch(&mut a, width);
        let root = first_root(&a, known).filter(|root| root.at * width <= left);
        let (part, x, slope) = match root {
            Some(root) => (root.at, 0.0, root.slope.min(0.0)),
            None => {
                let part = if left <= width * OVER { left / width } else { 1.0 };
                (part, value(&a, part), value(&derivative(&a), part))
            }
        };
        // less than rounding above the wall, and moving to it
        self.piece.lands = root.is_some() || (x <= 0.0 && slope < 0.0);
        let length = part * width;
        let ends = root.is_none() && left <= width * OVER;
        (self.piece.series, self.piece.length) = (a, length);
        stretch(&mut self.piece.series, part);
        // not max, which would drop NaN
        let x = if x < 0.0 { 0.0 } else { x };
        let mut end = self.after(now, length, x, slope / (width * h));
        if ends || end.t > t_end {
            (end.t, end.late) = (t_end, 0.0);
        }
        self.piece.end = end;
        &self.piece
    }

    /// `2^j` steps at once.
    fn jumped(&mut self, now: Point, j: usize, left: f64, t_end: f64) -> &Flown {
        let end = self.table.jump(&self.piece.start, j);
        let length = f64::from(1u32 << j);
        let mut end = self.after(now, length, end.x, end.v / self.table.h());
        if left <= length {
            (end.t, end.late) = (t_end, 0.0);
        }
        (self.piece.length, self.piece.doublings, self.piece.end) = (length, Some(j), end);
        &self.piece
    }

    /// Of how many power series the last piece consists.
    pub(in crate::switched) fn parts(&self) -> usize {
        self.piece.doublings.map_or(1, |j| 1 << j)
    }

    /// The power series of a part of the last piece, where it starts, its length (s), and whether it
    /// ends at the wall.
    pub(in crate::switched) fn part(&self, k: usize) -> (Series, f64, f64, bool) {
        let Flown { from, start, series, length, doublings, lands, .. } = self.piece;
        let h = self.table.h();
        let Some(j) = doublings else { return (series, from.t, length * h, lands) };
        let at = (0..j).filter(|bit| k >> bit & 1 == 1);
        let start = at.fold(start, |start, bit| self.table.jump(&start, bit));
        let from = from.after(k as f64 * h, 0.0, 0.0);
        (self.table.series(&start), from.t, h, false)
    }

    /// Up to where to look for the wall: a power of two times the step. A step of a motion that
    /// hardly turns may be far longer than an arc.
    fn width(&self, a: &Series, known: usize, left: f64) -> f64 {
        let [x, v, bend, ..] = *a;
        let arc = match known {
            0 if bend < 0.0 => (v + (v * v - 4.0 * bend * x).sqrt()) / (-2.0 * bend),
            0 if v < 0.0 => 2.0 * x / ((v * v - 4.0 * bend * x).sqrt() - v),
            1 if bend < 0.0 => -v / bend,
            _ => f64::INFINITY,
        };
        let longest = if self.table.is_parabola() { f64::INFINITY } else { 1.0 };
        // a root of a negative number is none, and min drops NaN
        let wanted = longest.min(ARC * arc).min(left);
        let power = power_of_two(wanted);
        if wanted > power * OVER {
            2.0 * power
        } else {
            power
        }
    }

    /// The clock at the next lift-off from rest, up to `t_end`, where that is known in closed form.
    pub(in crate::switched) fn lift_off(&mut self, now: Point, t_end: f64) -> Option<Option<f64>> {
        if self.linear.second().is_some() {
            return None;
        }
        self.look_at_clock(now);
        let wave = self.linear.first()?;
        let Some(phase) = self.linear.lift_off(wave, self.phase) else { return Some(None) };
        if phase == self.phase {
            return Some(Some(now.t));
        }
        let t = wave.clock.time(phase).0.max(now.t);
        if t > t_end {
            return Some(None);
        }
        (self.phase, self.at) = (phase, (t, 0.0));
        Some(Some(t))
    }
}

/// The largest power of two that is not larger, for a positive number.
fn power_of_two(x: f64) -> f64 {
    const EXPONENT: u64 = 0x7ff0_0000_0000_0000;
    let power = f64::from_bits(x.to_bits() & EXPONENT);
    // all of them are finite
    power.clamp(f64::MIN_POSITIVE, 1e300)
}

/// The series of a part of what it was one of.
#[inline]
fn stretch(a: &mut Series, part: f64) {
    if part == 1.0 {
        return;
    }
    let mut power = 1.0;
    for a in a.iter_mut() {
        *a *= power;
        power *= part;
    }
}
