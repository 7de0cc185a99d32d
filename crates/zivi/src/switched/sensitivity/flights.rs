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
use crate::numeric::step_size::{factor, shorter, FACTORS};
use crate::record::failure::Failure;
use crate::switched::point::Point;
use crate::switched::settings::SwitchedRk;
use crate::switched::stages::{Counted, Stages};
use crate::system::slopes::DifferentiableForce;
use crate::Status;

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
    /// The lowest minimum of the distance between the ends: when (s), and the distance (m), which
    /// is infinite where there is none.
    pub lowest: (f64, f64),
}

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
    let mut force = Counted::new(force);
    let stages = Stages::new(settings.order.pair(), 1);
    let mut pilot =
        FlightControl { settings, apart, stages, step: ColumnStep::new(&wrt), h: f64::INFINITY };
    flights.iter().map(|flight| pilot.fly(*flight, &mut force)).collect()
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
    use crate::ConstantForce;
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
}
