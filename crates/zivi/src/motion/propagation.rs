//! The motion of a linear system with a set of gaps closed, over steps of one length.
//!
//! With `M^-1 (p - C q' - K q) = A` and `G = M^-1 N_C^T D_CC^-1` the closed gaps stay closed under
//!
//! ```text
//! q'' = A + G (w'' - N_C A)      lambda = D_CC^-1 (w'' - N_C A)                            (1)
//! ```
//!
//! which is linear in `y = (q, h q', d)` with the drives `d`. Any number that is linear in `y` is a
//! power series in `s = (t - t_0)/h` whose coefficients are linear in `y` at the start of the step:
//! rows `r_0 = r`, `r_(k+1) = r_k Y/(k+1)` for `dy/ds = Y y`. There is no case that is not covered:
//! resonance, zero frequencies, damping of any kind.

use std::ops::Range;
use std::sync::Arc;

use crate::kinetics::{Kinetics, Undetermined};
use crate::motion::tail::SkippedArcs;
use crate::numeric::cholesky;
use crate::numeric::coordinates::LinearMap;
use crate::numeric::dense::{axpy, dot, sum_of_products};
use crate::numeric::power_series::{Series, TERMS};
use crate::record::gap_set::GapSet;
use crate::system::force::Smooth;
use crate::system::linear_system::{GapMotion, LinearSystem};
use crate::system::time_table::TimeTable;
use crate::Force;

/// Left of a diagonal entry of `D_CC` by the other gaps: below this they determine it.
const REDUNDANT: f64 = 1e-10;
/// The last coefficients of a series, relative to the largest: above it the step is too long.
const LAST: f64 = 2e-15;
/// Overhead of a term of the series, per coordinate and fixed, in multiplications.
const OVERHEAD: [usize; 2] = [8, 64];
/// Most numbers of these series that are kept by columns: more are slower to read than to compute.
const READ: usize = 1 << 15;

/// A linear system without contacts: `M^-1` times everything.
#[derive(Clone, Debug)]
pub(super) struct Free {
    pub(super) n: usize,
    pub(super) drives: Drives,
    /// `M^-1 K`, `M^-1 C` and `M^-1` times the loads of the drives.
    k: Vec<f64>,
    c: Vec<f64>,
    b: Vec<f64>,
    /// By gap `n_i`, where it is not zero, `M^-1 n_i` and the weights of the drives in its wall less the
    /// offset.
    normals: Vec<Vec<f64>>,
    supports: Vec<Range<usize>>,
    mobility: Vec<Vec<f64>>,
    walls: Vec<Vec<f64>>,
}

impl Free {
    /// None if the mass matrix is not definite.
    pub(super) fn new(system: &LinearSystem) -> Option<Self> {
        let n = system.load.len();
        let (drives, loads, walls) = Drives::of(system);
        let mut mass = system.mass.clone();
        if cholesky::factor(&mut mass, n).partial_cmp(&0.0) != Some(std::cmp::Ordering::Greater) {
            return None;
        }
        let divided = |matrix: &[f64], width: usize| {
            let mut out = vec![0.0; n * width];
            for j in 0..width {
                let mut column: Vec<f64> = (0..n).map(|i| matrix[i * width + j]).collect();
                cholesky::solve(&mass, n, &mut column);
                (0..n).for_each(|i| out[i * width + j] = column[i]);
            }
            out
        };
        let spread = |weights: &[(usize, f64)]| {
            let mut row = vec![0.0; drives.size];
            weights.iter().for_each(|&(place, weight)| row[place] += weight);
            row
        };
        let loads: Vec<f64> = loads.iter().flat_map(|it| spread(it)).collect();
        let mobility = system.gaps.iter().map(|gap| {
            let mut column = gap.normal.clone();
            cholesky::solve(&mass, n, &mut column);
            column
        });
        let walls = walls.iter().zip(&system.gaps).map(|(wall, gap)| {
            let mut row = spread(wall);
            row[0] -= gap.offset;
            row
        });
        Some(Self {
            n,
            k: divided(&system.stiffness, n),
            c: divided(&system.damping, n),
            b: divided(&loads, drives.size),
            normals: system.gaps.iter().map(|gap| gap.normal.clone()).collect(),
            supports: system.gaps.iter().map(|gap| support(&gap.normal)).collect(),
            mobility: mobility.collect(),
            walls: walls.collect(),
            drives,
        })
    }

    /// The derivatives of all this by a parameter, where `rate` has those of the system's numbers.
    pub(super) fn rates(&self, system: &LinearSystem, rate: &LinearSystem) -> Self {
        let n = self.n;
        let (drives, loads, walls) = Drives::of(rate);
        let mut mass = system.mass.clone();
        cholesky::factor(&mut mass, n);
        let spread = |weights: &[(usize, f64)]| {
            let mut row = vec![0.0; drives.size];
            weights.iter().for_each(|&(place, weight)| row[place] += weight);
            drives.without_tables(&mut row);
            row
        };
        // (M^-1 A)_p = M^-1 (A_p - M_p M^-1 A)
        let divided = |of: &[f64], known: &[f64], width: usize| {
            let mut out = vec![0.0; n * width];
            for j in 0..width {
                let mut column: Vec<f64> = (0..n).map(|i| of[i * width + j]).collect();
                let known: Vec<f64> = (0..n).map(|i| known[i * width + j]).collect();
                for (out, row) in column.iter_mut().zip(rate.mass.chunks_exact(n)) {
                    *out -= dot(row, &known);
                }
                cholesky::solve(&mass, n, &mut column);
                (0..n).for_each(|i| out[i * width + j] = column[i]);
            }
            out
        };
        let loads: Vec<f64> = loads.iter().flat_map(|it| spread(it)).collect();
        let gaps = rate.gaps.iter().zip(&self.mobility);
        let mobility = gaps.map(|(gap, known)| divided(&gap.normal, known, 1)).collect();
        let walls = walls.iter().zip(&rate.gaps).map(|(wall, gap)| {
            let mut row = spread(wall);
            row[0] -= gap.offset;
            row
        });
        Self {
            n,
            k: divided(&rate.stiffness, &self.k, n),
            c: divided(&rate.damping, &self.c, n),
            b: divided(&loads, &self.b, drives.size),
            normals: rate.gaps.iter().map(|gap| gap.normal.clone()).collect(),
            supports: rate.gaps.iter().map(|gap| support(&gap.normal)).collect(),
            mobility,
            walls: walls.collect(),
            drives,
        }
    }

    /// How many numbers `y` has.
    pub(super) fn size(&self) -> usize {
        2 * self.n + self.drives.size
    }

    /// How many gaps there are.
    pub(super) fn gaps(&self) -> usize {
        self.normals.len()
    }

    /// `M^-1 n_i`.
    pub(super) fn mobility(&self, i: usize) -> &[f64] {
        &self.mobility[i]
    }

    /// `n_i`.
    pub(super) fn normal(&self, i: usize) -> &[f64] {
        &self.normals[i]
    }

    /// The product of `n_i` with a vector: of few entries, in any order with the same bits.
    pub(super) fn along_normal(&self, i: usize, v: &[f64]) -> f64 {
        let support = self.supports[i].clone();
        if support.len() > 2 {
            return sum_of_products(&self.normals[i], v);
        }
        let pairs = self.normals[i][support.clone()].iter().zip(&v[support]);
        pairs.fold(0.0, |sum, (a, b)| sum + a * b)
    }

    /// Whether a gap mirrors another gap up to an offset.
    pub(super) fn is_opposite(&self, i: usize, j: usize) -> bool {
        let opposite = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| *a == -b);
        opposite(&self.normals[i], &self.normals[j])
            && opposite(&self.walls[i][1..], &self.walls[j][1..])
    }

    /// The weights of the drives in the wall of a gap, less its offset.
    pub(super) fn wall(&self, i: usize) -> &[f64] {
        &self.walls[i]
    }

    /// The weights of `y` in a gap.
    pub(super) fn gap(&self, i: usize) -> Vec<f64> {
        let wall = self.walls[i].iter().map(|weight| -weight);
        self.normals[i].iter().copied().chain(vec![0.0; self.n]).chain(wall).collect()
    }

    /// The size of the terms of `h^2/2 g''` of a gap without contacts, at the time `t`; that of a wave
    /// counts wherever it stands, as its phase has rounding.
    pub(super) fn acceleration_terms(&self, i: usize, (t, h): (f64, f64), y: &[f64]) -> f64 {
        let rows = free_acceleration(self, h);
        let mut sizes: Vec<f64> = y.iter().map(|y| y.abs()).collect();
        self.drives.enlarge(t, &mut sizes[2 * self.n..]);
        let of = |row: &[f64]| row.iter().zip(&sizes).map(|(a, y)| a.abs() * y).sum::<f64>();
        self.normals[i].iter().zip(&rows).map(|(n, row)| 0.5 * n.abs() * of(row)).sum()
    }

    /// An upper bound of how fast the modes grow, turn or decay (1/s), close to the fastest of them.
    pub(super) fn rate(&self) -> f64 {
        let n = self.n;
        let at = |i: usize, j: usize| match (i < n, j < n) {
            (true, true) => 0.0,
            (true, false) => f64::from(j - n == i),
            (false, true) => -self.k[(i - n) * n + j],
            (false, false) => -self.c[(i - n) * n + j - n],
        };
        let size = 2 * n;
        // position and velocity in units of one another
        let largest = |of: &[f64]| of.iter().fold(0.0_f64, |most, it| most.max(it.abs()));
        let unit = largest(&self.k).sqrt().max(largest(&self.c));
        if unit == 0.0 {
            return 0.0;
        }
        let scale = |i: usize| if i < n { 1.0 } else { 1.0 / unit };
        let entry = |place: usize| {
            let (i, j) = (place / size, place % size);
            at(i, j) * scale(i) / scale(j)
        };
        let mut power: Vec<f64> = (0..size * size).map(entry).collect();
        // |Y^(2^p)|^(2^-p) falls to the largest modulus of an eigenvalue
        let (mut log, mut part) = (0.0, 1.0);
        for _ in 0..8 {
            let norm = power.iter().map(|it| it * it).sum::<f64>().sqrt();
            if norm == 0.0 {
                return 0.0;
            }
            log += part * norm.ln();
            part *= 0.5;
            let old: Vec<f64> = power.iter().map(|it| it / norm).collect();
            for i in 0..size {
                let row = &mut power[i * size..][..size];
                row.fill(0.0);
                for (k, factor) in old[i * size..][..size].iter().enumerate() {
                    let other = &old[k * size..][..size];
                    row.iter_mut().zip(other).for_each(|(row, other)| *row += factor * other);
                }
            }
        }
        let norm = power.iter().map(|it| it * it).sum::<f64>().sqrt();
        if norm == 0.0 {
            return 0.0;
        }
        (log + part * norm.ln()).exp()
    }
}

/// A number that is linear in `y`, over a step: its coefficients by columns.
#[derive(Clone, Debug)]
pub(super) struct Functional(LinearMap);

impl Functional {
    /// From the rows of its coefficients.
    fn new(series: &[Vec<f64>]) -> Self {
        let size = series.first().map_or(0, Vec::len);
        Self(LinearMap::new(TERMS, size, |k, j| series[k][j]))
    }

    /// The power series from a state.
    #[inline]
    pub(super) fn series(&self, y: &[f64]) -> Series {
        let mut a = [0.0; TERMS];
        self.series_to(y, &mut a);
        a
    }

    /// The first terms, by the registers that the caller has, where that is quick.
    #[inline(always)]
    pub(super) fn first_terms<const FEW: usize>(&self, y: &[f64]) -> Option<[f64; FEW]> {
        self.0.first_of_product(TERMS, y)
    }

    /// The same into a series that is there.
    #[inline]
    pub(super) fn series_to(&self, y: &[f64], a: &mut Series) {
        a.fill(0.0);
        self.0.add(y, a);
    }

    /// The same by the registers that the caller has.
    #[inline(always)]
    pub(super) fn series_by_columns(&self, y: &[f64]) -> Series {
        let mut a = [0.0; TERMS];
        self.0.add_by_columns(y, &mut a);
        a
    }
}

/// The motion with a set of gaps closed.
#[derive(Clone, Debug)]
pub(super) struct Propagation {
    /// `dq'/ds h = (-h^2 K, -h C, h^2 B) y` under equation (1).
    acceleration: LinearMap,
    /// `(q, h q')` after a step.
    step: LinearMap,
    /// The coordinates, where their series are quicker read than computed term by term.
    pub(super) coordinates: Option<Vec<Functional>>,
    /// The gaps that are open, and the contact forces of the others.
    pub(super) gaps: Vec<Functional>,
}

impl Propagation {
    /// For steps of the length `h`; nothing if that is too long.
    pub(super) fn new(free: &Free, set: GapSet, h: f64) -> Result<Option<Self>, Undetermined> {
        let (n, size) = (free.n, free.size());
        let forces = contact_forces(free, set, h)?;
        // h^2 q'' with the contact forces
        let mut rows = free_acceleration(free, h);
        for (gap, force) in set.iter().zip(&forces) {
            for (i, row) in rows.iter_mut().enumerate() {
                let factor = h * h * free.mobility[gap][i];
                if factor != 0.0 {
                    row.iter_mut().zip(force).for_each(|(row, force)| *row += factor * force);
                }
            }
        }
        let (acceleration, ranges) =
            (LinearMap::new(n, size, |i, j| rows[i][j]), supports(&rows, n));
        let by_terms = acceleration.len() + OVERHEAD[0] * n + OVERHEAD[1];
        let reads = n * size <= by_terms && TERMS * n * size <= READ;
        let mut coordinates = reads.then(Vec::new);
        let (mut after, mut speeds) = (vec![], vec![]);
        for i in 0..n {
            let mut row = vec![0.0; size];
            row[i] = 1.0;
            let series = series_of(free, (&rows, &ranges), h, row);
            let largest = |row: &[f64]| row.iter().fold(0.0_f64, |most, it| most.max(it.abs()));
            let most = series.iter().map(|row| largest(row)).fold(0.0, f64::max);
            if largest(&series[TERMS - 1]) > LAST * most {
                return Ok(None);
            }
            // from the smallest terms on
            let sum = |weight: &dyn Fn(usize) -> f64| {
                let mut sums = vec![0.0; size];
                for (k, terms) in series.iter().enumerate().rev() {
                    let weight = weight(k);
                    sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += weight * term);
                }
                sums
            };
            after.push(sum(&|_| 1.0));
            speeds.push(sum(&|k| k as f64));
            if let Some(coordinates) = &mut coordinates {
                coordinates.push(Functional::new(&series));
            }
        }
        after.append(&mut speeds);
        let mut number = 0;
        let gaps = (0..free.normals.len()).map(|i| {
            let first = if set.has(i) {
                number += 1;
                forces[number - 1].clone()
            } else {
                free.gap(i)
            };
            Functional::new(&series_of(free, (&rows, &ranges), h, first))
        });
        Ok(Some(Self {
            gaps: gaps.collect(),
            coordinates,
            acceleration,
            step: LinearMap::new(2 * n, size, |i, j| after[i][j]),
        }))
    }

    /// How many numbers it consists of.
    pub(super) fn len(&self) -> usize {
        let series = self.gaps.iter().chain(self.coordinates.iter().flatten());
        let read: usize = series.map(|Functional(map)| map.len()).sum();
        self.acceleration.len() + self.step.len() + read
    }

    /// `(q, h q')` after a whole step from `y`.
    pub(super) fn whole(&self, y: &[f64], out: &mut [f64]) {
        out.fill(0.0);
        self.step.add(y, out);
    }

    /// `y <- factor Y y`.
    #[inline(always)]
    pub(super) fn advance(
        &self,
        free: &Free,
        (h, factor): (f64, f64),
        y: &mut [f64],
        acceleration: &mut [f64],
    ) {
        let n = free.n;
        acceleration.fill(0.0);
        self.acceleration.add_by_columns(y, acceleration);
        let (q, rest) = y.split_at_mut(n);
        for ((q, v), acceleration) in q.iter_mut().zip(&mut rest[..n]).zip(&*acceleration) {
            *q = factor * *v;
            *v = factor * acceleration;
        }
        free.drives.advance(h, factor, &mut rest[n..]);
    }
}

/// The rows `h^2 A` in `y`.
pub(super) fn free_acceleration(free: &Free, h: f64) -> Vec<Vec<f64>> {
    let (n, nd) = (free.n, free.drives.size);
    let row = |i: usize| {
        let k = free.k[i * n..][..n].iter().map(|k| -h * h * k);
        let c = free.c[i * n..][..n].iter().map(|c| -h * c);
        let b = free.b[i * nd..][..nd].iter().map(|b| h * h * b);
        k.chain(c).chain(b).collect()
    };
    (0..n).map(row).collect()
}

/// The rows of the contact forces in `y`, equation (1).
pub(super) fn contact_forces(
    free: &Free,
    set: GapSet,
    h: f64,
) -> Result<Vec<Vec<f64>>, Undetermined> {
    let closed: Vec<usize> = set.iter().collect();
    let factor = factored_mobility(free, &closed)?;
    let accelerations = free_acceleration(free, h);
    let mut rows = wall_accelerations((free, free), &closed, h);
    for (row, &i) in rows.iter_mut().zip(&closed) {
        for (normal, acceleration) in free.normals[i].iter().zip(&accelerations) {
            if *normal != 0.0 {
                row.iter_mut().zip(acceleration).for_each(|(row, a)| *row -= normal * a);
            }
        }
        row.iter_mut().for_each(|row| *row /= h * h);
    }
    solve_rows(&factor, closed.len(), &mut rows);
    Ok(rows)
}

/// The factor of `D_CC`.
pub(super) fn factored_mobility(free: &Free, closed: &[usize]) -> Result<Vec<f64>, Undetermined> {
    let count = closed.len();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let entry = |k: usize| {
        let (normal, mobility) = (closed[k / count], &free.mobility[closed[k % count]]);
        let support = free.supports[normal].clone();
        dot(&free.normals[normal][support.clone()], &mobility[support])
    };
    let mut d: Vec<f64> = (0..count * count).map(entry).collect();
    let left = cholesky::factor(&mut d, count);
    if left < REDUNDANT || left.is_nan() {
        return Err(Undetermined::Contacts);
    }
    Ok(d)
}

/// The rows `h^2 w''` of the walls of gaps in `y`, of the second system or of its derivatives.
pub(super) fn wall_accelerations(
    (free, of): (&Free, &Free),
    gaps: &[usize],
    h: f64,
) -> Vec<Vec<f64>> {
    let row = |&i: &usize| {
        let mut wall = of.walls[i].clone();
        free.drives.differentiate(h, &mut wall);
        free.drives.differentiate(h, &mut wall);
        vec![0.0; 2 * free.n].into_iter().chain(wall).collect()
    };
    gaps.iter().map(row).collect()
}

/// `X <- D^-1 X` for `X` by rows, from the factor of `D`.
pub(super) fn solve_rows(factor: &[f64], count: usize, rows: &mut [Vec<f64>]) {
    for j in 0..rows.first().map_or(0, Vec::len) {
        let mut column: Vec<f64> = rows.iter().map(|row| row[j]).collect();
        if column.iter().all(|entry| *entry == 0.0) {
            continue;
        }
        cholesky::solve(factor, count, &mut column);
        rows.iter_mut().zip(column).for_each(|(row, value)| row[j] = value);
    }
}

/// From the first to the last entry that is not zero.
fn support(row: &[f64]) -> Range<usize> {
    let is_set = |entry: &f64| *entry != 0.0;
    match (row.iter().position(is_set), row.iter().rposition(is_set)) {
        (Some(first), Some(last)) => first..last + 1,
        _ => 0..0,
    }
}

/// The same of the coordinates, the velocities and the drives in rows in `y`.
fn supports(rows: &[Vec<f64>], n: usize) -> Vec<[Range<usize>; 3]> {
    let of = |row: &Vec<f64>| {
        [0..n, n..2 * n, 2 * n..row.len()].map(|part| {
            let within = support(&row[part.clone()]);
            part.start + within.start..part.start + within.end
        })
    };
    rows.iter().map(of).collect()
}

/// The rows of the coefficients of a number in `y`.
fn series_of(
    free: &Free,
    (rows, ranges): (&[Vec<f64>], &[[Range<usize>; 3]]),
    h: f64,
    first: Vec<f64>,
) -> Vec<Vec<f64>> {
    let n = free.n;
    let mut series = vec![first];
    for k in 1..TERMS {
        let before = &series[k - 1];
        let mut next = vec![0.0; before.len()];
        next[n..2 * n].copy_from_slice(&before[..n]);
        next[2 * n..].copy_from_slice(&before[2 * n..]);
        free.drives.differentiate(h, &mut next[2 * n..]);
        for ((factor, row), ranges) in before[n..2 * n].iter().zip(rows).zip(ranges) {
            if *factor != 0.0 {
                for range in ranges.iter().cloned() {
                    let row = &row[range.clone()];
                    next[range].iter_mut().zip(row).for_each(|(next, row)| *next += factor * row);
                }
            }
        }
        next.iter_mut().for_each(|next| *next /= k as f64);
        series.push(next);
    }
    series
}

// Excitations of a linear system as the state of an autonomous linear equation.
//
// ```text
// 1' = 0      (cos, sin)' = W (-sin, cos)      (c_0, c_1, c_2, c_3)' = (c_1, 2 c_2, 3 c_3, 0)      W = w h
// ```
//
// in the time `s = (t - t_0)/h` since the start of a step: a constant, a wave, a polynomial of a table.

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

// The acceleration of a bouncing gap of a linear system along the flights of a jump.
//
// With the contacts `C` it is `rho . A + h_i - gamma . h_C` with `gamma = D_CC^-1 D_Ci` and
// `rho = n_i - gamma . N_C`, where `A = M^-1 (p - C q' - K q)`: linear in the coordinates and their
// velocities, so that the polynomials of these make two of it, known once for all flights.

/// The acceleration of a gap, as the force of a scalar motion.
pub(crate) struct PullAlongArcs {
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
    pub(crate) fn new(
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
mod tests {
    use super::*;

    /// The rate of a system of unit masses.
    fn rate_of(damping: Vec<f64>, stiffness: Vec<f64>, n: usize) -> f64 {
        let mass = (0..n * n).map(|k| f64::from(u8::from(k / n == k % n))).collect();
        let (load, waves, tables, gaps) = (vec![0.0; n], vec![], vec![], vec![]);
        let system = LinearSystem { mass, damping, stiffness, load, waves, tables, gaps };
        Free::new(&system).unwrap().rate()
    }

    #[test]
    fn the_rate_bounds_the_fastest_mode_closely() {
        let is_close = |found: f64, exact: f64| {
            assert!(found >= exact * (1.0 - 1e-14) && found < 1.01 * exact, "{found} {exact}");
        };
        // oscillators, weakly and strongly damped
        for omega in [1e-3_f64, 2.0, 5e4] {
            is_close(rate_of(vec![0.0], vec![omega * omega], 1), omega);
            is_close(rate_of(vec![0.2 * omega], vec![omega * omega], 1), omega);
            let fast = 2.0 + 3.0_f64.sqrt();
            is_close(rate_of(vec![4.0 * omega], vec![omega * omega], 1), fast * omega);
        }
        // an impact sequence between two walls: 2 sin(n pi/(2 (n + 1)))
        for n in 2..7 {
            let spring = |k: usize| match (k / n).abs_diff(k % n) {
                0 => 2.0,
                1 => -1.0,
                _ => 0.0,
            };
            let turn = n as f64 * std::f64::consts::FRAC_PI_2 / (n + 1) as f64;
            let stiffness = (0..n * n).map(spring).collect();
            is_close(rate_of(vec![0.0; n * n], stiffness, n), 2.0 * turn.sin());
        }
        // a free mass
        assert_eq!(rate_of(vec![0.0], vec![0.0], 1), 0.0);
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
    use crate::kinetics::Model;
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
