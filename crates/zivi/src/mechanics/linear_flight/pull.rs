//! The acceleration of a bouncing gap of a linear system along the arcs of a jump.
//!
//! With the contacts `C` it is `rho . A + h_i - gamma . h_C` with `gamma = D_CC^-1 D_Ci` and
//! `rho = n_i - gamma . N_C`, where `A = M^-1 (p - C q' - K q)`: linear in the coordinates and their
//! velocities, so that the polynomials of these make two of it, known once for all arcs.

use std::sync::Arc;

use crate::mechanics::kinetics::{Kinetics, Undetermined};
use crate::mechanics::tail::SkippedArcs;
use crate::numeric::vector::{axpy, dot};
use crate::record::gap_set::GapSet;
use crate::system::linear_system::LinearSystem;
use crate::system::stops::Smooth;
use crate::Force;

/// The acceleration of a gap, as the force of a scalar motion.
pub(in crate::mechanics) struct PullAlongArcs {
    system: Arc<LinearSystem>,
    smooth: Smooth,
    /// What the coordinates do to it, and what their velocities do.
    along: SkippedArcs,
    /// `M^-1 rho`.
    loads: Vec<f64>,
    /// By gap the weights of the accelerations of the walls.
    walls: Vec<(usize, f64)>,
    /// The values of a table.
    values: Vec<f64>,
}

impl PullAlongArcs {
    /// Of a gap while those of a set stay closed.
    pub(in crate::mechanics) fn new(
        system: Arc<LinearSystem>,
        smooth: Smooth,
        arcs: &SkippedArcs,
        (closed, gap): (GapSet, usize),
        kinetics: &mut Kinetics,
    ) -> Result<Self, Undetermined> {
        let n = system.load.len();
        let mut loads = kinetics.normal(gap).to_vec();
        let mut walls = vec![(gap, -1.0)];
        if !closed.is_empty() {
            let couplings: Vec<f64> = (0..system.gaps.len()).map(|i| kinetics.d(i, gap)).collect();
            kinetics.solve(closed, |_, i| couplings[i])?;
            walls.extend(closed.iter().zip(kinetics.solved().iter().copied()));
            for &(i, weight) in &walls[1..] {
                axpy(&mut loads, -weight, kinetics.normal(i));
            }
        }
        kinetics.solve_mass(&mut loads);
        let mut rows = [[0.0; 8]; 2];
        for (row, matrix) in rows.iter_mut().zip([&system.stiffness, &system.damping]) {
            let mut weights = vec![0.0; n];
            for (load, line) in loads.iter().zip(matrix.chunks_exact(n)) {
                axpy(&mut weights, -load, line);
            }
            for (weight, of) in weights.iter().zip(&arcs.rows) {
                axpy(row, *weight, of);
            }
        }
        let (start, end) = (arcs.start, arcs.end);
        let along = SkippedArcs::of_rows(start, end, rows.to_vec());
        Ok(Self { system, smooth, along, loads, walls, values: vec![0.0; n] })
    }

    /// What loads and walls do to it.
    fn of_loads_and_walls(&mut self, t: f64) -> f64 {
        let Self { system, loads, walls, values, .. } = self;
        let mut sum = dot(loads, &system.load);
        for wave in &system.waves {
            sum += dot(loads, &wave.amplitude) * (wave.omega * t + wave.phase).cos();
        }
        for table in &system.tables {
            table.values(t, values);
            sum += dot(loads, values);
        }
        walls.iter().fold(sum, |sum, &(i, weight)| sum + weight * system.gaps[i].motion.at(t)[2])
    }
}

impl<E> Force<E> for PullAlongArcs {
    fn at(&mut self, t: f64, y: f64, u: f64) -> Result<f64, E> {
        let ([mut x, mut v], t) = ([[0.0; 2]; 2], self.smooth.nearest(t));
        self.along.combine(t, (y, u), &mut x, &mut v);
        Ok(x[0] + v[1] + self.of_loads_and_walls(t))
    }
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use super::*;
    use crate::mechanics::kinetics::Model;
    use crate::system::dynamics::Layout;
    use crate::system::friction::Friction;
    use crate::system::linear_dynamics::LinearDynamics;
    use crate::system::linear_system::{GapMotion, LinearGap, LoadWave};
    use crate::system::time_table::TimeTable;
    use crate::HarmonicWall;

    #[test]
    fn it_is_the_acceleration_of_the_whole_system() {
        let (n, mut seed) = (4, 1.0_f64);
        let mut draw = || {
            seed = (seed * 997.1 + 0.37).rem_euclid(1.0);
            2.0 * seed - 1.0
        };
        let mut matrix = |diagonal: f64, part: f64| -> Vec<f64> {
            let mut a: Vec<f64> = (0..n * n).map(|_| part * draw()).collect();
            (0..n).for_each(|i| a[i * n + i] += diagonal);
            a
        };
        let (mut mass, damping, stiffness) = (matrix(2.0, 0.2), matrix(0.3, 0.2), matrix(5.0, 2.0));
        (0..n).for_each(|i| (0..i).for_each(|j| mass[i * n + j] = mass[j * n + i]));
        let rows = matrix(0.0, 1.0);
        let wall = HarmonicWall { amplitude: 0.1, omega: 3.0, phase: 0.4, offset: 0.0 };
        let gap = |row: usize, motion: GapMotion| LinearGap {
            normal: rows[row * n..][..n].to_vec(),
            offset: 0.2,
            motion,
        };
        let gaps = vec![
            gap(0, GapMotion::Fixed),
            gap(1, GapMotion::Harmonic(wall)),
            gap(2, GapMotion::Harmonic(HarmonicWall { omega: 2.0, ..wall })),
        ];
        let waves = vec![LoadWave { amplitude: rows[3 * n..].to_vec(), omega: 1.7, phase: 0.3 }];
        let load = vec![1.0, -2.0, 0.5, 0.0];
        let ramps = (0..2 * n).map(|k| (2.3 * k as f64).cos()).collect();
        let tables = vec![Arc::new(TimeTable::new(vec![0.0, 1.0], ramps, (2, n), None).unwrap())];
        let system = LinearSystem { mass, damping, stiffness, load, waves, tables, gaps };
        let system = Arc::new(system);
        let along = (0..n + 3).map(|c| {
            let mut row = [0.0; 8];
            row.iter_mut().enumerate().for_each(|(k, row)| *row = (1.3 * (8 * c + k) as f64).sin());
            row
        });
        let arcs = SkippedArcs::of_rows(0.5, 0.9, along.collect());
        for set in [GapSet::EMPTY, GapSet::of(0), GapSet::of(0).with(GapSet::of(1))] {
            let mut kinetics = Kinetics::new(Layout::smooth(n, 3), Friction::none());
            let mut dynamics = LinearDynamics::new(system.clone());
            let mut model = Model::new(&mut dynamics);
            let mut evaluate = |t: f64, x: &[f64], v: &[f64], kinetics: &mut Kinetics| {
                let done: Result<(), crate::record::failure::Failure<Infallible>> =
                    kinetics.evaluate(&mut model, t, &x[..n], &v[..n]);
                assert!(done.is_ok());
                kinetics.contact(set).unwrap();
                kinetics.acceleration[n + 2]
            };
            evaluate(0.5, &[0.0; 7], &[0.0; 7], &mut kinetics);
            let of = (set, 2);
            let smooth = Smooth::ALWAYS;
            let mut pull =
                PullAlongArcs::new(system.clone(), smooth, &arcs, of, &mut kinetics).unwrap();
            for (t, y, u) in [(0.5, 0.1, 0.4), (0.62, 0.3, -0.2), (0.9, 0.0, -1.0)] {
                let (mut x, mut v) = (vec![0.0; n + 3], vec![0.0; n + 3]);
                arcs.combine(t, (y, u), &mut x, &mut v);
                let exact = evaluate(t, &x, &v, &mut kinetics);
                let found: Result<f64, Infallible> = pull.at(t, y, u);
                assert!(
                    (found.unwrap() - exact).abs() < 1e-12 * (1.0 + exact.abs()),
                    "{set:?} {t}"
                );
            }
        }
    }
}
