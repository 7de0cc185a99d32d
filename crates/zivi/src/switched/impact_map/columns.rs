//! Columns of derivatives along a flight: the linear equation of the flight, with the derivative
//! of the force on its right side.

use crate::switched::flight::series::{column, derivative, value_and_slope, Linear};
use crate::switched::flight::series::{Reading, Series, Start, Step, Table, TERMS};
use crate::{LinearLaw, Wave};

/// A parameter by which the map is differentiated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MapParameter {
    /// Stiffness per unit mass.
    Stiffness,
    /// Damping per unit mass.
    Damping,
    /// Constant pull towards the wall.
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
pub(super) struct StepStart<'a> {
    pub(super) table: &'a Table,
    pub(super) start: &'a Start,
    pub(super) clock: &'a Reading,
    /// Steps so far.
    pub(super) steps: f64,
}

/// What enters the equation of a column besides the columns themselves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum By {
    #[default]
    Nothing,
    Stiffness,
    Damping,
    Omega,
}

/// Derivatives of the state, of the force and of the phase by something.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Column {
    pub(super) x: f64,
    /// Of the velocity, times the step of the table.
    pub(super) v: f64,
    pub(super) force: f64,
    /// Of the phase of an impact, and by how much the wave turns.
    pub(super) phase: f64,
    pub(super) turn: f64,
    /// A wave that is added.
    pub(super) wave: Option<Linear>,
    pub(super) e: f64,
    pub(super) by: By,
}

impl Column {
    pub(super) fn of_phase() -> Self {
        Self { phase: 1.0, turn: 1.0, ..Self::default() }
    }

    pub(super) fn of_speed(h: f64) -> Self {
        Self { v: h, ..Self::default() }
    }

    /// By a parameter of the force or the wall.
    pub(super) fn of_parameter(parameter: MapParameter, law: &LinearLaw) -> Self {
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
    pub(super) fn go_on(&mut self, at: StepStart<'_>, step: &Step) {
        let (table, [re, im]) = (at.table, at.start.waves[0]);
        let h = table.h();
        // the wave z turned by the angle a changes by i a z
        let angle = self.turn + if self.by == By::Omega { at.steps * h } else { 0.0 };
        let mut wave = [-angle * im, angle * re];
        if let Some(unit) = self.wave.as_ref().and_then(Linear::first) {
            let more = unit.at(at.clock.phase(0.0, table));
            wave = [wave[0] + more[0], wave[1] + more[1]];
        }
        let start = Start { x: self.x, v: self.v, force: self.force, waves: [wave, [0.0; 2]] };
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
