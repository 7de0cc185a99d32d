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
