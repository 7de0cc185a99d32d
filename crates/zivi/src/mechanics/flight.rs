//! Steps under error control, each searched for the first impact and the first lift-off.

use super::gap_set::GapSet;
use super::kinetics::Model;
use super::lift_off::Release;
use super::machine::{Jump, Machine, Pending};
use crate::record::failure::Failure;
use crate::system::dynamics::Dynamics;
use crate::Status;

/// Factor that keeps the next step from being rejected.
const SAFETY: f64 = 0.9;
/// Smallest and largest factor between two steps.
const FACTORS: (f64, f64) = (0.2, 5.0);
/// Factor after a step that could not be judged.
const RETREAT: f64 = 0.25;
/// A step near a Zeno point is a little longer than the arc under a constant pull.
const ARC: f64 = 1.1;
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

/// A step size, and what the error control had asked for if that was more.
#[derive(Clone, Copy)]
struct Plan {
    h: f64,
    wanted: f64,
}

impl Machine {
    /// One step, or the part of it up to an event.
    pub(super) fn fly<E, D: Dynamics<E>>(
        &mut self,
        t_end: f64,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let plan = self.plan(t_end, model)?;
        let (mut h, shortest) = (plan.h, 8.0 * f64::EPSILON * self.now.t.abs());
        self.jump = Jump { met_before: self.jump.met, ..Jump::default() };
        loop {
            if self.spent >= self.settings.max_steps {
                return Err(Failure::Status(Status::StepBudget));
            }
            self.spent += 1;
            let (factor, why) = match self.judge(h, model)? {
                Verdict::Take(growth) => return self.take(plan, h, growth, t_end, model),
                Verdict::Land(theta, gap) => match self.land(theta * h, gap, t_end, model) {
                    Err(Failure::Status(Status::StepSizeTooSmall)) => {
                        (RETREAT, Status::StepSizeTooSmall)
                    }
                    landed => {
                        if h < plan.h {
                            self.h = Some(h);
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
            h *= factor;
            let jumps = matches!(why, Status::StepSizeTooSmall | Status::ContactNotSolved);
            if h <= shortest && jumps && !(self.jump.allowed || self.jump.met_before) {
                (h, self.jump.allowed) = (shortest, true);
            } else if h <= shortest || h < f64::MIN_POSITIVE {
                return Err(Failure::Status(why));
            }
        }
    }

    fn plan<E, D: Dynamics<E>>(
        &mut self,
        t_end: f64,
        model: &mut Model<'_, D>,
    ) -> Result<Plan, Failure<E>> {
        let left = (t_end - self.now.t) - self.now.late;
        let wanted = match self.h {
            _ if !self.settings.adaptive => self.settings.max_step,
            Some(h) => h.min(self.settings.max_step),
            None => self.first_step(left, model)?.min(self.settings.max_step),
        };
        let (mut h, n) = (wanted, self.layout.n);
        for c in n..n + self.layout.m {
            let (speed, pull) = (self.now.v[c], -self.slope[c]);
            if self.now.x[c] == 0.0 && speed > 0.0 && pull > 0.0 {
                h = h.min(ARC * 2.0 * speed / pull);
            }
        }
        if let Some(obstacle) = self.obstacle {
            h = h.min(obstacle.longest_step(self.now.t));
        }
        // no sliver of a step is left for the end
        let h = if h >= left * (1.0 - 1e-12) { left } else { h };
        Ok(Plan { h, wanted })
    }

    /// A step whose error should be near the tolerance, from the accelerations and their change
    /// (E. Hairer, S. P. Norsett, G. Wanner, *Solving Ordinary Differential Equations I*, section
    /// II.4).
    fn first_step<E, D: Dynamics<E>>(
        &mut self,
        left: f64,
        model: &mut Model<'_, D>,
    ) -> Result<f64, Failure<E>> {
        let (n, size) = (self.layout.n, self.now.x.len());
        let scale = |c: usize| {
            let [atol_x, atol_v] = self.settings.atol;
            let of = |atol: f64, value: f64| atol + self.settings.rtol * value.abs();
            (of(atol_x, self.now.x[c]), of(atol_v, self.now.v[c]))
        };
        let norm = |of: &dyn Fn(usize) -> (f64, f64)| {
            (0..size).fold(0.0_f64, |worst, c| {
                let ((x, v), (scale_x, scale_v)) = (of(c), scale(c));
                worst.max((x / scale_x).abs()).max((v / scale_v).abs())
            })
        };
        let length = norm(&|c| (self.now.x[c], self.now.v[c]));
        let rate = norm(&|c| (self.now.v[c], self.slope[c]));
        let known = length > 1e-5 && rate > 1e-5;
        let euler = if known { 1e-2 * length / rate } else { 1e-6 * left }.min(left);
        let at = |c: usize| {
            (self.now.x[c] + euler * self.now.v[c], self.now.v[c] + euler * self.slope[c])
        };
        let (q, w): (Vec<f64>, Vec<f64>) = (0..n).map(at).unzip();
        match self.aside.evaluate(model, self.now.t + euler, &q, &w) {
            Err(Failure::Status(_)) => return Ok(euler),
            ahead => ahead?,
        }
        if self.aside.contact(self.closed).is_err() {
            return Ok(euler);
        }
        let ahead = &self.aside.acceleration;
        let change = norm(&|c| (euler * self.slope[c], ahead[c] - self.slope[c])) / euler;
        let fastest = rate.max(change);
        let step = if fastest > 1e-15 {
            (1e-2 / fastest).powf(1.0 / self.stages.order_of_error())
        } else {
            left
        };
        Ok(step.min(100.0 * euler).min(left))
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
        let factor = SAFETY * error.powf(-1.0 / self.stages.order_of_error());
        if error > 1.0 || error.is_nan() {
            let factor = if factor > FACTORS.0 { factor.min(SAFETY) } else { FACTORS.0 };
            return Ok(Verdict::Shorten(factor, Status::StepSizeTooSmall));
        }
        let growth = if self.settings.adaptive { factor.min(FACTORS.1) } else { 1.0 };
        let (n, end) = (self.layout.n, &self.stages.end);
        if !self.unarmed.iter().all(|i| end.x[n + i] > 0.0 && end.v[n + i] > 0.0) {
            return Ok(Verdict::Shorten(RETREAT, Status::StepSizeTooSmall));
        }
        let contact = self.first_contact(model)?;
        let release = match self.first_release(model)? {
            Release::None => None,
            Release::At(theta, gap) => Some((theta, gap)),
            Release::Unclear => return Ok(Verdict::Shorten(0.5, Status::ContactNotSolved)),
        };
        if self.stages.end.t > self.dense_from {
            self.stages.complete(&mut self.kinetics, model)?;
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
        let Self { stages, kinetics, now, slope, settings, closed, .. } = self;
        stages.step(now, slope, h, *closed, (kinetics, model))?;
        if !settings.adaptive {
            return Ok(0.0);
        }
        let error = stages.error(settings.atol, settings.rtol, kinetics, model)?;
        if self.jump.allowed && error > 1.0 && self.stages.is_smooth_to_rounding() {
            self.jump.met = true;
            return Ok(0.0);
        }
        Ok(error)
    }

    /// The first gap that closes in the step, and after which part of it.
    fn first_contact<E, D: Dynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
    ) -> Result<Option<(f64, usize)>, Failure<E>> {
        let n = self.layout.n;
        let mut first: Option<(f64, usize)> = None;
        for i in 0..self.layout.m {
            if self.closed.has(i) || self.unarmed.has(i) {
                continue;
            }
            let screen = self.stages.screen(n + i);
            if screen.is_some_and(|(p, slack)| p.coefficients().iter().all(|&c| c > slack)) {
                continue;
            }
            self.stages.complete(&mut self.kinetics, model)?;
            let [x, _] = self.stages.polynomials(n + i);
            // after an impact theta = 0 is a root, and known
            let p = if self.now.x[n + i] == 0.0 { x.without_root_at_zero() } else { x };
            if let Some(theta) = p.first_negative() {
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
        self.length = self.stages.h;
        let ends = self.stages.h >= (t_end - self.now.t) - self.now.late;
        self.h = Some(if h < plan.h {
            h * growth.min(1.0)
        } else if h < plan.wanted && growth >= 1.0 {
            // a step that something else cut short says nothing against a longer one
            (h * growth).max(plan.wanted)
        } else {
            h * growth
        });
        self.now.copy_from(&self.stages.end);
        if ends {
            (self.now.t, self.now.late) = (t_end, 0.0);
        }
        self.unarmed = GapSet::EMPTY;
        self.settle_step(model)
    }

    /// Back onto the manifold of the closed gaps, and the slope for the next step.
    fn settle_step<E, D: Dynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        if !self.closed.is_empty() {
            self.project(self.closed, model)?;
            self.refresh()?;
            for i in 0..self.layout.m {
                let rate = self.kinetics.rate(i, &self.now.v[..self.layout.n]);
                self.anchor(i, self.kinetics.gap(i), rate);
            }
            return Ok(());
        }
        self.fresh = self.stages.copy_end_slope(&mut self.slope);
        self.lambda.fill(0.0);
        if self.fresh {
            for i in 0..self.layout.m {
                self.anchor(i, self.stages.end_gap[i], self.stages.end_rate[i]);
            }
        }
        Ok(())
    }

    /// Steps once more, onto the impact near `now + length`; false if that step passes the gap
    /// closely.
    fn land<E, D: Dynamics<E>>(
        &mut self,
        mut length: f64,
        gap: usize,
        t_end: f64,
        model: &mut Model<'_, D>,
    ) -> Result<bool, Failure<E>> {
        let c = self.layout.n + gap;
        let mut delta = None;
        for _ in 0..2 {
            if self.try_step(length, model)? > 1.0 {
                return Err(Failure::Status(Status::StepSizeTooSmall));
            }
            self.stages.finish(&mut self.kinetics, model)?;
            let end = &self.stages.end;
            delta = touchdown(end.x[c], end.v[c], self.stages.end_slope(c))
                .filter(|delta| delta.abs() < 0.5 * length);
            match delta {
                Some(delta) if delta.abs() > 1e-3 * length => length += delta,
                _ => break,
            }
        }
        let delta = match delta {
            Some(delta) => delta,
            None if self.stages.end.x[c] > 0.0 => return Ok(false),
            None => self.crossing_inside(c, model)? - self.stages.h,
        };
        let total = (self.stages.h + delta).max(0.0);
        if self.now.t + total > self.dense_from {
            self.stages.complete(&mut self.kinetics, model)?;
        }
        self.counts.accepted += 1;
        self.arrive(total, delta, t_end);
        self.pending = Some(Pending::Hit(self.hit_together(gap, total)));
        Ok(true)
    }

    /// The time of the crossing within a step that ends behind it, by its polynomial.
    fn crossing_inside<E, D: Dynamics<E>>(
        &mut self,
        c: usize,
        model: &mut Model<'_, D>,
    ) -> Result<f64, Failure<E>> {
        self.stages.complete(&mut self.kinetics, model)?;
        let [x, _] = self.stages.polynomials(c);
        let p = if self.now.x[c] == 0.0 { x.without_root_at_zero() } else { x };
        Ok(p.first_negative().unwrap_or(1.0) * self.stages.h)
    }

    /// Moves to the time `total` after the start of the last step, `delta` after its end.
    pub(super) fn arrive(&mut self, total: f64, delta: f64, t_end: f64) {
        let end = &self.stages.end;
        self.length = total;
        self.now.pass(total);
        if self.now.t > t_end {
            (self.now.t, self.now.late) = (t_end, 0.0);
        }
        for c in 0..self.now.x.len() {
            let slope = self.stages.end_slope(c);
            self.now.x[c] = end.x[c] + delta * (end.v[c] + 0.5 * delta * slope);
            self.now.v[c] = end.v[c] + delta * slope;
        }
        self.fresh = false;
    }

    /// The gap and those that close at the same time, to rounding of the flight's length.
    fn hit_together(&self, gap: usize, flight: f64) -> GapSet {
        let n = self.layout.n;
        let near = TOGETHER * flight + ULPS * self.now.t.abs();
        let is_hit = |i: usize| {
            let (x, v) = (self.now.x[n + i], self.now.v[n + i]);
            !self.closed.has(i) && v < 0.0 && x <= -v * near
        };
        (0..self.layout.m).filter(|&i| i == gap || is_hit(i)).collect()
    }
}

/// Time until the downward root of `x + v d + a d^2/2` nearest to zero.
fn touchdown(x: f64, v: f64, a: f64) -> Option<f64> {
    let squared = v * v - 2.0 * a * x;
    if squared < 0.0 {
        return (x <= 0.0).then_some(0.0);
    }
    if x == 0.0 && v <= 0.0 {
        return Some(0.0);
    }
    let delta = 2.0 * x / (squared.sqrt() - v);
    delta.is_finite().then_some(delta)
}
