//! The filter: prediction through impacts and rest, correction within the gate, restart.

use super::{Covariance, Measurement, ObserverSettings, ObserverState};
use crate::observer::covariance::{Chosen, THE_LAST_TWO};
use crate::real::sqrt;
use crate::Real;
use crate::{flight, Physical};

/// Impacts of one period that are followed; a mass that has more is taken to rest.
const MAX_IMPACTS: u32 = 20;
/// The square of the standard deviations at which a measurement is rejected.
const GATE: Real = 25.0;
/// So many rejected in a row restart the filter where the velocity is measured.
const PATIENCE: u32 = 5;
/// Rejections in a row after which consistent positions restart the filter.
const DOUBT: u32 = 3;
/// So many positions do without agreement.
const LOST: u32 = 14;
/// Grazing: the speed in `(1 + e) a/v-` is taken to be at least this part of `h |a|`.
const GRAZING: Real = 0.1;
/// Impacts slower than this multiple of `s_x/h` carry no information about `e`.
const SLOW: Real = 10.0;
/// Process noise of `x` and `x'` per period, relative to `s_x^2` and `(s_x/h)^2`: without it a
/// wrong `e` could never be corrected after a rest.
const FLOOR: [Real; 2] = [1e-10, 1e-12];
/// The same of the variance of a velocity that nothing is known of.
const UNKNOWN_SPEED: Real = 100.0;
/// Deviations of the position within which the energy of the mass is bounded.
const HIGHEST: Real = 6.0;
/// Restitutions that are learnt.
const LEARNT: [Real; 2] = [0.01, 0.999];
/// Largest variance of a restitution.
const UNKNOWN_E: Real = 0.25;

impl ObserverSettings {
    /// This time and this measurement, under a known acceleration.
    pub(super) fn follow(
        &self,
        it: &mut ObserverState,
        dt: Real,
        measured: Option<Measurement>,
        known: Real,
    ) {
        let a = known + it.estimate.d;
        let mut rests = false;
        if it.started {
            it.memory.pass(dt, a);
            rests = self.predict(it, dt, a, velocity_of(measured));
        }
        let Some(measured) = measured else { return };
        it.memory.see(measured.x);
        let ObserverSettings { noise: [of_x, _], dmax, .. } = *self;
        if !it.started || (it.waiting && measured.xdot.is_some()) {
            self.start(it, measured);
        } else if it.waiting {
            it.refit(THE_LAST_TWO, of_x, dmax * dmax);
        } else {
            self.correct(it, measured, a, rests);
        }
    }

    /// At the first measurement of a position or of a velocity.
    fn start(&self, it: &mut ObserverState, Measurement { x, xdot }: Measurement) {
        let ObserverSettings { noise: [of_x, of_v], dmax, .. } = *self;
        let state = Physical { x: x.max(0.0), xdot: xdot.unwrap_or(0.0) };
        let unknown = self.fastest(state, of_x, dmax);
        let of_v = if xdot.is_some() { of_v } else { unknown };
        it.restart(state, Covariance::diagonal([of_x, of_v, dmax * dmax]));
        (it.started, it.waiting) = (true, xdot.is_none());
    }

    /// The variance of a velocity of which only the height is known, up to the variance `of_x`, and
    /// the acceleration: by the energy.
    fn fastest(&self, Physical { x, xdot }: Physical, of_x: Real, a: Real) -> Real {
        let ObserverSettings { noise: [noise, _], h, .. } = *self;
        let highest = x + HIGHEST * sqrt(of_x);
        4.0 * (xdot * xdot + 2.0 * a.abs() * highest) + UNKNOWN_SPEED * noise / (h * h)
    }

    /// The state after `dt` under the acceleration `a`, through impacts and into rest; the measured
    /// velocity then affects its uncertainty. Whether it rests.
    fn predict(&self, it: &mut ObserverState, dt: Real, a: Real, measured: Option<Real>) -> bool {
        let rests = self.move_on(it, dt, a);
        let ObserverSettings { h, q_d, dmax, noise: [of_x, of_v], .. } = *self;
        let (share, [floor_x, floor_v]) = (dt / h, FLOOR);
        it.covariance.xx += floor_x * of_x * share;
        it.covariance.vv += floor_v * of_x / (h * h) * share;
        it.covariance.dd += q_d * share;
        it.covariance.bound_d(dmax * dmax);
        // a sensor that is worse than the motion has its own word
        let sensor = if measured.is_some() { 4.0 * of_v } else { 0.0 };
        // which is the least that the bound can be
        if it.covariance.vv > sensor {
            it.covariance.bound_v(self.fastest(it.estimate.state, it.covariance.xx, a) + sensor);
        }
        rests
    }

    fn move_on(&self, it: &mut ObserverState, dt: Real, a: Real) -> bool {
        let (e, mut left) = (it.e, dt);
        let mut at = it.estimate.state;
        if at.arrives() {
            at = self.bounce(it, at.xdot, a);
        }
        for _ in 0..MAX_IMPACTS {
            let on_the_wall = at.x == 0.0 && a <= 0.0;
            // flights 2v/g, 2ev/g, ... take 2v/(g (1 - e)) in all
            if on_the_wall && 2.0 * at.xdot <= left * (1.0 - e) * -a {
                break;
            }
            match flight::time_to_wall(at, a) {
                Some(t) if t <= left => {
                    it.covariance.fly(t);
                    at = self.bounce(it, -flight::speed_at_wall(at, a), a);
                    left -= t;
                }
                _ => {
                    it.covariance.fly(left);
                    let x = at.x + left * (at.xdot + 0.5 * a * left);
                    it.estimate.state = Physical { x: x.max(0.0), xdot: at.xdot + a * left };
                    return false;
                }
            }
        }
        it.covariance.rest();
        it.estimate.state = Physical::default();
        true
    }

    /// The state after an impact with `before < 0`. A slow one carries no information about `e`,
    /// whose uncertainty is unchanged.
    fn bounce(&self, it: &mut ObserverState, before: Real, a: Real) -> Physical {
        let ObserverSettings { h, se, q_e, noise: [of_x, _], learn_e, .. } = *self;
        let (e, speed) = (it.e, before.abs());
        let least = speed.max(GRAZING * h * a.abs());
        let k = if least > 0.0 { -(1.0 + e) * a / least } else { 0.0 };
        let tells = learn_e && speed * speed * (h * h) >= SLOW * SLOW * of_x;
        it.covariance.bounce(e, k, if tells { speed } else { 0.0 });
        let of_e = if learn_e { it.covariance.ee } else { se * se };
        if !tells {
            it.covariance.vv += of_e * (before * before);
        }
        it.covariance.ee = (it.covariance.ee + q_e).min(UNKNOWN_E);
        Physical { x: 0.0, xdot: 0.0 - e * before }
    }

    /// Corrects with a measurement within the gate; `a` acted before it. A mass at rest stays
    /// exactly at rest: its variances are reduced to `FLOOR`.
    fn correct(&self, it: &mut ObserverState, measured: Measurement, a: Real, rests: bool) {
        let ObserverSettings { noise: [of_x, of_v], dmax, .. } = *self;
        // validate first: a rejected measurement needs no rollback
        if self.distance(it, measured) <= GATE {
            let gain = it.covariance.measure_x(of_x);
            it.shift(gain, measured.x - it.estimate.state.x);
            if let Some(xdot) = measured.xdot {
                let gain = it.covariance.measure_v(of_v);
                it.shift(gain, xdot - it.estimate.state.xdot);
            }
            it.estimate.state = match rests {
                true => Physical::default(),
                false => Physical { x: it.estimate.state.x.max(0.0), ..it.estimate.state },
            };
            it.estimate.d = it.estimate.d.max(-dmax).min(dmax);
            if self.learn_e {
                let [least, most] = LEARNT;
                it.e = it.e.max(least).min(most);
            }
            it.in_a_row = 0;
            return;
        }
        (it.in_a_row, it.refused) = (it.in_a_row + 1, it.refused.saturating_add(1));
        self.doubt(it, measured, a);
    }

    /// The square of how many standard deviations a measurement is off.
    #[inline]
    fn distance(&self, it: &ObserverState, Measurement { x, xdot }: Measurement) -> Real {
        let ObserverSettings { noise: [of_x, of_v], .. } = *self;
        let Covariance { xx, xv, vv, .. } = it.covariance;
        let (total, innovation) = (xx + of_x, x - it.estimate.state.x);
        let by_position = innovation * innovation / total;
        let Some(xdot) = xdot else { return by_position };
        // of the velocity, given the position
        let gain = xv / total;
        let innovation = xdot - (it.estimate.state.xdot + gain * innovation);
        by_position + innovation * innovation / ((vv - gain * xv).max(0.0) + of_v)
    }

    /// After a measurement that was rejected: where the mass is taken to be from now on.
    fn doubt(&self, it: &mut ObserverState, Measurement { x, xdot }: Measurement, a: Real) {
        let ObserverSettings { noise: [of_x, of_v], dmax, .. } = *self;
        match xdot {
            Some(_) if it.in_a_row >= PATIENCE => {}
            None if it.in_a_row >= DOUBT => {
                let agreeing = it.memory.consensus(of_x, dmax);
                let found = agreeing.is_some_and(|these| it.refit(these, of_x, 0.25 * dmax * dmax));
                if found || it.in_a_row < LOST {
                    return;
                }
            }
            _ => return,
        }
        // at the measurement; without a velocity at rest, with the speed of its height
        let state = Physical { x: x.max(0.0), xdot: xdot.unwrap_or(0.0) };
        let of_v = if xdot.is_some() { 4.0 * of_v } else { self.fastest(state, of_x, a) };
        let covariance = Covariance::diagonal([4.0 * of_x, of_v, 0.25 * dmax * dmax]);
        it.restart(state, covariance);
    }
}

/// The velocity that is measured.
fn velocity_of(measured: Option<Measurement>) -> Option<Real> {
    measured.and_then(|it| it.xdot)
}

impl ObserverState {
    /// Restarts from the least-squares line through these positions unless their times are equal.
    /// Of an error `delta` of the acceleration the velocity has `q delta/2`, the position `-(m - q
    /// tau) delta/2`, with `tau`, `m` the means of `tau_i`, `tau_i^2` and `q` the slope of
    /// `tau_i^2`. (Out of line: its part of the stack is not there while the filter moves on.)
    #[inline(never)]
    pub(super) fn refit(&mut self, chosen: Chosen, of_x: Real, of_d: Real) -> bool {
        let seen = || self.memory.seen().zip(&chosen).filter_map(|(it, taken)| taken.then_some(it));
        let (mut n, mut ages, mut places) = (0.0, 0.0, 0.0);
        for it in seen() {
            (n, ages, places) = (n + 1.0, ages + it.age, places + it.y);
        }
        let (age, place) = (ages / n, places / n);
        let (mut spread, mut slope, mut square, mut bent) = (0.0, 0.0, 0.0, 0.0);
        for it in seen() {
            let since = it.age - age;
            spread += since * since;
            slope += since * (it.y - place);
            square += it.age * it.age / n;
            bent += since * it.age * it.age;
        }
        if spread.is_nan() || spread <= 0.0 {
            return false;
        }
        let (v, q) = (-slope / spread, bent / spread);
        let (by_x, by_v) = (-0.5 * (square - q * age), 0.5 * q);
        let vv = of_x / spread;
        self.restart(Physical { x: place + v * age, xdot: v }, Covariance::default());
        let covariance = &mut self.covariance;
        covariance.xx = of_x / n + age * age * vv + by_x * by_x * of_d;
        covariance.xv = age * vv + by_x * by_v * of_d;
        covariance.xd = by_x * of_d;
        covariance.vv = vv + by_v * by_v * of_d;
        covariance.vd = by_v * of_d;
        covariance.dd = of_d;
        true
    }
}
