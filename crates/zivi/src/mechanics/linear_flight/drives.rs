//! Excitations of a linear system as the state of an autonomous linear equation.
//!
//! ```text
//! 1' = 0      (cos, sin)' = W (-sin, cos)      (c_0, c_1, c_2, c_3)' = (c_1, 2 c_2, 3 c_3, 0)      W = w h
//! ```
//!
//! in the time `s = (t - t_0)/h` since the start of a step: a constant, a wave, a polynomial of a table.

use crate::mechanics::accumulation::tail::SkippedArcs;
use crate::mechanics::kinetics::{Kinetics, Undetermined};
use crate::numeric::dense::{axpy, dot};
use crate::record::gap_set::GapSet;
use crate::system::force::Smooth;
use crate::system::linear_system::{GapMotion, LinearSystem};
use crate::system::time_table::TimeTable;
use crate::Force;
use std::sync::Arc;

/// One of them.
#[derive(Clone, Debug)]
pub(super) enum Drive {
    One,
    Wave { omega: f64, phase: f64 },
    Column { table: Arc<TimeTable>, column: usize },
}

/// Weight of the rounding of a phase relative to other numbers.
const TURNED: f64 = 1.0 / 64.0;

impl Drive {
    pub(super) fn size(&self) -> usize {
        match self {
            Self::One => 1,
            Self::Wave { .. } => 2,
            Self::Column { table, .. } => table.order(),
        }
    }
}

/// All of them, one after the other.
#[derive(Clone, Debug)]
pub(super) struct Drives {
    pub(super) all: Vec<Drive>,
    /// How many numbers they have.
    pub(super) size: usize,
}

/// Numbers that are multiplied with those of the drives.
type Weights = Vec<(usize, f64)>;

impl Drives {
    /// The excitations of a system, with their weights in the loads of the coordinates and in the
    /// walls of the gaps.
    pub(super) fn of(system: &LinearSystem) -> (Self, Vec<Weights>, Vec<Weights>) {
        let n = system.load.len();
        let mut drives = Self { all: vec![Drive::One], size: 1 };
        let mut loads: Vec<Weights> = system.load.iter().map(|&p| vec![(0, p)]).collect();
        for wave in &system.waves {
            let place = drives.add(Drive::Wave { omega: wave.omega, phase: wave.phase });
            for (load, &p) in loads.iter_mut().zip(&wave.amplitude) {
                load.push((place, p));
            }
        }
        for table in &system.tables {
            for (column, load) in loads.iter_mut().enumerate().take(n) {
                let place = drives.add(Drive::Column { table: table.clone(), column });
                load.push((place, 1.0));
            }
        }
        let walls = system.gaps.iter().map(|gap| match &gap.motion {
            GapMotion::Fixed => vec![],
            GapMotion::Harmonic(wall) => {
                let place = drives.add(Drive::Wave { omega: wall.omega, phase: wall.phase });
                vec![(0, wall.offset), (place, wall.amplitude)]
            }
            GapMotion::Table(table) => {
                let drive = Drive::Column { table: table.clone(), column: 0 };
                vec![(drives.add(drive), 1.0)]
            }
        });
        let walls = walls.collect();
        (drives, loads, walls)
    }

    fn add(&mut self, drive: Drive) -> usize {
        let place = self.size;
        self.size += drive.size();
        self.all.push(drive);
        place
    }

    /// The highest angular frequency (rad/s).
    pub(super) fn highest(&self) -> f64 {
        let each = self.all.iter().map(|drive| match drive {
            Drive::Wave { omega, .. } => omega.abs(),
            _ => 0.0,
        });
        each.fold(0.0, f64::max)
    }

    /// Writes the state at the time `t`, from where a step of length `h` begins.
    pub(super) fn write(&self, t: f64, h: f64, out: &mut [f64]) {
        let mut place = 0;
        for drive in &self.all {
            let out = &mut out[place..][..drive.size()];
            place += out.len();
            match drive {
                Drive::One => out[0] = 1.0,
                Drive::Wave { omega, phase } => {
                    (out[1], out[0]) = (omega * t + phase).sin_cos();
                }
                Drive::Column { table, column } => {
                    table.expansion(t, *column, out);
                    let mut power = 1.0;
                    for c in out {
                        *c *= power;
                        power *= h;
                    }
                }
            }
        }
    }

    /// The sizes `|d|` as they bound the rounding of the drives at `t`, in units of that of a number.
    pub(super) fn enlarge(&self, t: f64, sizes: &mut [f64]) {
        let mut place = 0;
        for drive in &self.all {
            let sizes = &mut sizes[place..][..drive.size()];
            place += sizes.len();
            if let Drive::Wave { omega, .. } = drive {
                sizes.fill(1.0 + TURNED * (omega * t).abs());
            }
        }
    }

    /// `d <- factor d'`.
    pub(super) fn advance(&self, h: f64, factor: f64, d: &mut [f64]) {
        let mut place = 0;
        for drive in &self.all {
            let d = &mut d[place..][..drive.size()];
            place += d.len();
            match drive {
                Drive::One => d[0] = 0.0,
                Drive::Wave { omega, .. } => {
                    let turn = factor * omega * h;
                    (d[0], d[1]) = (-turn * d[1], turn * d[0]);
                }
                Drive::Column { .. } => {
                    for k in 0..d.len() {
                        let next = d.get(k + 1).copied().unwrap_or(0.0);
                        d[k] = factor * (k + 1) as f64 * next;
                    }
                }
            }
        }
    }

    /// `r <- r D`: the weights of the derivative of the quantity with weights `r`.
    pub(super) fn differentiate(&self, h: f64, r: &mut [f64]) {
        let mut place = 0;
        for drive in &self.all {
            let r = &mut r[place..][..drive.size()];
            place += r.len();
            match drive {
                Drive::One => r[0] = 0.0,
                Drive::Wave { omega, .. } => (r[0], r[1]) = (omega * h * r[1], -omega * h * r[0]),
                Drive::Column { .. } => {
                    for k in (0..r.len()).rev() {
                        r[k] = if k > 0 { k as f64 * r[k - 1] } else { 0.0 };
                    }
                }
            }
        }
    }
}

// Derivatives of what drives a linear system by a parameter, as `a cos(w t + phi)` by `w` and `phi`.

impl Drives {
    /// The rates of these drives, where `self` has the derivatives of their numbers, at the time `t`,
    /// from where a step of length `h` begins.
    pub(super) fn write_rates(&self, of: &Self, t: f64, h: f64, out: &mut [f64]) {
        self.write(t, h, out);
        for ((of, rate), place) in of.pairs(self) {
            match (of, rate) {
                (Drive::Wave { omega, phase }, Drive::Wave { omega: faster, phase: ahead }) => {
                    let (sin, cos) = (omega * t + phase).sin_cos();
                    let turned = faster * t + ahead;
                    (out[place], out[place + 1]) = (-turned * sin, turned * cos);
                }
                (Drive::One, _) => out[place] = 0.0,
                _ => (),
            }
        }
    }

    /// Adds `factor D_p d`, where `self` has the derivatives of the numbers of `D`.
    pub(super) fn add_advance(&self, h: f64, factor: f64, d: &[f64], out: &mut [f64]) {
        for ((_, rate), place) in self.pairs(self) {
            if let Drive::Wave { omega, .. } = rate {
                let turn = factor * omega * h;
                out[place] -= turn * d[place + 1];
                out[place + 1] += turn * d[place];
            }
        }
    }

    /// Adds `r (D^2)_p`, where `self` has the derivatives of the numbers of the drives `of`.
    pub(super) fn add_differentiated_twice(&self, of: &Self, h: f64, r: &[f64], out: &mut [f64]) {
        for ((of, rate), place) in of.pairs(self) {
            if let (Drive::Wave { omega, .. }, Drive::Wave { omega: faster, .. }) = (of, rate) {
                let factor = -2.0 * omega * faster * h * h;
                (0..2).for_each(|k| out[place + k] += factor * r[place + k]);
            }
        }
    }

    /// Zeros for the weights of tables, whose derivatives are tables that have the same.
    pub(super) fn without_tables(&self, row: &mut [f64]) {
        for ((drive, _), place) in self.pairs(self) {
            if let Drive::Column { .. } = drive {
                row[place..][..drive.size()].fill(0.0);
            }
        }
    }

    /// Each excitation with its counterpart, and the start of its numbers.
    fn pairs<'a>(
        &'a self,
        other: &'a Self,
    ) -> impl Iterator<Item = ((&'a Drive, &'a Drive), usize)> {
        let mut next = 0;
        let place = move |drive: &Drive| {
            next += drive.size();
            next - drive.size()
        };
        let places: Vec<usize> = self.all.iter().map(place).collect();
        self.all.iter().zip(&other.all).zip(places)
    }
}

// The acceleration of a bouncing gap of a linear system along the arcs of a jump.
//
// With the contacts `C` it is `rho . A + h_i - gamma . h_C` with `gamma = D_CC^-1 D_Ci` and
// `rho = n_i - gamma . N_C`, where `A = M^-1 (p - C q' - K q)`: linear in the coordinates and their
// velocities, so that the polynomials of these make two of it, known once for all arcs.

/// The acceleration of a gap, as the force of a scalar motion.
pub(in crate::mechanics) struct PullAlongArcs {
    system: Arc<LinearSystem>,
    smooth: Smooth,
    /// Contributions of the coordinates and of their velocities.
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

    /// Contribution of loads and walls.
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
mod drives_tests {
    use super::*;
    use crate::numeric::dense::dot;

    #[test]
    fn the_weights_of_a_derivative_are_those_of_a_difference() {
        let table = TimeTable::new(vec![0.0, 2.0], vec![0.3, -0.7, 1.1, 0.4], (4, 1), None);
        let table = Arc::new(table.unwrap());
        let mut drives = Drives { all: vec![Drive::One], size: 1 };
        drives.add(Drive::Wave { omega: 3.0, phase: 0.4 });
        drives.add(Drive::Column { table, column: 0 });
        let (t, h, weights) = (0.6, 0.25, [0.5, -1.2, 0.8, 1.3, -0.4, 0.9, -0.7]);
        let at = |s: f64| {
            let mut d = [0.0; 7];
            drives.write(t + h * s, h, &mut d);
            d
        };
        // of fourth order: exact for the cubic
        let step = 1e-3;
        let pair = |k: f64| dot(&weights, &at(k * step)) - dot(&weights, &at(-k * step));
        let exact = (8.0 * pair(1.0) - pair(2.0)) / (12.0 * step);
        let (mut rates, mut slopes) = (weights, at(0.0));
        drives.differentiate(h, &mut rates);
        drives.advance(h, 1.0, &mut slopes);
        for found in [dot(&rates, &at(0.0)), dot(&weights, &slopes)] {
            assert!((found - exact).abs() < 1e-11, "{found} {exact}");
        }
    }
}

#[cfg(test)]
mod pull_tests {
    use std::convert::Infallible;

    use super::*;
    use crate::mechanics::kinetics::Model;
    use crate::system::dynamics::Layout;
    use crate::system::force::Friction;
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
                let done: Result<(), crate::record::status::Failure<Infallible>> =
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
