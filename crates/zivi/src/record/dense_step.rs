//! A step of fixed length and the motion within it.

use zivi_core::{transform, Lifted, Physical, Restitution};

/// An end of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepEnd {
    /// Time (s).
    pub t: f64,
    /// The state.
    pub state: Physical,
    /// Its image.
    pub z: Lifted,
}

/// Quantity that is linear within a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Interpolation {
    /// `s` and `v`, which are projected.
    Lifted(Restitution),
    /// `x` and `x'`, for a scheme that may penetrate the wall.
    Physical,
}

/// A step and the motion within it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DenseStep {
    /// Its start.
    pub from: StepEnd,
    /// Its end.
    pub to: StepEnd,
    /// The motion between them.
    pub interpolation: Interpolation,
}

impl DenseStep {
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

    /// The state at a time within the step; at an impact, the state after it.
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

    /// Time and state of a sample number, counted from 0: the ends of `looks` equal parts, plus the
    /// wall if met within the step (by rounding possibly at an end).
    pub(crate) fn nth_look(&self, number: usize, looks: usize) -> Option<(f64, Physical)> {
        let (from, to) = (self.from.t, self.to.t);
        let wall = self.crossing();
        let passed = wall.map(|t| ((t - from) / (to - from) * looks as f64) as usize);
        let passed = passed.map(|passed| passed.min(looks - 1));
        if let (Some(t), true) = (wall, passed == Some(number)) {
            return Some((t, Physical { x: 0.0, ..self.at(t) }));
        }
        let part = number + usize::from(passed.is_none_or(|passed| number < passed));
        match part {
            last if last == looks => Some((to, self.to.state)),
            beyond if beyond > looks => None,
            part => {
                let t = from + part as f64 / looks as f64 * (to - from);
                Some((t, self.at(t)))
            }
        }
    }
}
