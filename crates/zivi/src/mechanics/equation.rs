//! The equation of motion with a set of gaps closed, `x'' = a(t, x, x')`, where `x` are the
//! coordinates and the gaps.
//!
//! The gaps are integrated along: `g_k'' = b_k + D_kC lambda_C` costs no further evaluation, and
//! keeps its relative precision where the difference `g(q)` has none left.

use super::kinetics::{Kinetics, Model};
use crate::numeric::coordinates;
use crate::numeric::stages::Equation;
use crate::record::failure::Failure;
use crate::record::gap_set::GapSet;
use crate::system::dynamics::Dynamics;

/// A state at a time: `x` are the coordinates, then the gaps, `xdot` their rates.
pub(super) type State = coordinates::State<Vec<f64>>;

/// A step.
pub(super) type Stages = crate::numeric::stages::Stages<Vec<f64>>;

/// What is known at the end of the last step, by gap: contact forces, and the gaps, their rates and
/// the sums of their gradients as their functions have them.
#[derive(Clone, Debug)]
pub(super) struct AtEnd {
    pub(super) lambda: Vec<f64>,
    pub(super) gap: Vec<f64>,
    pub(super) rate: Vec<f64>,
    pub(super) steepness: Vec<f64>,
}

impl AtEnd {
    pub(super) fn new(m: usize) -> Self {
        let zeros = vec![0.0; m];
        Self { lambda: zeros.clone(), gap: zeros.clone(), rate: zeros.clone(), steepness: zeros }
    }
}

/// The motion while the gaps of a set are closed.
pub(super) struct InContact<'r, 'm, D> {
    pub(super) closed: GapSet,
    pub(super) kinetics: &'r mut Kinetics,
    pub(super) model: &'r mut Model<'m, D>,
    /// Where what is known at the end of a step goes.
    pub(super) at_end: Option<&'r mut AtEnd>,
}

impl<E, D: Dynamics<E>> Equation<Vec<f64>, Failure<E>> for InContact<'_, '_, D> {
    fn acceleration(&mut self, at: &State, into: &mut Vec<f64>) -> Result<(), Failure<E>> {
        let n = self.kinetics.coordinates();
        self.kinetics.evaluate(self.model, at.t, &at.x[..n], &at.xdot[..n])?;
        self.kinetics.contact(self.closed)?;
        into.copy_from_slice(&self.kinetics.acceleration);
        Ok(())
    }

    fn is_at_end(&mut self, at: &State) {
        let (Some(end), kinetics) = (&mut self.at_end, &self.kinetics) else { return };
        end.lambda.copy_from_slice(&kinetics.lambda);
        for gap in 0..end.gap.len() {
            end.gap[gap] = kinetics.gap(gap);
            end.steepness[gap] = kinetics.steepness(gap);
            end.rate[gap] = kinetics.rate(gap, &at.xdot[..kinetics.coordinates()]);
        }
    }
}
