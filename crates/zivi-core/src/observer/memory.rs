//! The last positions that were measured, and the line through those of them that agree: how the
//! filter starts without a velocity, and again when it has lost the mass.
//!
//! In flight under the acceleration `a` a position of age `tau` is
//!
//! ```text
//! x_i = x - x' tau_i + c_i      c_i <- c_i + a dt tau_i + a dt^2/2,  tau_i <- tau_i + dt
//! ```
//!
//! so that `y_i = x_i - c_i` lie on a line; an error `delta` of `a` bends it by `delta tau^2/2`.

use crate::real::sqrt;
use crate::Real;

/// Positions that are kept.
pub const REMEMBERED: usize = 6;
/// So many must agree, and all but two of those that there are.
const AGREEING: u32 = 4;
/// Positions agree within this number of standard deviations plus the effect of the unknown force.
const WITHIN: Real = 4.0;

/// Which of the positions are meant.
pub(super) type Chosen = [bool; REMEMBERED];

/// The last two.
pub(super) const THE_LAST_TWO: Chosen = [true, true, false, false, false, false];

/// A position that was measured.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Seen {
    /// `y`: the distance from the wall, less what the acceleration has moved the mass since (m).
    pub y: Real,
    /// Time since (s).
    pub age: Real,
}

/// The last positions, the newest first. (In columns, short enough to be copied without a call.)
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Memory {
    /// Positions, see [`Seen`] (m).
    pub y: [Real; REMEMBERED],
    /// Times since (s).
    pub age: [Real; REMEMBERED],
    /// How many there are.
    pub count: u32,
}

impl Memory {
    /// The positions that there are, the newest first.
    pub fn seen(&self) -> impl Iterator<Item = Seen> + Clone + '_ {
        let columns = self.y.iter().zip(&self.age).take(self.count as usize);
        columns.map(|(y, age)| Seen { y: *y, age: *age })
    }

    /// `dt` later, under the acceleration `a`.
    pub(super) fn pass(&mut self, dt: Real, a: Real) {
        let older = |(y, age): (&mut Real, &mut Real)| {
            *y -= a * dt * (*age + 0.5 * dt);
            *age += dt;
        };
        let count = self.count as usize;
        let all = self.y.iter_mut().zip(&mut self.age);
        // the usual case, several together
        if count == REMEMBERED {
            all.for_each(older);
        } else {
            all.take(count).for_each(older);
        }
    }

    /// A position is measured now.
    pub(super) fn see(&mut self, x: Real) {
        pushed(&mut self.y, x);
        pushed(&mut self.age, 0.0);
        self.count = (self.count + 1).min(REMEMBERED as u32);
    }

    /// The positions that agree with a line within noise and a force up to `dmax`, if there are
    /// enough.
    pub(super) fn consensus(&self, of_x: Real, dmax: Real) -> Option<Chosen> {
        let noise = WITHIN * sqrt(of_x);
        let mut best = Agreement::default();
        for (k, one) in self.seen().enumerate() {
            for other in self.seen().skip(k + 1) {
                let found = self.agreement((one, other), noise, dmax);
                let nearer = found.count == best.count && found.sum < best.sum;
                if found.count > best.count || nearer {
                    best = found;
                }
            }
        }
        (best.count >= AGREEING && best.count + 2 >= self.count).then_some(best.chosen)
    }

    /// The positions that lie near this line. (Out of line: on a target the code of its caller
    /// would be twice as long.)
    #[inline(never)]
    fn agreement(&self, line: Line, noise: Real, dmax: Real) -> Agreement {
        let mut found = Agreement::default();
        for (it, chosen) in self.seen().zip(&mut found.chosen) {
            let distance = off(line, &it);
            *chosen = distance <= noise + bend(line, &it, dmax);
            if *chosen {
                (found.count, found.sum) = (found.count + 1, found.sum + distance);
            }
        }
        found
    }
}

/// The positions near a line, how many, and the sum of their distances (m).
#[derive(Clone, Copy, Default)]
struct Agreement {
    chosen: Chosen,
    count: u32,
    sum: Real,
}

/// In front of the others, the last of which is gone.
fn pushed(column: &mut [Real; REMEMBERED], value: Real) {
    let [a, b, c, d, e, _] = *column;
    *column = [value, a, b, c, d, e];
}

/// Two positions, and the line through them.
type Line = (Seen, Seen);

/// How far a position is off the line through two others.
fn off((one, other): Line, it: &Seen) -> Real {
    let slope = (other.y - one.y) / (other.age - one.age);
    (it.y - one.y - slope * (it.age - one.age)).abs()
}

/// How far an unknown force of `dmax` may bring it off: a parabola through the two.
fn bend((one, other): Line, it: &Seen, dmax: Real) -> Real {
    0.5 * dmax * ((it.age - one.age) * (it.age - other.age)).abs()
}
