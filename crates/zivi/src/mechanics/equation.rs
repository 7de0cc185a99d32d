//! The equation of motion with a set of gaps closed, `x'' = a(t, x, x')`, where `x` are the
//! coordinates and the gaps.
//!
//! The gaps are integrated along: `g_k'' = b_k + D_kC lambda_C` costs no further evaluation, and
//! keeps its relative precision where the difference `g(q)` has none left. With friction the slips `s`
//! with `s' = w` follow them, and a last component whose rate is the work of friction.

use super::kinetics::{Kinetics, Model};
use crate::numeric::coordinates;
use crate::numeric::stages::Equation;
use crate::record::contact_mode::ContactMode;
use crate::record::failure::Failure;
use crate::system::dynamics::{Dynamics, Layout};

/// A state at a time: `x` are the coordinates, then the gaps, `xdot` their rates.
pub(super) type State = coordinates::State<Vec<f64>>;

/// A step.
pub(super) type Stages = crate::numeric::stages::Stages<Vec<f64>>;

/// What is known at the end of the last step: contact forces by row, what limits the mode, and by
/// row the gaps, rates and the sums of gradients as their functions have them.
#[derive(Clone, Debug)]
pub(super) struct AtEnd {
    pub(super) lambda: Vec<f64>,
    pub(super) levels: Vec<f64>,
    pub(super) gap: Vec<f64>,
    pub(super) rate: Vec<f64>,
    pub(super) steepness: Vec<f64>,
}

impl AtEnd {
    pub(super) fn new(Layout { m, p, .. }: Layout) -> Self {
        let (zeros, rows) = (vec![0.0; m], vec![0.0; m + p]);
        let levels = Vec::new();
        Self { lambda: rows.clone(), levels, gap: zeros.clone(), rate: rows, steepness: zeros }
    }
}

/// The motion in a mode.
pub(super) struct InContact<'r, 'm, D> {
    pub(super) mode: ContactMode,
    pub(super) kinetics: &'r mut Kinetics,
    pub(super) model: &'r mut Model<'m, D>,
    /// Where what is known at the end of a step goes.
    pub(super) at_end: Option<&'r mut AtEnd>,
}

impl<E, D: Dynamics<E>> Equation<Vec<f64>, Failure<E>> for InContact<'_, '_, D> {
    fn acceleration(&mut self, at: &State, into: &mut Vec<f64>) -> Result<(), Failure<E>> {
        let n = self.kinetics.coordinates();
        self.kinetics.evaluate(self.model, at.t, &at.x[..n], &at.xdot[..n])?;
        self.kinetics.contact(self.mode)?;
        into.copy_from_slice(&self.kinetics.acceleration);
        if let Some(power) = into.get_mut(n + self.kinetics.layout.rows()) {
            *power = self.kinetics.friction_power(self.mode, &at.xdot[n..]);
        }
        Ok(())
    }

    fn is_at_end(&mut self, at: &State) {
        let (Some(end), kinetics) = (&mut self.at_end, &mut self.kinetics) else { return };
        end.lambda.copy_from_slice(&kinetics.lambda);
        if self.mode.is_frictionless() && kinetics.undetermined.is_empty() {
            end.levels.clear();
            end.levels.extend(self.mode.closed.iter().map(|gap| end.lambda[gap]));
        } else {
            end.levels = kinetics.limits(self.mode).iter().map(|it| it.value).collect();
        }
        for gap in 0..end.gap.len() {
            end.gap[gap] = kinetics.gap(gap);
            end.steepness[gap] = kinetics.steepness(gap);
        }
        for row in 0..end.rate.len() {
            end.rate[row] = kinetics.rate(row, &at.xdot[..kinetics.coordinates()]);
        }
    }
}
