//! The covariance of `(x, x', d, e)`: ten numbers, and their propagation through flights, impacts,
//! rest and measurements.

use crate::real::sqrt;
use crate::Real;

/// A symmetric 4 x 4 matrix; where `e` is not learnt its row and column are 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Covariance {
    /// Variance of `x` (m^2).
    pub xx: Real,
    /// Covariance of `x` and `x'` (m^2/s).
    pub xv: Real,
    /// Covariance of `x` and `d` (m^2/s^2).
    pub xd: Real,
    /// Variance of `x'` (m^2/s^2).
    pub vv: Real,
    /// Covariance of `x'` and `d` (m^2/s^3).
    pub vd: Real,
    /// Variance of `d` (m^2/s^4).
    pub dd: Real,
    /// Covariance of `x` and `e` (m).
    pub xe: Real,
    /// Covariance of `x'` and `e` (m/s).
    pub ve: Real,
    /// Covariance of `d` and `e` (m/s^2).
    pub de: Real,
    /// Variance of `e`.
    pub ee: Real,
}

/// A variance `a^T P a`, below 0 by rounding alone: the true one is not, and 0 is nearer to it. (NaN
/// stays: `max` would hide an overflow.)
#[inline]
fn not_negative(variance: Real) -> Real {
    if variance < 0.0 {
        0.0
    } else {
        variance
    }
}

impl Covariance {
    /// No correlations, and nothing unknown of `e`.
    pub(super) fn diagonal([xx, vv, dd]: [Real; 3]) -> Self {
        Self { xx, vv, dd, ..Self::default() }
    }

    /// The rows of the matrix.
    #[must_use]
    pub fn rows(&self) -> [[Real; 4]; 4] {
        let Self { xx, xv, xd, vv, vd, dd, xe, ve, de, ee } = *self;
        [[xx, xv, xd, xe], [xv, vv, vd, ve], [xd, vd, dd, de], [xe, ve, de, ee]]
    }

    /// `A P A^T` of a flight of `t` seconds, `A = [[1, t, t^2/2], [0, 1, t], [0, 0, 1]]`.
    pub(super) fn fly(&mut self, t: Real) {
        let Self { xx, xv, xd, vv, vd, dd, ve, de, .. } = *self;
        self.vd = vd + t * dd;
        self.vv = not_negative(vv + t * (vd + self.vd));
        self.xd = xd + t * (vd + 0.5 * t * dd);
        self.xv = xv + t * (vv + xd + t * (1.5 * vd + 0.5 * t * dd));
        self.xx = not_negative(xx + t * (2.0 * xv + t * (vv + xd + t * (vd + 0.25 * t * dd))));
        self.xe += t * (ve + 0.5 * t * de);
        self.ve += t * de;
    }

    /// `Xi P Xi^T` of an impact, `Xi = [[-e, 0, 0, 0], [k, -e, 0, w], [0, 0, 1, 0], [0, 0, 0, 1]]`,
    /// with `k = (1 + e) a/v-`, the change of the velocity with the place of the state before it,
    /// and `w = -v-`, its change with `e`.
    pub(super) fn bounce(&mut self, e: Real, k: Real, w: Real) {
        let Self { xx, xv, xd, vv, vd, xe, ve, de, ee, .. } = *self;
        // the velocity's row with x, v, d and e before
        let (of_x, of_v) = (k * xx - e * xv + w * xe, k * xv - e * vv + w * ve);
        let (of_d, of_e) = (k * xd - e * vd + w * de, k * xe - e * ve + w * ee);
        self.xx = e * e * xx;
        self.xv = -e * of_x;
        self.xd = -e * xd;
        self.xe = -e * xe;
        self.vv = not_negative(k * of_x - e * of_v + w * of_e);
        (self.vd, self.ve) = (of_d, of_e);
    }

    /// Rest: nothing is left but what is unknown of `d` and `e`.
    pub(super) fn rest(&mut self) {
        let Self { dd, de, ee, .. } = *self;
        *self = Self { dd, de, ee, ..Self::default() };
    }

    /// The variance of `d` cut to `most`, its correlations kept.
    pub(super) fn bound_d(&mut self, most: Real) {
        if self.dd > most {
            let share = sqrt(most / self.dd);
            self.dd = most;
            self.xd *= share;
            self.vd *= share;
            self.de *= share;
        }
    }

    /// The same of `x'`.
    pub(super) fn bound_v(&mut self, most: Real) {
        if self.vv > most {
            let share = sqrt(most / self.vv);
            self.vv = most;
            self.xv *= share;
            self.vd *= share;
            self.ve *= share;
        }
    }

    /// A measurement of `x` with this variance: its gains.
    pub(super) fn measure_x(&mut self, variance: Real) -> [Real; 4] {
        let Self { xx, xv, xd, xe, .. } = *self;
        let total = xx + variance;
        let gain = [xx / total, xv / total, xd / total, xe / total];
        let left = variance / total;
        let [_, of_v, of_d, of_e] = gain;
        self.xx = left * xx;
        self.xv = left * xv;
        self.xd = left * xd;
        self.xe = left * xe;
        self.vv = (self.vv - of_v * xv).max(0.0);
        self.vd -= of_v * xd;
        self.ve -= of_v * xe;
        self.dd = (self.dd - of_d * xd).max(0.0);
        self.de -= of_d * xe;
        self.ee = (self.ee - of_e * xe).max(0.0);
        gain
    }

    /// The same of `x'`.
    pub(super) fn measure_v(&mut self, variance: Real) -> [Real; 4] {
        let Self { xv, vv, vd, ve, .. } = *self;
        let total = vv + variance;
        let gain = [xv / total, vv / total, vd / total, ve / total];
        let left = variance / total;
        let [of_x, _, of_d, of_e] = gain;
        self.vv = left * vv;
        self.xv = left * xv;
        self.vd = left * vd;
        self.ve = left * ve;
        self.xx = (self.xx - of_x * xv).max(0.0);
        self.xd -= of_x * vd;
        self.xe -= of_x * ve;
        self.dd = (self.dd - of_d * vd).max(0.0);
        self.de -= of_d * ve;
        self.ee = (self.ee - of_e * ve).max(0.0);
        gain
    }

    /// (One by one: an array of them would lie on the stack of a target.)
    pub(super) fn is_finite(&self) -> bool {
        let Self { xx, xv, xd, vv, vd, dd, xe, ve, de, ee } = *self;
        let of_motion = xx.is_finite() && xv.is_finite() && xd.is_finite();
        let of_force = vv.is_finite() && vd.is_finite() && dd.is_finite();
        let of_e = xe.is_finite() && ve.is_finite() && de.is_finite() && ee.is_finite();
        of_motion && of_force && of_e
    }
}

// The last positions that were measured, and the line through those of them that agree: how the
// filter starts without a velocity, and again when it has lost the mass.
//
// In flight under the acceleration `a` a position of age `tau` is
//
// ```text
// x_i = x - x' tau_i + c_i      c_i <- c_i + a dt tau_i + a dt^2/2,  tau_i <- tau_i + dt
// ```
//
// so that `y_i = x_i - c_i` lie on a line; an error `delta` of `a` bends it by `delta tau^2/2`.

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

#[cfg(test)]
mod tests {
    use super::*;

    /// A state of which one combination is known exactly: `P = a a^T`, which a flight or an impact
    /// that measures this combination reduces to rounding.
    #[test]
    fn variances_are_never_negative() {
        let mut below = 0;
        for k in 1..200 {
            let [x, v, d]: [Real; 3] = [0.7, -1.3, 2.9].map(|it: Real| it / k as Real);
            let known = || Covariance {
                xx: x * x,
                xv: x * v,
                xd: x * d,
                vv: v * v,
                vd: v * d,
                dd: d * d,
                ..Covariance::default()
            };
            // the velocity v + t d, and then the position, vanish
            let mut it = known();
            let t = -v / d;
            it.fly(t);
            below += u32::from(v * v + t * (v * d + (v * d + t * (d * d))) < 0.0);
            assert!(it.vv >= 0.0 && it.xx >= 0.0, "{it:?}");
            let mut it = known();
            let root = (-v + sqrt(v * v + 2.0 * x * d.abs())) / d;
            it.fly(root);
            assert!(it.vv >= 0.0 && it.xx >= 0.0, "{it:?}");
            // the velocity k x - e v after an impact vanishes
            let mut it = known();
            it.bounce(0.6, 0.6 * v / x, 0.0);
            assert!(it.vv >= 0.0 && it.xx >= 0.0, "{it:?}");
        }
        assert!(below > 10, "no case in which rounding matters: {below}");
    }

    #[test]
    fn an_overflow_stays_visible() {
        let mut it = Covariance::diagonal([1.0, Real::MAX, Real::MAX]);
        it.fly(Real::MAX);
        assert!(!it.is_finite());
    }
}
