//! Flights of known length, without any look for impacts, and their derivatives: what orbits that
//! are told by the times of their impacts and the speeds after them consist of.
//!
//! ```text
//! flight   from (t_i, 0, u_i) to t_j:   x, x', Phi = d(x, x')/d(x_i, x'_i), d(x, x')/dq
//! ```
//!
//! The force must continue below the wall, as for the switched method: a flight that is too long
//! goes there.

use super::columns::{ColumnStep, Wrt};
use super::flown::{Flight, Flown};
use super::linear_flights::LinearFlights;
use crate::numeric::step_size::{factor, shorter, FACTORS};
use crate::record::failure::Failure;
use crate::switched::point::Point;
use crate::switched::settings::SwitchedRk;
use crate::switched::stages::{Counted, Stages};
use crate::system::slopes::DifferentiableForce;
use crate::Status;

/// What is requested of flights.
#[derive(Clone, Copy, Debug)]
pub struct IndependentFlights<'a> {
    /// Tolerances, order and budget.
    pub settings: SwitchedRk,
    /// Numbers of the parameters of the force to differentiate by.
    pub by: &'a [usize],
    /// Magnitudes of `x`, `x'` and the parameters.
    pub sizes: &'a [f64],
    /// Whether the minima are wanted.
    pub minima: bool,
}

/// Flies each of the flights by itself.
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

#[cfg(test)]
mod tests {
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
