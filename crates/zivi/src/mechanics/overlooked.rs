//! Features of the forces or of the surfaces that lie between the stages of a step.

use super::flight::tolerances;
use super::kinetics::Model;
use super::lift_off::Rows;
use super::machine::Machine;
use super::mode::Next;
use crate::numeric::step_error::{worse, StepError};
use crate::numeric::step_size::{factor, FACTORS};
use crate::record::failure::Failure;
use crate::system::dynamics::Dynamics;

/// What is overlooked is more than so many tolerances: the polynomials are no better than that.
const DEFECT: f64 = 100.0;

impl Machine {
    /// Whether the step overlooks something that lies between its stages, and by which factor it
    /// is to be shortened then; `contact` tells the gap that closes in it. The gaps that are
    /// integrated must be those of their functions at its end, and where a step may be a whole arc,
    /// the equation of motion must hold at the apex.
    pub(super) fn overlooked<E, D: Dynamics<E>>(
        &mut self,
        contact: Option<usize>,
        model: &mut Model<'_, D>,
    ) -> Result<Option<f64>, Failure<E>> {
        if !self.settings.adaptive || self.control.jump.allowed {
            return Ok(None);
        }
        let mut excess = 0.0;
        if contact.is_none() {
            self.finish_step(model)?;
            excess = self.misfit();
        }
        if excess <= 1.0 && !self.next.experience().is_enough(self.last.stages.h) {
            let (n, closed) = (self.layout.n, self.contacts.closed);
            for i in (0..self.layout.m).filter(|&i| !closed.has(i)) {
                let falls = contact == Some(i) || self.last.stages.end.xdot[n + i] < 0.0;
                if self.now.xdot[n + i] > 0.0 && falls {
                    excess = worse(excess, self.defect_at_apex(i, model)?);
                }
            }
        }
        if excess <= 1.0 {
            return Ok(None);
        }
        // the shorter step is looked at again
        self.next = Next::STEP;
        Ok(Some(factor(excess, self.last.stages.order_of_error()).max(FACTORS.0)))
    }

    /// How far the gaps at the end of the finished step are from their functions, in what is
    /// allowed of it.
    pub(super) fn misfit(&self) -> f64 {
        let (n, m) = (self.layout.n, self.layout.m);
        let of = |c: usize| self.last.stages.scales(c, &tolerances(&self.settings))[0];
        let largest = (0..n).map(of).fold(0.0_f64, f64::max);
        let each = (0..m).map(|i| {
            let far = (self.last.at_end.gap[i] - self.last.stages.end.x[n + i]).abs();
            far / (DEFECT * (of(n + i) + self.last.at_end.steepness[i] * largest))
        });
        each.fold(0.0, worse)
    }

    /// How far the polynomials of the step are from the equation of motion where a gap is largest,
    /// as an error at its end, in what is allowed of it.
    fn defect_at_apex<E, D: Dynamics<E>>(
        &mut self,
        gap: usize,
        model: &mut Model<'_, D>,
    ) -> Result<f64, Failure<E>> {
        self.complete_step(model)?;
        let [_, rate] = self.last.stages.polynomials_of(self.layout.n + gap);
        let theta = rate.first_negative().unwrap_or(0.5);
        let rows = (0..self.now.x.len()).map(|c| self.last.stages.polynomials_of(c)).collect();
        self.defect(&rows, theta, model)
    }

    /// The same at a part of the step, where the system is evaluated.
    pub(super) fn defect<E, D: Dynamics<E>>(
        &mut self,
        rows: &Rows,
        theta: f64,
        model: &mut Model<'_, D>,
    ) -> Result<f64, Failure<E>> {
        self.evaluate_along(rows, theta, model)?;
        let (h, tolerances) = (self.last.stages.h, tolerances(&self.settings));
        let defects = rows.iter().enumerate().map(|(c, [_, v])| {
            let defect = h * self.aside.acceleration[c] - v.slope(theta);
            let error = StepError { x: [h * defect, 0.0], xdot: [defect, 0.0], double: false };
            error.norm(self.last.stages.scales(c, &tolerances)) / DEFECT
        });
        Ok(defects.fold(0.0, worse))
    }

    /// Evaluates the system at a part of the last step, aside.
    pub(super) fn evaluate_along<E, D: Dynamics<E>>(
        &mut self,
        rows: &Rows,
        theta: f64,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let coordinates = rows[..self.layout.n].iter();
        let (q, w): (Vec<f64>, Vec<f64>) =
            coordinates.map(|[x, v]| (x.at(theta), v.at(theta))).unzip();
        self.aside.evaluate(model, self.now.t + theta * self.last.stages.h, &q, &w)?;
        Ok(self.aside.contact(self.contacts.closed)?)
    }
}
