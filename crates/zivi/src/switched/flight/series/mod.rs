//! Flights under linear forces, to rounding: power series over steps, their first roots certified.
//!
//! A step evaluates no force and has no error to control. The clock of the first wave counts whole
//! turns and the part of one, and the time is read from it: phase and time cannot drift apart.

mod law;
mod root;
mod step;
mod table;

pub(crate) use law::Linear;
pub(crate) use root::{derivative, value};
pub(crate) use step::{stretch, Step};
pub(crate) use table::{column, Series, Start, Table, TERMS};

use std::sync::Arc;

use crate::numeric::turns::Phase;
use crate::switched::stages::Point;
use crate::LinearLaw;

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
    step: Step,
    /// Where it ends.
    pub(in crate::switched) end: Point,
}

impl Flown {
    /// Whether it ends at the wall.
    pub(in crate::switched) fn lands(&self) -> bool {
        self.step.lands
    }
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
        let piece = Flown { from, step: Step::NONE, end: from };
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
        let step = Step::next(&self.table, &start, known, left, true);
        let mut end = self.after(now, step.length, step.x, step.v / h);
        if step.complete || end.t > t_end {
            (end.t, end.late) = (t_end, 0.0);
        }
        self.piece = Flown { from: now, step, end };
        &self.piece
    }

    /// Of how many power series the last piece consists.
    pub(in crate::switched) fn parts(&self) -> usize {
        self.piece.step.doublings.map_or(1, |j| 1 << j)
    }

    /// The power series of a part of the last piece, where it starts and its length (s), the
    /// velocity there, and whether it ends at the wall.
    pub(in crate::switched) fn part(&self, k: usize) -> (Series, (f64, f64), f64, bool) {
        let Flown { from, step, .. } = self.piece;
        let Step { start, length, doublings, lands, .. } = step;
        let h = self.table.h();
        let Some(j) = doublings else {
            return (step.series(), (from.t, length * h), from.xdot, lands);
        };
        let at = (0..j).filter(|bit| k >> bit & 1 == 1);
        let start = at.fold(start, |start, bit| self.table.jump(&start, bit));
        let xdot = if k == 0 { from.xdot } else { start.v / h };
        let from = from.after(k as f64 * h, 0.0, 0.0);
        (self.table.series(&start), (from.t, h), xdot, false)
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
