//! Free flight: steps under error control, each searched for the first impact.

use crate::numeric::first_root::step_onto;
use crate::numeric::step_size::{factor, first_step, shorter, Plan, FACTORS, RETREAT};
use crate::record::failure::Failure;
use crate::switched::integrator::{Piece, SwitchedIntegrator};
use crate::switched::mode::{Flight, Mode};
use crate::switched::path::Curve;
use crate::switched::point::Point;
use crate::switched::stages::{Counted, Landing};
use crate::switched::step_control::{Experience, StepControl};
use crate::{Dependence, Force, Status};

/// Defect of the polynomials, relative to the tolerances, that shows a feature of the force.
const DEFECT: f64 = 100.0;

/// What to do with a step that was tried.
enum Verdict {
    /// Take it; the next may be longer by this factor.
    Take(f64),
    /// The mass reaches the wall within it, at this part of it.
    Land(f64),
    /// Try a shorter one, by this factor; the reason, should none be short enough.
    Shorten(f64, Status),
}

impl SwitchedIntegrator {
    /// One step, or the part of it up to an impact.
    pub(super) fn runge_kutta<E, F: Force<E>>(
        &mut self,
        t_end: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Piece, Failure<E>> {
        let slope = self.slope(force)?;
        let plan = self.plan(slope, t_end, force)?;
        let (mut h, shortest) = (plan.h, 8.0 * f64::EPSILON * self.now.t.abs());
        self.control.jump = self.control.jump.next();
        loop {
            self.spend()?;
            let (factor, why) = match self.judge(slope, h, force)? {
                Verdict::Take(growth) => return Ok(self.take(plan, h, growth, t_end)),
                Verdict::Land(theta) => match self.land(slope, theta * h, t_end, force) {
                    Err(Failure::Status(why)) => (RETREAT, why),
                    landed => {
                        let landed = landed?;
                        if h < plan.h {
                            self.control.h = Some(h);
                        }
                        return Ok(match landed {
                            Some(impact) => impact,
                            // the step was too long to tell: it saw an impact where there is none
                            None => self.take(plan, 0.5 * h, 1.0, t_end),
                        });
                    }
                },
                Verdict::Shorten(factor, why) => (factor, why),
            };
            self.counts.rejected += 1;
            let may_jump = why == Status::StepSizeTooSmall;
            h = self.control.shorter(h, shortest, (factor, why), may_jump)?;
        }
    }

    /// The acceleration here.
    fn slope<E, F: Force<E>>(&mut self, force: &mut Counted<'_, F>) -> Result<f64, Failure<E>> {
        if self.mode.continues() {
            self.last.stages.slope_at_end(force)
        } else {
            force.at(self.now.t, self.now.x, self.now.xdot)
        }
    }

    fn plan<E, F: Force<E>>(
        &mut self,
        slope: f64,
        t_end: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Plan, Failure<E>> {
        let left = (t_end - self.now.t) - self.now.late;
        let first = match self.control.h {
            _ if !self.settings.adaptive => self.settings.max_step,
            Some(h) => h,
            None => self.first_step(slope, left, force)?,
        };
        let wanted = (&self.settings, first);
        Ok(StepControl::plan(wanted, (&self.now, &slope), 0..1, self.obstacle, left))
    }

    /// The first step, from the force and its change.
    fn first_step<E, F: Force<E>>(
        &self,
        slope: f64,
        left: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<f64, Failure<E>> {
        let control = (&self.settings.tolerances(), self.last.stages.order_of_error());
        let harmless = |why: &Failure<E>| matches!(why, Failure::Status(_));
        first_step(&self.now, &slope, left, control, force, harmless)
    }

    fn judge<E, F: Force<E>>(
        &mut self,
        slope: f64,
        h: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Verdict, Failure<E>> {
        match self.judged(slope, h, force) {
            Err(Failure::Status(why)) => Ok(Verdict::Shorten(RETREAT, why)),
            verdict => verdict,
        }
    }

    /// The same, with a status where the step cannot be computed.
    fn judged<E, F: Force<E>>(
        &mut self,
        slope: f64,
        h: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Verdict, Failure<E>> {
        let end = self.try_step(slope, h, force)?;
        let error = self.error(force)?;
        let factor = factor(error, self.last.stages.order_of_error());
        if error > 1.0 || error.is_nan() {
            return Ok(Verdict::Shorten(shorter(factor), Status::StepSizeTooSmall));
        }
        let growth = if self.settings.adaptive { factor.min(FACTORS.1) } else { 1.0 };
        let leaves = self.mode.leaves();
        if leaves && !self.last.stages.rises(0) {
            return Ok(Verdict::Shorten(RETREAT, Status::StepSizeTooSmall));
        }
        let contact = if leaves { None } else { self.first_contact(force)? };
        if let Some(factor) = self.overlooked(contact, force)? {
            return Ok(Verdict::Shorten(factor, Status::StepSizeTooSmall));
        }
        if let Some(theta) = contact {
            return Ok(Verdict::Land(theta));
        }
        if end.t > self.looks.dense_from {
            // with its polynomials, or not at all
            self.last.stages.polynomials(force)?;
        }
        Ok(Verdict::Take(growth))
    }

    /// Whether the step overlooks a feature of the force that lies between its stages, and by which
    /// factor it is to be shortened then. Soon after an impact a step may be a whole arc, and one
    /// much longer than the last has little that speaks for it. One more look, at the apex: where
    /// a force that depends on the position differs most.
    fn overlooked<E, F: Force<E>>(
        &mut self,
        contact: Option<f64>,
        force: &mut Counted<'_, F>,
    ) -> Result<Option<f64>, Failure<E>> {
        let known = self.mode.experience().is_enough(self.last.stages.h);
        let turns = self.now.xdot > 0.0 && (contact.is_some() || self.last.stages.end.xdot < 0.0);
        if known || !turns || !self.settings.adaptive || self.control.jump.allowed {
            return Ok(None);
        }
        if force.dependence::<E>() == Dependence::Constant {
            return Ok(None);
        }
        let polynomials = self.last.stages.polynomials(force)?;
        let apex = polynomials[1].first_negative().unwrap_or(0.5);
        let defect = self.last.stages.defect(&polynomials, apex, force)?;
        let excess = defect.norm(self.last.stages.scales(0, &self.settings.tolerances())) / DEFECT;
        let factor = factor(excess, self.last.stages.order_of_error());
        if excess <= 1.0 {
            return Ok(None);
        }
        // the shorter step is looked at again
        if let Mode::Flight(Flight::Step { experience, .. }) = &mut self.mode {
            *experience = Experience::NONE;
        }
        Ok(Some(factor.max(FACTORS.0)))
    }

    /// The step of length `h` from here.
    fn try_step<E, F: Force<E>>(
        &mut self,
        slope: f64,
        h: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Point, Failure<E>> {
        self.last.stages.step(&self.now, &slope, h, force)?;
        if self.last.stages.is_finite() {
            Ok(self.last.stages.end)
        } else {
            Err(Failure::Status(Status::StateNotFinite))
        }
    }

    /// The error of the last step relative to the tolerances.
    fn error<E, F: Force<E>>(&mut self, force: &mut Counted<'_, F>) -> Result<f64, Failure<E>> {
        let asked = (&self.settings, &self.settings.tolerances());
        self.control.error(&mut self.last.stages, asked, force)
    }

    /// The part of the step after which the mass would be behind the wall.
    fn first_contact<E, F: Force<E>>(
        &mut self,
        force: &mut Counted<'_, F>,
    ) -> Result<Option<f64>, Failure<E>> {
        self.last.stages.first_root(0, force)
    }

    /// Takes the last step; `h` and `growth` say how long the next one may be.
    fn take(&mut self, plan: Plan, h: f64, growth: f64, t_end: f64) -> Piece {
        let from = self.now;
        self.counts.accepted += 1;
        self.now = self.last.stages.end;
        if self.last.stages.h >= (t_end - from.t) - from.late {
            (self.now.t, self.now.late) = (t_end, 0.0);
        }
        self.last.landing = None;
        self.mode.step(self.last.stages.h);
        self.control.h = Some(plan.next(h, growth));
        Piece::Flight { from, sigma: self.sigma, impact: None }
    }

    /// Steps once more, onto the impact near `now + length`; none if that step passes the wall
    /// closely.
    fn land<E, F: Force<E>>(
        &mut self,
        slope: f64,
        length: f64,
        t_end: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Option<Piece>, Failure<E>> {
        let from = self.now;
        let step = |it: &mut Self, length| {
            it.try_step(slope, length, force)?;
            if it.error(force)? > 1.0 {
                return Err(Failure::Status(Status::StepSizeTooSmall));
            }
            it.last.stages.finish(force)
        };
        let landing = step_onto(self, 0, length, step, |it| &it.last.stages)?;
        let end = self.last.stages.end;
        let (total, xdot) = match landing {
            Some((delta, xdot)) => (self.last.stages.h + delta, xdot),
            None if end.x > 0.0 => return Ok(None),
            None => self.landing_inside(force)?,
        };
        if from.t + total > self.looks.dense_from {
            self.last.stages.polynomials(force)?;
        }
        self.counts.accepted += 1;
        self.last.landing = Some(Landing { length: total, xdot });
        let mut contact = from.after(total.max(0.0), 0.0, xdot);
        if contact.t > t_end {
            (contact.t, contact.late) = (t_end, 0.0);
        }
        Ok(Some(self.strike(from, contact)))
    }

    /// The impact within a step that ends behind the wall, on its polynomials: where the motion is
    /// as small as the tolerance, two steps need not agree on it any better.
    fn landing_inside<E, F: Force<E>>(
        &mut self,
        force: &mut Counted<'_, F>,
    ) -> Result<(f64, f64), Failure<E>> {
        let theta = self.first_contact(force)?.unwrap_or(1.0);
        let [_, xdot] = self.last.stages.polynomials(force)?;
        Ok((theta * self.last.stages.h, xdot.at(theta).min(0.0)))
    }

    /// The polynomials of the last step, up to its impact if there was one.
    pub(super) fn stages_curve<E, F: Force<E>>(
        &mut self,
        sigma: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Curve, Failure<E>> {
        let [mut x, mut xdot] = self.last.stages.polynomials(force)?;
        let (from, mut h) = (self.last.stages.from, self.last.stages.h);
        if let Some(Landing { length, xdot: incoming }) = self.last.landing {
            x = x.split(length / h).0.with_ends(from.x, 0.0);
            xdot = xdot.split(length / h).0.with_ends(from.xdot, incoming);
            h = length;
        }
        Ok(Curve::polynomials(from.t, h, sigma, [x, xdot]))
    }
}
