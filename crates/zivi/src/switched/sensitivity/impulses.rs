//! The equations of a sequence of impacts that repeats, with impulses and times as unknowns.
//!
//! From `(t_k, 0, u_k)`, `u_k = e P_k/(1 + e)`, to the next impact,
//!
//! ```text
//! x(t_(k+1)) = 0,        (1 + e) x'(t_(k+1)-) + P_(k+1) = 0,
//! ```
//!
//! the first of them from the last, a period ago: regular where an impact grazes, `P = 0`.

use super::columns::Wrt;
use super::flights::{fly_apart, IndependentFlights};
use crate::record::status::Failure;
use crate::switched::sensitivity::flights::{Flight, Flown};
use crate::switched::settings::SwitchedRk;
use crate::system::slopes::DifferentiableForce;
use crate::Status;

/// A sequence of impacts.
#[derive(Clone, Copy, Debug)]
pub struct ImpactSequence<'a> {
    /// `P_k, t_k`, one after the other.
    pub unknowns: &'a [f64],
    /// The last impact, with which the period begins.
    pub last: [f64; 2],
    /// The period (s).
    pub length: f64,
    /// Newton's coefficient of restitution.
    pub e: f64,
}

/// Its equations.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SequenceEquations {
    /// The flights to the impacts.
    pub flights: Vec<Flown>,
    /// The residual, two numbers per impact.
    pub residual: Vec<f64>,
    /// The derivative by the unknowns, row by row.
    pub own: Vec<f64>,
    /// Apart from that, the derivative by the last impact, a period ago.
    pub before: Vec<f64>,
    /// The derivative with respect to a parameter at fixed period, empty if not requested.
    pub by: Vec<f64>,
}

impl SequenceEquations {
    /// The derivative with respect to a parameter on which the period depends.
    pub fn by_parameter(&self, longer: f64) -> Vec<f64> {
        let size = self.residual.len();
        // the last impact of the period before moves with its length
        let since = self.before.iter().skip(size.wrapping_sub(1)).step_by(size.max(1));
        self.by.iter().zip(since).map(|(by, since)| by - longer * since).collect()
    }
}

/// Flies to each impact and derives the equations, by [`Wrt::E`]
/// or by a parameter of the force (with its magnitude) where one is named.
///
/// # Errors
/// What the force raises, a status where a flight cannot be computed or has no length.
pub fn sequence_equations<E, F: DifferentiableForce<E>>(
    force: &mut F,
    ImpactSequence { unknowns, last, length, e }: ImpactSequence<'_>,
    settings: SwitchedRk,
    wrt: Option<(Wrt, f64)>,
) -> Result<SequenceEquations, Failure<E>> {
    let [part, scale] = [e / (1.0 + e), 1.0 + e];
    let mut start = [last[0], last[1] - length];
    let mut flights = Vec::with_capacity(unknowns.len() / 2);
    for impact in unknowns.chunks_exact(2) {
        let [push, from] = start;
        let flight = Flight { from, x: 0.0, xdot: part * push, to: impact[1] };
        // false for NaN, too
        let flies = flight.to > from && (flight.to - from).is_finite() && push.is_finite();
        if !flies {
            return Err(Failure::Status(Status::StepSizeTooSmall));
        }
        flights.push(flight);
        start = [impact[0], impact[1]];
    }
    let (number, magnitude) = match wrt {
        Some((Wrt::Parameter(number), magnitude)) => (Some(number), magnitude),
        _ => (None, 1.0),
    };
    let (by, sizes) = (number.as_slice(), &[1.0, 1.0, magnitude][..2 + number.iter().len()]);
    let apart = &IndependentFlights { settings, by, sizes, minima: true };
    let flown = fly_apart(force, &flights, apart)?;
    let size = unknowns.len();
    let mut found = SequenceEquations {
        residual: Vec::with_capacity(size),
        own: vec![0.0; size * size],
        before: vec![0.0; size * size],
        ..SequenceEquations::default()
    };
    for (k, ((impact, flight), it)) in
        unknowns.chunks_exact(2).zip(&flights).zip(&flown).enumerate()
    {
        let [first, at_end] = it.pull;
        found.residual.extend([it.x, scale * it.xdot + impact[0]]);
        let rows = [(&it.dx, it.xdot, 1.0), (&it.dv, at_end, scale)];
        for (i, (by, rate, scale)) in rows.into_iter().enumerate() {
            let row = (2 * k + i) * size;
            found.own[row + 2 * k + 1] = scale * rate;
            // by the impact before: its impulse, and its time at which the flight starts
            let to = if k > 0 { &mut found.own } else { &mut found.before };
            let at = row + if k > 0 { 2 * k - 2 } else { size - 2 };
            to[at] = scale * part * by[1];
            to[at + 1] = -scale * (by[0] * flight.xdot + by[1] * first);
        }
        found.own[(2 * k + 1) * size + 2 * k] = 1.0;
        match wrt {
            None => (),
            Some((Wrt::Parameter(_), _)) => found.by.extend([it.dx[2], scale * it.dv[2]]),
            Some(_) => {
                // e / (1 + e) of the impulse is the speed of the start
                let push = if k > 0 { unknowns[2 * k - 2] } else { last[0] };
                let moved = push / (scale * scale);
                found.by.extend([it.dx[1] * moved, scale * it.dv[1] * moved + it.xdot]);
            }
        }
    }
    found.flights = flown;
    Ok(found)
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use super::*;
    use crate::LinearForce;

    const FORCE: LinearForce = LinearForce {
        stiffness: 0.9,
        damping: 0.1,
        gravity: 1.0,
        amplitude: 0.4,
        omega: 1.1,
        phase: 0.3,
    };

    fn equations(
        unknowns: &[f64],
        last: [f64; 2],
    ) -> Result<SequenceEquations, Failure<Infallible>> {
        let sequence = ImpactSequence { unknowns, last, length: 5.7, e: 0.6 };
        sequence_equations(&mut FORCE.clone(), sequence, SwitchedRk::default(), None)
    }

    #[test]
    fn derivatives_by_parameters_are_those_of_differences() {
        let (y, last) = ([1.3, 0.4, 0.7, 2.9, 1.1, 4.4], [1.2, 4.3]);
        // a parameter p, with the period 5.7 + rate (p - p0)
        let check = |wrt: Wrt, rate: f64, moved: &dyn Fn(f64) -> (LinearForce, f64)| {
            let at = |h: f64, wrt: Option<(Wrt, f64)>| {
                let (mut force, e) = moved(h);
                let sequence = ImpactSequence { unknowns: &y, last, length: 5.7 + rate * h, e };
                let settings = SwitchedRk::default();
                let found: Result<_, Failure<Infallible>> =
                    sequence_equations(&mut force, sequence, settings, wrt);
                found.unwrap()
            };
            let h = 1e-5;
            let ends = [h, -h].map(|h| at(h, None).residual);
            let column = at(0.0, Some((wrt, 1.0))).by_parameter(rate);
            assert_eq!(column.len(), y.len());
            for ((exact, plus), minus) in column.iter().zip(&ends[0]).zip(&ends[1]) {
                let difference = (plus - minus) / (2.0 * h);
                assert!((exact - difference).abs() < 1e-8, "{wrt:?}: {exact} {difference}");
            }
        };
        check(Wrt::E, 0.0, &|h| (FORCE, 0.6 + h));
        check(Wrt::Parameter(3), 0.0, &|h| {
            (LinearForce { amplitude: FORCE.amplitude + h, ..FORCE }, 0.6)
        });
        check(Wrt::Parameter(4), -5.7 / FORCE.omega, &|h| {
            (LinearForce { omega: FORCE.omega + h, ..FORCE }, 0.6)
        });
        assert!(equations(&y, last).unwrap().by_parameter(1.0).is_empty());
    }

    #[test]
    fn derivatives_are_those_of_differences() {
        for y in [vec![1.3, 0.4, 0.7, 2.9, 1.1, 4.4], vec![0.8, 1.0]] {
            let n = y.len();
            let last = [y[n - 2] + 0.1, y[n - 1] - 0.2];
            let found = equations(&y, last).unwrap();
            let h = 1e-5;
            let check = |exact: f64, ends: [f64; 2]| {
                let difference = (ends[0] - ends[1]) / (2.0 * h);
                assert!((exact - difference).abs() < 1e-9, "{exact} {difference}");
            };
            for column in 0..n {
                let moved = [h, -h].map(|h| {
                    let mut y = y.clone();
                    y[column] += h;
                    equations(&y, last).unwrap().residual
                });
                (0..n).for_each(|i| check(found.own[i * n + column], [moved[0][i], moved[1][i]]));
            }
            for column in 0..2 {
                let moved = [h, -h].map(|h| {
                    let mut last = last;
                    last[column] += h;
                    equations(&y, last).unwrap().residual
                });
                let at = |i: usize| found.before[i * n + n - 2 + column];
                (0..n).for_each(|i| check(at(i), [moved[0][i], moved[1][i]]));
            }
        }
    }

    #[test]
    fn impacts_out_of_order_are_refused() {
        for unknowns in [vec![1.0, 2.0, 1.0, 2.0], vec![1.0, 3.0, 1.0, 2.0], vec![f64::NAN, 1.0]] {
            let last = [unknowns[unknowns.len() - 2], unknowns[unknowns.len() - 1]];
            let refused = equations(&unknowns, last);
            assert!(matches!(refused, Err(Failure::Status(Status::StepSizeTooSmall))));
        }
    }
}
