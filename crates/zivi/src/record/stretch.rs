//! A step of fixed length and the motion within it.

use zivi_core::{transform, Lifted, Physical, Restitution};

/// An end of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Knot {
    /// Time (s).
    pub t: f64,
    /// The state.
    pub state: Physical,
    /// Its image.
    pub z: Lifted,
}

/// What is linear within a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Interpolation {
    /// `s` and `v`, which are projected.
    Lifted(Restitution),
    /// `x` and `x'`, for a scheme that may go behind the wall.
    Physical,
}

/// A step and the motion within it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stretch {
    /// Its start.
    pub from: Knot,
    /// Its end.
    pub to: Knot,
    /// The motion between them.
    pub interpolation: Interpolation,
}

impl Stretch {
    /// A quantity that goes linearly from `start` to `end`.
    fn linear(&self, t: f64, start: f64, end: f64) -> f64 {
        let (from, to) = (self.from.t, self.to.t);
        if t == from {
            start
        } else if t == to {
            end
        } else {
            (end - start) / (to - from) * (t - from) + start
        }
    }

    pub(crate) fn z(&self, t: f64) -> Lifted {
        let (from, to) = (self.from.z, self.to.z);
        Lifted { s: self.linear(t, from.s, to.s), v: self.linear(t, from.v, to.v) }
    }

    /// The state at a time within the step, after the impact where there is one.
    pub(crate) fn at(&self, t: f64) -> Physical {
        let (from, to) = (self.from.state, self.to.state);
        match self.interpolation {
            Interpolation::Lifted(restitution) => transform::project(self.z(t), restitution),
            Interpolation::Physical => Physical {
                x: self.linear(t, from.x, to.x),
                xdot: self.linear(t, from.xdot, to.xdot),
            },
        }
    }

    /// Where `s` changes its sign within the step.
    pub(crate) fn crossing(&self) -> Option<f64> {
        let (start, end) = (self.from.z.s, self.to.z.s);
        let crosses = (start < 0.0 && end > 0.0) || (start > 0.0 && end < 0.0);
        let (from, to) = (self.from.t, self.to.t);
        crosses.then(|| from + (to - from) / (1.0 - end / start))
    }

    /// Where the functions are looked at: at the wall, if it is met within the step (rounding may
    /// put that at one of its ends), and at the end.
    pub(crate) fn looks(&self) -> impl Iterator<Item = (f64, Physical)> {
        let wall = self.crossing().map(|t| (t, Physical { x: 0.0, ..self.at(t) }));
        wall.into_iter().chain(Some((self.to.t, self.to.state)))
    }
}
