//! The covariance of `(x, x', d)`: six numbers, and what a flight, an impact, rest and a
//! measurement make of them.

/// A symmetric 3 x 3 matrix.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Covariance {
    /// Variance of `x` (m^2).
    pub xx: f64,
    /// Covariance of `x` and `x'` (m^2/s).
    pub xv: f64,
    /// Covariance of `x` and `d` (m^2/s^2).
    pub xd: f64,
    /// Variance of `x'` (m^2/s^2).
    pub vv: f64,
    /// Covariance of `x'` and `d` (m^2/s^3).
    pub vd: f64,
    /// Variance of `d` (m^2/s^4).
    pub dd: f64,
}

impl Covariance {
    /// No correlations.
    pub(super) fn diagonal([xx, vv, dd]: [f64; 3]) -> Self {
        Self { xx, vv, dd, ..Self::default() }
    }

    /// The rows of the matrix.
    #[must_use]
    pub fn rows(&self) -> [[f64; 3]; 3] {
        let Self { xx, xv, xd, vv, vd, dd } = *self;
        [[xx, xv, xd], [xv, vv, vd], [xd, vd, dd]]
    }

    /// `A P A^T` of a flight of `t` seconds, `A = [[1, t, t^2/2], [0, 1, t], [0, 0, 1]]`.
    pub(super) fn fly(&mut self, t: f64) {
        let Self { xx, xv, xd, vv, vd, dd } = *self;
        self.vd = vd + t * dd;
        self.vv = vv + t * (vd + self.vd);
        self.xd = xd + t * (vd + 0.5 * t * dd);
        self.xv = xv + t * (vv + xd + t * (1.5 * vd + 0.5 * t * dd));
        self.xx = xx + t * (2.0 * xv + t * (vv + xd + t * (vd + 0.25 * t * dd)));
    }

    /// `Xi P Xi^T` of an impact, `Xi = [[-e, 0, 0], [k, -e, 0], [0, 0, 1]]`, with `k` =
    /// `(1 + e) a/v-`, the change of the velocity with the place of the state before it.
    pub(super) fn bounce(&mut self, e: f64, k: f64) {
        let Self { xx, xv, xd, vv, vd, .. } = *self;
        self.xx = e * e * xx;
        self.xv = e * (e * xv - k * xx);
        self.xd = -e * xd;
        self.vv = k * (k * xx - 2.0 * e * xv) + e * e * vv;
        self.vd = k * xd - e * vd;
    }

    /// Rest: nothing is left but what is unknown of `d`.
    pub(super) fn rest(&mut self) {
        *self = Self::diagonal([0.0, 0.0, self.dd]);
    }

    /// The variance of `d` cut to `most`, its correlations kept.
    pub(super) fn bound_d(&mut self, most: f64) {
        if self.dd > most {
            let share = libm::sqrt(most / self.dd);
            self.dd = most;
            self.xd *= share;
            self.vd *= share;
        }
    }

    /// The same of `x'`.
    pub(super) fn bound_v(&mut self, most: f64) {
        if self.vv > most {
            let share = libm::sqrt(most / self.vv);
            self.vv = most;
            self.xv *= share;
            self.vd *= share;
        }
    }

    /// A measurement of `x` with this variance: its gains and the variance of its innovation.
    pub(super) fn measure_x(&mut self, variance: f64) -> ([f64; 3], f64) {
        let Self { xx, xv, xd, .. } = *self;
        let total = xx + variance;
        let (gain, left) = ([xx / total, xv / total, xd / total], variance / total);
        let [_, of_v, of_d] = gain;
        self.xx = left * xx;
        self.xv = left * xv;
        self.xd = left * xd;
        self.vv = (self.vv - of_v * xv).max(0.0);
        self.vd -= of_v * xd;
        self.dd = (self.dd - of_d * xd).max(0.0);
        (gain, total)
    }

    /// The same of `x'`.
    pub(super) fn measure_v(&mut self, variance: f64) -> ([f64; 3], f64) {
        let Self { xv, vv, vd, .. } = *self;
        let total = vv + variance;
        let (gain, left) = ([xv / total, vv / total, vd / total], variance / total);
        let [of_x, _, of_d] = gain;
        self.vv = left * vv;
        self.xv = left * xv;
        self.vd = left * vd;
        self.xx = (self.xx - of_x * xv).max(0.0);
        self.xd -= of_x * vd;
        self.dd = (self.dd - of_d * vd).max(0.0);
        (gain, total)
    }

    pub(super) fn is_finite(&self) -> bool {
        let Self { xx, xv, xd, vv, vd, dd } = *self;
        [xx, xv, xd, vv, vd, dd].iter().all(|it| it.is_finite())
    }
}
