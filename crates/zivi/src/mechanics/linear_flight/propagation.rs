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

use super::drives::Drives;
use crate::mechanics::kinetics::Undetermined;
use crate::numeric::cholesky;
use crate::numeric::coordinates::LinearMap;
use crate::numeric::dense::{dot, sum_of_products};
use crate::numeric::power_series::{Series, TERMS};
use crate::record::gap_set::GapSet;
use crate::system::linear_system::LinearSystem;
use std::ops::Range;

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

    /// Whether a gap moves as another one, the other way; offsets apart.
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
        // a chain between two walls: 2 sin(n pi/(2 (n + 1)))
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
