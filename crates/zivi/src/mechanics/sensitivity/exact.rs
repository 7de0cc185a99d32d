//! The columns along the flights of a linear system: by the same power series, to rounding.

use super::variational_run::VariationalRun;
use crate::mechanics::integrator::MechanicalIntegrator;
use crate::mechanics::kinetics::Model;
use crate::mechanics::linear_flight::{FlightRates, Flown};
use crate::mechanics::mode::Next;
use crate::mechanics::path::Piece;
use crate::numeric::bernstein::Polynomial;
use crate::numeric::power_series::TERMS;
use crate::record::status::Failure;
use crate::switched::sensitivity::Limit;
use crate::system::dynamics::Layout;
use crate::system::partials::DifferentiableDynamics;

impl VariationalRun<'_> {
    /// A step of a linear system, with the columns.
    pub(super) fn fly_exactly<E, D: DifferentiableDynamics<E>>(
        &mut self,
        machine: &mut MechanicalIntegrator,
        t_end: f64,
        model: &mut Model<'_, D>,
    ) -> Result<Piece, Failure<E>> {
        let (from, mode) = (machine.state().now().clone(), machine.state().mode());
        let closed = mode.closed;
        let t = model.smooth.nearest(from.t);
        let piece = machine.advance(t_end, model)?;
        let length = machine.motion().length();
        if machine.motion_mut().linear().is_none() {
            // its contacts are not determined: from here on by steps
            self.columns.advance(machine.motion().last(), mode, model)?;
            self.flew(machine, model)?;
            return Ok(piece);
        }
        self.note_height(machine);
        self.columns.visited = None;
        self.prepare_rates(machine, model);
        let flown = Flown { from: &from, t, closed, length };
        if let Next::Step = machine.next() {
            self.exact_minima(flown, machine)?;
        }
        let until = machine.state().now().t;
        while let Some(t) = self.next_time().filter(|&t| t < until) {
            let length = ((t - from.t) - from.late).clamp(0.0, length);
            let (x, v) = self.columns_after(Flown { length, ..flown }, machine)?;
            let (n, size) = (self.columns.layout.n, self.columns.size());
            for of in [&x, &v] {
                self.samples.extend(of.chunks_exact(size).flat_map(|column| &column[..n]));
            }
        }
        (self.columns.now.x, self.columns.now.xdot) = self.columns_after(flown, machine)?;
        if !closed.is_empty() {
            self.columns.visit(model, machine.state().now(), mode)?;
            self.columns.project(mode, machine.state().now())?;
        }
        Ok(piece)
    }

    /// How the parameters move the flights.
    fn prepare_rates<E, D: DifferentiableDynamics<E>>(
        &mut self,
        machine: &mut MechanicalIntegrator,
        model: &Model<'_, D>,
    ) {
        if self.exact.is_some() {
            return;
        }
        let (Some(flight), Some(system)) = (machine.motion_mut().linear(), model.dynamics.linear())
        else {
            return;
        };
        let by = self.columns.local.by().iter();
        let rates = by.filter_map(|&parameter| model.dynamics.linear_rate(parameter));
        self.exact = Some(FlightRates::new(flight, system, rates.map(|rate| &**rate)));
    }

    /// The columns, and their rates, after a part of a step that was flown.
    fn columns_after<E>(
        &mut self,
        flown: Flown<'_>,
        machine: &mut MechanicalIntegrator,
    ) -> Result<(Vec<f64>, Vec<f64>), Failure<E>> {
        let size = self.columns.size();
        let (mut x, mut v) = (self.columns.now.x.clone(), self.columns.now.xdot.clone());
        if let (Some(flight), Some(rates)) = (machine.motion_mut().linear(), &mut self.exact) {
            let each = x.chunks_exact_mut(size).zip(v.chunks_exact_mut(size));
            for (column, parameter) in each.zip(&self.columns.parameter) {
                flight.differentiate(flown, rates, *parameter, column)?;
            }
        }
        Ok((x, v))
    }

    /// Minima of the gaps within the step.
    fn exact_minima<E>(
        &mut self,
        flown: Flown<'_>,
        machine: &mut MechanicalIntegrator,
    ) -> Result<(), Failure<E>> {
        let (Layout { n, m, .. }, size) = (self.columns.layout, self.columns.size());
        for gap in (0..m).filter(|&gap| !flown.closed.has(gap)) {
            let (before, after) = (flown.from.xdot[n + gap], machine.state().now().xdot[n + gap]);
            let falls_and_rises = before < 0.0 && after > 0.0;
            let Some(flight) = machine.motion_mut().linear().filter(|_| falls_and_rises) else {
                continue;
            };
            let (mut series, mut power) = (*flight.series(gap), 1.0);
            for a in &mut series {
                *a *= power;
                power *= flown.length / flight.step();
            }
            let p = Polynomial::<TERMS>::from_powers(series);
            let Some(theta) = p.derivative().negated().first_negative() else { continue };
            let length = theta * flown.length;
            let (x, _) = self.columns_after(Flown { length, ..flown }, machine)?;
            let rates: Vec<f64> = x.chunks_exact(size).map(|column| column[n + gap]).collect();
            self.validity.note(Limit::Minimum, flown.from.t + length, p.at(theta), rates);
        }
        Ok(())
    }
}
