//! The map from one impact to the next under a linear force with at most one frequency.
//!
//! ```text
//! (phi, u) -> (phi', u'),    phi = omega t modulo 2 pi,  u > 0 the speed after an impact     (1)
//! ```
//!
//! A column `(X, V)` of derivatives of the flight solves the same linear equation as the flight,
//! with the derivative of the force on its right side. At the impact with the velocity `v` and the
//! acceleration `a`
//!
//! ```text
//! dt = -X/v      dphi' = dphi + omega dt + t domega      du' = -e (V + a dt) - v de          (2)
//! ```
//!
//! Where only `phi` and `u` vary, `det J = e^2 (u/u') exp(-c t)`.

use crate::numeric::root::{of_angle, Phase};
use crate::switched::flight::series::{
    column, derivative, value_and_slope, Linear, Series, SeriesStart, Step, Table, WaveReading,
    TERMS,
};
use crate::{LinearLaw, SetupError, Wave};
use std::f64::consts::TAU;
use std::sync::Arc;
use zivi_core::Restitution;

/// Result of the map of an impact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Return {
    /// `omega t` at the next impact, from 0 to below `2 pi` (rad).
    pub phase: f64,
    /// The speed after it (m/s).
    pub u: f64,
    /// The time between both (s).
    pub duration: f64,
}

impl Return {
    const NONE: Self = Self { phase: f64::NAN, u: f64::NAN, duration: f64::NAN };
}

/// The map from impact to impact, to rounding; there is no next one where it gives NaN: the mass
/// never comes back, or is so slow that its impacts accumulate.
///
/// ```
/// use zivi::{ImpactMap, LinearForce, Restitution};
///
/// let oscillator = LinearForce {
///     stiffness: 1.0, damping: 0.1, gravity: 0.0, amplitude: 1.0, omega: 2.2, phase: 0.0,
/// };
/// let map = ImpactMap::new(&oscillator, Restitution::from_e(0.7)?)?;
/// // a periodic motion with one impact in each period
/// let (phase, u) = (2.2 * 2.5350230410371397, 1.1762635553748877);
/// let (next, jacobian) = map.with_jacobian(phase, u);
/// assert!((next.phase - phase).abs() < 1e-13 && (next.u - u).abs() < 1e-13);
/// let det = jacobian[0][0] * jacobian[1][1] - jacobian[0][1] * jacobian[1][0];
/// assert!((det - 0.49 * (-0.1 * next.duration).exp()).abs() < 1e-13);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct ImpactMap {
    law: LinearLaw,
    linear: Linear,
    table: Arc<Table>,
    omega: f64,
    e: f64,
}

/// Steps of a flight after which it is given up as one that never ends.
const MOST_STEPS: usize = 1_000_000;

/// A flight that lasts so little, in turns and in steps of the table, is one of an accumulation.
const SHORTEST: f64 = 1e-13;

/// The clock of the one wave that there is tells no time.
const NO_TIME: (f64, f64) = (0.0, 0.0);

/// A flight in progress: its start, and derivatives of its state.
struct MapFlight<'m> {
    map: &'m ImpactMap,
    clock: WaveReading,
    /// The phase of the impact at its end.
    end: Phase,
    start: SeriesStart,
    known: usize,
    /// Steps so far.
    steps: f64,
}

impl ImpactMap {
    /// The map of a force and a wall.
    ///
    /// # Errors
    /// [`SetupError::Setting`] where the force is not linear, has two frequencies, or is not driven:
    /// `omega` is zero.
    pub fn new<F: crate::Force<std::convert::Infallible>>(
        force: &F,
        restitution: Restitution,
    ) -> Result<Self, SetupError> {
        let refuse = |name, value, range| Err(SetupError::Setting(name, value, range));
        let Some(law) = force.linear() else {
            return refuse("force", f64::NAN, "a number or a linear force");
        };
        let linear = Linear::new(&law);
        if linear.second().is_some() {
            let second = linear.table_law().omega[1];
            return refuse("omega", second, "the same for the force and its wall");
        }
        let omega = match linear.first() {
            Some(_) => linear.table_law().omega[0],
            None => law.waves[0].omega.abs(),
        };
        if !(omega > 0.0 && omega.is_finite()) {
            return refuse("omega", omega, "> 0: the phase of an impact is that of the excitation");
        }
        let mut of_table = linear.table_law();
        of_table.omega[0] = omega;
        let table = Table::shared(of_table);
        if !(table.h() > 1e-100 && table.h() < 1e100) {
            return refuse("force", table.h(), "one with times that can be computed with");
        }
        Ok(Self { law, linear, table, omega, e: restitution.e() })
    }

    /// The next impact.
    #[must_use]
    pub fn next(&self, phase: f64, u: f64) -> Return {
        self.after(of_angle(phase), u).0
    }

    /// The next impact, and `[[dphi'/dphi, dphi'/du], [du'/dphi, du'/du]]`.
    #[must_use]
    pub fn with_jacobian(&self, phase: f64, u: f64) -> (Return, [[f64; 2]; 2]) {
        let by = [MapColumn::of_phase(), MapColumn::of_speed(self.table.h())];
        let (next, [[a, c], [b, d]]) = self.with_columns(phase, u, by, true);
        (next, [[a, b], [c, d]])
    }

    /// The next impact, and the derivatives of its phase and speed by each parameter.
    ///
    /// # Errors
    /// [`SetupError::Setting`] for a wall that moves: its motion depends on some of them.
    pub fn with_parameters(
        &self,
        phase: f64,
        u: f64,
        parameters: &[MapParameter],
    ) -> Result<(Return, Vec<[f64; 2]>), SetupError> {
        if self.law.waves[1].amplitude != [0.0; 2] {
            let range = "0 where the map is differentiated by parameters of the force";
            return Err(SetupError::Setting("wall", self.law.waves[1].omega, range));
        }
        let mut next = self.next(phase, u);
        let mut all = Vec::with_capacity(parameters.len());
        for &parameter in parameters {
            let (found, [column]) =
                self.with_columns(phase, u, [MapColumn::of_parameter(parameter, &self.law)], false);
            next = found;
            all.push(column);
        }
        Ok((next, all))
    }

    /// The impacts that follow one another: into `out` phase and speed of each that is kept, the
    /// first after `skip` others. NaN after the last impact.
    pub fn orbit(&self, phase: f64, u: f64, skip: usize, out: &mut [[f64; 2]]) {
        self.orbit_unless([phase, u], skip, out, &|| false);
    }

    /// The same with interruption: the rest of `out` is then unchanged.
    pub(crate) fn orbit_unless(
        &self,
        [phase, u]: [f64; 2],
        skip: usize,
        out: &mut [[f64; 2]],
        stop: &dyn Fn() -> bool,
    ) {
        /// Impacts between two looks whether to stop.
        const LOOK: usize = 4096;
        let (mut phase, mut u) = (of_angle(phase), u);
        for n in 0..skip.saturating_add(out.len()) {
            if n % LOOK == 0 && stop() {
                return;
            }
            let (next, at) = self.after(phase, u);
            if let Some(place) = n.checked_sub(skip).and_then(|n| out.get_mut(n)) {
                *place = [next.phase, next.u];
            }
            if next.u.is_nan() {
                return out
                    .iter_mut()
                    .skip(n.saturating_sub(skip))
                    .for_each(|it| *it = [next.u; 2]);
            }
            (phase, u) = (at, next.u);
        }
    }

    /// The next impact and its phase, of which nothing is lost.
    fn after(&self, phase: Phase, u: f64) -> (Return, Phase) {
        if !(u > 0.0 && u.is_finite()) {
            return (Return::NONE, phase);
        }
        let mut flight = MapFlight::new(self, phase, u);
        for _ in 0..MOST_STEPS {
            let step = Step::next(&self.table, &flight.start, flight.known, true);
            flight.go_on(&step);
            if step.lands {
                return (flight.landed(&step), flight.end);
            }
            if !(step.x.is_finite() && step.v.is_finite()) {
                break;
            }
        }
        (Return::NONE, phase)
    }

    fn with_columns<const N: usize>(
        &self,
        phase: f64,
        u: f64,
        mut columns: [MapColumn; N],
        far: bool,
    ) -> (Return, [[f64; 2]; N]) {
        const NONE: [f64; 2] = [f64::NAN; 2];
        if !(u > 0.0 && u.is_finite()) {
            return (Return::NONE, [NONE; N]);
        }
        let mut flight = MapFlight::new(self, of_angle(phase), u);
        for _ in 0..MOST_STEPS {
            let step = Step::next(&self.table, &flight.start, flight.known, far);
            for column in &mut columns {
                column.go_on(flight.step_start(), &step);
            }
            flight.go_on(&step);
            if step.lands {
                let next = flight.landed(&step);
                return (next, columns.map(|column| flight.derivatives(&step, &next, &column)));
            }
            if !(step.x.is_finite() && step.v.is_finite()) {
                break;
            }
        }
        (Return::NONE, [NONE; N])
    }
}

impl<'m> MapFlight<'m> {
    fn new(map: &'m ImpactMap, phase: Phase, u: f64) -> Self {
        let clock = WaveReading::new(&map.linear, Phase { turns: 0.0, ..phase }, NO_TIME);
        let start = SeriesStart {
            x: 0.0,
            v: u * map.table.h(),
            force: map.linear.constant,
            waves: clock.waves,
        };
        Self { map, clock, end: phase, start, known: 1, steps: 0.0 }
    }

    /// Where its next step starts.
    fn step_start(&self) -> StepStart<'_> {
        let Self { map, clock, start, steps, .. } = self;
        StepStart { table: &map.table, start, clock, steps: *steps }
    }

    /// To the end of a step.
    fn go_on(&mut self, step: &Step) {
        self.steps += step.length;
        let ImpactMap { linear, table, .. } = self.map;
        if step.lands {
            self.end = self.clock.phase(step.length, table);
            return;
        }
        self.clock = self.clock.after::<1>(step.length, NO_TIME, linear, table);
        self.start = SeriesStart { x: step.x, v: step.v, waves: self.clock.waves, ..self.start };
        self.known = if step.x > 0.0 { 0 } else { 1 };
    }

    fn landed(&self, step: &Step) -> Return {
        let part = self.end.part;
        let part = part + if part < 0.0 { 1.0 } else { 0.0 };
        let duration = self.steps * self.map.table.h();
        if self.steps * (1.0 + self.map.table.turns()) < SHORTEST {
            return Return::NONE;
        }
        // a part just below zero is a whole turn by rounding
        let phase = if part < 1.0 { TAU * part } else { 0.0 };
        let u = -self.map.e * step.v / self.map.table.h();
        Return { phase, u, duration }
    }

    /// Equations (2), at the end of the last step.
    fn derivatives(&self, step: &Step, next: &Return, column: &MapColumn) -> [f64; 2] {
        let ImpactMap { table, e, omega, .. } = self.map;
        let h = table.h();
        let v = step.v / h;
        let ImpactMap { law, linear, .. } = self.map;
        let push = linear.first().map_or(0.0, |wave| wave.at(self.end)[0]);
        let a = linear.constant + push - law.damping * v;
        let dt = -column.x / v;
        let du = -e * (column.v / h + a * dt) - v * column.e;
        let own = if column.by == By::Omega { next.duration } else { 0.0 };
        [column.phase + omega * dt + own, du]
    }
}

// Columns of derivatives along a flight: the linear equation of the flight, with the derivative
// of the force on its right side.

/// A parameter by which the map is differentiated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MapParameter {
    /// Stiffness per unit mass.
    Stiffness,
    /// Damping per unit mass.
    Damping,
    /// Constant acceleration towards the wall.
    Gravity,
    /// Amplitude of the excitation.
    Amplitude,
    /// Angular frequency of the excitation.
    Omega,
    /// Phase of the excitation.
    Phase,
    /// Coefficient of restitution.
    Restitution,
}

/// Where a step of a flight starts.
#[derive(Clone, Copy, Debug)]
struct StepStart<'a> {
    table: &'a Table,
    start: &'a SeriesStart,
    clock: &'a WaveReading,
    /// Steps so far.
    steps: f64,
}

/// Inhomogeneity of the equation of a column.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum By {
    #[default]
    Nothing,
    Stiffness,
    Damping,
    Omega,
}

/// Derivatives of the state, of the force and of the phase by something.
#[derive(Clone, Copy, Debug, Default)]
struct MapColumn {
    x: f64,
    /// Of the velocity, times the step of the table.
    v: f64,
    force: f64,
    /// Of the phase of an impact and the rotation of the wave.
    phase: f64,
    turn: f64,
    /// A wave that is added.
    wave: Option<Linear>,
    e: f64,
    by: By,
}

impl MapColumn {
    fn of_phase() -> Self {
        Self { phase: 1.0, turn: 1.0, ..Self::default() }
    }

    fn of_speed(h: f64) -> Self {
        Self { v: h, ..Self::default() }
    }

    /// By a parameter of the force or the wall.
    fn of_parameter(parameter: MapParameter, law: &LinearLaw) -> Self {
        let none = Self::default();
        let unit = Wave { amplitude: [1.0, 0.0], ..law.waves[0] };
        let unit = LinearLaw { waves: [unit, Wave::default()], ..LinearLaw::default() };
        let unit = Linear::new(&unit);
        match parameter {
            MapParameter::Stiffness => Self { by: By::Stiffness, ..none },
            MapParameter::Damping => Self { by: By::Damping, ..none },
            MapParameter::Gravity => Self { force: -1.0, ..none },
            MapParameter::Amplitude => Self { wave: Some(unit), ..none },
            MapParameter::Omega => Self { by: By::Omega, ..none },
            // a frequency below zero turns the other way
            MapParameter::Phase => {
                Self { turn: if law.waves[0].omega < 0.0 { -1.0 } else { 1.0 }, ..none }
            }
            MapParameter::Restitution => Self { e: 1.0, ..none },
        }
    }

    /// To the end of a step of the flight.
    fn go_on(&mut self, at: StepStart<'_>, step: &Step) {
        let (table, [re, im]) = (at.table, at.start.waves[0]);
        let h = table.h();
        // the wave z turned by the angle a changes by i a z
        let angle = self.turn + if self.by == By::Omega { at.steps * h } else { 0.0 };
        let mut wave = [-angle * im, angle * re];
        if let Some(unit) = self.wave.as_ref().and_then(Linear::first) {
            let more = unit.at(at.clock.phase(0.0, table));
            wave = [wave[0] + more[0], wave[1] + more[1]];
        }
        let start =
            SeriesStart { x: self.x, v: self.v, force: self.force, waves: [wave, [0.0; 2]] };
        let whole = (step.length == 1.0 && self.by == By::Nothing).then_some(0);
        if let Some(j) = step.doublings.or(whole) {
            let end = table.jump(&start, j);
            (self.x, self.v) = (end.x, end.v);
            return;
        }
        let mut y = table.series(&start);
        if self.by != By::Nothing {
            let own = self.particular(at);
            y.iter_mut().zip(own).for_each(|(y, own)| *y += own);
        }
        [self.x, self.v] = value_and_slope(&y, step.length);
    }

    /// The flight that starts at rest under what `k`, `c` or `omega` adds to the force of a column,
    /// `-x`, `-x'` or `s h i z e^(i W s)`.
    fn particular(&self, at: StepStart<'_>) -> Series {
        let table = at.table;
        let (law, h) = (table.law(), table.h());
        let a = table.series(at.start);
        let mut d = [0.0; TERMS];
        match self.by {
            By::Stiffness => d.iter_mut().zip(a).for_each(|(d, a)| *d = -h * h * a),
            By::Damping => d.iter_mut().zip(derivative(&a)).for_each(|(d, a)| *d = -h * a),
            By::Omega => {
                let (w, [re, im]) = (law.omega[0] * h, at.start.waves[0]);
                // h^3 Re i z (i W)^n/n! s^(n+1)
                let (mut term, mut size) = ([-im, re], h * h * h);
                for (n, d) in d.iter_mut().enumerate().skip(1) {
                    *d = size * term[0];
                    term = [-term[1], term[0]];
                    size *= w / n as f64;
                }
            }
            By::Nothing => {}
        }
        column(law.stiffness * h * h, law.damping * h, 0.0, 0.0, &d)
    }
}

#[cfg(test)]
mod impact_map_tests {
    use super::*;
    use crate::LinearForce;

    /// `x = -.9 + .9 cos t + u sin t` under a spring and a load that does not turn while it flies.
    #[test]
    fn flights_are_too_short_by_their_length_and_not_by_the_slowness_of_the_wave() {
        let force = LinearForce {
            stiffness: 1.0,
            gravity: 1.0,
            amplitude: 0.1,
            omega: 1e-14,
            damping: 0.0,
            phase: 0.0,
        };
        let map = ImpactMap::new(&force, Restitution::from_e(0.5).unwrap()).unwrap();
        for u in [1.0_f64, 1e-3, 1e-9] {
            let next = map.next(0.0, u);
            let duration = 2.0 * (u / 0.9).atan();
            assert!((next.u / (0.5 * u) - 1.0).abs() < 1e-12, "{next:?}");
            assert!((next.duration / duration - 1.0).abs() < 1e-12, "{next:?}");
        }
        assert!(map.next(0.0, 1e-16).u.is_nan());
    }
}
