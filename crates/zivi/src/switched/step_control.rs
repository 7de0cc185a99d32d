//! The lengths of steps from one to the next, and how many there may be.

use super::settings::SwitchedRk;
use crate::numeric::step_size::Jump;
use crate::record::failure::Failure;
use crate::Status;

/// How long steps are and how many there were.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct StepControl {
    /// Step size to try next (s).
    pub(crate) h: Option<f64>,
    pub(crate) jump: Jump,
    /// Steps that were tried.
    pub(crate) spent: usize,
}

impl StepControl {
    /// Counts a step; an error when there were too many.
    pub(crate) fn spend<E>(&mut self, settings: &SwitchedRk) -> Result<(), Failure<E>> {
        self.left(settings)?;
        self.spent += 1;
        Ok(())
    }

    /// How many steps there may be yet; an error if there are none.
    pub(crate) fn left<E>(&self, settings: &SwitchedRk) -> Result<usize, Failure<E>> {
        let left = settings.max_steps.saturating_sub(self.spent);
        if left == 0 {
            return Err(Failure::Status(Status::StepBudget));
        }
        Ok(left)
    }
}

/// What speaks for the length of a step: those before it since the last event.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Experience {
    /// How many.
    steps: u32,
    /// The length of the last (s).
    last: f64,
}

impl Experience {
    pub(crate) const NONE: Self = Self { steps: 0, last: 0.0 };
    /// So many steps after an event there is none.
    const YOUNG: u32 = 1;
    /// Nor is there any for a step that is so many times longer than the last.
    const GREW: f64 = 2.0;

    /// A step of this length was taken.
    #[inline]
    pub(crate) fn gain(&mut self, length: f64) {
        (self.steps, self.last) = (self.steps + 1, length);
    }

    /// Whether there is enough for a step of this length to be taken without another look.
    #[inline]
    pub(crate) fn is_enough(self, length: f64) -> bool {
        self.steps > Self::YOUNG && length <= Self::GREW * self.last
    }
}

/// Who looks at the ends of steps and at the motion between them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Looks {
    /// Steps that end later than this have their polynomials computed.
    pub(crate) dense_from: f64,
    /// Whether all ends of steps are looked at.
    pub(crate) by_steps: bool,
}

impl Looks {
    /// Nobody.
    pub(crate) const NONE: Self = Self { dense_from: f64::INFINITY, by_steps: false };
}
