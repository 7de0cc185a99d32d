//! Who asks the machine for the next piece of the motion.

use super::kinetics::Model;
use super::machine::{Machine, Piece};
use crate::record::failure::Failure;
use crate::system::dynamics::Dynamics;

/// Takes the pieces of a run; one that follows the motion may refuse a step and ask for a shorter.
pub(super) trait Stepper<E, D> {
    /// The next piece of the motion, towards `t_end`.
    fn step(
        &mut self,
        machine: &mut Machine,
        t_end: f64,
        model: &mut Model<'_, D>,
    ) -> Result<Piece, Failure<E>>;
}

/// Takes the pieces as they come.
pub(super) struct Plainly;

impl<E, D: Dynamics<E>> Stepper<E, D> for Plainly {
    fn step(
        &mut self,
        machine: &mut Machine,
        t_end: f64,
        model: &mut Model<'_, D>,
    ) -> Result<Piece, Failure<E>> {
        machine.advance(t_end, model)
    }
}
