//! Whether the force makes the motion that a tail describes.
//!
//! The expansion behind a tail holds where the force is smooth, and a chain of impacts says nothing
//! about the force that lies ahead of it. So before a jump the arcs that it would skip are put
//! back into the equation. On the arc of duration `h` between the speeds `u` and `w`
//!
//! ```text
//! r = f(t, x, x') - x''                                                               (1)
//! ```
//!
//! is taken at Gauss's two points: `x''` of the cubic is a line, and there a smooth force differs
//! from its best line by the third order in `h` only. To first order `r` moves the end of the arc,
//! the speed after it and, with the mean pull `g = (u + w)/h`, the Zeno point by
//!
//! ```text
//! dt = 1/w int r (h - tau) dtau      du = e (g dt - int r dtau)
//! dt_inf = dt + 2 du/(g (1 - e))                                                      (2)
//! ```
//!
//! The sum of `|dt_inf|` over the arcs says how far the tail is from the motion; for smooth forces
//! it is a small part of the tolerance. The long arcs at the start of the tail are looked at most
//! closely. Where little of the tail is left, one arc stands for several: a pulse between two of
//! them is overlooked, a change that lasts is not.

use super::stages::Counted;
use super::tail::{Tail, TailArc};
use crate::fixed_step::Failure;
use crate::Force;

/// Where a smooth force and its best line meet, as parts of the way from the middle to an end.
const GAUSS: f64 = 0.577_350_269_189_625_8;

/// How far a tail may be from the motion, in tolerances of the Zeno time.
const MOST: f64 = 10.0;

/// What is left of a tail when its arcs are looked at less closely.
const CLOSE: f64 = 0.5;

/// Panels of an arc before that.
const PANELS: usize = 3;

/// What is left of a tail when not every arc is looked at any more.
const SPARSE: f64 = 0.15;

/// From then on one arc stands for those after which this part is left of what was left before.
const LASTING: f64 = 0.25;

/// Steps of a flight where the force is known to do something.
const STEPS: f64 = 4.0;

/// An arc on which the force was seen to make another motion than expected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Obstacle {
    from: f64,
    to: f64,
    /// Impacts before all arcs are looked at again.
    patience: u64,
}

/// Evaluations of a look in vain for which one impact passes before the next: under a force with
/// noise in it every look may be in vain.
const PER_IMPACT: u64 = 32;

impl Obstacle {
    /// Longest step at `t`: between the stages of one that is a whole arc long there may be enough
    /// room to overlook once more what was seen.
    pub(super) fn longest_step(&self, t: f64) -> f64 {
        if t >= self.from && t < self.to {
            (self.to - self.from) / STEPS
        } else {
            f64::INFINITY
        }
    }
}

/// The arcs of a tail, looked at before they are skipped.
pub(super) struct Lookahead<'t> {
    pub(super) tail: &'t Tail,
    pub(super) e: f64,
    /// Tolerance of the Zeno time (s).
    pub(super) tolerance: f64,
    /// Longest time between two looks (s).
    pub(super) max_step: f64,
}

impl Lookahead<'_> {
    /// The first arc at which the force is known to make another motion; none if it makes that of
    /// the tail. One that did so before, `suspect`, is looked at first.
    pub(super) fn obstacle<E, F: Force<E>>(
        &self,
        suspect: Option<Obstacle>,
        force: &mut Counted<'_, F>,
    ) -> Result<Option<Obstacle>, Failure<E>> {
        let (zeno, most) = (self.tail.zeno_time(), MOST * self.tolerance);
        if let Some(last) = suspect {
            let patience = last.patience.saturating_sub(1);
            if let Some(arc) = self.tail.arc_at(0.5 * (last.from + last.to)) {
                let shift = self.shift(&arc, PANELS, force)?;
                if shift.is_nan() || shift > most {
                    return Ok(Some(Obstacle { from: arc.start, to: arc.end, patience }));
                }
            }
            if last.patience > 0 {
                return Ok(Some(Obstacle { patience, ..last }));
            }
        }
        let before = force.count();
        let whole = zeno - self.tail.start();
        let (mut shift, mut m) = (0.0, 0);
        while let Some(arc) = self.tail.arc(m).filter(|arc| zeno - arc.start > most) {
            let (panels, arcs) = self.closeness(&arc, (zeno - arc.start) / whole);
            shift += arcs as f64 * self.shift(&arc, panels, force)?;
            if shift.is_nan() || shift > most {
                let patience = (force.count() - before) / PER_IMPACT;
                return Ok(Some(Obstacle { from: arc.start, to: arc.end, patience }));
            }
            m += arcs;
        }
        let pulled = match force.at_wall(zeno) {
            Err(Failure::Status(_)) => false,
            pull => pull? <= 0.0,
        };
        Ok((!pulled).then_some(Obstacle { from: zeno, to: zeno, patience: 0 }))
    }

    /// How closely to look at an arc when a part `left` of the tail is left: in how many panels,
    /// and for how many arcs it stands.
    fn closeness(&self, arc: &TailArc, left: f64) -> (usize, usize) {
        let h = arc.end - arc.start;
        let panels = (GAUSS * h / self.max_step).ceil().max(1.0) as usize;
        if left > CLOSE {
            return (panels.max(PANELS), 1);
        }
        if left > SPARSE {
            return (panels, 1);
        }
        let arcs = LASTING.ln() / self.e.ln();
        (panels, arcs.min(self.max_step / h).max(1.0).round() as usize)
    }

    /// As [`Self::deviation`]; NaN where the force is not finite.
    fn shift<E, F: Force<E>>(
        &self,
        arc: &TailArc,
        panels: usize,
        force: &mut Counted<'_, F>,
    ) -> Result<f64, Failure<E>> {
        match self.deviation(arc, panels, force) {
            Err(Failure::Status(_)) => Ok(f64::NAN),
            shift => Ok(shift?.abs()),
        }
    }

    /// By how much the residual on an arc moves the Zeno point, equation (2).
    fn deviation<E, F: Force<E>>(
        &self,
        arc: &TailArc,
        panels: usize,
        force: &mut Counted<'_, F>,
    ) -> Result<f64, Failure<E>> {
        let h = arc.end - arc.start;
        let parts = panels as f64;
        let (mut impulse, mut moment) = (0.0, 0.0);
        for panel in 0..panels {
            for side in [-GAUSS, GAUSS] {
                let theta = (panel as f64 + 0.5 + 0.5 * side) / parts;
                let t = arc.start + theta * h;
                let at = arc.at(t);
                let r = force.at(t, at.x, at.xdot)? - arc.acceleration(t);
                impulse += r;
                moment += r * (1.0 - theta) * h;
            }
        }
        let weight = 0.5 * h / parts;
        let (u, w) = (arc.u, -arc.incoming);
        let g = (u + w) / h;
        let dt = weight * moment / w;
        let du = self.e * (g * dt - weight * impulse);
        Ok(dt + 2.0 * du / (g * (1.0 - self.e)))
    }
}
