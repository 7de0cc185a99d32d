//! The columns in flight: through the steps of the motion, shorter ones where the columns need them.

use super::VariationalRun;
use crate::numeric::step_size::{factor, shorter, FACTORS};
use crate::record::failure::Failure;
use crate::switched::integrator::SwitchedIntegrator;
use crate::switched::piece::Piece;
use crate::switched::sensitivity::validity::Limit;
use crate::switched::stages::{Counted, Stages};
use crate::system::slopes::DifferentiableForce;
use crate::{Impact, Status};

/// Steps that are given up for the columns before one is taken as it is.
const RETRIES: u32 = 40;
/// How far the step onto an impact may be moved to it, relative to its length.
const NUDGE: f64 = 1e-4;

impl VariationalRun {
    /// The columns over a piece of flight; by how much the step was too long for them.
    fn fly<E, F: DifferentiableForce<E>>(
        &mut self,
        integrator: &mut SwitchedIntegrator,
        onto: Option<&mut Stages>,
        force: &mut Counted<'_, F>,
    ) -> Result<f64, Failure<E>> {
        let settings = *integrator.settings();
        let stages = onto.unwrap_or_else(|| integrator.flight().last_mut());
        self.step.step(stages, force)?;
        if !self.controlled || !settings.adaptive {
            return Ok(0.0);
        }
        self.step.error(stages, &settings.tolerances(), &self.sizes, force)
    }

    /// The step onto an impact that was found on the polynomials of a longer one.
    fn onto<E, F: DifferentiableForce<E>>(
        integrator: &mut SwitchedIntegrator,
        impact: Option<Impact>,
        force: &mut Counted<'_, F>,
    ) -> Result<Option<Stages>, Failure<E>> {
        let flight = integrator.flight();
        let length = flight.landing().filter(|_| impact.is_some());
        let last = flight.last_mut();
        let Some(total) = length.filter(|&total| far(total, last)) else { return Ok(None) };
        let mut stages = last.clone();
        let (from, slope) = (stages.from, stages.start_slope(0));
        stages.step(&from, &slope, total, force)?;
        Ok(Some(stages))
    }

    /// What a piece of flight that was taken adds: a minimum, the dense output, an impact.
    fn flew<E, F: DifferentiableForce<E>>(
        &mut self,
        integrator: &mut SwitchedIntegrator,
        impact: Option<Impact>,
        onto: Option<&mut Stages>,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        let law = *integrator.law();
        let flight = integrator.flight();
        self.highest = self.highest.max(flight.last_mut().from.x.abs());
        if impact.is_none() {
            self.minimum(flight.last_mut(), force)?;
        }
        let length = flight.landing().filter(|_| impact.is_some());
        let stages = onto.unwrap_or_else(|| flight.last_mut());
        if let Some(path) = &mut self.path {
            // the columns are forced by the motion at its own further stages
            stages.complete(force)?;
            self.step.all_stages(stages, force)?;
            path.push_flight(stages, &self.step, length);
        }
        if let Some(total) = length {
            self.step.polish(stages, total - stages.h, force)?;
        }
        match impact {
            Some(impact) => self.strike(&impact, &law, force),
            None => Ok(()),
        }
    }

    /// A minimum of the distance within the step, above the wall.
    fn minimum<E, F: DifferentiableForce<E>>(
        &mut self,
        stages: &mut Stages,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        if !(stages.from.xdot < 0.0 && stages.end.xdot > 0.0) {
            return Ok(());
        }
        let [x, xdot] = stages.polynomials(force)?;
        let Some(theta) = xdot.negated().first_negative() else { return Ok(()) };
        self.step.all_stages(stages, force)?;
        let rates: Vec<f64> = (0..self.sizes.len())
            .map(|column| self.step.polynomials(stages, column)[0].at(theta))
            .collect();
        let t = stages.from.t + theta * stages.h;
        self.validity.note(Limit::Minimum, t, x.at(theta), rates);
        Ok(())
    }

    /// A step of flight, shorter ones until the columns are within the tolerances too.
    pub(super) fn fly_within<E, F: DifferentiableForce<E>>(
        &mut self,
        integrator: &mut SwitchedIntegrator,
        t_end: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Piece, Failure<E>> {
        std::mem::swap(&mut self.step.from, &mut self.step.end);
        let before = integrator.clone();
        let order = integrator.flight().last_mut().order_of_error();
        let shortest = 16.0 * f64::EPSILON * before.t().abs();
        for retry in 0.. {
            let piece = integrator.proceed(t_end, force)?;
            let Piece::Flight { impact, .. } = piece else {
                // rest follows an impact that stopped the mass
                std::mem::swap(&mut self.step.from, &mut self.step.end);
                return self.other(integrator, piece, force);
            };
            if let Some(impact) = impact.filter(|_| integrator.flight().landing().is_none()) {
                // the last step ended at the wall
                std::mem::swap(&mut self.step.from, &mut self.step.end);
                self.strike(&impact, integrator.law(), force)?;
                return Ok(piece);
            }
            let mut onto = Self::onto(integrator, impact, force)?;
            let h = onto.as_ref().map_or_else(|| integrator.flight().last_mut().h, |it| it.h);
            let error = self.fly(integrator, onto.as_mut(), force)?;
            let factor = factor(error, order);
            if error <= 1.0 || retry == RETRIES || h <= shortest {
                if error > 0.0 {
                    // that an impact comes soon says nothing of the next step
                    let most = if onto.is_some() { f64::INFINITY } else { FACTORS.1 };
                    integrator.flight().steps_mut().limit_next(h * factor.clamp(FACTORS.0, most));
                }
                self.flew(integrator, impact, onto.as_mut(), force)?;
                return Ok(piece);
            }
            integrator.give_up_step(&before, shorter(factor) * h);
        }
        Err(Failure::Status(Status::Internal))
    }
}

/// Whether an impact lies away from the end of the step that was made onto it.
fn far(total: f64, stages: &Stages) -> bool {
    (total - stages.h).abs() > NUDGE * stages.h
}
