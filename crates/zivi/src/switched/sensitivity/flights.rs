//! Flights of known length, without event detection, and their derivatives: the elements of orbits
//! with unknown impact times and speeds.
//!
//! ```text
//! flight   from (t_i, 0, u_i) to t_j:   x, x', Phi = d(x, x')/d(x_i, x'_i), d(x, x')/dq
//! ```
//!
//! The force must continue below the wall, which a too long flight enters (the switched method has
//! the same requirement).

use super::{ColumnStep, Wrt};
use crate::numeric::bernstein::Polynomial;
use crate::numeric::elimination::Elimination;
use crate::numeric::power_series::{derivative, stretch, value_and_slope, Series, TERMS};
use crate::numeric::root::{of_angle, sin_cos, Clock, Phase};
use crate::numeric::stages::{factor, shorter, FACTORS};
use crate::record::status::Failure;
use crate::switched::flight::series::{column, wave};
use crate::switched::mode::{Counted, Point, Stages};
use crate::switched::settings::SwitchedRk;
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

// The equations of a sequence of impacts that repeats, with impulses and times as unknowns.
//
// From `(t_k, 0, u_k)`, `u_k = e P_k/(1 + e)`, to the next impact,
//
// ```text
// x(t_(k+1)) = 0,        (1 + e) x'(t_(k+1)-) + P_(k+1) = 0,
// ```
//
// the first of them from the last, a period ago: regular where an impact grazes, `P = 0`.

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

// A guess corrected towards a branch of orbits: Newton's iteration for the equations of a sequence of
// impacts and a parameter, in a hyperplane.
//
// ```text
// F(y, p) = 0,        n . (z - z_guess) = 0,        z = (y, p) in scaled unknowns
// ```

/// Hyperplane of the corrector: scaled unknowns and parameter as one vector.
#[derive(Clone, Copy, Debug)]
pub struct Hyperplane<'a> {
    /// A point of the plane, near the solution.
    pub guess: &'a [f64],
    /// Its normal.
    pub normal: &'a [f64],
    /// Magnitudes of the unknowns and of the parameter.
    pub scale: &'a [f64],
    /// Those of the equations.
    pub sizes: &'a [f64],
}

/// When the iteration ends.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// The most evaluations.
    pub evaluations: usize,
    /// The required scaled residual.
    pub tolerance: f64,
    /// The one with which an iteration that stalls has found what rounding allows.
    pub enough: f64,
    /// Where the residual falls by less, the derivative by the parameter is computed again.
    pub stale: f64,
}

/// A solution.
#[derive(Clone, Debug, PartialEq)]
pub struct Corrected {
    /// The scaled unknowns and the parameter.
    pub z: Vec<f64>,
    /// The unit tangent of the branch, along the normal.
    pub tangent: Vec<f64>,
    /// The steps of Newton's iteration.
    pub steps: usize,
    /// The scaled residual.
    pub residual: f64,
    /// The equations there.
    pub equations: SequenceEquations,
}

/// Why there is no solution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NotCorrected<E> {
    /// A flight cannot be computed, or its force raises.
    Flight(Failure<E>),
    /// The iteration did not converge.
    Diverged,
}

/// Seeks the solution in a hyperplane. `equations` evaluates them at unknowns and a parameter, on
/// request with the derivative with respect to the parameter, period included.
///
/// # Errors
/// An error of the equations; a singular system; too many evaluations.
pub fn correct<E>(
    plane: Hyperplane<'_>,
    limits: Limits,
    mut equations: impl FnMut(&[f64], f64, bool) -> Result<(SequenceEquations, Vec<f64>), Failure<E>>,
) -> Result<Corrected, NotCorrected<E>> {
    let Hyperplane { guess, normal, scale, sizes } = plane;
    let (n, mut z) = (sizes.len(), guess.to_vec());
    let (mut column, mut before, mut stalled) = (Vec::new(), f64::INFINITY, false);
    for steps in 0..limits.evaluations {
        let full: Vec<f64> = z.iter().zip(scale).map(|(z, scale)| z * scale).collect();
        let mut at =
            |derives| equations(&full[..n], full[n], derives).map_err(NotCorrected::Flight);
        let (found, derived) = at(column.is_empty())?;
        let scaled = || found.residual.iter().zip(sizes).map(|(it, size)| it / size);
        let residual = scaled().fold(0.0, |most: f64, it| most.max(it.abs()));
        if !scaled().all(f64::is_finite) {
            return Err(NotCorrected::Diverged);
        }
        if column.is_empty() {
            column = derived;
        } else if limits.stale * before < residual {
            // only the convergence depends on it
            column = at(true)?.1;
        }
        let factors = bordered(plane, &found, &column).ok_or(NotCorrected::Diverged)?;
        // near a grazing impact one step may stall before the next ones converge
        let stalls = residual >= 0.5 * before;
        if residual <= limits.tolerance || (stalls && stalled && residual <= limits.enough) {
            let tangent = tangent(&factors, n).ok_or(NotCorrected::Diverged)?;
            return Ok(Corrected { z, tangent, steps, residual, equations: found });
        }
        (before, stalled) = (residual, stalls);
        let away = z.iter().zip(guess).zip(normal).map(|((z, guess), by)| by * (z - guess)).sum();
        let right: Vec<f64> = scaled().chain([away]).collect();
        let step = factors.solve(&right);
        z.iter_mut().zip(step).for_each(|(z, step)| *z -= step);
        // false for NaN, too
        if !z.iter().zip(guess).all(|(z, guess)| (z - guess).abs() <= 1.0) {
            return Err(NotCorrected::Diverged);
        }
    }
    Err(NotCorrected::Diverged)
}

/// The derivative of the scaled equations, with the normal as its last row; `None` if singular.
fn bordered(
    Hyperplane { normal, scale, sizes, .. }: Hyperplane<'_>,
    found: &SequenceEquations,
    column: &[f64],
) -> Option<Elimination> {
    let n = sizes.len();
    let mut matrix = Vec::with_capacity((n + 1) * (n + 1));
    for (i, size) in sizes.iter().enumerate() {
        let row = found.own[i * n..][..n].iter().zip(&found.before[i * n..][..n]);
        let whole = row.map(|(own, before)| own + before).chain([column[i]]);
        matrix.extend(whole.zip(scale).map(|(by, scale)| by * scale / size));
    }
    matrix.extend(normal);
    let factors = Elimination::new(matrix, n + 1, 0.0);
    (factors.rank() == n + 1).then_some(factors)
}

/// The unit vector along which the equations do not change; `None` if not finite.
fn tangent(bordered: &Elimination, n: usize) -> Option<Vec<f64>> {
    let mut right = vec![0.0; n];
    right.push(1.0);
    let mut along = bordered.solve(&right);
    let length = along.iter().map(|it| it * it).sum::<f64>().sqrt();
    along.iter_mut().for_each(|it| *it /= length);
    along.iter().all(|it| it.is_finite()).then_some(along)
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
        // far above the largest number
        let away = LinearLaw { stiffness: -1e4, ..law };
        let flights = LinearFlights::new(away, vec![], 10.0, (10_000, false)).unwrap();
        let far = flights.fly::<Infallible>(flight);
        assert!(matches!(far, Err(Failure::Status(Status::StepSizeTooSmall))));
    }
}

#[cfg(test)]
mod impulses_tests {
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

#[cfg(test)]
mod correction_tests {
    use std::convert::Infallible;

    use super::super::{sequence_equations, ImpactSequence, Wrt};
    use super::*;
    use crate::{LinearForce, Status, SwitchedRk};

    const E: f64 = 0.5;
    const LIMITS: Limits = Limits { evaluations: 10, tolerance: 1e-12, enough: 1e-10, stale: 0.05 };

    /// A ball on a table that vibrates with the amplitude `a` and frequency 1.
    fn table(
        y: &[f64],
        a: f64,
        derives: bool,
    ) -> Result<(SequenceEquations, Vec<f64>), Failure<Infallible>> {
        let mut force = LinearForce {
            stiffness: 0.0,
            damping: 0.0,
            gravity: 1.0,
            amplitude: a,
            omega: 1.0,
            phase: -std::f64::consts::FRAC_PI_2,
        };
        let length = 2.0 * std::f64::consts::PI;
        let sequence = ImpactSequence { unknowns: y, last: [y[0], y[1]], length, e: E };
        let wrt = derives.then_some((Wrt::Parameter(3), a));
        let found = sequence_equations(&mut force, sequence, SwitchedRk::default(), wrt)?;
        let column = found.by_parameter(0.0);
        Ok((found, column))
    }

    /// Impulse, time and amplitude of one impact a period, by its time.
    fn exact(t: f64) -> [f64; 3] {
        // x'' = a sin t - 1 from (t, 0, u) to (t + 2 pi, 0, -u/e):
        //   x: (u + a cos t) 2 pi - 2 pi^2 = 0,    x': u - 2 pi = -u/e
        let pi = std::f64::consts::PI;
        let u = 2.0 * pi * E / (1.0 + E);
        [(1.0 + E) / E * u, t, (pi - u) / t.cos()]
    }

    #[test]
    fn a_branch_of_closed_form_is_found_with_its_tangent() {
        let (scale, sizes) = ([6.0, 6.0, 0.6], [3.0, 2.0]);
        for t in [0.3, 0.6, -0.4] {
            let scaled = |y: [f64; 3]| [0, 1, 2].map(|i| y[i] / scale[i]);
            let guess = scaled([exact(t)[0] + 0.2, t + 0.05, exact(t)[2] - 0.05]);
            let normal = [0.0, 0.6, 0.8];
            let plane = Hyperplane { guess: &guess, normal: &normal, scale: &scale, sizes: &sizes };
            let it = correct(plane, LIMITS, table).unwrap();
            let found = exact(it.z[1] * scale[1]);
            for (z, exact) in it.z.iter().zip(scaled(found)) {
                assert!((z - exact).abs() < 1e-11, "{it:?}");
            }
            let apart: f64 = (0..3).map(|i| normal[i] * (it.z[i] - guess[i])).sum();
            assert!(apart.abs() < 1e-14 && it.residual <= 1e-12 && it.steps > 1, "{it:?}");
            // da/dt = a tan t, of a derivative by the parameter at the guess
            let along = [0.0, 1.0 / scale[1], found[2] * found[1].tan() / scale[2]];
            let length = along.iter().map(|it| it * it).sum::<f64>().sqrt();
            let side = (normal[1] * along[1] + normal[2] * along[2]).signum();
            assert_eq!(it.tangent.len(), 3);
            for (tangent, along) in it.tangent.iter().zip(along) {
                assert!((tangent - side * along / length).abs() < 0.05, "{it:?}");
            }
        }
    }

    /// Corrects by residuals that come one after the other; the steps, and whether each evaluation
    /// asked for the derivative.
    fn scripted(residuals: &[f64], limits: Limits) -> (Option<usize>, Vec<bool>) {
        let (mut count, mut asked) = (0, Vec::new());
        let plane = Hyperplane {
            guess: &[0.0; 3],
            normal: &[0.0, 0.0, 1.0],
            scale: &[1.0; 3],
            sizes: &[1.0; 2],
        };
        let found = correct(plane, limits, |_, _, derives| {
            count += usize::from(!derives || asked.is_empty());
            asked.push(derives);
            let found = SequenceEquations {
                flights: Vec::new(),
                residual: vec![residuals[count - 1], 0.0],
                own: vec![1.0, 0.0, 0.0, 1.0],
                before: vec![0.0; 4],
                by: Vec::new(),
            };
            Ok::<_, Failure<Infallible>>((found, vec![0.0; 2]))
        });
        (found.ok().map(|it| it.steps), asked)
    }

    #[test]
    fn the_derivative_by_the_parameter_is_renewed_where_the_residual_falls_slowly() {
        let limits = Limits { stale: 0.3, ..LIMITS };
        let slow = [true, false, true, false];
        assert_eq!(scripted(&[0.1, 0.05, 1e-13], limits), (Some(2), slow.to_vec()));
        let fast = [true, false, false];
        assert_eq!(scripted(&[0.1, 0.02, 1e-13], limits), (Some(2), fast.to_vec()));
    }

    #[test]
    fn what_rounding_allows_is_enough_after_two_steps_that_stall() {
        let steps = |residuals: &[f64]| scripted(residuals, LIMITS).0;
        assert_eq!(steps(&[4e-11, 3e-11, 2e-11]), Some(2));
        assert_eq!(steps(&[4e-11, 1e-11, 8e-12, 7e-12]), Some(3));
        // not yet, or never
        assert_eq!(steps(&[4e-9, 3e-9, 2e-9, 1.5e-9, 1e-12]), Some(4));
        assert_eq!(steps(&[3e-9; 10]), None);
    }

    #[test]
    fn what_cannot_be_corrected_is_told() {
        let (scale, sizes, guess) = ([6.0, 6.0, 0.6], [3.0, 2.0], [1.1, 0.1, 2.0]);
        let plane = |normal| Hyperplane { guess: &guess, normal, scale: &scale, sizes: &sizes };
        let few = Limits { evaluations: 2, ..LIMITS };
        let diverged = Err(NotCorrected::Diverged);
        assert_eq!(correct(plane(&[0.0, 0.0, 1.0]), few, table), diverged);
        assert_eq!(correct(plane(&[0.0; 3]), LIMITS, table), diverged);
        let nan = |y: &[f64], p: f64, derives: bool| {
            let (mut found, column) = table(y, p, derives)?;
            found.residual[0] = f64::NAN;
            Ok((found, column))
        };
        assert_eq!(correct(plane(&[0.0, 0.0, 1.0]), LIMITS, nan), diverged);
        let fails = |_: &[f64], _: f64, _: bool| {
            Err::<_, Failure<Infallible>>(Failure::Status(Status::StepBudget))
        };
        let failed = NotCorrected::Flight(Failure::Status(Status::StepBudget));
        assert_eq!(correct(plane(&[0.0, 0.0, 1.0]), LIMITS, fails), Err(failed));
    }
}
