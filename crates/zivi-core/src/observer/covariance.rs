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
