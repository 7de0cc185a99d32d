//! The mechanics along a step, between its stages.

use super::equation::Stages;
use super::kinetics::{Kinetics, Model};
use crate::numeric::bernstein::Bernstein;
use crate::numeric::step_error::{worse, StepError, Tolerances};
use crate::record::contact_mode::ContactMode;
use crate::record::failure::Failure;

use crate::system::dynamics::Dynamics;

/// What is overlooked is more than so many tolerances: the polynomials are no better than that.
pub(super) const DEFECT: f64 = 100.0;

/// A complete step, evaluated at any part of it.
pub(super) struct AlongStep<'r, 'm, D> {
    pub(super) step: &'r Stages,
    pub(super) mode: ContactMode,
    pub(super) tolerances: &'r Tolerances,
    /// Whether directions in which something sticks turn or move in the step.
    pub(super) turns: bool,
    /// The mechanics where they were evaluated last.
    pub(super) aside: &'r mut Kinetics,
    pub(super) model: &'r mut Model<'m, D>,
}

/// The polynomials of position and velocity over a step, of the coordinates and then the gaps.
pub(super) type Rows = Vec<[Bernstein; 2]>;

impl<D> AlongStep<'_, '_, D> {
    /// The first so many polynomials of the step.
    pub(super) fn rows(&self, count: usize) -> Rows {
        (0..count).map(|c| self.step.polynomials_of(c)).collect()
    }

    /// Evaluates the system at a part of the step.
    pub(super) fn evaluate<E>(&mut self, rows: &Rows, theta: f64) -> Result<(), Failure<E>>
    where
        D: Dynamics<E>,
    {
        let coordinates = rows[..self.aside.coordinates()].iter();
        let (q, w): (Vec<f64>, Vec<f64>) =
            coordinates.map(|[x, v]| (x.at(theta), v.at(theta))).unzip();
        let t = self.step.from.t + theta * self.step.h;
        self.aside.evaluate(self.model, t, &q, &w)?;
        Ok(self.aside.contact(self.mode)?)
    }

    /// How far the polynomials are from the equation of motion at a part of the step, as an error
    /// at its end, in what is allowed of it. The system is evaluated there.
    pub(super) fn defect<E>(&mut self, rows: &Rows, theta: f64) -> Result<f64, Failure<E>>
    where
        D: Dynamics<E>,
    {
        self.evaluate(rows, theta)?;
        let h = self.step.h;
        let defects = rows.iter().enumerate().map(|(c, [_, v])| {
            let defect = h * self.aside.acceleration[c] - v.slope(theta);
            let error = StepError { x: [h * defect, 0.0], xdot: [defect, 0.0], double: false };
            error.norm(self.step.scales(c, self.tolerances)) / DEFECT
        });
        Ok(defects.fold(0.0, worse))
    }
}
