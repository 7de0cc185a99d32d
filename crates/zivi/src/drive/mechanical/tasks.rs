//! Functions of the coordinates that follow a reference beside the gaps.
//!
//! ```text
//! y'  = J T w + C g' + y_t           C = J M^-1 N^T W^-1
//! y'' = J T b + C (g'' - h) + k      Z q'' = b, h and k what g'' and y'' are without acceleration
//! J T b = y_r'' - k + C h - kp (y - y_r) - kd (J T w + y_t - y_r')
//! ```
//!
//! What impacts and contact forces do to `y` by `C` is left alone: in flight `y` follows `y_r + C g`,
//! in contact `y_r`. Where `J T` has fewer rows than columns, the rest follows the posture; where it
//! has not full rank, this is the solution by least squares.

use super::kinetics::GapKinetics;
use crate::numeric::cholesky;
use crate::numeric::singular::Singular;
use crate::numeric::vector::dot;
use crate::system::dynamics::{Dynamics, Layout};

/// Squares of singular values below this part of the largest are zero.
const SMALL: f64 = 1e-12;

/// Functions of the coordinates: the gaps of a system whose masses and forces do not matter.
#[derive(Clone, Debug)]
pub struct Tasks<D> {
    dynamics: D,
    row: Vec<f64>,
}

impl<D> Tasks<D> {
    /// The gaps of this system.
    pub fn new<E>(dynamics: D) -> Self
    where
        D: Dynamics<E>,
    {
        let row = vec![0.0; dynamics.layout().len()];
        Self { dynamics, row }
    }

    /// Changes accelerations that are wanted beside the gaps, by as little kinetic energy as will do,
    /// so that the functions follow `goal`: values, first and second derivatives.
    ///
    /// # Errors
    /// What the functions raise.
    pub(super) fn steer<E>(
        &mut self,
        t: f64,
        (q, w): (&[f64], &[f64]),
        (goal, (kp, kd)): (&[f64], (f64, f64)),
        kinetics: &mut GapKinetics,
        wanted: &mut [f64],
    ) -> Result<(), E>
    where
        D: Dynamics<E>,
    {
        self.dynamics.evaluate(t, q, w, &mut self.row)?;
        let (layout, row) = (self.dynamics.layout(), &self.row);
        let Layout { n, m: count, .. } = layout;
        let every = vec![true; kinetics.layout().m];
        let (mut along, mut turning) = (w.to_vec(), vec![0.0; n]);
        kinetics.without_gaps(&every, &mut along);
        kinetics.without_gaps(&every, wanted);
        kinetics.push(&every, kinetics.curvatures().to_vec(), &mut turning);
        let (mut directions, mut missing) = (Vec::with_capacity(count * n), vec![0.0; count]);
        for i in 0..count {
            let jacobian = &row[layout.gradient()][i * n..][..n];
            let rate = dot(jacobian, &along) + row[layout.rate()][i];
            let error = (row[layout.gap()][i] - goal[i], rate - goal[count + i]);
            let drift = row[layout.curvature()][i] + dot(jacobian, &turning);
            let asked = goal[2 * count + i] - drift - kp * error.0 - kd * error.1;
            missing[i] = asked - dot(jacobian, wanted);
            let mut direction = jacobian.to_vec();
            cholesky::solve(&kinetics.mass, n, &mut direction);
            kinetics.without_gaps(&every, &mut direction);
            directions.extend(direction);
        }
        let jacobians = row[layout.gradient()].chunks_exact(n);
        let reach: Vec<f64> = jacobians
            .flat_map(|row| directions.chunks_exact(n).map(move |direction| dot(row, direction)))
            .collect();
        let found = Singular::new(&reach, count, count);
        let parts = found.solve(&missing, found.rank(SMALL));
        for (part, direction) in parts.iter().zip(directions.chunks_exact(n)) {
            wanted.iter_mut().zip(direction).for_each(|(to, by)| *to += part * by);
        }
        Ok(())
    }
}
