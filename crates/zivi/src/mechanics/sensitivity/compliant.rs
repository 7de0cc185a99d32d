//! Compliant gaps: their forces are part of the force of the system, their events move.
//!
//! ```text
//! lambda' = -l_d g' - l_r g'' + l_k k'        F' += N'^T lambda + N^T lambda'      in contact
//! dt      = -dg/g'                            dq'+ = dq' + (q''- - q''+) dt        where a gap crosses zero
//! dt      = -dlambda/lambda'                                                       where the law vanishes
//! ```

use super::columns::{hold_rows, CompliantPartials, Local};
use super::variational_run::{Change, VariationalRun};
use crate::mechanics::integrator::MechanicalIntegrator;
use crate::mechanics::kinetics::Model;
use crate::mechanics::path::Piece;
use crate::numeric::dense::{axpy, dot, largest};
use crate::record::gap_set::{ContactMode, GapSet};
use crate::record::status::Failure;
use crate::system::dynamics::Layout;
use crate::system::force::ContactForce;
use crate::system::partials::{DifferentiableDynamics, WEIGHTS};

/// Steps of differences of a law that is a function: relative to depth or rate, and to the largest gap or
/// rate so far.
const RELATIVE: f64 = 1e-3;
const LEAST: [f64; 2] = [1e-8, 1e-4];
/// Accelerations that differ by less, relative to the largest, are the same.
const SAME: f64 = 1e-12;
/// Derivatives of times that differ by less, relatively, are the same.
const TOGETHER: f64 = 1e-6;

impl Local {
    /// From here on the compliant gaps are those of a mode.
    pub(super) fn carry(&mut self, mode: ContactMode) {
        self.kinetics.carry(mode.pressed);
        if let Some(compliant) = &mut self.compliant {
            compliant.pressed = mode.pressed;
            compliant.deep = mode.pressed.with(mode.unloaded);
        }
    }

    /// Adds the contact forces of compliant gaps to the partial derivatives of an evaluation.
    pub(super) fn differentiate_contacts<E, D: DifferentiableDynamics<E>>(
        &mut self,
        w: &[f64],
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let Some(mut compliant) = self.compliant.take() else { return Ok(()) };
        let found = self.differentiate_forces(&mut compliant, w, model);
        self.add_to_forces(&compliant);
        self.compliant = Some(compliant);
        found?;
        for channel in 0..self.layout.p {
            for row in 0..self.partials.len() / self.layout.len() {
                let at = row * self.layout.len();
                let own = [self.layout.limit(), self.layout.static_limit()]
                    .map(|range| at + range.start + channel);
                let [slip, stick] = own.map(|i| self.partials[i]);
                self.partials[own[0]] = self.compliant_limit(channel, row, slip);
                self.partials[own[1]] = self.product_with_force(channel, row, (stick, true));
            }
        }
        Ok(())
    }

    /// The derivatives of the forces.
    fn differentiate_forces<E, D: DifferentiableDynamics<E>>(
        &mut self,
        compliant: &mut CompliantPartials,
        w: &[f64],
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let (Layout { n, m, .. }, length) = (self.layout, self.layout.len());
        let constant = self.partials.len() - compliant.constant.len();
        self.partials[constant..].copy_from_slice(&compliant.constant);
        let rows = self.partials.len() / length;
        compliant.forces.clear();
        compliant.forces.resize(rows * m, 0.0);
        for gap in self.kinetics.compliant().iter() {
            let now = [self.kinetics.gap(gap), self.kinetics.rate(gap, w)];
            (0..2).for_each(|k| compliant.extent[k] = compliant.extent[k].max(now[k].abs()));
        }
        for gap in compliant.deep.iter() {
            let (depth, rate) = (-self.kinetics.gap(gap), -self.kinetics.rate(gap, w));
            let law = self.kinetics.law(gap).unwrap_or(ContactForce::Function);
            let [by_depth, by_rate] = match law.slopes(depth, rate) {
                Some(slopes) => slopes,
                None => differences((gap, compliant.extent), (depth, rate), model)?,
            };
            for row in 0..rows {
                let at = &self.partials[row * length..][..length];
                let own = row.checked_sub(1 + n).filter(|&c| c < n);
                let own = own.map_or(0.0, |c| self.kinetics.normal(gap)[c]);
                let of_rate = dot(self.normal(at, gap), w) + at[self.layout.rate()][gap] + own;
                let mut force = -by_depth * at[self.layout.gap()][gap] - by_rate * of_rate;
                let parameter = row.checked_sub(1 + 2 * n);
                let moved = parameter.map_or(&[][..], |it| &compliant.numbers[it]);
                for &(_, number, by) in moved.iter().filter(|it| it.0 == gap) {
                    force += by * law.by(number, depth, rate);
                }
                compliant.forces[row * m + gap] = force;
            }
        }
        Ok(())
    }

    /// `F' += N'^T lambda + N^T lambda'`.
    fn add_to_forces(&mut self, compliant: &CompliantPartials) {
        let (Layout { n, m, .. }, length) = (self.layout, self.layout.len());
        for gap in compliant.pressed.iter() {
            let (force, normal) =
                (self.kinetics.contact_force(gap), self.kinetics.normal(gap).to_vec());
            for (at, forces) in
                self.partials.chunks_exact_mut(length).zip(compliant.forces.chunks_exact(m))
            {
                let turned = at[self.layout.gradient()][gap * n..][..n].to_vec();
                let to = &mut at[self.layout.force()];
                axpy(to, force, &turned);
                axpy(to, forces[gap], &normal);
            }
        }
    }

    /// The derivative of the limit of a channel in slip by that of its coefficient.
    pub(super) fn compliant_limit(&self, channel: usize, row: usize, of_mu: f64) -> f64 {
        self.product_with_force(channel, row, (of_mu, false))
    }

    /// `mu' lambda + mu lambda'`; of other channels the derivative of the limit itself.
    fn product_with_force(&self, channel: usize, row: usize, (of_mu, sticks): (f64, bool)) -> f64 {
        let Some((gap, (slip, stick))) = self.kinetics.compliant_friction(channel) else {
            return of_mu;
        };
        let force = self.kinetics.contact_force(gap);
        let compliant = self.compliant.as_ref().filter(|it| force > 0.0 && it.pressed.has(gap));
        let mu = if sticks { stick } else { slip };
        compliant.map_or(0.0, |it| of_mu * force + mu * it.forces[row * self.layout.m + gap])
    }

    /// Writes the derivatives of the forces along a direction into those by row.
    pub(super) fn add_contact_forces(&self, row: &[f64], forces: &mut [f64]) {
        let Some(compliant) = &self.compliant else { return };
        let own = &row[self.layout.len()..];
        compliant.deep.iter().for_each(|gap| forces[gap] = own[gap]);
    }
}

/// The derivatives of a law that is a function, by depth and rate.
fn differences<E, D: DifferentiableDynamics<E>>(
    (gap, extent): (usize, [f64; 2]),
    (depth, rate): (f64, f64),
    model: &mut Model<'_, D>,
) -> Result<[f64; 2], Failure<E>> {
    let step = |of: usize, value: f64| {
        (RELATIVE * value.abs()).max(LEAST[of] * extent[of]).max(f64::EPSILON)
    };
    let steps = [step(0, depth), step(1, rate)];
    let mut slopes = [0.0; 2];
    for (of, slope) in slopes.iter_mut().enumerate() {
        for (k, weight) in (1..).map(f64::from).zip(WEIGHTS) {
            let h = k * steps[of];
            let mut at = |h: f64| match of {
                0 => model.contact_force(gap, depth + h, rate),
                _ => model.contact_force(gap, depth, rate + h),
            };
            *slope += weight * (at(h)? - at(-h)?) / steps[of];
        }
    }
    Ok(slopes)
}

impl VariationalRun<'_> {
    /// Whether a gap is compliant.
    pub(super) fn is_compliant(&self, gap: usize) -> bool {
        self.columns.local.kinetics.compliant().has(gap)
    }

    /// Where compliant gaps cross zero.
    pub(super) fn cross<E, D: DifferentiableDynamics<E>>(
        &mut self,
        gaps: GapSet,
        machine: &mut MechanicalIntegrator,
        t_end: f64,
        model: &mut Model<'_, D>,
    ) -> Result<Piece, Failure<E>> {
        let (n, size, from) =
            (self.columns.layout.n, self.columns.size(), machine.occurrences().len());
        let (before, mode) = (machine.state().now().clone(), machine.state().mode());
        self.columns.visit(model, &before, mode)?;
        let slope = self.columns.local.kinetics.acceleration.clone();
        let time = |gap: usize| -> Vec<f64> {
            let columns = self.columns.now.x.chunks_exact(size);
            columns
                .map(|x| if x[n + gap] == 0.0 { 0.0 } else { -x[n + gap] / before.xdot[n + gap] })
                .collect()
        };
        let times: Vec<(usize, Vec<f64>)> = gaps.iter().map(|gap| (gap, time(gap))).collect();
        let piece = machine.advance(t_end, model)?;
        machine.state_mut().know(model)?;
        let of = |change: Change| {
            let Change::Opening(gap) = change else { return None };
            times.iter().find(|it| it.0 == gap).map(|it| it.1.clone())
        };
        self.note_events(machine, from, |_| None, of, &[]);
        let (now, after) = (machine.state().now().clone(), machine.state().mode());
        if gaps.iter().all(|gap| self.is_compliant(gap)) {
            self.shift_crossings((&slope, mode), &times, machine, model)?;
        } else {
            self.lose_all(now.t);
        }
        self.blank();
        self.columns.visit(model, &now, after)?;
        if !(after.closed.is_empty() && after.stick.is_empty()) {
            self.columns.project(after, &now)?;
        }
        Ok(piece)
    }

    /// The columns after gaps have crossed zero: the force of each changes at its own time.
    fn shift_crossings<E, D: DifferentiableDynamics<E>>(
        &mut self,
        (slope, before): (&[f64], ContactMode),
        times: &[(usize, Vec<f64>)],
        machine: &MechanicalIntegrator,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let (Layout { n, p, .. }, size) = (self.columns.layout, self.columns.size());
        let (now, after) = (machine.state().now(), machine.state().mode());
        let jump: Vec<f64> =
            slope.iter().zip(machine.state().slope()).map(|(old, new)| old - new).collect();
        if largest(&jump[..n]) <= SAME * largest(&slope[..n]) {
            return Ok(());
        }
        let mut jumps = vec![jump];
        if times.len() > 1 && p == 0 {
            jumps.clear();
            for (gap, _) in times {
                let one = GapSet::of(*gap);
                let mode = ContactMode {
                    pressed: match after.pressed.has(*gap) {
                        true => before.pressed.with(one),
                        false => before.pressed.without(one),
                    },
                    ..before
                };
                let local = &mut self.columns.local;
                local.carry(mode);
                local.kinetics.evaluate(model, now.t, &now.x[..n], &now.xdot[..n])?;
                local.contact(mode)?;
                let changed = slope.iter().zip(&local.kinetics.acceleration);
                jumps.push(changed.map(|(old, new)| old - new).collect());
            }
            self.columns.visited = None;
        }
        for column in 0..self.count() {
            let dt = times[0].1[column];
            let apart = |it: &(usize, Vec<f64>)| {
                (it.1[column] - dt).abs() > TOGETHER * (it.1[column].abs() + dt.abs())
            };
            if jumps.len() < times.len() && times.iter().any(apart) {
                self.lose(column, now.t);
            }
            let end = &mut self.columns.now;
            let (x, v) =
                (&mut end.x[column * size..][..size], &mut end.xdot[column * size..][..size]);
            for (jump, (_, dt)) in jumps.iter().zip(times) {
                (0..n + self.columns.layout.rows()).for_each(|c| v[c] += jump[c] * dt[column]);
            }
            hold_rows(after, self.columns.layout, (x, v));
        }
        Ok(())
    }
}
