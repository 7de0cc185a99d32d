//! States side by side, the end of a step without a branch, and whether it is that of a mass alone.

use pulp::Simd;
use zivi_core::step::SIGN_TOLERANCE;
use zivi_core::{Lifted, ThetaGammaStep};

/// Masses that are moved side by side.
pub(in super::super) const WIDTH: usize = 64;

pub(super) type Lane = [f64; WIDTH];

/// Relative distance from a switch from which on a step is everyday without a closer look.
pub(super) const MARGIN: f64 = 100.0 * SIGN_TOLERANCE;
/// Larger states are processed one by one: the square of a speed is a number there.
pub(super) const HUGE: f64 = 1e140;

/// Data of the kernels: states on the branch of the mass. The signs
/// `lambda_s` are all `+1` from there.
#[repr(C, align(64))] // lanes begin where vectors of the machine do
pub(super) struct Lanes {
    /// `|s|` and `v sgn s`.
    pub(super) s: Lane,
    pub(super) v: Lane,
    /// Whether the mass moves or may do so, as `1` or `0`.
    pub(super) busy: Lane,
    /// `1 - kappa` and `1 + kappa`, and their divisors.
    pub(super) r: [Lane; 2],
    pub(super) inverse_r: [Lane; 2],
    /// `gamma/(1 - kappa)`, and more.
    pub(super) turn: Lane,
    /// Largest `|s|` and `|x'|` so far.
    pub(super) x_max: Lane,
    pub(super) speed_max: Lane,
    /// How many masses there are.
    n: usize,
    /// The step, the same for all.
    pub(super) h: f64,
    pub(super) theta: f64,
}

impl Lanes {
    /// Masses that are nowhere yet.
    pub(super) fn of(steps: &[ThetaGammaStep]) -> Self {
        let zero = [0.0; WIDTH];
        let mut lanes = Self {
            s: zero,
            v: zero,
            busy: zero,
            r: [zero; 2],
            inverse_r: [zero; 2],
            turn: zero,
            x_max: zero,
            speed_max: zero,
            n: steps.len(),
            h: 0.0,
            theta: 1.0,
        };
        for (i, step) in steps.iter().enumerate() {
            (lanes.h, lanes.theta) = (step.h(), step.theta());
            for (way, lambda_v) in [1.0, -1.0].into_iter().enumerate() {
                let r = step.restitution().r(1.0, lambda_v);
                lanes.r[way][i] = r;
                lanes.inverse_r[way][i] = 1.0 / r;
            }
            // an apex is accepted where R is beyond its range by twice the tolerance
            let least = lanes.r[0][i] - 4.0 * SIGN_TOLERANCE;
            lanes.turn[i] = (1.0 + MARGIN) * step.gamma() / least;
        }
        lanes
    }

    pub(super) fn any_busy(&self) -> bool {
        self.busy.iter().any(|&busy| busy != 0.0)
    }

    /// How many vectors of the machine they take.
    #[inline(always)]
    pub(super) fn vectors<S: Simd>(&self, _: S) -> usize {
        self.n.div_ceil(S::F64_LANES).min(WIDTH / S::F64_LANES)
    }

    /// The state of a mass that is on this branch.
    pub(super) fn at(&self, i: usize, sigma: f64) -> Lifted {
        // adding 0.0 turns the -0.0 of a mirrored zero into 0.0
        Lifted { s: sigma * self.s[i] + 0.0, v: sigma * self.v[i] + 0.0 }
    }

    /// Places a mass at its state on the branch `sigma`; `busy` if it moves or may do so.
    pub(super) fn place(&mut self, i: usize, z: Lifted, sigma: f64, busy: bool) {
        // no negative zeros
        (self.s[i], self.v[i]) = (sigma * z.s + 0.0, sigma * z.v + 0.0);
        self.busy[i] = f64::from(u8::from(busy));
    }

    #[inline(always)]
    pub(super) fn note_extremes<S: Simd>(&mut self, simd: S) {
        let (zero, n) = (simd.splat_f64s(0.0), self.vectors(simd));
        let (s, v) = (vectors(simd, &self.s), vectors(simd, &self.v));
        let [outward, inward] = self.r.each_ref().map(|lane| vectors(simd, lane));
        let x_max = vectors_mut(simd, &mut self.x_max);
        let speed_max = vectors_mut(simd, &mut self.speed_max);
        for i in 0..n {
            let away = simd.greater_than_f64s(v[i], zero);
            let r = simd.select_f64s(away, outward[i], inward[i]);
            x_max[i] = simd.max_f64s(x_max[i], s[i]);
            speed_max[i] = simd.max_f64s(speed_max[i], simd.mul_f64s(r, simd.abs_f64s(v[i])));
        }
    }
}

/// Quantities of a step common to all masses.
#[derive(Clone, Copy)]
pub(super) struct Common<S: Simd> {
    pub(super) simd: S,
    pub(super) h: S::f64s,
    /// `theta h`.
    pub(super) drop: S::f64s,
    /// 1 less the margin.
    pub(super) near: S::f64s,
    pub(super) huge: S::f64s,
    pub(super) zero: S::f64s,
}

impl<S: Simd> Common<S> {
    #[inline(always)]
    pub(super) fn of(simd: S, &Lanes { h, theta, .. }: &Lanes) -> Self {
        Self {
            simd,
            h: simd.splat_f64s(h),
            drop: simd.splat_f64s(theta * h),
            near: simd.splat_f64s(1.0 - MARGIN),
            huge: simd.splat_f64s(HUGE),
            zero: simd.splat_f64s(0.0),
        }
    }
}

/// Some masses in flight, at the start of a step.
pub(super) struct FlyingMasses<S: Simd> {
    pub(super) of: Common<S>,
    pub(super) s: S::f64s,
    pub(super) v: S::f64s,
    pub(super) r: S::f64s,
    pub(super) inverse_r: S::f64s,
    /// `h R v`.
    pub(super) travel: S::f64s,
    pub(super) turn: S::f64s,
}

impl<S: Simd> FlyingMasses<S> {
    #[inline(always)]
    pub(super) fn from(
        of: Common<S>,
        (s, v): (S::f64s, S::f64s),
        r: [S::f64s; 2],
        inverse_r: [S::f64s; 2],
        turn: S::f64s,
    ) -> Self {
        let simd = of.simd;
        let inward = simd.less_than_f64s(v, of.zero);
        let r = simd.select_f64s(inward, r[1], r[0]);
        let inverse_r = simd.select_f64s(inward, inverse_r[1], inverse_r[0]);
        let travel = simd.mul_f64s(simd.mul_f64s(of.h, r), v);
        Self { of, s, v, r, inverse_r, travel, turn }
    }

    /// The end of the step under `push = h f`, if the signs stay.
    #[inline(always)]
    pub(super) fn end(&self, push: S::f64s) -> (S::f64s, S::f64s) {
        let simd = self.of.simd;
        let drop = simd.mul_f64s(self.of.drop, push);
        let kick = simd.mul_f64s(push, self.inverse_r);
        (simd.add_f64s(self.s, simd.add_f64s(self.travel, drop)), simd.add_f64s(self.v, kick))
    }

    /// How far they stay from the wall without a force, less a margin.
    #[inline(always)]
    pub(super) fn room(&self) -> S::f64s {
        let simd = self.of.simd;
        // only for a comparison with room to spare: it may be fused
        simd.mul_add_e_f64s(self.of.near, self.s, simd.min_f64s(self.travel, self.of.zero))
    }

    /// Whether they stay under every `push` of at most this size, the least `v push` of which is
    /// `along`, and that is the only solution.
    #[inline(always)]
    pub(super) fn stays(
        &self,
        size: S::f64s,
        along: S::f64s,
        (s, v): (S::f64s, S::f64s),
    ) -> S::m64s {
        let Self { of: Common { simd, .. }, .. } = *self;
        let keeps_s = simd.greater_than_f64s(self.room(), simd.mul_f64s(self.of.h, size));
        let turning = simd.mul_f64s(self.turn, size);
        let keeps_v = simd.or_m64s(
            simd.greater_than_f64s(along, self.of.zero),
            simd.greater_than_f64s(simd.abs_f64s(self.v), turning),
        );
        let bounded = simd.less_than_f64s(simd.add_f64s(s, simd.abs_f64s(v)), self.of.huge);
        simd.and_m64s(simd.and_m64s(keeps_s, keeps_v), bounded)
    }

    /// Whether they are at the origin.
    #[inline(always)]
    pub(super) fn is_at_origin(&self) -> S::m64s {
        let simd = self.of.simd;
        let away = simd.add_f64s(self.s, simd.abs_f64s(self.v));
        simd.equal_f64s(away, self.of.zero)
    }
}

/// A lane as the machine's vectors, of which [`WIDTH`] is a multiple.
#[inline(always)]
pub(super) fn vectors<S: Simd>(_: S, lane: &Lane) -> &[S::f64s] {
    S::as_simd_f64s(lane).0
}

#[inline(always)]
pub(super) fn vectors_mut<S: Simd>(_: S, lane: &mut Lane) -> &mut [S::f64s] {
    S::as_mut_simd_f64s(lane).0
}
