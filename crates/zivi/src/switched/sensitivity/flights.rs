//! Flights of known length, without event detection, and their derivatives: the elements of orbits
//! with unknown impact times and speeds.
//!
//! ```text
//! flight   from (t_i, 0, u_i) to t_j:   x, x', Phi = d(x, x')/d(x_i, x'_i), d(x, x')/dq
//! ```
//!
//! The force must continue below the wall, which a too long flight enters (the switched method has
//! the same requirement).

use crate::numeric::bernstein::Polynomial;
use crate::numeric::power_series::{derivative, stretch, value_and_slope, Series, TERMS};
use crate::numeric::root::{of_angle, sin_cos, Clock, Phase};
use crate::numeric::stages::{factor, shorter, FACTORS};
use crate::record::status::Failure;
use crate::switched::flight::series::{column, wave};
use crate::switched::mode::Point;
use crate::switched::sensitivity::columns::{ColumnStep, Wrt};
use crate::switched::settings::SwitchedRk;
use crate::switched::stages::{Counted, Stages};
use crate::system::slopes::DifferentiableForce;
use crate::{LinearLaw, LinearRate, Status, Wave};

/// Options of flights.
#[derive(Clone, Copy, Debug)]
pub struct IndependentFlights<'a> {
    /// Tolerances, order and budget.
    pub settings: SwitchedRk,
    /// Numbers of the parameters of the force to differentiate by.
    pub by: &'a [usize],
    /// Magnitudes of `x`, `x'` and the parameters.
    pub sizes: &'a [f64],
    /// Whether the minima are computed.
    pub minima: bool,
}

/// Integrates each flight independently.
///
/// # Errors
/// What the force raises, a status where a flight cannot be computed.
pub fn fly_apart<E, F: DifferentiableForce<E>>(
    force: &mut F,
    flights: &[Flight],
    apart: &IndependentFlights<'_>,
) -> Result<Vec<Flown>, Failure<E>> {
    let settings = apart.settings.validated().map_err(|_| Failure::Status(Status::Internal))?;
    let mut wrt = vec![Wrt::X0, Wrt::Xdot0];
    wrt.extend(apart.by.iter().map(|&index| Wrt::Parameter(index)));
    if let Some(exact) = exact(force, flights, (settings, apart)) {
        return flights.iter().map(|flight| exact_flight(&exact, *flight, force)).collect();
    }
    let mut force = Counted::new(force);
    let stages = Stages::new(settings.order.pair(), 1);
    let mut pilot =
        FlightControl { settings, apart, stages, step: ColumnStep::new(&wrt), h: f64::INFINITY };
    flights.iter().map(|flight| pilot.fly(*flight, &mut force)).collect()
}

/// The flights as power series, where the force is linear and the method takes these.
fn exact<E, F: DifferentiableForce<E>>(
    force: &F,
    flights: &[Flight],
    (settings, apart): (SwitchedRk, &IndependentFlights<'_>),
) -> Option<LinearFlights> {
    let law = settings.law_of(force)?;
    let rates = apart.by.iter().map(|&index| force.linear_rate(index)).collect::<Option<_>>()?;
    let longest = flights.iter().fold(0.0_f64, |longest, it| longest.max(it.to - it.from));
    LinearFlights::new(law, rates, longest, (settings.max_steps, apart.minima))
}

fn exact_flight<E, F: DifferentiableForce<E>>(
    exact: &LinearFlights,
    flight: Flight,
    force: &mut F,
) -> Result<Flown, Failure<E>> {
    let flown = exact.fly(flight)?;
    let first = force.at(flight.from, flight.x, flight.xdot).map_err(Failure::Raised)?;
    let last = force.at(flight.to, flown.x, flown.xdot).map_err(Failure::Raised)?;
    Ok(Flown { pull: [first, last], ..flown })
}

struct FlightControl<'a> {
    settings: SwitchedRk,
    apart: &'a IndependentFlights<'a>,
    stages: Stages,
    step: ColumnStep,
    /// The step to try next.
    h: f64,
}

impl FlightControl<'_> {
    fn fly<E, F: DifferentiableForce<E>>(
        &mut self,
        flight: Flight,
        force: &mut Counted<'_, F>,
    ) -> Result<Flown, Failure<E>> {
        let Flight { from: t, x, xdot, to } = flight;
        let mut now = Point { t, late: 0.0, x, xdot };
        let first = force.at(t, x, xdot)?;
        self.step.end.clear();
        (self.step.end.x[0], self.step.end.v[1]) = (1.0, 1.0);
        let (mut slope, mut lowest, mut spent) = (first, (t, f64::INFINITY), 0);
        while now.t < to {
            let left = (to - now.t) - now.late;
            let mut h = self.h.min(self.settings.max_step);
            h = if h >= left * (1.0 - 1e-12) { left } else { h };
            std::mem::swap(&mut self.step.from, &mut self.step.end);
            loop {
                spent += 1;
                if spent > self.settings.max_steps {
                    return Err(Failure::Status(Status::StepBudget));
                }
                let error = self.try_step(now, slope, h, force)?;
                let factor = factor(error, self.stages.order_of_error());
                if error <= 1.0 {
                    let next = h * factor.clamp(FACTORS.0, FACTORS.1);
                    self.h = if h < left { next } else { self.h.max(next).min(FACTORS.1 * next) };
                    break;
                }
                h *= shorter(factor);
                if h <= 8.0 * f64::EPSILON * now.t.abs() || h < f64::MIN_POSITIVE {
                    return Err(Failure::Status(Status::StepSizeTooSmall));
                }
            }
            if self.apart.minima {
                self.minimum(&mut lowest, force)?;
            }
            slope = self.stages.slope_at_end(force)?;
            now = self.stages.end;
            if h >= left {
                (now.t, now.late) = (to, 0.0);
            }
        }
        let (dx, dv) = (self.step.end.x.clone(), self.step.end.v.clone());
        Ok(Flown { x: now.x, xdot: now.xdot, pull: [first, slope], dx, dv, lowest })
    }

    /// A step of the motion and the columns: the larger of their errors, infinite where it left
    /// the numbers.
    fn try_step<E, F: DifferentiableForce<E>>(
        &mut self,
        now: Point,
        slope: f64,
        h: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<f64, Failure<E>> {
        match self.stages.step(&now, &slope, h, force) {
            Err(Failure::Status(_)) => return Ok(f64::INFINITY),
            done => done?,
        }
        let tolerances = self.settings.tolerances();
        let error = self.stages.error(&tolerances, force)?;
        if error > 1.0 || error.is_nan() {
            return Ok(if error.is_nan() { f64::INFINITY } else { error });
        }
        self.step.step(&self.stages, force)?;
        let of_columns = self.step.error(&self.stages, &tolerances, self.apart.sizes, force)?;
        Ok(if of_columns.is_nan() { f64::INFINITY } else { error.max(of_columns) })
    }

    fn minimum<E, F: DifferentiableForce<E>>(
        &mut self,
        lowest: &mut (f64, f64),
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        let [x, xdot] = self.stages.polynomials(force)?;
        for theta in xdot.crossings(0.0) {
            let (t, depth) = (self.stages.from.t + theta * self.stages.h, x.at(theta));
            let is_minimum = xdot.slope(theta) > 0.0;
            if is_minimum && depth < lowest.1 {
                *lowest = (t, depth);
            }
        }
        Ok(())
    }
}

// Flights of known length: where they start, where they end.

/// Where a flight starts and when it ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flight {
    /// Start (s).
    pub from: f64,
    /// Distance there (m).
    pub x: f64,
    /// Velocity there (m/s).
    pub xdot: f64,
    /// End (s).
    pub to: f64,
}

/// The end of a flight and its derivatives.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Flown {
    /// Distance at the end (m).
    pub x: f64,
    /// Velocity at the end (m/s).
    pub xdot: f64,
    /// Accelerations at both ends (m/s^2).
    pub pull: [f64; 2],
    /// Derivatives of the distance at the end by the initial distance, the initial velocity, and
    /// the parameters.
    pub dx: Vec<f64>,
    /// Those of the velocity.
    pub dv: Vec<f64>,
    /// The lowest minimum of the distance between the ends: time (s) and distance (m), infinite
    /// without a minimum.
    pub lowest: (f64, f64),
}

// Flights of known length under a linear force, with their derivatives, to rounding.
//
// Over a step of length `h` position and derivatives are power series of its part `s`. A derivative
// by a parameter `q` obeys the equation of the motion under the force `f_q`, a linear one of the
// motion itself and of time:
//
// ```text
// x_q'' = -k x_q - c x_q' + f_q        f_q = -k_q x - c_q x' - g_q + sum_m Re (a_m + b_m t) e^(i w_m t)
// ```

/// Length of a step times the fastest rate: the truncation error is `24 1.75^24/24! = 3e-17`.
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
    /// Flights up to a duration and a number of steps, optionally with minima and with derivatives
    /// with respect to parameters; `None` if its numbers are too large.
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

/// A time and its rounding error.
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
mod flights_tests {
    use super::*;
    use crate::switched::settings::Flights;
    use crate::{ConstantForce, HarmonicWall, LinearForce, OnMovingWall};
    use std::convert::Infallible;

    #[test]
    fn a_flight_begins_with_at_most_five_times_what_the_last_one_ended_with() {
        let settings = SwitchedRk::default();
        let apart = IndependentFlights { settings, by: &[], sizes: &[1.0, 1.0], minima: false };
        let mut pilot = FlightControl {
            settings,
            apart: &apart,
            stages: Stages::new(settings.order.pair(), 1),
            step: ColumnStep::new(&[Wrt::X0, Wrt::Xdot0]),
            h: f64::INFINITY,
        };
        let mut force = ConstantForce(-2.0);
        let mut force = Counted::new(&mut force);
        let flight = Flight { from: 0.0, x: 0.0, xdot: 1.0, to: 0.125 };
        // a parabola, in one step without an error: five times its length, and five times that
        let flown: Result<Flown, Failure<Infallible>> = pilot.fly(flight, &mut force);
        assert!((flown.unwrap().x - (0.125 - 0.125 * 0.125)).abs() < 1e-16);
        assert_eq!(pilot.h, 25.0 * 0.125);
    }

    const OSCILLATOR: LinearForce = LinearForce {
        stiffness: 1.3,
        damping: 0.2,
        gravity: 0.7,
        amplitude: 1.1,
        omega: 1.7,
        phase: 0.4,
    };

    fn flown<F: DifferentiableForce<Infallible>>(
        mut force: F,
        flights: &[Flight],
        by: &[usize],
        way: Flights,
    ) -> Vec<Flown> {
        let settings =
            SwitchedRk { rtol: 1e-13, atol: [1e-14; 2], flights: way, ..SwitchedRk::default() };
        let sizes = vec![1.0; 2 + by.len()];
        let apart = IndependentFlights { settings, by, sizes: &sizes, minima: true };
        fly_apart(&mut force, flights, &apart).unwrap()
    }

    /// Both ways of flight, one after the other.
    fn check<F: DifferentiableForce<Infallible> + Copy>(force: F) {
        let by: Vec<usize> = (0..force.parameters()).collect();
        let flights = [
            Flight { from: 0.3, x: 0.0, xdot: 1.2, to: 4.9 },
            Flight { from: -2.0, x: 0.5, xdot: -0.3, to: 11.0 },
            Flight { from: 7.0, x: 0.1, xdot: 2.0, to: 7.02 },
        ];
        let [exact, pair] =
            [Flights::Auto, Flights::RungeKutta].map(|way| flown(force, &flights, &by, way));
        assert_ne!(exact, pair);
        for (exact, pair) in exact.iter().zip(&pair) {
            let numbers = |it: &Flown| {
                let own = [it.x, it.xdot, it.pull[0], it.pull[1], it.lowest.0, it.lowest.1];
                own.into_iter().chain(it.dx.clone()).chain(it.dv.clone()).collect::<Vec<_>>()
            };
            for (k, (a, b)) in numbers(exact).into_iter().zip(numbers(pair)).enumerate() {
                let near = (a - b).abs() < 1e-11 * (1.0 + b.abs());
                assert!(near || (a == b && k == 5), "{k}: {a} {b}");
            }
        }
    }

    #[test]
    fn they_are_what_the_pair_finds() {
        let wall = HarmonicWall { amplitude: 0.4, omega: 2.3, phase: -0.5, offset: 0.2 };
        for force in [
            OSCILLATOR,
            LinearForce { omega: -1.7, ..OSCILLATOR },
            LinearForce { omega: 0.0, ..OSCILLATOR },
            LinearForce { amplitude: 0.0, ..OSCILLATOR },
            LinearForce { stiffness: -0.3, damping: -0.1, ..OSCILLATOR },
            LinearForce { stiffness: 0.0, damping: 0.0, amplitude: 0.0, ..OSCILLATOR },
            LinearForce { stiffness: 200.0, damping: 90.0, ..OSCILLATOR },
        ] {
            check(force);
            check(OnMovingWall { force, wall });
            check(OnMovingWall { force, wall: HarmonicWall { omega: force.omega, ..wall } });
        }
        check(ConstantForce(-0.7));
        check(OnMovingWall { force: ConstantForce(-0.7), wall });
    }

    #[test]
    fn resonance_is_exact() {
        // x'' = -x + a cos(w t), w = a = 1, from rest:
        //   x = x_a = t sin(t)/2,    x_w'' = -x_w - t sin(t):   x_w = (t^2 cos(t) - t sin(t))/4
        let force = LinearForce {
            stiffness: 1.0,
            damping: 0.0,
            gravity: 0.0,
            amplitude: 1.0,
            omega: 1.0,
            phase: 0.0,
        };
        for to in [0.4, 3.0, 20.0_f64] {
            let flight = Flight { from: 0.0, x: 0.0, xdot: 0.0, to };
            let it = &flown(force, &[flight], &[3, 4], Flights::Auto)[0];
            let (sin, cos) = to.sin_cos();
            let close =
                |a: f64, b: f64| assert!((a - b).abs() < 4e-15 * (1.0 + to * to), "{a} {b}");
            close(it.x, 0.5 * to * sin);
            close(it.xdot, 0.5 * (sin + to * cos));
            close(it.dx[0], cos);
            close(it.dx[1], sin);
            close(it.dv[0], -sin);
            close(it.dx[2], 0.5 * to * sin);
            close(it.dx[3], 0.25 * (to * to * cos - to * sin));
            close(it.dv[3], 0.25 * (to * cos - to * to * sin - sin));
        }
    }
}

#[cfg(test)]
mod linear_flights_tests {
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
