//! Flights of known length under a linear force, with their derivatives, to rounding.
//!
//! Over a step of length `h` position and derivatives are power series of its part `s`. A derivative
//! by a parameter `q` obeys the equation of the motion under the force `f_q`, a linear one of the
//! motion itself and of time:
//!
//! ```text
//! x_q'' = -k x_q - c x_q' + f_q        f_q = -k_q x - c_q x' - g_q + sum_m Re (a_m + b_m t) e^(i w_m t)
//! ```

use super::flown::{Flight, Flown};
use crate::numeric::bernstein::Polynomial;
use crate::numeric::power_series::{derivative, stretch, value_and_slope, Series, TERMS};
use crate::numeric::turns::{of_angle, sin_cos, Clock, Phase};
use crate::record::failure::Failure;
use crate::switched::flight::series::{column, wave};
use crate::{LinearLaw, LinearRate, Status, Wave};

/// Length of a step times the fastest rate: beyond the last coefficient there is
/// `24 1.75^24/24! = 3e-17`.
const STEP: f64 = 1.75;
/// Lengths of steps whose powers are numbers.
const USUAL: std::ops::Range<f64> = 1e-100..1e100;

/// The flights under one force.
pub(super) struct LinearFlights {
    law: LinearLaw,
    h: f64,
    forcing: Forcing,
    /// By each parameter.
    rates: Vec<(LinearRate, Forcing)>,
    /// The derivatives of a step by position and velocity at its start.
    columns: [Series; 2],
    /// Where a whole step takes these.
    whole: [[f64; 2]; 2],
    most: usize,
    minima: bool,
}

impl LinearFlights {
    /// Flights of at most a duration and so many steps, with their minima or without, and with
    /// derivatives by parameters; unless its numbers are beyond what can be computed with.
    pub(super) fn new(
        law: LinearLaw,
        rates: Vec<LinearRate>,
        longest: f64,
        (most, minima): (usize, bool),
    ) -> Option<Self> {
        let waves = |law: &LinearLaw| law.waves.map(|wave| wave.omega.abs());
        let LinearLaw { stiffness, damping, .. } = law;
        let own = 0.5 * (damping.abs() + (damping * damping + 4.0 * stiffness.abs()).sqrt());
        let fastest = waves(&law).into_iter().fold(own, f64::max);
        let h = (STEP / fastest).min(longest);
        // false for NaN, too
        if !USUAL.contains(&h) {
            return None;
        }
        let forcing = |law: &LinearLaw, growing: &[Wave]| {
            let steady = law.waves.iter().map(|wave| Oscillation::new(wave, h));
            let growing = growing.iter().map(|wave| Oscillation::new(wave, h));
            let waves = [steady.flatten().collect(), growing.flatten().collect()];
            Forcing { constant: -law.gravity * h * h, waves }
        };
        let rates = rates.into_iter().map(|rate| (rate, forcing(&rate.law, &rate.growing)));
        let none = [0.0; TERMS];
        let step = |x, v| column(stiffness * h * h, damping * h, x, v, &none);
        let columns = [step(1.0, 0.0), step(0.0, 1.0)];
        Some(Self {
            law,
            h,
            forcing: forcing(&law, &[]),
            rates: rates.collect(),
            columns,
            whole: columns.map(|a| value_and_slope(&a, 1.0)),
            most,
            minima,
        })
    }

    /// Flies one of them, the accelerations at the ends left open.
    ///
    /// # Errors
    /// A status where it has too many steps or leaves the numbers.
    pub(super) fn fly<E>(&self, flight: Flight) -> Result<Flown, Failure<E>> {
        let (h, length) = (self.h, flight.to - flight.from);
        let (k, c) = (self.law.stiffness * h * h, self.law.damping * h);
        let [mut motion, mut by_x, mut by_v] =
            [[flight.x, flight.xdot * h], [1.0, 0.0], [0.0, 1.0]];
        let mut by = vec![[0.0; 2]; self.rates.len()];
        let (mut lowest, steps) = ((flight.from, f64::INFINITY), (length / h).ceil());
        if steps > self.most as f64 {
            return Err(Failure::Status(Status::StepBudget));
        }
        for step in 0..steps as usize {
            let done = step as f64 * h;
            let at = Time::after(flight.from, done);
            let part = ((length - done) / h).min(1.0);
            let mut d = [0.0; TERMS];
            self.forcing.add(at, h, &mut d);
            let [x, v] = motion;
            let a = column(k, c, x, v, &d);
            for (by, (rate, forcing)) in by.iter_mut().zip(&self.rates) {
                let (dk, dc) = (rate.law.stiffness * h * h, rate.law.damping * h);
                let mut d: Series = std::array::from_fn(|n| {
                    let slope = a.get(n + 1).map_or(0.0, |a| (n as f64 + 1.0) * a);
                    -dk * a[n] - dc * slope
                });
                forcing.add(at, h, &mut d);
                *by = value_and_slope(&column(k, c, by[0], by[1], &d), part);
            }
            motion = value_and_slope(&a, part);
            let [of_x, of_v] = if part == 1.0 {
                self.whole
            } else {
                self.columns.map(|a| value_and_slope(&a, part))
            };
            for by in [&mut by_x, &mut by_v] {
                let [x, v] = *by;
                *by = [x * of_x[0] + v * of_v[0], x * of_x[1] + v * of_v[1]];
            }
            if self.minima {
                minimum(a, (v, motion[1]), part, |part| at.t + part * h, &mut lowest);
            }
        }
        let all = [motion, by_x, by_v];
        if !all.iter().chain(&by).flatten().all(|number| number.is_finite()) {
            return Err(Failure::Status(Status::StepSizeTooSmall));
        }
        let mut flown = Flown { x: motion[0], xdot: motion[1] / h, lowest, ..Flown::default() };
        // by the velocity, not by what it is times a step
        flown.dx.extend([by_x[0], by_v[0] * h]);
        flown.dv.extend([by_x[1] / h, by_v[1]]);
        flown.dx.extend(by.iter().map(|by| by[0]));
        flown.dv.extend(by.iter().map(|by| by[1] / h));
        Ok(flown)
    }
}

/// Looks for minima over a part of a step, at the ends of which the velocities are known.
fn minimum(
    mut a: Series,
    (first, last): (f64, f64),
    part: f64,
    time: impl Fn(f64) -> f64,
    lowest: &mut (f64, f64),
) {
    stretch(&mut a, part);
    let xdot =
        Polynomial::<TERMS>::from_powers(derivative(&a)).with_ends(part * first, part * last);
    for theta in xdot.crossings(0.0) {
        let depth = value_and_slope(&a, theta)[0];
        if xdot.slope(theta) > 0.0 && depth < lowest.1 {
            *lowest = (time(theta * part), depth);
        }
    }
}

/// A time, and what rounding leaves out of it.
#[derive(Clone, Copy)]
struct Time {
    t: f64,
    late: f64,
}

impl Time {
    fn after(from: f64, time: f64) -> Self {
        let t = from + time;
        Self { t, late: time - (t - from) }
    }
}

/// A force that does not depend on the state: its constant, times the square of the step, its waves,
/// and those that grow with time.
struct Forcing {
    constant: f64,
    waves: [Vec<Oscillation>; 2],
}

impl Forcing {
    /// Adds the powers over a step from a time.
    fn add(&self, at: Time, h: f64, d: &mut Series) {
        d[0] += self.constant;
        let [steady, growing] = &self.waves;
        for wave in steady {
            wave.add(wave.at(at), d);
        }
        for wave in growing {
            // (t + s h) z
            let [re, im] = wave.at(at);
            wave.add([at.t * re, at.t * im], d);
            wave.add([h * re, h * im], &mut d[1..]);
        }
    }
}

/// A wave `Re z e^(i omega t)`, `omega >= 0`.
struct Oscillation {
    /// None of one that does not turn.
    clock: Option<Clock>,
    /// Its value at `t = 0`.
    z: [f64; 2],
    /// Powers over a step for `z = 1` and `z = i`, times the square of the step.
    powers: [Series; 2],
}

impl Oscillation {
    fn new(of: &Wave, h: f64) -> Option<Self> {
        let Wave { amplitude: [re, im], omega, phase } = *of;
        // the conjugate turns the other way
        let sign = if omega < 0.0 { -1.0 } else { 1.0 };
        let turning = sign * omega;
        let clock = (turning > 0.0).then(|| Clock::new(turning));
        let z = turned([re, sign * im], of_angle(sign * phase));
        ([re, im] != [0.0; 2]).then(|| Self { clock, z, powers: wave(turning * h, h) })
    }

    fn at(&self, Time { t, late }: Time) -> [f64; 2] {
        self.clock.map_or(self.z, |clock| turned(self.z, clock.phase(t, late)))
    }

    /// Adds the powers of a wave with this value at the start of the step.
    fn add(&self, [re, im]: [f64; 2], d: &mut [f64]) {
        let [cos, sin] = &self.powers;
        for (d, (cos, sin)) in d.iter_mut().zip(cos.iter().zip(sin)) {
            *d += re * cos + im * sin;
        }
    }
}

/// `z e^(2 pi i part)`.
fn turned([re, im]: [f64; 2], phase: Phase) -> [f64; 2] {
    let (sin, cos) = sin_cos(phase.part);
    [re * cos - im * sin, im * cos + re * sin]
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use super::*;

    #[test]
    fn a_flight_of_too_many_steps_is_refused() {
        let wave = Wave { amplitude: [1.1, 0.0], omega: 1.7, phase: 0.4 };
        let waves = [wave, Wave::default()];
        let law = LinearLaw { stiffness: 1.3, damping: 0.2, gravity: 0.7, waves };
        let flights = |most| LinearFlights::new(law, vec![], 10.0, (most, false)).unwrap();
        let flight = Flight { from: 0.0, x: 0.0, xdot: 1.0, to: 10.0 };
        // 1.75 of the wave are a step
        let fly = |most| flights(most).fly::<Infallible>(flight);
        assert!(fly(10).is_ok());
        assert!(matches!(fly(9), Err(Failure::Status(Status::StepBudget))));
        // far beyond the largest number
        let away = LinearLaw { stiffness: -1e4, ..law };
        let flights = LinearFlights::new(away, vec![], 10.0, (10_000, false)).unwrap();
        let far = flights.fly::<Infallible>(flight);
        assert!(matches!(far, Err(Failure::Status(Status::StepSizeTooSmall))));
    }
}
