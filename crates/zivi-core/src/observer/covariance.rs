//! The covariance of `(x, x', d, e)`: ten numbers, and what a flight, an impact, rest and a
//! measurement make of them.

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
        self.vv = vv + t * (vd + self.vd);
        self.xd = xd + t * (vd + 0.5 * t * dd);
        self.xv = xv + t * (vv + xd + t * (1.5 * vd + 0.5 * t * dd));
        self.xx = xx + t * (2.0 * xv + t * (vv + xd + t * (vd + 0.25 * t * dd)));
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
        self.vv = k * of_x - e * of_v + w * of_e;
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
