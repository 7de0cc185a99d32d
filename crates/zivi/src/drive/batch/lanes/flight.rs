//! States side by side, the end of a step without a branch, and whether it is that of a mass alone.

use pulp::Simd;
use zivi_core::cosine::{cos, turn_into_cosines};
use zivi_core::step::SIGN_TOLERANCE;
use zivi_core::{transform, Branch, Lifted, Physical, Restitution, ThetaGammaStep};

use crate::drive::batch::pool::{Outcome, Saved};
use crate::drive::batch::{Save, Stopped};
use crate::record::events::EventLog;
use crate::stepping::fixed_step::{FixedStep, Start};
use crate::stepping::implicit::{ImplicitForce, TOLERANCE};
use crate::stepping::step_solver::Exact;
use crate::stepping::theta_gamma::ThetaGammaStepper;
use crate::{Failure, Force, Grid, LinearForce, SetupError, Status, Summary};

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

// Masses under constants: all that a step takes of the force is known before the first.

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

// Masses on springs and dampers: the force at the end of a step depends on where it ends.
//
// The first two trials of [`crate::stepping::implicit`], of which one is the force in nearly every
// step: within a pattern the mismatch is linear in the trial, and its slope is known from the step
// that entered the pattern.

#[repr(C, align(64))] // lanes begin where vectors of the machine do
pub(super) struct LinearLanes {
    stiffness: Lane,
    damping: Lane,
    /// Not a number where a mass does not move any more.
    gravity: Lane,
    /// The force of the last step and the slope of its mismatch; no number before the first.
    last: Lane,
    slope: Lane,
    /// Evaluations of the force side by side.
    nfev: Lane,
    waves: Waves,
}

impl LinearLanes {
    pub(super) fn of<F: Force<Stopped>>(masses: &[Mass<F>]) -> Self {
        let forces = || masses.iter().filter_map(|mass| mass.force.as_linear_force());
        let (zero, nan) = ([0.0; WIDTH], [f64::NAN; WIDTH]);
        let mut lanes = Self {
            waves: Waves::of(forces()),
            stiffness: zero,
            damping: zero,
            gravity: nan,
            last: nan,
            slope: nan,
            nfev: zero,
        };
        for (i, force) in forces().enumerate() {
            (lanes.stiffness[i], lanes.damping[i]) = (force.stiffness, force.damping);
            lanes.gravity[i] = force.gravity;
        }
        lanes
    }
}

/// Some masses on springs and dampers, at the start of a step. (Functions and no closures: only what
/// is certainly inlined is compiled for the machine's vectors.)
struct Sprung<S: Simd> {
    flight: FlyingMasses<S>,
    at_origin: S::m64s,
    theta: [S::f64s; 2],
    stiffness: S::f64s,
    damping: S::f64s,
    gravity: S::f64s,
    excitation: S::f64s,
}

/// A trial: `h f`, the end of the step, and the mismatch of the force there.
struct LinearTrial<S: Simd> {
    push: S::f64s,
    end: (S::f64s, S::f64s),
    mismatch: S::f64s,
}

impl<S: Simd> Sprung<S> {
    #[inline(always)]
    fn tried(&self, f: S::f64s) -> LinearTrial<S> {
        let FlyingMasses { of: Common { simd, h, zero, .. }, s, v, r, .. } = self.flight;
        let push = simd.mul_f64s(h, f);
        // what rests stays
        let end = self.flight.end(simd.select_f64s(self.at_origin, zero, push));
        let spring = simd.mul_f64s(self.stiffness, self.at_theta(end.0, s));
        let damper = simd.mul_f64s(self.damping, simd.mul_f64s(r, self.at_theta(end.1, v)));
        let value = simd.sub_f64s(simd.neg_f64s(spring), damper);
        let value = simd.add_f64s(simd.sub_f64s(value, self.gravity), self.excitation);
        LinearTrial { push, end, mismatch: simd.sub_f64s(value, f) }
    }

    #[inline(always)]
    fn at_theta(&self, new: S::f64s, old: S::f64s) -> S::f64s {
        let (simd, [theta, rest]) = (self.flight.of.simd, self.theta);
        simd.add_f64s(simd.mul_f64s(theta, new), simd.mul_f64s(rest, old))
    }

    #[inline(always)]
    fn is_within(&self, mismatch: S::f64s, scale: S::f64s) -> S::m64s {
        let simd = self.flight.of.simd;
        let allowed = simd.mul_f64s(simd.splat_f64s(TOLERANCE), scale);
        simd.less_than_or_equal_f64s(simd.abs_f64s(mismatch), allowed)
    }
}

impl<F: Force<Stopped>> StepLaw<F> for LinearLanes {
    fn place(&mut self, i: usize, run: &OneByOne<F>, _: &Lanes) {
        let ImplicitForce { last, slope, .. } = run.stepper.implicit;
        (self.last[i], self.slope[i]) = (last.unwrap_or(f64::NAN), slope);
        if run.ended.is_some() {
            self.gravity[i] = f64::NAN;
        }
    }

    fn tell(&self, i: usize, run: &mut OneByOne<F>) {
        if !self.last[i].is_nan() {
            run.stepper.implicit.last = Some(self.last[i]);
        }
    }

    #[inline(always)]
    fn begin(&mut self, t: f64, _: &mut [OneByOne<F>]) {
        self.waves.go_to(t);
    }

    #[inline(always)]
    fn everyday<S: Simd>(&mut self, simd: S, lanes: &mut Lanes, n: usize, hard: &mut Lane) -> bool {
        let of = Common::of(simd, lanes);
        let theta = [simd.splat_f64s(lanes.theta), simd.splat_f64s(1.0 - lanes.theta)];
        let (one, two) = (simd.splat_f64s(1.0), simd.splat_f64s(2.0));
        let mut any = of.zero;
        let Lanes { s, v, busy, r, inverse_r, turn, .. } = lanes;
        let (s, v) = (vectors_mut(simd, s), vectors_mut(simd, v));
        let [r_out, r_in] = r.each_ref().map(|lane| vectors(simd, lane));
        let [inverse_out, inverse_in] = inverse_r.each_ref().map(|lane| vectors(simd, lane));
        let turn = vectors(simd, turn);
        let (stiffness, damping) = (vectors(simd, &self.stiffness), vectors(simd, &self.damping));
        let (gravity, slope) = (vectors(simd, &self.gravity), vectors(simd, &self.slope));
        let excitation = vectors(simd, &self.waves.excitation);
        let (last, nfev) = (vectors_mut(simd, &mut self.last), vectors_mut(simd, &mut self.nfev));
        let (busy, hard) = (vectors(simd, busy), vectors_mut(simd, hard));
        for i in 0..n {
            let (r, inverse_r) = ([r_out[i], r_in[i]], [inverse_out[i], inverse_in[i]]);
            let flight = FlyingMasses::from(of, (s[i], v[i]), r, inverse_r, turn[i]);
            let masses = Sprung {
                at_origin: flight.is_at_origin(),
                flight,
                theta,
                stiffness: stiffness[i],
                damping: damping[i],
                gravity: gravity[i],
                excitation: excitation[i],
            };
            let Sprung { ref flight, at_origin, .. } = masses;
            let first = last[i];
            let one_trial = masses.tried(first);
            let second = simd.sub_f64s(first, simd.div_f64s(one_trial.mismatch, slope[i]));
            let two_trials = masses.tried(second);
            let size = simd.abs_f64s(first);
            let at_once = masses.is_within(one_trial.mismatch, size);
            // of the scales by which a run alone judges it the smaller one; and it is within reach of the
            // search, as no slope is below 1e-3
            let then = masses.is_within(two_trials.mismatch, size);
            let found = simd.or_m64s(at_once, then);
            let end = (
                simd.select_f64s(at_once, one_trial.end.0, two_trials.end.0),
                simd.select_f64s(at_once, one_trial.end.1, two_trials.end.1),
            );
            let (push, other) = (one_trial.push, two_trials.push);
            let size = simd.max_f64s(simd.abs_f64s(push), simd.abs_f64s(other));
            let along =
                simd.min_f64s(simd.mul_f64s(flight.v, push), simd.mul_f64s(flight.v, other));
            let stays = flight.stays(size, along, end);
            let pressed = simd.less_than_or_equal_f64s(simd.max_f64s(push, other), of.zero);
            let stays = simd.or_m64s(stays, simd.and_m64s(at_origin, pressed));
            let taken = simd.and_m64s(found, stays);
            s[i] = simd.select_f64s(taken, end.0, flight.s);
            v[i] = simd.select_f64s(taken, end.1, flight.v);
            last[i] = simd.select_f64s(taken, simd.select_f64s(at_once, first, second), first);
            let count = simd.select_f64s(taken, simd.select_f64s(at_once, one, two), of.zero);
            nfev[i] = simd.add_f64s(nfev[i], count);
            hard[i] = simd.select_f64s(taken, of.zero, busy[i]);
            any = simd.or_f64s(any, hard[i]);
        }
        simd.first_true_m64s(simd.greater_than_f64s(any, of.zero)) < S::F64_LANES
    }

    fn nfev(&self, i: usize, run: &OneByOne<F>, _: u64) -> u64 {
        run.stepper.implicit.nfev + self.nfev[i] as u64
    }
}

// Kernels of lanes: common interface, waves, single masses.
//
// Common part of kernels for different forces.

/// The everyday steps under one kind of force.
pub(super) trait StepLaw<F> {
    /// Looks at a mass after a step of its own, and before steps of another size.
    fn place(&mut self, i: usize, run: &OneByOne<F>, lanes: &Lanes);

    /// Tells a mass what the steps side by side have left, before a step of its own.
    fn tell(&self, i: usize, run: &mut OneByOne<F>);

    /// Evaluates what depends on time alone, for the step that takes its force at `t`.
    fn begin(&mut self, t: f64, runs: &mut [OneByOne<F>]);

    /// Takes the everyday steps of the masses in the first `n` vectors; one whose step is `hard` (not
    /// 0) stays. Gives whether there is one. Must be inlined always.
    fn everyday<S: Simd>(&mut self, simd: S, lanes: &mut Lanes, n: usize, hard: &mut Lane) -> bool;

    /// Evaluations of the force in a number of steps.
    fn nfev(&self, i: usize, run: &OneByOne<F>, steps: u64) -> u64;
}

// The excitations of many linear forces at one time.

/// Excitations; masses whose waves have the same frequency and phase share a cosine.
#[repr(C, align(64))] // lanes begin where vectors of the machine do
pub(super) struct Waves {
    amplitude: Lane,
    /// At the last requested time.
    pub(super) excitation: Lane,
    /// Distinct angular frequencies and phases, and the index of each mass.
    omega: Lane,
    phase: Lane,
    different: usize,
    which: [usize; WIDTH],
}

impl Waves {
    pub(super) fn of(forces: impl Iterator<Item = LinearForce>) -> Self {
        let zero = [0.0; WIDTH];
        let mut waves = Self {
            amplitude: zero,
            excitation: zero,
            omega: zero,
            phase: zero,
            different: 0,
            which: [0; WIDTH],
        };
        for (i, LinearForce { amplitude, omega, phase, .. }) in forces.enumerate() {
            // a force without a wave takes part in any other's
            if amplitude != 0.0 {
                let n = waves.different;
                let known = waves.omega[..n].iter().zip(&waves.phase);
                let mut known = known.map(|(omega, phase)| [*omega, *phase]);
                let place = known.position(|angle| angle == [omega, phase]).unwrap_or(n);
                (waves.omega[place], waves.phase[place]) = (omega, phase);
                waves.different = n.max(place + 1);
                (waves.amplitude[i], waves.which[i]) = (amplitude, place);
            }
        }
        waves
    }

    /// Goes to a time.
    #[inline(always)]
    pub(super) fn go_to(&mut self, t: f64) {
        if self.different <= 1 {
            // none: times no amplitude
            let cosine = cos(self.omega[0] * t + self.phase[0]);
            for (it, amplitude) in self.excitation.iter_mut().zip(&self.amplitude) {
                *it = amplitude * cosine;
            }
            return;
        }
        // whole vectors of any machine
        let n = self.different.next_multiple_of(8).min(WIDTH);
        let mut cosines = [0.0; WIDTH];
        let angles = self.omega.iter().zip(&self.phase);
        for (it, (omega, phase)) in cosines[..n].iter_mut().zip(angles) {
            *it = omega * t + phase;
        }
        turn_into_cosines(&mut cosines[..n]);
        for i in 0..WIDTH {
            self.excitation[i] = self.amplitude[i] * cosines[self.which[i]];
        }
    }
}

// One mass of many: its individual steps, and the records of all steps.

/// A mass, its force and where it starts.
#[derive(Clone, Copy, Debug)]
pub(in crate::drive::batch) struct Mass<F> {
    pub(in crate::drive::batch) step: ThetaGammaStep,
    pub(in crate::drive::batch) force: F,
    pub(in crate::drive::batch) initial: Physical,
}

/// Run of one mass outside the kernels.
pub(super) struct OneByOne<F> {
    pub(super) stepper: ThetaGammaStepper<Exact>,
    pub(super) force: F,
    restitution: Restitution,
    log: EventLog,
    pub(super) sigma: f64,
    status: Status,
    /// After how many steps it stopped, if it did.
    pub(super) ended: Option<usize>,
    saved: Saved,
}

impl<F: Force<Stopped>> OneByOne<F> {
    pub(super) fn start(
        mass: Mass<F>,
        z: Lifted,
        grid: Grid,
        save: Save<'_>,
    ) -> Result<Self, SetupError> {
        let Mass { step, force, initial } = mass;
        let restitution = step.restitution();
        let mut run = Self {
            stepper: ThetaGammaStepper::new(step, Exact),
            force,
            restitution,
            log: EventLog::start(grid.t(0), z, initial.arrives(), restitution),
            sigma: transform::side(z, Branch::Positive.sigma()),
            status: Status::Completed,
            ended: None,
            saved: Saved::with_room(save.every(), grid)?,
        };
        run.stepper.evaluate_constant(&mut run.force, grid.t(0));
        if save.every() > 0 {
            run.sample(z);
        }
        Ok(run)
    }

    /// Whether it moves from `z` or may do so: not if it has ended, or rests under a constant.
    pub(super) fn is_busy(&self, z: Lifted) -> bool {
        let rests = z == Lifted::default() && self.stepper.constant().is_some_and(|f| f <= 0.0);
        !rests && self.ended.is_none()
    }

    /// The step after `k` that is not everyday; `None` without one; the mass stops.
    #[cold]
    #[inline(never)]
    pub(super) fn step(&mut self, z: Lifted, k: usize, (t, t_next): (f64, f64)) -> Option<Lifted> {
        let start = Start { t, z, sigma: self.sigma };
        let noted = self.stepper.advance(start, &mut self.force).and_then(|sample| {
            self.log.step((t, z), (t_next, sample.z))?;
            Ok(sample.z)
        });
        match noted {
            Ok(end) => {
                self.sigma = transform::side(end, self.sigma);
                Some(end)
            }
            Err(failure) => {
                self.ended = Some(k);
                self.status = match failure {
                    Failure::Status(status) => status,
                    Failure::Raised(Stopped) => Status::Raised,
                };
                None
            }
        }
    }

    pub(super) fn sample(&mut self, z: Lifted) {
        if self.ended.is_none() {
            let Physical { x, xdot } = transform::project(z, self.restitution);
            self.saved.push(x, xdot);
        }
    }

    pub(super) fn finish(
        self,
        lanes: &Lanes,
        i: usize,
        (grid, k): (Grid, usize),
        nfev: u64,
        save: (Save<'_>, f64),
    ) -> Outcome {
        let Physical { x, xdot } = transform::project(lanes.at(i, self.sigma), self.restitution);
        let (x_max, speed_max) = (lanes.x_max[i], lanes.speed_max[i]);
        let summary = Summary { t: grid.t(self.ended.unwrap_or(k)), x, xdot, x_max, speed_max };
        Outcome::new((self.log.finish(), &[]), self.saved, summary, (self.status, nfev), save)
    }
}
