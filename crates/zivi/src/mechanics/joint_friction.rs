//! Friction in joints within the implicit step: `f_c in -L_c Sign(w_c+)`.
//!
//! The slip speed at the end of a step rises with the force `f_c`. So it is `-L_c` where the slip is
//! positive even then, `L_c` where it is negative, and else what makes it zero.

use super::fixed_steps::Stepped;
use super::kinetics::Kinetics;
use crate::numeric::vector::axpy;
use crate::record::contact_mode::ContactMode;
use crate::record::failure::Failure;
use crate::record::occurrence::Occurrence;
use crate::system::dynamics::Layout;

/// Bisections of a force; each is a step of the scheme without an evaluation.
const BISECTIONS: usize = 200;
/// A slip that is smaller than this part of the velocities is none.
const NONE: f64 = 1e-13;

/// Coordinates and velocities at the end of a step.
type End = (Vec<f64>, Vec<f64>);

/// The forces of friction in joints.
pub(super) struct JointForces {
    forces: Vec<f64>,
    pattern: ContactMode,
    /// What friction did in the last step.
    before: ContactMode,
}

impl Kinetics {
    /// What forces in the channels add to `b_i`.
    pub(super) fn pulled(&mut self, i: usize, forces: &[f64]) -> f64 {
        let rows = (0..forces.len()).map(|channel| self.row(channel)).collect::<Vec<_>>();
        rows.into_iter().zip(forces).map(|(row, force)| force * self.d(i, row)).sum()
    }
}

impl JointForces {
    pub(super) fn new(p: usize) -> Self {
        let before = ContactMode::default();
        Self { forces: vec![0.0; p], pattern: before, before }
    }

    /// The forces, by channel.
    pub(super) fn forces(&self) -> &[f64] {
        &self.forces
    }

    /// The end of the step, which `step` gives for what the forces add to the accelerations: one joint
    /// after the other.
    pub(super) fn solve<E>(
        &mut self,
        state: &mut Stepped,
        mut step: impl FnMut(&mut Stepped, &[f64], &[f64]) -> Result<End, Failure<E>>,
    ) -> Result<End, Failure<E>> {
        let Layout { n, p, .. } = state.layout;
        let mut end = |state: &mut Stepped, forces: &[f64]| {
            let mut pushed = vec![0.0; n];
            for (channel, &force) in forces.iter().enumerate() {
                let row = state.kinetics.row(channel);
                axpy(&mut pushed, force, state.kinetics.mobility(row));
            }
            step(state, &pushed, forces)
        };
        for channel in 0..p {
            let row = state.kinetics.row(channel);
            let (slip, stick) = state.kinetics.friction_limits(channel);
            let mut forces = self.forces.clone();
            let mut at = |state: &mut Stepped, force: f64| -> Result<f64, Failure<E>> {
                forces[channel] = force;
                let (_, w) = end(state, &forces)?;
                let rate = state.kinetics.rate(row, &w);
                let size = w.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
                Ok(if rate.abs() <= NONE * size { 0.0 } else { rate })
            };
            let (force, sign) = if at(state, -stick)? > 0.0 && at(state, -slip)? > 0.0 {
                (-slip, 1.0)
            } else if at(state, stick)? < 0.0 && at(state, slip)? < 0.0 {
                (slip, -1.0)
            } else {
                (stopping(stick, |force| at(state, force))?, 0.0)
            };
            self.forces[channel] = force;
            self.pattern = self.pattern.with_channel(channel, sign);
        }
        end(state, &self.forces)
    }

    /// Slips at the end of the step, how far they went, and the work of friction.
    pub(super) fn finish_step(&self, state: &mut Stepped, h: f64) {
        let Layout { n, m, p } = state.layout;
        if p == 0 {
            return;
        }
        let mut work = 0.0;
        for channel in 0..p {
            let (row, sticks) = (m + channel, self.pattern.stick.has(channel));
            let rate = state.kinetics.rate(row, &state.next_v[..n]);
            let c = n + row;
            state.next_v[c] = if sticks { 0.0 } else { rate };
            state.next_x[c] = state.x[c] + h * state.next_v[c];
            work -= h * self.forces[channel] * state.next_v[c];
            state.lambda[row] = self.forces[channel];
        }
        state.next_v[n + m + p] = state.v[n + m + p] + work;
        state.pattern = self.pattern;
    }

    /// Notes what friction does otherwise than before.
    pub(super) fn note(&mut self, t: f64, state: &mut Stepped) {
        for channel in 0..self.forces.len() {
            let (before, after) = (self.before.number(channel), self.pattern.number(channel));
            if before != after {
                let it = Occurrence::Transition { t, channel, before, after };
                state.occurrences.push(it);
            }
        }
        self.before = self.pattern;
    }
}

/// The force up to a size that stops a slip, which rises with it.
fn stopping<E>(
    most: f64,
    mut slip: impl FnMut(f64) -> Result<f64, Failure<E>>,
) -> Result<f64, Failure<E>> {
    let (mut low, mut high) = ((-most, slip(-most)?), (most, slip(most)?));
    for k in 0..BISECTIONS {
        if high.1 - low.1 <= 0.0 || high.0 - low.0 <= f64::EPSILON * most {
            break;
        }
        // the chord, every third time the middle
        let chord = (low.0 * high.1 - high.0 * low.1) / (high.1 - low.1);
        let force = if k % 3 == 2 { 0.5 * (low.0 + high.0) } else { chord };
        let rate = slip(force)?;
        if rate == 0.0 {
            return Ok(force);
        }
        let side = if rate < 0.0 { &mut low } else { &mut high };
        *side = (force, rate);
    }
    Ok(0.5 * (low.0 + high.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn before_a_step_joints_have_no_force() {
        assert_eq!(JointForces::new(2).forces(), [0.0; 2]);
    }
}
