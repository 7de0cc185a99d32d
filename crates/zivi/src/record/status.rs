//! Statuses, failures and monitors of runs.
//!
//! How a run ended.

use crate::record::recorder::DenseStep;
use crate::Keep;
use std::collections::TryReserveError;
use std::ops::ControlFlow;
use std::time::{Duration, Instant};
use zivi_core::StepFailure;

/// How a run ended; the numbers are part of the public interface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Status {
    /// The end of the span was reached.
    Completed = 0,
    /// The force returned NaN or infinity.
    ForceNotFinite = 1,
    /// The state became infinite or NaN (overflow).
    StateNotFinite = 2,
    /// The step's equation for the force at its end was not solved within its iterations.
    ForceNotConverged = 3,
    /// The step's inclusion was not solved: no sign pattern fits within rounding.
    StepNotSolved = 4,
    /// The force or the caller raised an error, or the run was interrupted.
    Raised = 5,
    /// An impact sequence of falling speeds was longer than its budget, or impacts without an acceleration
    /// to the wall went on below the tolerance.
    ZenoBudget = 6,
    /// The run took more steps than its budget.
    StepBudget = 7,
    /// No step that still advances the time was short enough for the tolerances.
    StepSizeTooSmall = 8,
    /// An event of the user that was to end the run did.
    TerminatedByEvent = 9,
    /// The record exceeded the memory.
    OutOfMemory = 10,
    /// A fault in this library.
    Internal = 11,
    /// Closed gaps that depend on each other, and no forces keep all of them closed.
    RedundantContacts = 12,
    /// The complementarity problem of an impact has no solution, or the solver did not find it.
    ImpactNotSolved = 13,
    /// Which contacts stay closed was not decided.
    ContactNotSolved = 14,
    /// The mass matrix is not symmetric positive definite.
    MassNotDefinite = 15,
    /// No motion in contact obeys the law of friction (Painlevé's paradox).
    InconsistentContact = 16,
    /// Several motions obey the law of friction.
    IndeterminateContact = 17,
    /// A sliding contact reached the border of Painlevé's paradox.
    PainleveSingular = 18,
    /// More than one force of sticking contacts is not determined by the motion: of earlier versions only.
    RedundantStick = 19,
    /// Friction changed its mode again and again at one instant.
    ModeChatter = 20,
    /// The controller's updates were rejected, all of them or all in the end.
    ControlRejected = 21,
    /// Many steps without an event hardly advanced the time.
    NoProgress = 22,
    /// Dependent equality rows require different motions.
    InconsistentConstraints = 23,
    /// No impulses obey the laws of an impact on several gaps with friction.
    InconsistentImpact = 24,
}

impl Status {
    /// Every status, in the order of their numbers.
    pub const ALL: [Status; 25] = [
        Status::Completed,
        Status::ForceNotFinite,
        Status::StateNotFinite,
        Status::ForceNotConverged,
        Status::StepNotSolved,
        Status::Raised,
        Status::ZenoBudget,
        Status::StepBudget,
        Status::StepSizeTooSmall,
        Status::TerminatedByEvent,
        Status::OutOfMemory,
        Status::Internal,
        Status::RedundantContacts,
        Status::ImpactNotSolved,
        Status::ContactNotSolved,
        Status::MassNotDefinite,
        Status::InconsistentContact,
        Status::IndeterminateContact,
        Status::PainleveSingular,
        Status::RedundantStick,
        Status::ModeChatter,
        Status::ControlRejected,
        Status::NoProgress,
        Status::InconsistentConstraints,
        Status::InconsistentImpact,
    ];

    /// Reason and advice.
    #[must_use]
    pub fn message(self) -> &'static str {
        match self {
            Status::Completed => "The end of t_span was reached.",
            Status::ForceNotFinite => {
                "The force returned NaN or infinity; the trajectory ends at the last step before. \
                 Check the force at the last sample."
            }
            Status::StateNotFinite => {
                "The state overflowed; the trajectory ends at the last finite step. \
                 Check the units and the sign of the force."
            }
            Status::ForceNotConverged => {
                "The force at the end of the step was not found within its iterations; the \
                 trajectory ends at the last solved step. Try a smaller h, or a force that is \
                 continuous in x and xdot."
            }
            Status::StepNotSolved => {
                "No sign pattern solves the step within rounding; the trajectory ends at the last \
                 solved step. Try a different h, and please report the case."
            }
            Status::Raised => {
                "The force raised an exception or the run was interrupted; the trajectory ends at \
                 the last complete step."
            }
            Status::ZenoBudget => {
                "The impacts of one sequence exceeded max_impacts before their accumulation was known \
                 to the tolerance, or they do not accumulate: e = 1, or the force at the wall is zero. \
                 The trajectory ends at the last impact. Increase max_impacts, or loosen rtol and atol."
            }
            Status::StepBudget => {
                "The steps exceeded max_steps; the trajectory ends at the last one. Increase \
                 max_steps, shorten t_span, or loosen rtol and atol."
            }
            Status::StepSizeTooSmall => {
                "The tolerances require a step below the rounding of t; the trajectory ends at the \
                 last step before. Check the force for a singularity there, or loosen rtol and atol."
            }
            Status::TerminatedByEvent => "A terminal event ended the run.",
            Status::OutOfMemory => {
                "The record of the run no longer fits into memory; the trajectory ends at the last \
                 step before. Set t_eval or dense_output=False, or shorten t_span."
            }
            Status::Internal => {
                "A fault in zivi itself ended the run; its results are lost. Please report the case, \
                 with the text on standard error."
            }
            Status::RedundantContacts => {
                "The closed gaps do not determine their forces: no forces keep all gaps closed, or \
                 derivatives depend on forces that are not unique. The trajectory ends before. Remove \
                 dependent gaps, or add a coordinate in which the contacts are compliant."
            }
            Status::ImpactNotSolved => {
                "The impulses of an impact on several gaps were not found; the trajectory ends \
                 before the impact. With friction they may not exist: try impact_law='poisson', or a \
                 smaller mu. Without friction, check the mass matrix and the gradients there."
            }
            Status::ContactNotSolved => {
                "The contacts that stay closed could not be determined, or impacts at one instant do \
                 not end; the trajectory ends there. Check that the gaps leave room for the bodies, \
                 tighten rtol and atol, and check that mass, force and gaps are smooth."
            }
            Status::MassNotDefinite => {
                "The mass matrix is not symmetric positive definite; the trajectory ends at the \
                 last step before. Check it at the last sample."
            }
            Status::InconsistentContact => {
                "A sliding contact is jammed (Painlevé's paradox): no contact force obeys the law of \
                 friction there; the trajectory ends there. Lower mu."
            }
            Status::IndeterminateContact => {
                "Several motions obey the law of friction from here on; the trajectory ends there. A \
                 sliding contact is in Painlevé's paradox, or contacts at rest hold each other by a \
                 prestress that the motion does not determine. Lower mu."
            }
            Status::PainleveSingular => {
                "A sliding contact has reached the border of Painlevé's paradox, where its force \
                 grows without bound; the trajectory ends there. Lower mu."
            }
            Status::RedundantStick => {
                "Several forces of the closed contacts are not determined by the motion. Only runs of \
                 zivi before 0.2 ended with this status."
            }
            Status::ModeChatter => {
                "Friction changed repeatedly between sticking and slipping at one instant; the \
                 trajectory ends there. Check that the forces are smooth there, and please report \
                 the case."
            }
            Status::ControlRejected => {
                "The end of t_span was reached, but all control updates, or all of the last tenth, were \
                 rejected: the plant moved under a held control. Find the first rejected update in \
                 tick_status, and check the samples and forces there: controls must be finite, and \
                 measurements >= -depth."
            }
            Status::NoProgress => {
                "1000 steps without an event advanced the time by less than 1e-9 of the span; the \
                 trajectory ends at the last step. The forces are not smooth at this scale: check at \
                 the last sample that they depend on time and state only, or loosen rtol and atol."
            }
            Status::InconsistentConstraints => {
                "Dependent equality rows prescribe different motions, or an impulse requires a motion \
                 that the rows exclude; the trajectory ends at the last step before. Make the dependent \
                 rows consistent, or remove some of them."
            }
            Status::InconsistentImpact => {
                "An impact on several gaps does not have a solution: no combination of sticking, \
                 slipping and opening gaps obeys the laws of restitution and friction. The trajectory \
                 ends before the impact. \
                 Try impact_law='poisson', or a smaller mu."
            }
        }
    }
}

// Why a step failed.

/// Why a step failed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Failure<E> {
    /// For a reason that has a status.
    Status(Status),
    /// The force raised an error.
    Raised(E),
}

impl<E> From<StepFailure> for Failure<E> {
    fn from(failure: StepFailure) -> Self {
        Failure::Status(match failure {
            StepFailure::NotFinite => Status::StateNotFinite,
            StepFailure::NoSolution => Status::StepNotSolved,
        })
    }
}

impl<E> From<TryReserveError> for Failure<E> {
    fn from(_: TryReserveError) -> Self {
        Failure::Status(Status::OutOfMemory)
    }
}

// Watching a run from outside: progress, and the wish to stop.

/// Receiver of progress that may end a run.
pub trait Monitor<E> {
    /// Called about 30 times a second with the number of steps done, out of `of`.
    ///
    /// # Errors
    /// An error ends the run; what was computed is kept.
    fn poll(&mut self, done: usize, of: usize) -> Result<(), E>;

    /// Which samples a method of fixed steps shall keep.
    fn keep(&self) -> Keep {
        Keep::All
    }

    /// Whether a method of fixed steps shall tell each of its steps; asked often.
    fn follows(&self) -> bool {
        false
    }

    /// Called after each step of a method of fixed steps if [`Monitor::follows`] says so. `Break`
    /// ends the run with that status, after the step.
    ///
    /// # Errors
    /// An error ends the run; what was computed is kept.
    fn follow(&mut self, _step: &DenseStep) -> Result<ControlFlow<Status>, E> {
        Ok(ControlFlow::Continue(()))
    }

    /// Called once with the address and the length of the record's memory before it is touched: a
    /// chance to tell the operating system how it will be used.
    fn record_allocated(&mut self, _start: *const f64, _len: usize) {}
}

/// Nobody watches.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Monitor<std::convert::Infallible> for Silent {
    fn poll(&mut self, _: usize, _: usize) -> Result<(), std::convert::Infallible> {
        Ok(())
    }
}

/// Chooses how many steps pass between polls, so that the time between polls stays near
/// [`PollInterval::PERIOD`] whatever a step costs, and a step pays nothing for being watched.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PollInterval {
    chunk: usize,
    since: Instant,
}

impl PollInterval {
    const PERIOD: Duration = Duration::from_millis(30);

    pub(crate) fn start() -> Self {
        Self { chunk: 16, since: Instant::now() }
    }

    /// Steps until the next poll.
    pub(crate) fn chunk(&self) -> usize {
        self.chunk
    }

    /// Adjusts the chunk to the time that the last one took.
    pub(crate) fn adjust(&mut self) {
        let took = self.since.elapsed();
        if took < Self::PERIOD / 2 {
            self.chunk = (self.chunk * 2).min(1 << 22);
        } else if took > Self::PERIOD * 2 {
            self.chunk = (self.chunk / 4).max(1);
        }
        self.since = Instant::now();
    }
}
