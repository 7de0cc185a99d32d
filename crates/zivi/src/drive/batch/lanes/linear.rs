//! Masses on springs and dampers: the force at the end of a step depends on where it ends.
//!
//! The first two trials of [`crate::stepping::implicit`], of which one is the force in nearly every
//! step: within a pattern the mismatch is linear in the trial, and its slope is known from the step
//! that entered the pattern.

use pulp::Simd;

use crate::stepping::implicit::{ImplicitForce, TOLERANCE};
use crate::Force;

use super::flight::{vectors, vectors_mut, Common, FlyingMasses, Lane, Lanes, WIDTH};
use super::law::StepLaw;
use crate::drive::batch::lanes::law::{Mass, OneByOne, Waves};
use crate::drive::batch::Stopped;

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
