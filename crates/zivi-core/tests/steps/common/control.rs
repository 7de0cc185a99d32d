//! The tracker's step as the tests see it: three draws, and its equations written a second time.

use zivi_core::control::tracking::{Target, Tracking, TrackingStep};
use zivi_core::control::Gains;
use zivi_core::{Lifted, Restitution};

use super::Rng;

/// A step of the plant to be solved.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Instance {
    pub(crate) step: TrackingStep,
    pub(crate) z: Lifted,
    pub(crate) f: f64,
    pub(crate) target: Target,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Draw {
    /// Plant and reference anywhere.
    Wide,
    /// Both within a few steps of the wall and of each other.
    Near,
    /// The plant crosses the wall within the step.
    Crossing,
}

pub(crate) const DRAWS: [Draw; 3] = [Draw::Wide, Draw::Near, Draw::Crossing];

/// Gains within the stability condition for a bound of the force, a force within that bound.
pub(crate) fn stable(rng: &Rng) -> (Gains, f64) {
    let bound = rng.log_between(1e-2, 1e2);
    let mu2 = bound * (1.0 + rng.log_between(1e-3, 10.0));
    let mu1 = (mu2 + bound) * (1.0 + rng.log_between(1e-3, 10.0));
    let gains = Gains::new(mu1, mu2).expect("stable by construction");
    (gains, rng.between(-bound, bound))
}

pub(crate) fn random_wall(rng: &Rng) -> Restitution {
    Restitution::from_kappa(rng.between(0.01, 0.99)).expect("in range")
}

pub(crate) fn signed(rng: &Rng, low: f64, high: f64) -> f64 {
    rng.sign() * rng.log_between(low, high)
}

impl Instance {
    pub(crate) fn draw(rng: &Rng, kind: Draw) -> Self {
        let (gains, f) = stable(rng);
        let step =
            TrackingStep { h: rng.log_between(1e-5, 1e-1), restitution: random_wall(rng), gains };
        let acceleration = signed(rng, 1e-3, 1e2);
        let reach = step.h * step.gains.mu1();
        let (z, end) = match kind {
            Draw::Wide => {
                let state = || Lifted { s: signed(rng, 1e-12, 1e3), v: signed(rng, 1e-12, 1e3) };
                (state(), state())
            }
            Draw::Near => {
                let small =
                    |unit: f64| if rng.chance(0.1) { 0.0 } else { unit * signed(rng, 1e-4, 10.0) };
                let z = Lifted { s: small(step.h * reach), v: small(reach) };
                (z, Lifted { s: z.s + small(step.h * reach), v: z.v + small(reach) })
            }
            Draw::Crossing => {
                let v = signed(rng, 1e-3, 1e2);
                let s = v * step.h;
                let z = Lifted { s: -s * rng.between(0.0, 2.0), v };
                (z, Lifted { s: s * rng.between(-2.0, 2.0), v: v * rng.between(-1.5, 1.5) })
            }
        };
        Instance { step, z, f, target: Target { end, acceleration } }
    }

    /// The same with each of `s, v, s_r+, v_r+` set to exactly zero with this probability.
    pub(crate) fn with_zeros(self, rng: &Rng, probability: f64) -> Self {
        let kept = |value: f64| if rng.chance(probability) { 0.0 } else { value };
        let some = |z: Lifted| Lifted { s: kept(z.s), v: kept(z.v) };
        let target = Target { end: some(self.target.end), ..self.target };
        Instance { z: some(self.z), target, ..self }
    }

    /// `(s, v, s_r, v_r, A) -> -(s, v, s_r, v_r, A)`.
    pub(crate) fn mirrored(self) -> Self {
        let mirror = |z: Lifted| Lifted { s: -z.s, v: -z.v };
        let Target { end, acceleration } = self.target;
        let target = Target { end: mirror(end), acceleration: -acceleration };
        Instance { z: mirror(self.z), target, ..self }
    }

    pub(crate) fn solve(&self) -> Tracking {
        self.step.solve(self.z, self.f, self.target)
    }

    /// The end of the step for these signs, `(s+, v+)`, and the magnitudes of their terms.
    ///
    /// ```text
    /// v+ = v + h [ ls^2 (A - mu1 les - mu2 lev) + ls (1 - ls^2) F/R ]     s+ = s + h R v+
    /// ```
    pub(crate) fn end(&self, [ls, lv, les, lev]: [f64; 4]) -> ([f64; 2], [f64; 2]) {
        let TrackingStep { h, restitution, gains } = self.step;
        let r = 1.0 - restitution.kappa() * ls * lv;
        let terms = [
            self.z.v,
            h * ls * ls * self.target.acceleration,
            -h * ls * ls * gains.mu1() * les,
            -h * ls * ls * gains.mu2() * lev,
            h * ls * (1.0 - ls * ls) * self.f / r,
        ];
        let v: f64 = terms.iter().sum();
        let of_v: f64 = terms.iter().map(|it| it.abs()).sum();
        ([self.z.s + h * r * v, v], [self.z.s.abs() + h * r * of_v, of_v])
    }

    /// The natural residual of the four inclusions, each divided by the magnitude of its terms.
    pub(crate) fn residual(&self, signs: [f64; 4]) -> f64 {
        let ([s, v], [of_s, of_v]) = self.end(signs);
        let aim = self.target.end;
        let rows = [
            (s, of_s),
            (v, of_v),
            (s - aim.s, of_s + aim.s.abs()),
            (v - aim.v, of_v + aim.v.abs()),
        ];
        let mut worst = 0.0;
        for ((row, terms), sign) in rows.into_iter().zip(signs) {
            // sign in sgn(row): 0 between what the row says and the ends of the box
            let towards = if terms == 0.0 { 0.0 } else { -row / terms };
            let misfit = (sign - 1.0).max((sign + 1.0).min(towards)).abs();
            worst = if misfit > worst || misfit.is_nan() { misfit } else { worst };
        }
        worst
    }
}

pub(crate) fn signs(it: &Tracking) -> [f64; 4] {
    [it.lambda_s, it.lambda_v, it.lambda_es, it.lambda_ev]
}
