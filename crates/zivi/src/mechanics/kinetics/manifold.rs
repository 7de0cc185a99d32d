//! The equality rows of a state: what is left of accelerations and mobilities on the manifold, and projections
//! onto it, equations (1) and (2) of [`super::equalities`].

use super::equalities::{clear, Equalities, AGREES, PROJECTIONS, SLIGHT, VELOCITIES};
use super::{Kinetics, Model, REDUNDANT};
use crate::numeric::dense::dot;
use crate::numeric::stages::StepError;
use crate::record::status::Failure;
use crate::system::dynamics::{Dynamics, Layout};
use crate::Status;

impl Kinetics {
    /// The equality rows of a layout, if there are any.
    pub(super) fn rows_of_equality(layout: Layout) -> Option<Box<Equalities>> {
        (layout.k > 0).then(|| Box::new(Equalities::new(layout)))
    }

    /// The equality rows where the system was evaluated last, if there are any.
    pub(in crate::mechanics) fn equalities(&self) -> Option<&Equalities> {
        self.equalities.as_deref()
    }

    /// From here on projections use these rows, which belong to a place nearby.
    pub(in crate::mechanics) fn restore_equalities(&mut self, from: &Equalities) {
        if let Some(to) = &mut self.equalities {
            to.as_mut().clone_from(from);
        }
    }

    /// The next evaluation is on the manifold.
    pub(in crate::mechanics) fn land_on_manifold(&mut self) {
        if let Some(rows) = &mut self.equalities {
            rows.on_manifold = true;
        }
    }

    /// `M^-1 G^T` and `D` of another evaluation.
    pub(super) fn renew_equalities(&mut self) {
        if let Some(rows) = &mut self.equalities {
            rows.renew(&self.values, &self.factor);
        }
    }

    /// Free accelerations on the manifold, the first of (1).
    pub(super) fn hold_free<E>(&mut self) -> Result<(), Failure<E>> {
        let Some(rows) = &mut self.equalities else { return Ok(()) };
        rows.free.copy_from_slice(&self.free);
        let wanted = |free: &[f64], row: usize| rows.acceleration(&self.values, row, free);
        let right: Vec<f64> = (0..rows.layout.k).map(|row| wanted(&self.free, row)).collect();
        let forces = rows.solve(|row| right[row]);
        let mut sizes: Vec<f64> = self.free.iter().map(|a| a.abs()).collect();
        for (row, force) in forces.iter().enumerate() {
            for (i, part) in rows.mobility(row).iter().enumerate() {
                self.free[i] -= force * part;
                sizes[i] += (force * part).abs();
            }
        }
        rows.sizes.copy_from_slice(&sizes);
        if std::mem::take(&mut rows.on_manifold) {
            for row in (0..rows.layout.k).filter(|row| !rows.basis.contains(row)) {
                let terms = rows.gradient(&self.values, row).iter().zip(&sizes);
                let curvature = self.values[rows.layout.equality_curvature().start + row];
                let size: f64 = terms.map(|(g, a)| (g * a).abs()).sum::<f64>() + curvature.abs();
                if rows.acceleration(&self.values, row, &self.free).abs() > AGREES * size {
                    return Err(Failure::Status(Status::InconsistentConstraints));
                }
            }
        }
        Ok(())
    }

    /// The mobility of a row on the manifold, the second of (1), where the mass alone has been solved for.
    pub(super) fn hold_mobility(&mut self, i: usize) {
        let Some(rows) = &self.equalities else { return };
        let n = self.layout.n;
        let column = &mut self.mobility[i * n..][..n];
        let normal = &self.values[self.gradient + i * n..][..n];
        let whole = dot(normal, column);
        // the second removes what rounding has left of the first
        for _ in 0..2 {
            let along = column.to_vec();
            rows.pull(column, |row| dot(rows.gradient(&self.values, row), &along));
        }
        // NaN counts as free
        if dot(normal, column) <= REDUNDANT * whole {
            column.fill(0.0);
        }
    }

    /// By coordinate the size of the terms of `A`, where there are equality rows.
    pub(super) fn sizes_of_free(&self) -> Option<&[f64]> {
        self.equalities.as_ref().map(|rows| &rows.sizes[..])
    }

    /// Contact forces by row, then the multipliers of the equality rows, where the forces are known.
    pub(in crate::mechanics) fn forces(&mut self) -> &[f64] {
        let Some(mut rows) = self.equalities.take() else { return &self.lambda };
        let Layout { n, k, .. } = self.layout;
        let mut right: Vec<f64> =
            (0..k).map(|row| rows.acceleration(&self.values, row, &rows.free)).collect();
        let contacts = self.lambda.len();
        for (i, force) in self.lambda.iter().enumerate().filter(|it| *it.1 != 0.0) {
            let normal = &self.values[self.gradient + i * n..][..n];
            for (row, right) in right.iter_mut().enumerate() {
                *right += force * dot(normal, rows.mobility(row));
            }
        }
        let mut multipliers = rows.solve(|row| -right[row]);
        rows.shorten(&self.values, &mut multipliers);
        rows.forces[..contacts].copy_from_slice(&self.lambda);
        rows.forces[contacts..].copy_from_slice(&multipliers);
        &self.equalities.insert(rows).forces
    }

    /// Whether multipliers of equality rows are not determined by the motion.
    pub(in crate::mechanics) fn has_dependent_equalities(&self) -> bool {
        self.equalities.as_ref().is_some_and(|rows| {
            // a row without a gradient acts on nothing
            let acting = rows.scales.iter().filter(|scale| **scale > 0.0).count();
            rows.basis.len() < acting
        })
    }

    /// One iteration of (2) at the place of the last evaluation: whether one more is needed at another. Gaps
    /// move with the coordinates.
    pub(in crate::mechanics) fn pull_back(&mut self, q: &mut [f64], w: &mut [f64]) -> bool {
        let Some(rows) = &self.equalities else { return false };
        let (far, fast) = (rows.far(&self.values, q), rows.fast(&self.values, w));
        if far.max(fast) <= clear(q, w) {
            return false;
        }
        let before = q.to_vec();
        rows.pull_position(&self.values, q);
        rows.pull_velocity(&self.values, w);
        let moved: Vec<f64> = q.iter().zip(&before).map(|(q, before)| q - before).collect();
        let gaps = self.layout.gap().start;
        for i in 0..self.layout.m {
            self.values[gaps + i] += dot(self.normal(i), &moved);
        }
        far > SLIGHT || fast > SLIGHT
    }

    /// Projects a state onto the manifold (2), with the mobilities of an evaluation nearby.
    pub(in crate::mechanics) fn hold<E, D: Dynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
        t: f64,
        (q, w): (&mut [f64], &mut [f64]),
    ) -> Result<(), Failure<E>> {
        self.forget_place();
        let Some(rows) = &self.equalities else { return Ok(()) };
        let mut last = f64::INFINITY;
        for iteration in 0..=PROJECTIONS {
            model.evaluate_equalities(t, (q, w), &mut self.values)?;
            let far = rows.far(&self.values, q);
            // as near as rounding lets it come
            if far <= clear(q, w) || far >= 0.5 * last || iteration == PROJECTIONS {
                break;
            }
            last = far;
            rows.pull_position(&self.values, q);
            rows.pull_velocity(&self.values, w);
            if far <= SLIGHT {
                break;
            }
        }
        for _ in 0..VELOCITIES {
            if rows.fast(&self.values, w) > clear(q, w) {
                rows.pull_velocity(&self.values, w);
            }
        }
        match rows.basis.len() == rows.layout.k || rows.obeys(&self.values, (q, w)) {
            true => Ok(()),
            false => Err(Failure::Status(Status::InconsistentConstraints)),
        }
    }

    /// Accelerations of a place nearby on the manifold of the last projection.
    pub(in crate::mechanics) fn hold_acceleration(&self, a: &mut [f64]) {
        if let Some(rows) = &self.equalities {
            let right: Vec<f64> =
                (0..rows.layout.k).map(|row| rows.acceleration(&self.values, row, a)).collect();
            rows.pull(a, |row| right[row]);
        }
    }

    /// Takes out of errors of coordinates what a projection (2) removes; gaps move with the coordinates.
    pub(in crate::mechanics) fn project_errors(&self, errors: &mut [StepError]) {
        let Some(rows) = &self.equalities else { return };
        let parts: [fn(&mut StepError) -> &mut f64; 4] =
            [|it| &mut it.x[0], |it| &mut it.x[1], |it| &mut it.xdot[0], |it| &mut it.xdot[1]];
        let n = self.layout.n;
        for part in parts {
            let mut error: Vec<f64> = errors[..n].iter_mut().map(|it| *part(it)).collect();
            let before = error.clone();
            rows.pull(&mut error, |row| dot(rows.gradient(&self.values, row), &before));
            let moved: Vec<f64> = error.iter().zip(&before).map(|(to, from)| to - from).collect();
            for row in 0..self.layout.rows() {
                *part(&mut errors[n + row]) += dot(self.normal(row), &moved);
            }
            errors.iter_mut().zip(error).for_each(|(it, error)| *part(it) = error);
        }
    }

    /// Whether the state of the last evaluation obeys the equality rows to a part of their terms.
    pub(in crate::mechanics) fn obeys_equalities(&self, q: &[f64], w: &[f64]) -> bool {
        self.equalities.as_ref().is_none_or(|rows| rows.obeys(&self.values, (q, w)))
    }
}
