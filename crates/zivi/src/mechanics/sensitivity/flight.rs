//! The columns in flight and in contact: through the steps of the motion, shorter ones where the
//! columns need them.

use super::variational_run::VariationalRun;
use crate::mechanics::equation::{InContact, Stages};
use crate::mechanics::flight::tolerances;
use crate::mechanics::integrator::MechanicalIntegrator;
use crate::mechanics::kinetics::Model;
use crate::mechanics::mode::Next;
use crate::mechanics::piece::Piece;
use crate::numeric::step_size::{factor, shorter, FACTORS};
use crate::record::failure::Failure;
use crate::record::gap_set::GapSet;
use crate::switched::sensitivity::Limit;
use crate::system::dynamics::Layout;
use crate::system::partials::DifferentiableDynamics;
use crate::Status;

/// Steps that are given up for the columns before one is taken as it is.
const RETRIES: u32 = 40;
/// How far the step onto an impact may be moved to it, relative to its length.
const NUDGE: f64 = 1e-4;

impl VariationalRun<'_> {
    /// A step, shorter ones until the columns are within the tolerances too.
    pub(super) fn fly_within<E, D: DifferentiableDynamics<E>>(
        &mut self,
        machine: &mut MechanicalIntegrator,
        t_end: f64,
        model: &mut Model<'_, D>,
    ) -> Result<Piece, Failure<E>> {
        let (visited, closed) = (self.columns.visited, machine.state().closed());
        let before = machine.save();
        let order = machine.motion().last().order_of_error();
        let shortest = 16.0 * f64::EPSILON * before.state().now().t.abs();
        for retry in 0.. {
            let piece = machine.advance(t_end, model)?;
            let h = machine.motion().last().h;
            self.columns.visited = visited.filter(|_| retry == 0);
            self.columns.advance(machine.motion().last(), closed, model)?;
            let error = self.error(machine, model)?;
            let factor = factor(error, order);
            if error <= 1.0 || retry == RETRIES || h <= shortest {
                if error > 0.0 {
                    let longest = h * factor.clamp(FACTORS.0, FACTORS.1);
                    machine.motion_mut().steps_mut().limit_next(longest);
                }
                self.flew(machine, model)?;
                return Ok(piece);
            }
            machine.give_up_step(&before, shorter(factor) * h);
        }
        Err(Failure::Status(Status::Internal))
    }

    fn error<E, D: DifferentiableDynamics<E>>(
        &mut self,
        machine: &MechanicalIntegrator,
        model: &mut Model<'_, D>,
    ) -> Result<f64, Failure<E>> {
        if !self.controlled || !machine.settings().adaptive {
            return Ok(0.0);
        }
        let tolerances = tolerances(machine.settings());
        self.columns.error(machine.motion().last(), &tolerances, (self.sizes, &self.lost), model)
    }

    /// What a step that was taken adds: samples, minima, the end of the columns.
    pub(super) fn flew<E, D: DifferentiableDynamics<E>>(
        &mut self,
        machine: &mut MechanicalIntegrator,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        self.note_height(machine);
        let (total, t) = (machine.motion().length(), machine.state().now().t);
        let mut onto = None;
        let closed = self.columns.closed;
        if (total - machine.motion().last().h).abs() > NUDGE * machine.motion().last().h {
            // the event was found on the polynomials, away from the end of the step
            let mut stages = machine.motion().last().clone();
            let (from, size) = (stages.from.clone(), self.columns.size());
            let slope: Vec<f64> = (0..size).map(|c| stages.start_slope(c)).collect();
            stages.step(&from, &slope, total, &mut self.motion(closed, model))?;
            self.columns.visited = None;
            self.columns.advance(&stages, closed, model)?;
            onto = Some(stages);
        }
        if let Next::Step = machine.next() {
            self.minima(machine, model)?;
        }
        let stages = onto.as_ref().unwrap_or(machine.motion().last());
        self.sample(stages, t, model)?;
        self.columns.take(stages, total - stages.h, model)?;
        if !closed.is_empty() {
            self.columns.visit(model, machine.state().now(), closed)?;
            self.columns.project(closed, machine.state().now())?;
        }
        Ok(())
    }

    /// The motion itself, evaluated aside.
    fn motion<'r, 'm, D>(
        &'r mut self,
        closed: GapSet,
        model: &'r mut Model<'m, D>,
    ) -> InContact<'r, 'm, D> {
        InContact {
            mode: closed.into(),
            kinetics: &mut self.columns.local.kinetics,
            model,
            at_end: None,
        }
    }

    /// Minima of the gaps within the step.
    fn minima<E, D: DifferentiableDynamics<E>>(
        &mut self,
        machine: &mut MechanicalIntegrator,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let (Layout { n, m, .. }, size) = (self.columns.layout, self.columns.size());
        let closed = self.columns.closed;
        for gap in (0..m).filter(|&gap| !closed.has(gap)) {
            let (from, end) = (
                machine.motion().last().from.xdot[n + gap],
                machine.motion().last().end.xdot[n + gap],
            );
            if !(from < 0.0 && end > 0.0) {
                continue;
            }
            let stages = machine.motion_mut().steps_mut().last_mut();
            stages.complete(&mut self.motion(closed, model))?;
            let [x, rate] = stages.polynomials_of(n + gap);
            let Some(theta) = rate.negated().first_negative() else { continue };
            self.columns.complete(stages, model)?;
            let rates: Vec<f64> = (0..self.count())
                .map(|column| {
                    let entry = column * size + n + gap;
                    self.columns.steps.polynomials_of(entry)[0].at(theta)
                })
                .collect();
            let t = stages.from.t + theta * stages.h;
            self.validity.note(Limit::Minimum, t, x.at(theta), rates);
        }
        Ok(())
    }

    /// Samples within the last step, before `until`.
    fn sample<E, D: DifferentiableDynamics<E>>(
        &mut self,
        stages: &Stages,
        until: f64,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let (n, size) = (self.columns.layout.n, self.columns.size());
        while let Some(t) = self.next_time().filter(|&t| t < until) {
            self.columns.complete(stages, model)?;
            let theta = ((t - stages.from.t) / stages.h).clamp(0.0, 1.0);
            for part in 0..2 {
                for column in 0..self.count() {
                    for c in 0..n {
                        let entry = column * size + c;
                        let curves = self.columns.steps.polynomials_of(entry);
                        self.samples.push(curves[part].at(theta));
                    }
                }
            }
        }
        Ok(())
    }
}
