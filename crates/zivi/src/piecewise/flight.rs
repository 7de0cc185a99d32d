//! Flight: the loop over steps that are tried, searched for events, and taken or given up for
//! shorter ones.

use super::steps::{Start, Steps};
use crate::numeric::coordinates::Coordinates;
use crate::numeric::stages::{Equation, Plan, RETREAT};
use crate::record::status::Failure;
use crate::Status;

/// Decision about a tried step.
pub(crate) enum StepDecision<V> {
    /// Take it; the next may be longer by this factor.
    Take(f64),
    /// An event lies within it, after this part of it.
    Stop(f64, V),
    /// Try a shorter one, by this factor; the reason, should none be short enough.
    Shorten(f64, Status),
}

impl<V> StepDecision<V> {
    /// It is too long for event detection.
    pub(crate) const TOO_LONG: Self = Self::Shorten(RETREAT, Status::StepSizeTooSmall);
}

/// Where a coordinate vanishes that the last step was to end with.
pub(crate) enum StepRoot {
    /// So much later than the end of the step, which is near, with this rate.
    Near { delta: f64, xdot: f64 },
    /// After this part of it.
    Within(f64),
}

/// A motion from a state, integrated step by step up to events.
pub(crate) trait SteppedFlight<Q: Coordinates, E> {
    /// Event that ends a step early.
    type Event: Copy;
    /// Description of a step.
    type Piece;

    /// The steps so far.
    fn steps(&mut self) -> &mut Steps<Q>;

    /// The same, where the next one starts, and the equation of motion.
    fn parts(&mut self) -> (&mut Steps<Q>, Start<'_, Q>, impl Equation<Q, Failure<E>>);

    /// Whether a shorter step may do where one cannot be computed for a reason.
    fn is_curable(_why: Status) -> bool {
        true
    }

    /// The same of the step onto an event.
    fn is_curable_at_event(why: Status) -> bool {
        Self::is_curable(why)
    }

    /// The first event in a step that is accurate enough, after which the next may be longer by the
    /// factor `growth`; a shorter step where this one cannot tell.
    fn search(&mut self, growth: f64) -> Result<StepDecision<Self::Event>, Failure<E>>;

    /// Ends the step at an event near the time `length` after its start; `None` without one.
    fn stop(&mut self, length: f64, event: Self::Event) -> Result<Option<Self::Piece>, Failure<E>>;

    /// Takes the last step.
    fn take(&mut self) -> Result<Self::Piece, Failure<E>>;

    /// One step, or the part of it up to an event; none is shorter than `shortest`.
    #[inline(always)]
    fn fly(&mut self, plan: Plan, shortest: f64) -> Result<Self::Piece, Failure<E>> {
        let mut h = plan.h;
        self.steps().begin();
        loop {
            self.steps().spend()?;
            let (factor, why) = match self.decide(h)? {
                StepDecision::Take(growth) => {
                    self.steps().set_next(Some(plan.next(h, growth)));
                    return self.take();
                }
                StepDecision::Stop(theta, event) => match self.stop(theta * h, event) {
                    Err(Failure::Status(why)) if Self::is_curable_at_event(why) => (RETREAT, why),
                    stopped => {
                        if h < plan.h {
                            self.steps().set_next(Some(h));
                        }
                        if let Some(piece) = stopped? {
                            return Ok(piece);
                        }
                        // the step was too long to tell: it saw an event where there is none
                        self.steps().set_next(Some(plan.next(0.5 * h, 1.0)));
                        return self.take();
                    }
                },
                StepDecision::Shorten(factor, why) => (factor, why),
            };
            h = self.steps().shorter(h, shortest, (factor, why))?;
        }
    }

    /// Decides about the step of length `h`.
    #[inline(always)]
    fn decide(&mut self, h: f64) -> Result<StepDecision<Self::Event>, Failure<E>> {
        let decision = match self.attempt(h) {
            Ok(error) => match self.steps().growth(error) {
                Ok(growth) => self.search(growth),
                Err(factor) => Ok(StepDecision::Shorten(factor, Status::StepSizeTooSmall)),
            },
            Err(failure) => Err(failure),
        };
        match decision {
            Err(Failure::Status(why)) if Self::is_curable(why) => {
                Ok(StepDecision::Shorten(RETREAT, why))
            }
            decision => decision,
        }
    }

    /// The step of length `h` from here, and its error relative to the tolerances.
    #[inline(always)]
    fn attempt(&mut self, h: f64) -> Result<f64, Failure<E>> {
        let (steps, from, mut equation) = self.parts();
        steps.attempt(from, h, &mut equation)
    }

    /// Evaluates the equation of motion at the end of the last step.
    #[inline(always)]
    fn finish(&mut self) -> Result<(), Failure<E>> {
        let (steps, _, mut equation) = self.parts();
        steps.last_mut().finish(&mut equation)
    }

    /// Computes what the polynomials of the last step need.
    #[inline(always)]
    fn complete(&mut self) -> Result<(), Failure<E>> {
        let (steps, _, mut equation) = self.parts();
        steps.last_mut().complete(&mut equation)
    }

    /// The part of the last step after which a coordinate that was positive is negative, if it
    /// comes to that.
    #[inline(always)]
    fn first_root(&mut self, c: usize) -> Result<Option<f64>, Failure<E>> {
        let (steps, _, mut equation) = self.parts();
        steps.last_mut().first_root(c, &mut equation)
    }

    /// The part of the last step after which a coordinate that was negative is positive.
    fn first_rise(&mut self, c: usize) -> Result<Option<f64>, Failure<E>> {
        let (steps, _, mut equation) = self.parts();
        steps.last_mut().first_rise(c, &mut equation)
    }

    /// Steps onto the root of a coordinate near a length, at most twice; none if that step passes
    /// it closely, on the side from which it comes.
    #[inline(always)]
    fn step_onto(
        &mut self,
        c: usize,
        mut length: f64,
        side: f64,
    ) -> Result<Option<StepRoot>, Failure<E>> {
        /// How near the end of the step must be to the root, relative to its length.
        const NEAR: f64 = 1e-3;
        let mut root = None;
        for _ in 0..2 {
            if self.attempt(length)? > 1.0 {
                return Err(Failure::Status(Status::StepSizeTooSmall));
            }
            self.finish()?;
            root = self.steps().last().root_at_end(c, side);
            match root {
                Some((delta, _)) if delta.abs() > NEAR * length => length += delta,
                _ => break,
            }
        }
        if let Some((delta, xdot)) = root {
            return Ok(Some(StepRoot::Near { delta, xdot }));
        }
        if side * self.steps().last().end.x.as_slice()[c] > 0.0 {
            return Ok(None);
        }
        // where the motion is as small as the tolerance, two steps need not agree on it any better
        self.complete()?;
        let last = self.steps().last();
        let theta = match side > 0.0 {
            true => last.root_of_polynomial(c),
            false => last.rise_of_polynomial(c),
        };
        Ok(Some(StepRoot::Within(theta.unwrap_or(1.0))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::coordinates::State;
    use crate::numeric::stages::Tolerances;
    use crate::numeric::tableau::DOP853;
    use crate::piecewise::steps::StepLimits;
    use std::f64::consts::FRAC_PI_2;

    /// `x'' = -x`, which is not known below a position for a reason.
    struct Spring {
        unknown: Option<(f64, Status)>,
    }

    impl Equation<f64, Failure<()>> for Spring {
        fn acceleration(&mut self, at: &State<f64>, into: &mut f64) -> Result<(), Failure<()>> {
            *into = -at.x;
            match self.unknown {
                Some((below, why)) if at.x < below => Err(Failure::Status(why)),
                _ => Ok(()),
            }
        }
    }

    /// From rest at `x = 1`, in steps that are called too long above a length.
    struct Oscillator {
        steps: Steps<f64>,
        now: State<f64>,
        slope: f64,
        too_long: f64,
        unknown: Option<(f64, Status)>,
        /// Why there is no step onto zero.
        no_stop: Option<Status>,
    }

    impl SteppedFlight<f64, ()> for Oscillator {
        type Event = ();
        /// When it is at zero.
        type Piece = Option<f64>;

        fn steps(&mut self) -> &mut Steps<f64> {
            &mut self.steps
        }

        fn parts(&mut self) -> (&mut Steps<f64>, Start<'_, f64>, impl Equation<f64, Failure<()>>) {
            let spring = Spring { unknown: self.unknown };
            (&mut self.steps, (&self.now, &self.slope), spring)
        }

        fn is_curable(why: Status) -> bool {
            why != Status::RedundantContacts
        }

        fn search(&mut self, growth: f64) -> Result<StepDecision<()>, Failure<()>> {
            if self.steps.last().h >= self.too_long {
                return Ok(StepDecision::TOO_LONG);
            }
            let root = self.first_root(0)?;
            Ok(root.map_or(StepDecision::Take(growth), |theta| StepDecision::Stop(theta, ())))
        }

        fn stop(&mut self, length: f64, (): ()) -> Result<Option<Option<f64>>, Failure<()>> {
            if let Some(why) = self.no_stop {
                return Err(Failure::Status(why));
            }
            let root = self.step_onto(0, length, 1.0)?;
            let last = self.steps.last();
            Ok(root.map(|root| match root {
                StepRoot::Near { delta, .. } => Some(last.from.t + last.h + delta),
                StepRoot::Within(theta) => Some(last.from.t + theta * last.h),
            }))
        }

        fn take(&mut self) -> Result<Option<f64>, Failure<()>> {
            self.steps.accept();
            self.now = self.steps.last().end;
            self.slope = -self.now.x;
            Ok(None)
        }
    }

    fn oscillator(too_long: f64, max_steps: usize) -> Oscillator {
        let tolerances = Tolerances { rtol: 1e-12, atol: [1e-12; 2], rounding: 0.25 };
        let limits = StepLimits { adaptive: true, tolerances, max_step: 1.0, max_steps };
        let steps = Steps::new(limits, &DOP853, 1, None);
        let now = State { t: 0.0, late: 0.0, x: 1.0, xdot: 0.0 };
        Oscillator { steps, now, slope: -1.0, too_long, unknown: None, no_stop: None }
    }

    /// When it is at zero, and the steps that were taken and given up before.
    fn at_zero(mut it: Oscillator) -> (Result<f64, Failure<()>>, (u64, u64)) {
        let mut fly = || loop {
            let from = (&it.now, &it.slope);
            let plan =
                it.steps.plan(from, 0..1, f64::INFINITY, 10.0, &mut Spring { unknown: None })?;
            if let Some(t) = it.fly(plan, 1e-15)? {
                return Ok(t);
            }
        };
        let t = fly();
        (t, it.steps.counts())
    }

    #[test]
    fn steps_end_at_the_first_root() {
        for too_long in [f64::INFINITY, 0.02] {
            let (t, (accepted, rejected)) = at_zero(oscillator(too_long, 1000));
            assert!(t.is_ok_and(|t| (t - FRAC_PI_2).abs() < 1e-12), "{too_long}");
            let most = if too_long == 0.02 { accepted } else { 1 };
            assert!(accepted > 3 && rejected <= most, "{accepted} {rejected}");
        }
        let (_, (accepted, rejected)) = at_zero(oscillator(0.02, 1000));
        assert!(accepted > 75 && rejected > 0, "{accepted} {rejected}");
    }

    #[test]
    fn the_reason_why_there_is_no_step_ends_a_run() {
        let too_small = |t| matches!(t, Err(Failure::Status(Status::StepSizeTooSmall)));
        let (t, (accepted, rejected)) = at_zero(oscillator(0.0, 1000));
        assert!(too_small(t) && accepted == 0 && rejected > 10, "{rejected}");
        let (t, _) = at_zero(oscillator(f64::INFINITY, 3));
        assert!(matches!(t, Err(Failure::Status(Status::StepBudget))));
    }

    #[test]
    fn only_what_a_shorter_step_may_cure_is_tried_again() {
        for (why, cured) in [(Status::RedundantContacts, false), (Status::ForceNotFinite, true)] {
            // within a step, and in the step onto zero
            for (unknown, no_stop) in [(Some((0.5, why)), None), (None, Some(why))] {
                let plain = oscillator(f64::INFINITY, 10_000);
                let (t, (accepted, rejected)) = at_zero(Oscillator { unknown, no_stop, ..plain });
                assert!(matches!(t, Err(Failure::Status(found)) if found == why), "{t:?}");
                assert!(accepted > 1 && (rejected > 10) == cured, "{why:?}: {rejected}");
                assert!(cured || rejected <= 1, "{rejected}");
            }
        }
    }
}
