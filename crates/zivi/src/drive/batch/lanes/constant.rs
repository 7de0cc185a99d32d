//! Masses under constants: all that a step takes of the force is known before the first.

use pulp::Simd;

use crate::Force;

use super::flight::{vectors, vectors_mut, Common, Lane, Lanes, HUGE, MARGIN, WIDTH};
use super::law::StepLaw;
use crate::drive::batch::lanes::law::OneByOne;
use crate::drive::batch::Stopped;

#[repr(C, align(64))] // lanes begin where vectors of the machine do
pub(super) struct Constant {
    /// `h (1 - kappa)` and `h (1 + kappa)`.
    reach: [Lane; 2],
    /// `h f/(1 - kappa)` and `h f/(1 + kappa)`.
    kick: [Lane; 2],
    /// `theta h^2 f`.
    drop: Lane,
    /// Below this end of a step, infinite where none is everyday, the wall is near.
    least: Lane,
    /// Half of the velocity that would turn the mass, in the direction of the force, and its size.
    shift: Lane,
    half: Lane,
    /// Steps of the run.
    n_steps: f64,
}

impl Constant {
    pub(super) fn over(n_steps: usize) -> Self {
        let zero = [0.0; WIDTH];
        Self {
            reach: [zero; 2],
            kick: [zero; 2],
            drop: zero,
            least: [f64::INFINITY; WIDTH],
            shift: zero,
            half: zero,
            n_steps: n_steps as f64,
        }
    }
}

impl<F: Force<Stopped>> StepLaw<F> for Constant {
    fn place(&mut self, i: usize, run: &OneByOne<F>, lanes: &Lanes) {
        // a force that has no value says so in the first step
        let push = lanes.h * run.stepper.constant().unwrap_or(f64::NAN);
        for way in [0, 1] {
            self.reach[way][i] = lanes.h * lanes.r[way][i];
            self.kick[way][i] = push * lanes.inverse_r[way][i];
        }
        self.drop[i] = lanes.theta * lanes.h * push;
        self.shift[i] = 0.5 * lanes.turn[i] * push;
        self.half[i] = self.shift[i].abs();
        // whatever the steps of the run add is a number
        let fastest = lanes.v[i].abs() + self.n_steps * self.kick[0][i].abs();
        let in_one_step = lanes.h * (lanes.r[1][i] * fastest + push.abs());
        let bounded = fastest + lanes.s[i] + self.n_steps * in_one_step < HUGE;
        let everyday = bounded && lanes.busy[i] != 0.0;
        // pressed, the end of the step is off the wall; pulled, so is that without the force, by all
        // that the force can do
        let pulled = if push > 0.0 { self.drop[i] + lanes.h * push } else { 0.0 };
        let least = pulled + MARGIN * (self.drop[i].abs() + pulled);
        self.least[i] = if everyday { least } else { f64::INFINITY };
    }

    fn tell(&self, _: usize, _: &mut OneByOne<F>) {}

    #[inline(always)]
    fn begin(&mut self, _: f64, _: &mut [OneByOne<F>]) {}

    #[inline(always)]
    fn everyday<S: Simd>(&mut self, simd: S, lanes: &mut Lanes, n: usize, hard: &mut Lane) -> bool {
        let of = Common::of(simd, lanes);
        let mut any = of.zero;
        let Lanes { s, v, busy, .. } = lanes;
        let (s, v) = (vectors_mut(simd, s), vectors_mut(simd, v));
        let [reach_out, reach_in] = self.reach.each_ref().map(|lane| vectors(simd, lane));
        let [kick_out, kick_in] = self.kick.each_ref().map(|lane| vectors(simd, lane));
        let (drop, least) = (vectors(simd, &self.drop), vectors(simd, &self.least));
        let (shift, half) = (vectors(simd, &self.shift), vectors(simd, &self.half));
        let (busy, hard) = (vectors(simd, busy), vectors_mut(simd, hard));
        let margin = simd.splat_f64s(MARGIN);
        for i in 0..n {
            let (from_s, from_v) = (s[i], v[i]);
            let inward = simd.less_than_f64s(from_v, of.zero);
            let reach = simd.select_f64s(inward, reach_in[i], reach_out[i]);
            let kick = simd.select_f64s(inward, kick_in[i], kick_out[i]);
            let change = simd.add_f64s(simd.mul_f64s(reach, from_v), drop[i]);
            let (end_s, end_v) = (simd.add_f64s(from_s, change), simd.add_f64s(from_v, kick));
            // only for a comparison with room to spare: it may be fused
            let floor = simd.mul_add_e_f64s(margin, from_s, least[i]);
            // v f > 0 or |v| beyond what turns it
            let shifted = simd.abs_f64s(simd.add_f64s(from_v, shift[i]));
            let flies = simd.and_m64s(
                simd.greater_than_f64s(end_s, floor),
                simd.greater_than_f64s(shifted, half[i]),
            );
            s[i] = simd.select_f64s(flies, end_s, from_s);
            v[i] = simd.select_f64s(flies, end_v, from_v);
            // what rests is not busy
            hard[i] = simd.select_f64s(flies, of.zero, busy[i]);
            any = simd.or_f64s(any, hard[i]);
        }
        simd.first_true_m64s(simd.greater_than_f64s(any, of.zero)) < S::F64_LANES
    }

    fn nfev(&self, _: usize, _: &OneByOne<F>, _: u64) -> u64 {
        1
    }
}
