//! Features of the forces or of the surfaces that lie between the stages of a step.

use super::{Flying, SmoothMotion};
use crate::mechanics::along_step::DEFECT;
use crate::numeric::step_error::worse;
use crate::numeric::step_size::{factor, FACTORS};
use crate::piecewise::flight::SteppedFlight;
use crate::piecewise::steps::StepHistory;
use crate::record::failure::Failure;
use crate::system::dynamics::{Dynamics, Layout};

impl<D> Flying<'_, '_, D> {
    /// Whether the step overlooks something that lies between its stages, and by which factor it
    /// is to be shortened then; `contact` tells the gap that closes in it. The gaps that are
    /// integrated must be those of their functions at its end, and where a step may be a whole arc,
    /// the equation of motion must hold at the apex.
    pub(super) fn missed_events<E>(
        &mut self,
        contact: Option<usize>,
    ) -> Result<Option<f64>, Failure<E>>
    where
        D: Dynamics<E>,
    {
        if !self.motion.steps.limits().adaptive || self.motion.steps.is_jump() {
            return Ok(None);
        }
        let mut excess = 0.0;
        if contact.is_none() {
            self.finish()?;
            excess = self.misfit();
        }
        if excess <= 1.0 && !self.motion.experience.is_enough(self.motion.last().h) {
            for i in self.state.open_gaps() {
                let end = &self.motion.last().end;
                let falls = contact == Some(i) || end.xdot[self.state.layout().n + i] < 0.0;
                if self.state.gap(i).1 > 0.0 && falls {
                    excess = worse(excess, self.defect_at_apex(i)?);
                }
            }
        }
        if excess <= 1.0 {
            return Ok(None);
        }
        // the shorter step is looked at again
        self.motion.experience = StepHistory::NONE;
        let factor = factor(excess, self.motion.last().order_of_error());
        Ok(Some(factor.max(FACTORS.0)))
    }

    /// How far the gaps at the end of the finished step are from their functions, in what is
    /// allowed of it.
    pub(super) fn misfit(&self) -> f64 {
        let Layout { n, m, .. } = self.state.layout();
        let SmoothMotion { steps, at_end, .. } = &*self.motion;
        let (step, tolerances) = (steps.last(), &steps.limits().tolerances);
        let of = |c: usize| step.scales(c, tolerances)[0];
        let largest = (0..n).map(of).fold(0.0_f64, f64::max);
        let each = (0..m).map(|i| {
            let far = (at_end.gap[i] - step.end.x[n + i]).abs();
            far / (DEFECT * (of(n + i) + at_end.steepness[i] * largest))
        });
        each.fold(0.0, worse)
    }

    /// How far the polynomials of the step are from the equation of motion where a gap is largest.
    fn defect_at_apex<E>(&mut self, gap: usize) -> Result<f64, Failure<E>>
    where
        D: Dynamics<E>,
    {
        self.complete()?;
        let Layout { n, m, .. } = self.state.layout();
        let mut along = self.along();
        let rows = along.rows(n + m);
        let theta = rows[n + gap][1].first_negative().unwrap_or(0.5);
        along.defect(&rows, theta)
    }
}
