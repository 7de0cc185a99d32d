//! Who asks the integrator for the next piece of the motion.

use super::integrator::{Piece, SwitchedIntegrator};
use super::stages::Counted;
use crate::record::failure::Failure;
use crate::Force;

/// Takes the steps of a run; one that follows the motion may refuse a step and ask for a shorter.
pub(super) trait Stepper<E, F> {
    /// The next piece of the motion, towards `t_end`.
    fn step(
        &mut self,
        integrator: &mut SwitchedIntegrator,
        t_end: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Piece, Failure<E>>;
}

/// Takes the steps as they come.
pub(super) struct Plainly;

impl<E, F: Force<E>> Stepper<E, F> for Plainly {
    fn step(
        &mut self,
        integrator: &mut SwitchedIntegrator,
        t_end: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Piece, Failure<E>> {
        integrator.step(t_end, force)
    }
}
