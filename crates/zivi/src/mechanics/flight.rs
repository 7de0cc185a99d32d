//! Steps under error control, each searched for the first impact and the first lift-off.

use super::along_step::{AlongStep, DEFECT};
use super::contact_probes::ContactProbes;
use super::equation::{InContact, LastStep};
use super::kinetics::{Kinetics, Model};
use super::lift_off::{self, Release};
use super::mode::Next;
use super::state::MechanicalState;
use crate::numeric::first_root::step_onto;
use crate::numeric::step_error::{worse, Tolerances};
use crate::numeric::step_size::{factor, first_step, shorter, Plan, FACTORS, RETREAT};
use crate::record::failure::Failure;
use crate::record::gap_set::GapSet;
use crate::switched::lookahead::Obstacle;
use crate::switched::step_control::{Experience, StepControl};
use crate::switched::SwitchedRk;
use crate::system::dynamics::{Dynamics, Layout};
use crate::Status;

/// What closes within this part of a flight closes together.
const TOGETHER: f64 = 1e-13;
/// Rounding of the time.
const ULPS: f64 = 4.0 * f64::EPSILON;
/// Iterations for the time of lift-off.
const ITERATIONS: usize = 4;
/// The first step after a lift-off, relative to that before.
const PART: f64 = 1e-2;
/// Contacts that open so often at one instant open whatever the force does next.
const OFTEN: u32 = 8;

/// Those of the settings. Gaps and coordinates are rounded apart: by more than one number is.
pub(super) fn tolerances(settings: &SwitchedRk) -> Tolerances {
    Tolerances { rounding: 4.0, ..settings.tolerances() }
}

/// The steps of a run.
#[derive(Clone, Debug)]
pub(super) struct Steps {
    settings: SwitchedRk,
    last: LastStep,
    control: StepControl,
    /// What speaks for the length of the next step.
    experience: Experience,
    probes: ContactProbes,
    /// Steps that end later than this have their polynomials computed.
    dense_from: f64,
    accepted: u64,
    rejected: u64,
    /// The mechanics away from the state.
    aside: Kinetics,
}

impl Steps {
    pub(super) fn new(settings: SwitchedRk, layout: Layout) -> Self {
        Self {
            settings,
            last: LastStep::new(settings.order.pair(), layout),
            control: StepControl { h: settings.first_step, ..StepControl::default() },
            experience: Experience::NONE,
            probes: ContactProbes::default(),
            dense_from: f64::INFINITY,
            accepted: 0,
            rejected: 0,
            aside: Kinetics::new(layout),
        }
    }

    /// The last step, or the part of it up to an event.
    pub(super) fn last(&self) -> &LastStep {
        &self.last
    }

    /// The same, to have its polynomials computed.
    pub(super) fn last_mut(&mut self) -> &mut LastStep {
        &mut self.last
    }

    /// From when on the motion between the ends of steps is asked for.
    pub(super) fn dense_from(&self) -> f64 {
        self.dense_from
    }

    /// Steps that end later than this have their polynomials computed.
    pub(super) fn look_from(&mut self, t: f64) {
        self.dense_from = t;
    }

    /// How many were taken, and how many were given up for shorter ones.
    pub(super) fn counts(&self) -> (u64, u64) {
        (self.accepted, self.rejected)
    }

    /// From here on the forces are others.
    pub(super) fn restart(&mut self) {
        self.probes = ContactProbes::default();
    }

    /// After an event nothing speaks for long steps.
    pub(super) fn forget_experience(&mut self) {
        self.experience = Experience::NONE;
    }

    /// The next step is no longer than this.
    pub(super) fn limit_next(&mut self, longest: f64) {
        self.control.h = self.control.h.map(|next| next.min(longest));
    }

    /// The last step was given up, after so many that were: the next is to have the length `h`.
    pub(super) fn retry(&mut self, h: f64, rejected: u64) {
        self.control.h = Some(h);
        self.rejected = rejected;
    }

    /// Contact forces at a time and a state that is on the contacts of a set.
    pub(super) fn contact_forces<E, D: Dynamics<E>>(
        &mut self,
        (t, x, v): (f64, &[f64], &[f64]),
        closed: GapSet,
        model: &mut Model<'_, D>,
    ) -> Result<&[f64], Failure<E>> {
        if closed.is_empty() {
            self.aside.lambda.fill(0.0);
        } else {
            let n = self.aside.coordinates();
            self.aside.evaluate(model, t, &x[..n], &v[..n])?;
            self.aside.contact(closed)?;
        }
        Ok(&self.aside.lambda)
    }

    /// Opens the contacts that open where the force of one vanishes, in a step of length `h`, after
    /// so many events at this instant: these.
    pub(super) fn open<E, D: Dynamics<E>>(
        &mut self,
        (gap, h): (usize, f64),
        events: u32,
        state: &mut MechanicalState,
        model: &mut Model<'_, D>,
    ) -> Result<GapSet, Failure<E>> {
        let left = lift_off::open((gap, h), events > OFTEN, state, &mut self.aside, model)?;
        self.control.h = Some(PART * h);
        Ok(left)
    }

    /// One step, or the part of it up to an event: what comes next.
    pub(super) fn fly<E, D: Dynamics<E>>(
        &mut self,
        t_end: f64,
        state: &mut MechanicalState,
        obstacle: Option<Obstacle>,
        model: &mut Model<'_, D>,
    ) -> Result<Next, Failure<E>> {
        Flying { steps: self, state, model, t_end }.fly(obstacle)
    }
}

/// What to do with a step that was tried.
enum Verdict {
    /// Take it; the next may be longer by this factor.
    Take(f64),
    /// An event lies within it, after this part of it.
    Stop(f64, Event),
    /// Try a shorter one, by this factor; the reason, should none be short enough.
    Shorten(f64, Status),
}

/// What ends a step early.
#[derive(Clone, Copy)]
enum Event {
    /// A gap closes.
    Hit(usize),
    /// The force of a contact vanishes.
    Release(usize),
}

/// A step under way.
struct Flying<'r, 'm, D> {
    steps: &'r mut Steps,
    state: &'r mut MechanicalState,
    model: &'r mut Model<'m, D>,
    t_end: f64,
}

impl<'m, D> Flying<'_, 'm, D> {
    fn fly<E>(&mut self, obstacle: Option<Obstacle>) -> Result<Next, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let plan = self.plan(obstacle)?;
        let (mut h, shortest) = (plan.h, self.shortest_step());
        self.steps.control.jump = self.steps.control.jump.next();
        loop {
            self.steps.control.spend(&self.steps.settings)?;
            let (factor, why) = match self.judge(h)? {
                Verdict::Take(growth) => return self.take(plan.next(h, growth)),
                Verdict::Stop(theta, event) => match self.stop(theta * h, event) {
                    Err(Failure::Status(Status::StepSizeTooSmall)) => {
                        (RETREAT, Status::StepSizeTooSmall)
                    }
                    stopped => {
                        if h < plan.h {
                            self.steps.control.h = Some(h);
                        }
                        return match stopped? {
                            Some(next) => Ok(next),
                            // the step was too long to tell: there is no impact
                            None => self.take(plan.next(0.5 * h, 1.0)),
                        };
                    }
                },
                Verdict::Shorten(factor, why) => (factor, why),
            };
            self.steps.rejected += 1;
            let may_jump = matches!(why, Status::StepSizeTooSmall | Status::ContactNotSolved);
            h = self.steps.control.shorter(h, shortest, (factor, why), may_jump)?;
        }
    }

    /// No step is shorter: below it rounding of the time is, at `t = 0` that of a time of rest.
    fn shortest_step(&self) -> f64 {
        let contact = !self.state.closed().is_empty();
        let rest = if contact { self.steps.probes.horizon() } else { 0.0 };
        (8.0 * f64::EPSILON * self.state.now().t.abs()).max(f64::EPSILON * rest)
    }

    fn plan<E>(&mut self, obstacle: Option<Obstacle>) -> Result<Plan, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let left = (self.t_end - self.state.now().t) - self.state.now().late;
        let Layout { n, m } = self.state.layout();
        let first = match self.steps.control.h {
            _ if !self.steps.settings.adaptive => self.steps.settings.max_step,
            Some(h) => h,
            None => self.first_step(left)?,
        };
        let (steps, state) = (&mut *self.steps, &*self.state);
        let (wanted, here) = ((&steps.settings, first), (state.now(), state.slope()));
        let mut plan = StepControl::plan(wanted, here, n..n + m, obstacle, left);
        let t = state.now().t;
        let end = steps.probes.end(state.closed(), t, self.t_end);
        if end < self.t_end {
            plan.h = plan.h.min(end - t);
        }
        Ok(plan)
    }

    /// The first step, from the accelerations and their change.
    fn first_step<E>(&mut self, left: f64) -> Result<f64, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let Steps { settings, last, aside: kinetics, .. } = &mut *self.steps;
        let (closed, model) = (self.state.closed(), &mut *self.model);
        let mut equation = InContact { closed, kinetics, model, at_end: None };
        let control = (&tolerances(settings), last.stages.order_of_error());
        let harmless = |why: &Failure<E>| matches!(why, Failure::Status(_));
        let (now, slope) = (self.state.now(), self.state.slope());
        first_step(now, slope, left, control, &mut equation, harmless)
    }

    fn judge<E>(&mut self, h: f64) -> Result<Verdict, Failure<E>>
    where
        D: Dynamics<E>,
    {
        match self.judged(h) {
            Err(Failure::Status(why)) if why != Status::RedundantContacts => {
                Ok(Verdict::Shorten(RETREAT, why))
            }
            verdict => verdict,
        }
    }

    /// The same, with a status where the step cannot be computed.
    fn judged<E>(&mut self, h: f64) -> Result<Verdict, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let error = self.try_step(h)?;
        let factor = factor(error, self.steps.last.stages.order_of_error());
        if error > 1.0 || error.is_nan() {
            return Ok(Verdict::Shorten(shorter(factor), Status::StepSizeTooSmall));
        }
        let growth = if self.steps.settings.adaptive { factor.min(FACTORS.1) } else { 1.0 };
        let (n, end) = (self.state.layout().n, &self.steps.last.stages.end);
        if !self.state.left().iter().all(|i| end.x[n + i] > 0.0 && end.xdot[n + i] > 0.0) {
            return Ok(Verdict::Shorten(RETREAT, Status::StepSizeTooSmall));
        }
        let contact = self.first_contact()?;
        if let Some(factor) = self.overlooked(contact.map(|(_, gap)| gap))? {
            return Ok(Verdict::Shorten(factor, Status::StepSizeTooSmall));
        }
        let release = match self.first_release(contact.map_or(1.0, |(theta, _)| theta))? {
            Release::None => None,
            Release::At(theta, gap) => Some((theta, gap)),
            Release::Unclear => return Ok(Verdict::Shorten(0.5, Status::ContactNotSolved)),
            Release::Varies(length) => {
                return Ok(Verdict::Shorten(length / h, Status::StepSizeTooSmall))
            }
        };
        if self.steps.last.stages.end.t > self.steps.dense_from {
            self.complete()?;
        }
        Ok(match (contact, release) {
            (Some((theta, gap)), other) if other.is_none_or(|(lift, _)| theta <= lift) => {
                Verdict::Stop(theta, Event::Hit(gap))
            }
            (_, Some((theta, gap))) => Verdict::Stop(theta, Event::Release(gap)),
            _ => Verdict::Take(growth),
        })
    }

    /// The step of length `h` from here, and its error relative to the tolerances: zero where
    /// steps are not adapted to them.
    fn try_step<E>(&mut self, h: f64) -> Result<f64, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let Steps { last: LastStep { stages, at_end, .. }, control, settings, .. } =
            &mut *self.steps;
        let (now, slope, mut equation) = self.state.equation(self.model, at_end);
        stages.step(now, slope, h, &mut equation)?;
        if !stages.is_finite() {
            return Err(Failure::Status(Status::StateNotFinite));
        }
        control.error(stages, (settings, &tolerances(settings)), &mut equation)
    }

    /// Evaluates the system at the end of the last step.
    fn finish<E>(&mut self) -> Result<(), Failure<E>>
    where
        D: Dynamics<E>,
    {
        let LastStep { stages, at_end, .. } = &mut self.steps.last;
        stages.finish(&mut self.state.equation(self.model, at_end).2)
    }

    /// Computes what the polynomials of the last step need.
    fn complete<E>(&mut self) -> Result<(), Failure<E>>
    where
        D: Dynamics<E>,
    {
        let LastStep { stages, at_end, .. } = &mut self.steps.last;
        stages.complete(&mut self.state.equation(self.model, at_end).2)
    }

    /// The last step, which is complete, between its stages.
    fn along(&mut self) -> AlongStep<'_, 'm, D> {
        let Steps { last, aside, settings, .. } = &mut *self.steps;
        AlongStep {
            step: &last.stages,
            closed: self.state.closed(),
            tolerances: tolerances(settings),
            aside,
            model: self.model,
        }
    }

    /// The first gap that closes in the step, and after which part of it.
    fn first_contact<E>(&mut self) -> Result<Option<(f64, usize)>, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let (n, left) = (self.state.layout().n, self.state.left());
        let mut first: Option<(f64, usize)> = None;
        for i in self.state.open_gaps().filter(|&i| !left.has(i)) {
            let LastStep { stages, at_end, .. } = &mut self.steps.last;
            let mut equation = self.state.equation(self.model, at_end).2;
            if let Some(theta) = stages.first_root(n + i, &mut equation)? {
                if first.is_none_or(|(before, _)| theta < before) {
                    first = Some((theta, i));
                }
            }
        }
        Ok(first)
    }

    /// Whether the step overlooks something that lies between its stages, and by which factor it
    /// is to be shortened then; `contact` tells the gap that closes in it. The gaps that are
    /// integrated must be those of their functions at its end, and where a step may be a whole arc,
    /// the equation of motion must hold at the apex.
    fn overlooked<E>(&mut self, contact: Option<usize>) -> Result<Option<f64>, Failure<E>>
    where
        D: Dynamics<E>,
    {
        if !self.steps.settings.adaptive || self.steps.control.jump.allowed {
            return Ok(None);
        }
        let mut excess = 0.0;
        if contact.is_none() {
            self.finish()?;
            excess = self.misfit();
        }
        if excess <= 1.0 && !self.steps.experience.is_enough(self.steps.last.stages.h) {
            for i in self.state.open_gaps() {
                let end = &self.steps.last.stages.end;
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
        self.steps.experience = Experience::NONE;
        let factor = factor(excess, self.steps.last.stages.order_of_error());
        Ok(Some(factor.max(FACTORS.0)))
    }

    /// How far the gaps at the end of the finished step are from their functions, in what is
    /// allowed of it.
    fn misfit(&self) -> f64 {
        let Layout { n, m } = self.state.layout();
        let (LastStep { stages, at_end, .. }, tolerances) =
            (&self.steps.last, tolerances(&self.steps.settings));
        let of = |c: usize| stages.scales(c, &tolerances)[0];
        let largest = (0..n).map(of).fold(0.0_f64, f64::max);
        let each = (0..m).map(|i| {
            let far = (at_end.gap[i] - stages.end.x[n + i]).abs();
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
        let Layout { n, m } = self.state.layout();
        let mut along = self.along();
        let rows = along.rows(n + m);
        let theta = rows[n + gap][1].first_negative().unwrap_or(0.5);
        along.defect(&rows, theta)
    }

    /// The first contact whose force vanishes in the step, of which the part up to `end` counts.
    fn first_release<E>(&mut self, end: f64) -> Result<Release, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let closed = self.state.closed();
        if closed.is_empty() {
            return Ok(Release::None);
        }
        if self.steps.control.jump.allowed {
            // across a jump of the forces no polynomial fits
            self.finish()?;
            let lambda = &self.steps.last.at_end.lambda;
            let released = closed.iter().find(|&i| lambda[i] < 0.0);
            return Ok(released.map_or(Release::None, |i| Release::At(1.0, i)));
        }
        self.complete()?;
        let mut probes = self.steps.probes;
        let looking = self.steps.settings.adaptive.then_some(&mut probes);
        let release = lift_off::first_release(&mut self.along(), end, looking);
        self.steps.probes = probes;
        release
    }

    /// Takes the last step; the next may have the length `next`.
    fn take<E>(&mut self, next: f64) -> Result<Next, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let (steps, now) = (&mut *self.steps, self.state.now());
        let LastStep { stages, at_end, length } = &mut steps.last;
        *length = stages.h;
        steps.accepted += 1;
        steps.experience.gain(stages.h);
        steps.control.h = Some(next);
        let ends = stages.h >= (self.t_end - now.t) - now.late;
        let end = ends.then_some(self.t_end);
        self.state.take((stages, at_end), end, self.model)?;
        Ok(Next::Step)
    }

    /// Ends a step at an event after the time `length`: what comes next. None if there is none.
    fn stop<E>(&mut self, length: f64, event: Event) -> Result<Option<Next>, Failure<E>>
    where
        D: Dynamics<E>,
    {
        match event {
            Event::Hit(gap) => self.land(length, gap),
            Event::Release(gap) => self.lift(length, gap).map(Some),
        }
    }

    /// Steps once more, onto the impact near `now + length`; none if that step passes the gap
    /// closely.
    fn land<E>(&mut self, length: f64, gap: usize) -> Result<Option<Next>, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let c = self.state.layout().n + gap;
        let step = |it: &mut Self, length| {
            if it.try_step(length)? > 1.0 {
                return Err(Failure::Status(Status::StepSizeTooSmall));
            }
            it.finish()
        };
        let landing = step_onto(self, c, length, step, |it| &it.steps.last.stages)?;
        let h = self.steps.last.stages.h;
        let delta = match landing {
            Some((delta, _)) => delta,
            None if self.steps.last.stages.end.x[c] > 0.0 => return Ok(None),
            None => {
                // the crossing within the step, by its polynomial
                self.complete()?;
                self.steps.last.stages.root_of_polynomial(c).unwrap_or(1.0) * h - h
            }
        };
        let judged = self.steps.settings.adaptive && !self.steps.control.jump.allowed;
        if judged && self.misfit() > 1.0 {
            return Err(Failure::Status(Status::StepSizeTooSmall));
        }
        let total = (h + delta).max(0.0);
        self.arrive(total, delta)?;
        Ok(Some(Next::Hit(self.hit_together(gap, total))))
    }

    /// Steps to where the force of a contact vanishes, near `now + length`.
    fn lift<E>(&mut self, length: f64, gap: usize) -> Result<Next, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let whole = self.steps.last.stages.h;
        let mut one = (0.0, self.state.lambda()[gap]);
        let mut x = length;
        for iteration in 0..ITERATIONS {
            self.try_step(x)?;
            self.finish()?;
            let force = self.steps.last.at_end.lambda[gap];
            let slope = (force - one.1) / (x - one.0);
            let next = x - force / slope;
            one = (x, force);
            let rounding = 4.0 * f64::EPSILON * (self.state.now().t.abs() + x);
            let done = (next - x).abs() <= rounding;
            if done || !next.is_finite() || iteration + 1 == ITERATIONS {
                break;
            }
            x = next.clamp(0.0, whole);
        }
        self.arrive(x, 0.0)?;
        Ok(Next::Release { gap, h: whole })
    }

    /// To an event at the time `total` after the start of the last step, `delta` after its end.
    fn arrive<E>(&mut self, total: f64, delta: f64) -> Result<(), Failure<E>>
    where
        D: Dynamics<E>,
    {
        if self.state.now().t + total > self.steps.dense_from {
            self.complete()?;
        }
        let steps = &mut *self.steps;
        steps.accepted += 1;
        steps.experience = Experience::NONE;
        steps.last.length = total;
        self.state.move_along(&steps.last.stages, (total, delta), self.t_end);
        Ok(())
    }

    /// The gap and those that close at the same time, to rounding of the flight's length.
    fn hit_together(&self, gap: usize, flight: f64) -> GapSet {
        let near = TOGETHER * flight + ULPS * self.state.now().t.abs();
        let is_hit = |i: usize| {
            let (x, v) = self.state.gap(i);
            v < 0.0 && x <= -v * near
        };
        self.state.open_gaps().filter(|&i| i == gap || is_hit(i)).collect()
    }
}
