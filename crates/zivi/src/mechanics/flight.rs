//! Steps under error control, each searched for the first impact and the first lift-off.

use super::equation::{InContact, LastStep};
use super::kinetics::Model;
use super::lift_off::Release;
use super::machine::Machine;
use super::mode::Next;
use crate::numeric::first_root::step_onto;
use crate::numeric::step_error::Tolerances;
use crate::numeric::step_size::{factor, first_step, shorter, Plan, FACTORS, RETREAT};
use crate::record::failure::Failure;
use crate::record::gap_set::GapSet;
use crate::switched::step_control::StepControl;
use crate::switched::SwitchedRk;
use crate::system::dynamics::Dynamics;
use crate::Status;

/// What closes within this part of a flight closes together.
const TOGETHER: f64 = 1e-13;
/// Rounding of the time.
const ULPS: f64 = 4.0 * f64::EPSILON;

/// What to do with a step that was tried.
pub(super) enum Verdict {
    /// Take it; the next may be longer by this factor.
    Take(f64),
    /// A gap closes within it, at this part of it.
    Land(f64, usize),
    /// The force of a contact vanishes within it, at this part of it.
    Lift(f64, usize),
    /// Try a shorter one, by this factor; the reason, should none be short enough.
    Shorten(f64, Status),
}

impl Machine {
    /// One step, or the part of it up to an event.
    pub(super) fn fly<E, D: Dynamics<E>>(
        &mut self,
        t_end: f64,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let plan = self.plan(t_end, model)?;
        let (mut h, shortest) = (plan.h, self.shortest_step());
        self.control.jump = self.control.jump.next();
        loop {
            self.control.spend(&self.settings)?;
            let (factor, why) = match self.judge(h, model)? {
                Verdict::Take(growth) => return self.take(plan, h, growth, t_end, model),
                Verdict::Land(theta, gap) => match self.land(theta * h, gap, t_end, model) {
                    Err(Failure::Status(Status::StepSizeTooSmall)) => {
                        (RETREAT, Status::StepSizeTooSmall)
                    }
                    landed => {
                        if h < plan.h {
                            self.control.h = Some(h);
                        }
                        return match landed? {
                            true => Ok(()),
                            // the step was too long to tell: there is no impact
                            false => self.take(plan, 0.5 * h, 1.0, t_end, model),
                        };
                    }
                },
                Verdict::Lift(theta, gap) => return self.lift(theta * h, gap, t_end, model),
                Verdict::Shorten(factor, why) => (factor, why),
            };
            self.counts.rejected += 1;
            let may_jump = matches!(why, Status::StepSizeTooSmall | Status::ContactNotSolved);
            h = self.control.shorter(h, shortest, (factor, why), may_jump)?;
        }
    }

    /// No step is shorter: below it rounding of the time is, at `t = 0` that of a time of rest.
    fn shortest_step(&self) -> f64 {
        let rest = if self.contacts.closed.is_empty() { 0.0 } else { self.probes.horizon() };
        (8.0 * f64::EPSILON * self.now.t.abs()).max(f64::EPSILON * rest)
    }

    fn plan<E, D: Dynamics<E>>(
        &mut self,
        t_end: f64,
        model: &mut Model<'_, D>,
    ) -> Result<Plan, Failure<E>> {
        let left = (t_end - self.now.t) - self.now.late;
        let first = match self.control.h {
            _ if !self.settings.adaptive => self.settings.max_step,
            Some(h) => h,
            None => self.first_step(left, model)?,
        };
        let (wanted, here) = ((&self.settings, first), (&self.now, &self.here.slope));
        let gaps = self.layout.n..self.layout.n + self.layout.m;
        let mut plan = StepControl::plan(wanted, here, gaps, self.gathered.obstacle, left);
        let end = self.probes.end(self.contacts.closed, self.now.t, t_end);
        if end < t_end {
            plan.h = plan.h.min(end - self.now.t);
        }
        Ok(plan)
    }

    /// The first step, from the accelerations and their change.
    fn first_step<E, D: Dynamics<E>>(
        &mut self,
        left: f64,
        model: &mut Model<'_, D>,
    ) -> Result<f64, Failure<E>> {
        let Self { settings, last, contacts, aside: kinetics, now, here, .. } = self;
        let mut equation = InContact { closed: contacts.closed, kinetics, model, at_end: None };
        let control = (&tolerances(settings), last.stages.order_of_error());
        let harmless = |why: &Failure<E>| matches!(why, Failure::Status(_));
        first_step(now, &here.slope, left, control, &mut equation, harmless)
    }

    fn judge<E, D: Dynamics<E>>(
        &mut self,
        h: f64,
        model: &mut Model<'_, D>,
    ) -> Result<Verdict, Failure<E>> {
        match self.judged(h, model) {
            Err(Failure::Status(why)) if why != Status::RedundantContacts => {
                Ok(Verdict::Shorten(RETREAT, why))
            }
            verdict => verdict,
        }
    }

    /// The same, with a status where the step cannot be computed.
    fn judged<E, D: Dynamics<E>>(
        &mut self,
        h: f64,
        model: &mut Model<'_, D>,
    ) -> Result<Verdict, Failure<E>> {
        let error = self.try_step(h, model)?;
        let factor = factor(error, self.last.stages.order_of_error());
        if error > 1.0 || error.is_nan() {
            return Ok(Verdict::Shorten(shorter(factor), Status::StepSizeTooSmall));
        }
        let growth = if self.settings.adaptive { factor.min(FACTORS.1) } else { 1.0 };
        let (n, end) = (self.layout.n, &self.last.stages.end);
        if !self.contacts.left.iter().all(|i| end.x[n + i] > 0.0 && end.xdot[n + i] > 0.0) {
            return Ok(Verdict::Shorten(RETREAT, Status::StepSizeTooSmall));
        }
        let contact = self.first_contact(model)?;
        if let Some(factor) = self.overlooked(contact.map(|(_, gap)| gap), model)? {
            return Ok(Verdict::Shorten(factor, Status::StepSizeTooSmall));
        }
        let end = contact.map_or(1.0, |(theta, _)| theta);
        let release = match self.first_release(end, model)? {
            Release::None => None,
            Release::At(theta, gap) => Some((theta, gap)),
            Release::Unclear => return Ok(Verdict::Shorten(0.5, Status::ContactNotSolved)),
            Release::Varies(length) => {
                return Ok(Verdict::Shorten(length / h, Status::StepSizeTooSmall))
            }
        };
        if self.last.stages.end.t > self.dense_from {
            self.complete_step(model)?;
        }
        Ok(match (contact, release) {
            (Some((theta, gap)), other) if other.is_none_or(|(lift, _)| theta <= lift) => {
                Verdict::Land(theta, gap)
            }
            (_, Some((theta, gap))) => Verdict::Lift(theta, gap),
            _ => Verdict::Take(growth),
        })
    }

    /// The step of length `h` from here, and its error relative to the tolerances: zero where
    /// steps are not adapted to them.
    pub(super) fn try_step<E, D: Dynamics<E>>(
        &mut self,
        h: f64,
        model: &mut Model<'_, D>,
    ) -> Result<f64, Failure<E>> {
        let Self { last, kinetics, now, here, settings, contacts, control, .. } = self;
        let LastStep { stages, at_end, .. } = last;
        let closed = contacts.closed;
        let mut equation = InContact { closed, kinetics, model, at_end: Some(at_end) };
        stages.step(now, &here.slope, h, &mut equation)?;
        if !stages.is_finite() {
            return Err(Failure::Status(Status::StateNotFinite));
        }
        control.error(stages, (settings, &tolerances(settings)), &mut equation)
    }

    /// The first gap that closes in the step, and after which part of it.
    fn first_contact<E, D: Dynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
    ) -> Result<Option<(f64, usize)>, Failure<E>> {
        let n = self.layout.n;
        let mut first: Option<(f64, usize)> = None;
        for i in 0..self.layout.m {
            if self.contacts.closed.has(i) || self.contacts.left.has(i) {
                continue;
            }
            let (stages, mut equation) = self.stages_of(model);
            if let Some(theta) = stages.first_root(n + i, &mut equation)? {
                if first.is_none_or(|(before, _)| theta < before) {
                    first = Some((theta, i));
                }
            }
        }
        Ok(first)
    }

    /// Takes the last step; `h` and `growth` say how long the next one may be.
    fn take<E, D: Dynamics<E>>(
        &mut self,
        plan: Plan,
        h: f64,
        growth: f64,
        t_end: f64,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        self.counts.accepted += 1;
        self.last.length = self.last.stages.h;
        if let Next::Step(experience) = &mut self.next {
            experience.gain(self.last.length);
        }
        let ends = self.last.stages.h >= (t_end - self.now.t) - self.now.late;
        self.control.h = Some(plan.next(h, growth));
        self.now.copy_from(&self.last.stages.end);
        if ends {
            (self.now.t, self.now.late) = (t_end, 0.0);
        }
        self.contacts.left = GapSet::EMPTY;
        self.settle_step(model)
    }

    /// Back onto the manifold of the closed gaps, and the slope for the next step.
    fn settle_step<E, D: Dynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        if !self.contacts.closed.is_empty() {
            self.project(self.contacts.closed, model)?;
            self.refresh()?;
            for i in 0..self.layout.m {
                let rate = self.kinetics.rate(i, &self.now.xdot[..self.layout.n]);
                self.anchor(i, self.kinetics.gap(i), rate);
            }
            return Ok(());
        }
        self.here.known = self.last.stages.copy_end_slope(&mut self.here.slope);
        self.here.lambda.fill(0.0);
        if self.here.known {
            for i in 0..self.layout.m {
                self.anchor(i, self.last.at_end.gap[i], self.last.at_end.rate[i]);
            }
        }
        Ok(())
    }

    /// Steps once more, onto the impact near `now + length`; false if that step passes the gap
    /// closely.
    fn land<E, D: Dynamics<E>>(
        &mut self,
        length: f64,
        gap: usize,
        t_end: f64,
        model: &mut Model<'_, D>,
    ) -> Result<bool, Failure<E>> {
        let c = self.layout.n + gap;
        let step = |it: &mut Self, length| {
            if it.try_step(length, model)? > 1.0 {
                return Err(Failure::Status(Status::StepSizeTooSmall));
            }
            it.finish_step(model)
        };
        let landing = step_onto(self, c, length, step, |it| &it.last.stages)?;
        let delta = match landing {
            Some((delta, _)) => delta,
            None if self.last.stages.end.x[c] > 0.0 => return Ok(false),
            None => self.crossing_inside(c, model)? - self.last.stages.h,
        };
        if self.settings.adaptive && !self.control.jump.allowed && self.misfit() > 1.0 {
            return Err(Failure::Status(Status::StepSizeTooSmall));
        }
        let total = (self.last.stages.h + delta).max(0.0);
        if self.now.t + total > self.dense_from {
            self.complete_step(model)?;
        }
        self.counts.accepted += 1;
        self.arrive(total, delta, t_end);
        self.next = Next::Hit(self.hit_together(gap, total));
        Ok(true)
    }

    /// The time of the crossing within a step that ends behind it, by its polynomial.
    fn crossing_inside<E, D: Dynamics<E>>(
        &mut self,
        c: usize,
        model: &mut Model<'_, D>,
    ) -> Result<f64, Failure<E>> {
        self.complete_step(model)?;
        let stages = &self.last.stages;
        Ok(stages.root_of_polynomial(c).unwrap_or(1.0) * stages.h)
    }

    /// Moves to the time `total` after the start of the last step, `delta` after its end.
    pub(super) fn arrive(&mut self, total: f64, delta: f64, t_end: f64) {
        let end = &self.last.stages.end;
        self.last.length = total;
        self.now.pass(total);
        if self.now.t > t_end {
            (self.now.t, self.now.late) = (t_end, 0.0);
        }
        for c in 0..self.now.x.len() {
            let slope = self.last.stages.end_slope(c);
            self.now.x[c] = end.x[c] + delta * (end.xdot[c] + 0.5 * delta * slope);
            self.now.xdot[c] = end.xdot[c] + delta * slope;
        }
        self.here.known = false;
    }

    /// The gap and those that close at the same time, to rounding of the flight's length.
    fn hit_together(&self, gap: usize, flight: f64) -> GapSet {
        let n = self.layout.n;
        let near = TOGETHER * flight + ULPS * self.now.t.abs();
        let is_hit = |i: usize| {
            let (x, v) = (self.now.x[n + i], self.now.xdot[n + i]);
            !self.contacts.closed.has(i) && v < 0.0 && x <= -v * near
        };
        (0..self.layout.m).filter(|&i| i == gap || is_hit(i)).collect()
    }
}

/// Those of the settings. Gaps and coordinates are rounded apart: by more than one number is.
pub(super) fn tolerances(settings: &SwitchedRk) -> Tolerances {
    Tolerances { rounding: 4.0, ..settings.tolerances() }
}
