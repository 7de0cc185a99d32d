//! The mechanics with dry friction and its derivatives along any direction.
//!
//! With the rows `R` and the edges `C` of [`crate::mechanics::friction`] in a mode, forces `lambda` by row and
//! `r'` for the derivative of `r` along the direction
//!
//! ```text
//! M a' - E^T x' = F' - M' a + sum_rows lambda R'^T - sum_slip (mu' lambda, L') sigma B^T      E^T = M C
//! R a'          = -r' - R' a                                                                  (1)
//! ```
//!
//! and the velocities after the impulses `P` of a pattern, whose rows have the rates `u` after it,
//!
//! ```text
//! M w+' - E^T x' = M w-' - M' (w+ - w-) + sum_rows P R'^T - sum_slip mu' P sigma B^T
//! R w+'          = u' - R' w+ - r_t'                                                          (2)
//! ```

use super::columns::Local;
use crate::mechanics::friction::Edges;
use crate::mechanics::kinetics::Model;
use crate::numeric::dense::{axpy, dot};
use crate::record::gap_set::ContactMode;
use crate::record::status::Failure;
use crate::system::partials::{DifferentiableDynamics, TimedState};
use crate::Status;

/// Weights of values at 1, 2, .. that extrapolate to 0.
const EXTRAPOLATION: [f64; 5] = [5.0, -10.0, 10.0, -5.0, 1.0];
/// So much farther than differences look the first of these values lies.
const APART: f64 = 1.05;

/// Impulses with friction and the data on which they depend.
pub(super) struct FrictionalImpulses<'a> {
    /// The contacts with impulses and the modes of friction there.
    pub(super) mode: ContactMode,
    /// Impulses by row.
    pub(super) impulses: &'a [f64],
    /// `w-` and `w+`.
    pub(super) before: &'a [f64],
    pub(super) after: &'a [f64],
    /// Derivatives of `mu` in impacts, by channel, if other than at the evaluation.
    pub(super) limits: Option<&'a [f64]>,
}

/// An impact with friction.
pub(super) struct RoughImpact {
    /// The contacts with an impulse and their modes.
    pub(super) pattern: ContactMode,
    /// Impulses by row.
    pub(super) impulses: Vec<f64>,
    /// Slips by channel: before it, and after it with their restitution.
    pub(super) slips: Vec<[f64; 2]>,
}

impl Local {
    /// Accelerations and forces in a mode with friction.
    pub(super) fn frictional_contact<E>(&mut self, mode: ContactMode) -> Result<(), Failure<E>> {
        self.kinetics.contact(mode)?;
        if self.kinetics.is_shared_motion {
            return Err(Failure::Status(Status::RedundantContacts));
        }
        self.edges = Some(self.kinetics.edges(mode)?);
        Ok(())
    }

    /// Limits of friction may depend on the size of the slip speed: where differences would look at slips of
    /// both signs, their derivatives are extrapolated from faster slips of the same sign.
    pub(super) fn differentiate_limits<E, D: DifferentiableDynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
        (t, q, w): (f64, &[f64], &[f64]),
        mode: ContactMode,
    ) -> Result<(), Failure<E>> {
        let Some(reach) = model.dynamics.reach(self.by()) else { return Ok(()) };
        let (n, length) = (self.layout.n, self.layout.len());
        let t = model.smooth.nearest(t);
        for channel in mode.slipping().iter() {
            let row = self.kinetics.row(channel);
            let moves = |(j, reach): (usize, &f64)| {
                let at = &self.partials[j * length..][..length];
                let turned = dot(self.normal(at, row), w) + at[self.layout.rate()][row];
                let own = j.checked_sub(1 + n).filter(|&i| i < n);
                let own = own.map_or(0.0, |i| self.kinetics.normal(row)[i]);
                reach * (turned + own).abs()
            };
            let moved: Vec<f64> = reach.iter().enumerate().map(moves).collect();
            let span: f64 = moved.iter().sum();
            let slip = mode.sign(channel) * self.kinetics.rate(row, w);
            if slip > span || span == 0.0 {
                continue;
            }
            let push = mode.sign(channel) * APART * span / self.kinetics.d(row, row);
            let along = self.kinetics.mobility(row).to_vec();
            let mut found = vec![0.0; reach.len()];
            let mut partials = vec![0.0; reach.len() * length];
            for (k, weight) in EXTRAPOLATION.into_iter().enumerate() {
                let mut faster = w.to_vec();
                axpy(&mut faster, (k + 1) as f64 * push, &along);
                let at = TimedState { t, q, w: &faster };
                let by = self.by().to_vec();
                model.dynamics.partials(at, &by, &mut partials).map_err(Failure::Raised)?;
                for (found, at) in found.iter_mut().zip(partials.chunks_exact(length)) {
                    *found += weight * at[self.layout.limit()][channel];
                }
            }
            let at = self.layout.limit().start + channel;
            // a difference that does not move the slip does not look at both signs
            let turned = found.into_iter().enumerate().filter(|&(j, _)| moved[j] > 0.0);
            for (j, found) in turned {
                self.partials[j * length + at] = self.compliant_limit(channel, j, found);
            }
        }
        Ok(())
    }

    /// The edges of the last mode.
    fn take_edges<E>(&mut self) -> Result<Edges, Failure<E>> {
        self.edges.take().ok_or(Failure::Status(Status::Internal))
    }

    /// Adds the effect of turning rows and of the limits of friction on the forces.
    fn turn_forces(
        &self,
        mode: ContactMode,
        row: &[f64],
        (forces, limits, joints): (&[f64], &[f64], bool),
        to: &mut [f64],
    ) {
        for (i, force) in forces.iter().enumerate().filter(|it| *it.1 != 0.0) {
            axpy(to, *force, self.normal(row, i));
        }
        for channel in mode.slipping().iter() {
            let pressed = match self.kinetics.gap_of(channel) {
                Some(gap) => forces[gap],
                None if joints => 1.0,
                None => continue,
            };
            let change = -limits[channel] * mode.sign(channel) * pressed;
            if change != 0.0 {
                axpy(to, change, self.kinetics.normal(self.kinetics.row(channel)));
            }
        }
    }

    /// Equations (1) for the mode of the last kinetics: derivatives of the accelerations of
    /// coordinates and rows and of the forces by row.
    pub(super) fn frictional_acceleration<E>(
        &mut self,
        mode: ContactMode,
        row: &[f64],
    ) -> Result<(Vec<f64>, Vec<f64>), Failure<E>> {
        let (layout, edges) = (self.layout, self.take_edges()?);
        let (n, rows, mut forces) = (layout.n, layout.rows(), self.kinetics.lambda.clone());
        // those of compliant gaps are among the forces of the system
        self.kinetics.compliant().iter().for_each(|gap| forces[gap] = 0.0);
        let at = self.kinetics.acceleration[..n].to_vec();
        let limits = &row[layout.limit()];
        let mut change = row[layout.force()].to_vec();
        self.less_mass(row, &at, &mut change);
        self.turn_forces(mode, row, (&forces, limits, true), &mut change);
        self.kinetics.solve_mass(&mut change);
        let bends = &row[layout.curvature()];
        let turned: Vec<f64> =
            (0..rows).map(|i| bends[i] + dot(self.normal(row, i), &at)).collect();
        let kinetics = &self.kinetics;
        let solved = edges.solve(|i| -(turned[i] + dot(kinetics.normal(i), &change)));
        edges.push(&solved, &mut change);
        let mut by_row = vec![0.0; rows];
        edges.rows().iter().zip(&solved).for_each(|(&i, force)| by_row[i] = *force);
        for channel in mode.slipping().iter() {
            let (sign, limit) = (mode.sign(channel), kinetics.friction_limits(channel).0);
            by_row[kinetics.row(channel)] = -sign
                * match kinetics.gap_of(channel) {
                    Some(gap) => limits[channel] * forces[gap] + limit * by_row[gap],
                    None => limits[channel],
                };
        }
        self.add_contact_forces(row, &mut by_row);
        let mut of_rows: Vec<f64> =
            (0..rows).map(|i| turned[i] + dot(kinetics.normal(i), &change)).collect();
        edges.rows().iter().for_each(|&i| of_rows[i] = 0.0);
        change.extend(of_rows);
        self.edges = Some(edges);
        Ok((change, by_row))
    }

    /// `K` of a pattern of impulses.
    pub(super) fn prepare_pattern<E>(&mut self, mode: ContactMode) -> Result<(), Failure<E>> {
        self.edges = Some(self.kinetics.edges(mode)?);
        Ok(())
    }

    /// Equations (2) for a pattern that was prepared, with `w-'` in `velocities`, which `w+'` takes the place
    /// of, and the rates of the rows: those of the pattern become `target`, the others change by the impulses.
    pub(super) fn frictional_exchange<E>(
        &mut self,
        how: &FrictionalImpulses<'_>,
        row: &[f64],
        target: impl Fn(usize) -> f64,
        (velocities, rates): (&mut [f64], &mut [f64]),
    ) -> Result<(), Failure<E>> {
        let FrictionalImpulses { mode, impulses, before, after, limits } = *how;
        let (layout, edges) = (self.layout, self.take_edges()?);
        let jump: Vec<f64> =
            after.iter().zip(before).map(|(after, before)| after - before).collect();
        let mut change = vec![0.0; layout.n];
        self.less_mass(row, &jump, &mut change);
        let limits = limits.unwrap_or(&row[layout.limit()]);
        self.turn_forces(mode, row, (impulses, limits, false), &mut change);
        self.kinetics.solve_mass(&mut change);
        // the part of M w-' is solved for already
        let old = velocities.to_vec();
        let kinetics = &self.kinetics;
        let wanted = |i: usize| {
            let moves = dot(self.normal(row, i), after) + row[layout.rate()][i];
            let normal = kinetics.normal(i);
            target(i) - moves - dot(normal, &old) - dot(normal, &change)
        };
        let solved = edges.solve(wanted);
        edges.push(&solved, &mut change);
        axpy(velocities, 1.0, &change);
        for (i, rate) in rates.iter_mut().enumerate().take(layout.rows()) {
            *rate += dot(self.normal(row, i), &jump) + dot(kinetics.normal(i), &change);
        }
        edges.rows().iter().for_each(|&i| rates[i] = target(i));
        self.edges = Some(edges);
        Ok(())
    }
}
