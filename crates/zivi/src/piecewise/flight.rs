//! Flight: the loop over steps that are tried, searched for events, and taken or given up for
//! shorter ones.

use super::steps::{Start, Steps};
use crate::numeric::coordinates::Coordinates;
use crate::numeric::stages::Equation;
use crate::numeric::step_size::{Plan, RETREAT};
use crate::record::failure::Failure;
use crate::Status;

/// What to do with a step that was tried.
pub(crate) enum Verdict<V> {
    /// Take it; the next may be longer by this factor.
    Take(f64),
    /// An event lies within it, after this part of it.
    Stop(f64, V),
    /// Try a shorter one, by this factor; the reason, should none be short enough.
    Shorten(f64, Status),
}

impl<V> Verdict<V> {
    /// It is too long to tell what happens in it.
    pub(crate) const TOO_LONG: Self = Self::Shorten(RETREAT, Status::StepSizeTooSmall);
}

/// Where a coordinate vanishes that the last step was to end with.
pub(crate) enum Root {
    /// So much later than the end of the step, which is near, with this rate.
    Near { delta: f64, xdot: f64 },
    /// After this part of it.
    Within(f64),
}

/// A motion from a state, integrated step by step up to events.
pub(crate) trait SteppedFlight<Q: Coordinates, E> {
    /// What ends a step early.
    type Event: Copy;
    /// What is told of a step.
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
    fn search(&mut self, growth: f64) -> Result<Verdict<Self::Event>, Failure<E>>;

    /// Ends the step at an event near the time `length` after its start; none if there is none after all.
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
            let (factor, why) = match self.judge(h)? {
                Verdict::Take(growth) => {
                    self.steps().set_next(Some(plan.next(h, growth)));
                    return self.take();
                }
                Verdict::Stop(theta, event) => match self.stop(theta * h, event) {
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
                Verdict::Shorten(factor, why) => (factor, why),
            };
            h = self.steps().shorter(h, shortest, (factor, why))?;
        }
    }

    /// What to do with the step of length `h`.
    #[inline(always)]
    fn judge(&mut self, h: f64) -> Result<Verdict<Self::Event>, Failure<E>> {
        let verdict = match self.attempt(h) {
            Ok(error) => match self.steps().growth(error) {
                Ok(growth) => self.search(growth),
                Err(factor) => Ok(Verdict::Shorten(factor, Status::StepSizeTooSmall)),
            },
            Err(failure) => Err(failure),
        };
        match verdict {
            Err(Failure::Status(why)) if Self::is_curable(why) => {
                Ok(Verdict::Shorten(RETREAT, why))
            }
            verdict => verdict,
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

    /// The part of the last step after which a coordinate that was positive is negative, if it comes
    /// to that.
    #[inline(always)]
    fn first_root(&mut self, c: usize) -> Result<Option<f64>, Failure<E>> {
        let (steps, _, mut equation) = self.parts();
        steps.last_mut().first_root(c, &mut equation)
    }

    /// Steps onto the root of a coordinate near a length, at most twice; none if that step passes
    /// it closely.
    #[inline(always)]
    fn step_onto(&mut self, c: usize, mut length: f64) -> Result<Option<Root>, Failure<E>> {
        /// How near the end of the step must be to the root, relative to its length.
        const NEAR: f64 = 1e-3;
        let mut root = None;
        for _ in 0..2 {
            if self.attempt(length)? > 1.0 {
                return Err(Failure::Status(Status::StepSizeTooSmall));
            }
            self.finish()?;
            root = self.steps().last().root_at_end(c);
            match root {
                Some((delta, _)) if delta.abs() > NEAR * length => length += delta,
                _ => break,
            }
        }
        if let Some((delta, xdot)) = root {
            return Ok(Some(Root::Near { delta, xdot }));
        }
        if self.steps().last().end.x.as_slice()[c] > 0.0 {
            return Ok(None);
        }
        // where the motion is as small as the tolerance, two steps need not agree on it any better
        self.complete()?;
        let theta = self.steps().last().root_of_polynomial(c);
        Ok(Some(Root::Within(theta.unwrap_or(1.0))))
    }
}
