//! Contact forces that the motion leaves undetermined: how far inequalities and round cones let them vary.
//!
//! ```text
//! x = x_0 + V alpha      levels  a_j + s_j . alpha >= 0                                    (1)
//! margin   max t :  a_j + s_j . alpha >= t     =  min y . a :  y >= 0, sum y = 1, S^T y = 0  (2)
//! least    min |alpha|^2 :  a_j + s_j . alpha >= 0                                         (3)
//! ```
//!
//! The dual form of (2) is solved by the simplex method, (3) by the dual active-set method of D. Goldfarb and
//! A. Idnani (Mathematical Programming 27, 1983). The margin is the minimum of the sums `y . a` at the
//! vertices of (2): each of them varies as smoothly as the levels do.

use crate::numeric::cholesky;
use crate::numeric::dense::{dot, largest};
use crate::numeric::elimination::{Elimination, Singular};

/// Bound of the margin, a multiple of the largest levels: it may be unbounded otherwise.
const CAP: f64 = 4.0;
/// Numbers below this part of the largest of their kind are rounding.
const ROUNDING: f64 = 1e-11;
/// The equations of a vertex hold to this, and its weights are no more negative.
const VERTEX: f64 = 1e-8;
/// Exchanges by unknown after which a method is given up.
const EXCHANGES: usize = 50;

/// Inequalities (1) of the forces that the motion leaves undetermined.
#[derive(Clone, Debug, Default)]
pub(crate) struct Shares {
    /// The number of undetermined forces.
    d: usize,
    a: Vec<f64>,
    /// The rows `s_j`, one after the other.
    s: Vec<f64>,
}

/// `alpha` (3), and the rows that it reaches with their multipliers.
pub(crate) type Least = (Vec<f64>, Vec<(usize, f64)>);

/// The margin (2).
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Margin {
    pub(crate) value: f64,
    /// The levels that determine it with their weights `y`; empty without a bound.
    pub(crate) support: Vec<(usize, f64)>,
}

impl Shares {
    pub(crate) fn new(d: usize) -> Self {
        Self { d, ..Self::default() }
    }

    /// One more level.
    pub(crate) fn push(&mut self, a: f64, s: impl Iterator<Item = f64>) {
        self.a.push(a);
        self.s.extend(s);
    }

    fn row(&self, j: usize) -> &[f64] {
        &self.s[j * self.d..][..self.d]
    }

    fn largest(&self) -> f64 {
        largest(&self.a)
    }

    /// The margin (2).
    pub(crate) fn margin(&self) -> Margin {
        let unbounded = || Margin { value: CAP * self.largest(), support: Vec::new() };
        let Some(basis) = self.optimal_basis() else { return unbounded() };
        let Some(weights) = self.weights(&basis) else { return unbounded() };
        let support: Vec<(usize, f64)> =
            basis.into_iter().zip(weights).filter(|&(_, y)| y > ROUNDING).collect();
        match support.is_empty() {
            true => unbounded(),
            false => {
                let value = support.iter().map(|&(j, y)| y * self.a[j]).sum();
                Margin { value, support }
            }
        }
    }

    /// The sum `y . a` with the weights that these levels have here; `None` if they are not a
    /// vertex of (2).
    pub(crate) fn combined(&self, levels: &[usize]) -> Option<f64> {
        let weights = self.weights(levels)?;
        Some(levels.iter().zip(weights).map(|(&j, y)| y * self.a[j]).sum())
    }

    /// `y` on some levels with `S^T y = 0` and `sum y = 1`, if a nonnegative one exists.
    fn weights(&self, levels: &[usize]) -> Option<Vec<f64>> {
        let (rows, count) = (self.d + 1, levels.len());
        // padded to a square matrix
        let size = rows.max(count);
        let (mut matrix, unit) = (vec![0.0; size * size], largest(&self.s));
        for (column, &j) in levels.iter().enumerate() {
            let s = self.row(j);
            s.iter().enumerate().for_each(|(i, s)| matrix[i * size + column] = s / unit);
            matrix[self.d * size + column] = 1.0;
        }
        let mut right = vec![0.0; size];
        right[self.d] = 1.0;
        let y = Elimination::new(matrix.clone(), size, ROUNDING).solve(&right);
        let left = |i: usize| dot(&matrix[i * size..][..size], &y) - right[i];
        let solves = (0..rows).all(|i| left(i).abs() <= VERTEX);
        (solves && y[..count].iter().all(|&y| y >= -VERTEX)).then(|| y[..count].to_vec())
    }

    /// The levels in an optimal basis of the dual form of (2), by the simplex method; none if only the cap is
    /// in it. From the vertex of the cap alone, whose other unknowns are zero.
    fn optimal_basis(&self) -> Option<Vec<usize>> {
        let (d, j) = (self.d, self.a.len());
        let (scale, width) = (self.largest(), j + 2);
        let unit = largest(&self.s);
        if scale == 0.0 || unit == 0.0 {
            return None;
        }
        // the rows S^T y = 0 and sum y = 1, then the reduced costs; the columns y_j, the cap, the right side
        let mut table = vec![0.0; (d + 2) * width];
        for column in 0..j {
            let s = self.row(column);
            (0..d).for_each(|i| table[i * width + column] = s[i] / unit);
            table[d * width + column] = 1.0;
            table[(d + 1) * width + column] = self.a[column] / scale - CAP;
        }
        (table[d * width + j], table[d * width + j + 1]) = (1.0, 1.0);
        let mut basis: Vec<Option<usize>> = vec![None; d];
        basis.push(Some(j));
        let pivot = |table: &mut Vec<f64>, row: usize, column: usize| {
            let by = table[row * width + column];
            (0..width).for_each(|k| table[row * width + k] /= by);
            let pivots: Vec<f64> = table[row * width..][..width].to_vec();
            for other in (0..d + 2).filter(|&other| other != row) {
                let factor = table[other * width + column];
                if factor != 0.0 {
                    let to = &mut table[other * width..][..width];
                    to.iter_mut().zip(&pivots).for_each(|(to, pivot)| *to -= factor * pivot);
                }
            }
        };
        // rows without an unknown in the basis take one: all of them are zero there
        for row in 0..d {
            let size = |k: usize| table[row * width + k].abs();
            let best = (0..j).max_by(|&k, &l| size(k).total_cmp(&size(l)));
            let Some(column) = best.filter(|&k| size(k) > ROUNDING) else { continue };
            pivot(&mut table, row, column);
            basis[row] = Some(column);
        }
        let most = EXCHANGES * (j + d + 1);
        for exchange in 0..most {
            let cost = |k: usize| table[(d + 1) * width + k];
            let enters = |k: &usize| cost(*k) < -ROUNDING && !basis.contains(&Some(*k));
            // the steepest at first; the first of all does not cycle
            let column = match 2 * exchange < most {
                true => (0..=j).filter(enters).min_by(|&k, &l| cost(k).total_cmp(&cost(l))),
                false => (0..=j).find(enters),
            };
            let Some(column) = column else { break };
            let mut leaves: Option<(f64, usize)> = None;
            for row in (0..=d).filter(|&row| basis[row].is_some()) {
                let by = table[row * width + column];
                if by <= ROUNDING {
                    continue;
                }
                let ratio = table[row * width + j + 1].max(0.0) / by;
                let sooner = leaves.is_none_or(|(least, at)| {
                    ratio < least || (ratio == least && basis[row] < basis[at])
                });
                if sooner {
                    leaves = Some((ratio, row));
                }
            }
            let Some((_, row)) = leaves else { break };
            pivot(&mut table, row, column);
            basis[row] = Some(column);
        }
        let levels: Vec<usize> = basis.into_iter().flatten().filter(|&k| k < j).collect();
        let cap = levels.len() <= d && self.weights(&levels).is_none();
        (!cap).then_some(levels)
    }

    /// The least `alpha` (3), and the multipliers of the rows that it reaches, of which it is the combination;
    /// none if no `alpha` obeys the inequalities.
    pub(crate) fn least(&self) -> Option<Least> {
        let (d, j) = (self.d, self.a.len());
        let scale = self.largest();
        let violated = |alpha: &[f64], k: usize| self.a[k] + dot(self.row(k), alpha);
        let mut active: Vec<usize> = Vec::new();
        let mut alpha = vec![0.0; d];
        let size: Vec<f64> = (0..j).map(|k| dot(self.row(k), self.row(k)).sqrt()).collect();
        let steepest = size.iter().fold(0.0_f64, |a, b| a.max(*b));
        let may = |k: &usize| size[*k] > ROUNDING * steepest;
        let mut u: Vec<f64> = Vec::new();
        for _ in 0..EXCHANGES * (j + 1) {
            let worst = (0..j)
                .filter(|k| may(k) && !active.contains(k))
                .map(|k| (violated(&alpha, k) / size[k], k))
                .min_by(|one, other| one.0.total_cmp(&other.0));
            let Some((by, enters)) = worst else { break };
            if by >= -ROUNDING * scale / steepest {
                break;
            }
            // the multiplier of the row that enters grows until that is obeyed; those that would
            // become negative leave, at most all of them
            let mut grown = 0.0;
            loop {
                let row = self.row(enters);
                let r = self.among(&active, |k| dot(self.row(k), row))?;
                let mut along = row.to_vec();
                for (&k, r) in active.iter().zip(&r) {
                    along.iter_mut().zip(self.row(k)).for_each(|(x, s)| *x -= r * s);
                }
                let slope = dot(&along, row);
                let dependent = slope <= 1e-12 * size[enters] * size[enters];
                let full = match dependent {
                    true => f64::INFINITY,
                    false => -violated(&alpha, enters) / slope,
                };
                let mut step = full;
                let mut leaves = None;
                for (at, (u, r)) in u.iter().zip(&r).enumerate() {
                    if *r > ROUNDING && u / r < step {
                        (step, leaves) = (u / r, Some(at));
                    }
                }
                if step.is_infinite() {
                    return None;
                }
                if !dependent {
                    alpha.iter_mut().zip(&along).for_each(|(x, y)| *x += step * y);
                }
                u.iter_mut().zip(&r).for_each(|(u, r)| *u -= step * r);
                grown += step;
                match leaves {
                    Some(at) => {
                        active.remove(at);
                        u.remove(at);
                    }
                    None => {
                        active.push(enters);
                        u.push(grown);
                        break;
                    }
                }
            }
        }
        // once more from the active rows, to the last digits
        let u = self.among(&active, |k| -self.a[k])?;
        let mut exact = vec![0.0; d];
        for (&k, u) in active.iter().zip(&u) {
            exact.iter_mut().zip(self.row(k)).for_each(|(x, s)| *x += u * s);
        }
        Some((exact, active.into_iter().zip(u).collect()))
    }

    /// The `alpha` with the margin (2), towards which the least moves as the margin falls to zero.
    pub(crate) fn of_margin(&self) -> Option<Vec<f64>> {
        let Margin { value, support } = self.margin();
        let (rows, unit) = (support.len(), largest(&self.s));
        if rows == 0 {
            return None;
        }
        let matrix: Vec<f64> =
            support.iter().flat_map(|&(j, _)| self.row(j).iter().map(|s| s / unit)).collect();
        let parts = Singular::new(&matrix, rows, self.d);
        let longest = largest(parts.values());
        let rank = parts.values().iter().filter(|&&size| size > VERTEX * longest).count();
        let right: Vec<f64> = support.iter().map(|&(j, _)| (value - self.a[j]) / unit).collect();
        Some(parts.solve(&right, rank))
    }

    /// Whether the inequalities hold to rounding.
    pub(crate) fn are_obeyed(&self, alpha: &[f64]) -> bool {
        let least = -VERTEX * self.largest();
        self.a.iter().enumerate().all(|(k, a)| a + dot(self.row(k), alpha) >= least)
    }

    /// `(S_A S_A^T)^-1 r` of some rows.
    fn among(&self, active: &[usize], right: impl Fn(usize) -> f64) -> Option<Vec<f64>> {
        let k = active.len();
        let gram: Vec<f64> =
            (0..k * k).map(|at| dot(self.row(active[at / k]), self.row(active[at % k]))).collect();
        let mut factor = gram.clone();
        if cholesky::factor(&mut factor, k) <= 0.0 {
            return None;
        }
        let wanted: Vec<f64> = active.iter().map(|&k| right(k)).collect();
        let mut x = wanted.clone();
        cholesky::solve(&factor, k, &mut x);
        let mut left: Vec<f64> = (0..k).map(|i| wanted[i] - dot(&gram[i * k..][..k], &x)).collect();
        cholesky::solve(&factor, k, &mut left);
        x.iter_mut().zip(&left).for_each(|(x, more)| *x += more);
        x.iter().all(|x| x.is_finite()).then_some(x)
    }

    /// Range of one component of the feasible `alpha` within the inequalities.
    pub(crate) fn width(&self, alpha: &[f64], part: usize) -> f64 {
        let (mut down, mut up) = (f64::INFINITY, f64::INFINITY);
        let least = ROUNDING * largest(&self.s);
        for (k, a) in self.a.iter().enumerate() {
            let row = self.row(k);
            let (slope, value) = (row[part], (a + dot(row, alpha)).max(0.0));
            match slope {
                s if s > least => down = down.min(value / s),
                s if s < -least => up = up.min(-value / s),
                _ => (),
            }
        }
        down + up
    }
}

/// An orthonormal basis of the span of some vectors.
pub(crate) fn orthonormal(vectors: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let mut basis: Vec<Vec<f64>> = Vec::new();
    for vector in vectors {
        let mut next = vector.clone();
        // twice is enough
        for _ in 0..2 {
            for one in &basis {
                let part = dot(one, &next);
                next.iter_mut().zip(one).for_each(|(x, y)| *x -= part * y);
            }
        }
        let size = dot(&next, &next).sqrt();
        if size > ROUNDING * dot(vector, vector).sqrt() {
            next.iter_mut().for_each(|x| *x /= size);
            basis.push(next);
        }
    }
    basis
}

/// Takes from a vector its parts along an orthonormal basis.
fn remove_along(basis: &[Vec<f64>], x: &mut [f64]) {
    for one in basis {
        let part = dot(one, x);
        x.iter_mut().zip(one).for_each(|(x, y)| *x -= part * y);
    }
}

/// Of the vectors `x + V alpha` the shortest whose parts `of` are not negative; otherwise the
/// shortest of all.
pub(crate) fn shortest(x: &mut [f64], null: &[Vec<f64>], of: impl Iterator<Item = usize>) {
    if null.is_empty() {
        return;
    }
    let basis = orthonormal(null);
    remove_along(&basis, x);
    let mut shares = Shares::new(basis.len());
    of.for_each(|i| shares.push(x[i], basis.iter().map(|one| one[i])));
    if let Some((alpha, _)) = shares.least() {
        for (one, alpha) in basis.iter().zip(alpha) {
            x.iter_mut().zip(one).for_each(|(x, y)| *x += alpha * y);
        }
    }
}

// Undetermined forces within round cones: how far inequalities let them vary.
//
// ```text
// x = x_0 + V alpha    levels  l_j = a_j + s_j . alpha,   l_j = n_j(alpha) - |t_j(alpha)|       (1)
// margin   max t :  l_j >= t                                                               (2)
// least    min |alpha|^2 :  l_j >= 0                                                       (3)
// ```
//
// Both are found by Newton's method along the central path of their logarithmic barrier, `-log((n - t)^2 - |t|^2)` for
// a cone (S. Boyd and L. Vandenberghe, *Convex Optimization*, section 11). The margin is that of
// [`Shares`], where cones are intervals.

/// Bounds of the margin and of the forces, relative to the largest level.
const CONE_CAP: f64 = 4.0;
const FAR: f64 = 1e3;
/// The weight of the objective grows by this factor, up to the last: what is left is rounding.
const GROWTH: f64 = 8.0;
const LAST: f64 = 1e13;
/// Newton steps for one weight, and their halvings.
const NEWTON: usize = 40;
const HALVINGS: usize = 50;
/// Where a Newton step lowers the barrier by less, its minimum is reached.
const REACHED: f64 = 1e-9;
/// Pivots below this are zero.
const SINGULAR: f64 = 1e-15;
/// Levels above this part of the largest, below zero, obey the inequality.
const OBEYED: f64 = 1e-9;

/// A number that is affine in `alpha`.
type AffineLevel = (f64, Vec<f64>);

/// The inequalities (1).
#[derive(Clone, Debug, Default)]
pub(crate) struct ConeShares {
    d: usize,
    levels: Vec<AffineLevel>,
    cones: Vec<[AffineLevel; 3]>,
}

/// A barrier at a place: its value, gradient and Hessian.
struct Barrier {
    value: f64,
    gradient: Vec<f64>,
    hessian: Vec<f64>,
}

impl Barrier {
    fn new(size: usize) -> Self {
        Self { value: 0.0, gradient: vec![0.0; size], hessian: vec![0.0; size * size] }
    }

    /// Adds `-log f`. The Hessian of `f` is the sum of `w u u^T`.
    fn add(&mut self, f: f64, gradient: &[f64], curved: &[(f64, &[f64])]) {
        let n = gradient.len();
        self.value -= f.ln();
        for i in 0..n {
            self.gradient[i] -= gradient[i] / f;
            for j in 0..n {
                let outer = gradient[i] * gradient[j] / f;
                let own: f64 = curved.iter().map(|(w, u)| w * u[i] * u[j]).sum();
                self.hessian[i * n + j] += (outer - own) / f;
            }
        }
    }
}

impl ConeShares {
    pub(crate) fn new(d: usize) -> Self {
        Self { d, ..Self::default() }
    }

    /// One more level.
    pub(crate) fn push(&mut self, level: AffineLevel) {
        self.levels.push(level);
    }

    /// One more level that is the distance to the surface of a cone: its limit, then both components.
    pub(crate) fn push_cone(&mut self, cone: [AffineLevel; 3]) {
        self.cones.push(cone);
    }

    /// The levels at a place.
    fn values<'a>(&'a self, alpha: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
        let at = |(a, s): &AffineLevel| a + dot(s, alpha);
        let lines = self.levels.iter().map(at);
        lines.chain(self.cones.iter().map(move |[n, x, y]| at(n) - at(x).hypot(at(y))))
    }

    fn least_value(&self, alpha: &[f64]) -> f64 {
        self.values(alpha).fold(f64::INFINITY, f64::min)
    }

    fn size(&self) -> f64 {
        let all = self.levels.iter().chain(self.cones.iter().flatten());
        all.fold(0.0, |most, it| most.max(it.0.abs()))
    }

    /// The margin (2) and its place.
    pub(crate) fn margin(&self) -> (f64, Vec<f64>) {
        let (d, size) = (self.d, self.size());
        if size == 0.0 {
            return (0.0, vec![0.0; d]);
        }
        // alpha, then t, both relative to the largest level
        let mut z = vec![0.0; d + 1];
        z[d] = self.least_value(&vec![0.0; d]) / size - 1.0;
        let mut weight = 1.0;
        while weight < LAST {
            weight *= GROWTH;
            let objective = |z: &[f64], to: &mut Barrier| {
                to.value -= weight * z[d];
                to.gradient[d] -= weight;
            };
            self.follow(&mut z, size, &objective);
        }
        let alpha: Vec<f64> = z[..d].iter().map(|z| z * size).collect();
        (self.least_value(&alpha).min(CONE_CAP * size), alpha)
    }

    /// The least `alpha` (3), and whether it obeys the inequalities.
    pub(crate) fn least(&self) -> (Vec<f64>, bool) {
        let (d, size) = (self.d, self.size());
        let mut z = vec![0.0; d + 1];
        if self.least_value(&z[..d]) >= -OBEYED * size {
            return (z[..d].to_vec(), true);
        }
        let (margin, alpha) = self.margin();
        if margin <= OBEYED * size {
            return (alpha, margin >= -OBEYED * size);
        }
        z[..d].iter_mut().zip(&alpha).for_each(|(z, alpha)| *z = alpha / size);
        let mut weight = 1.0;
        while weight < LAST {
            weight *= GROWTH;
            let objective = |z: &[f64], to: &mut Barrier| {
                for (i, z) in z[..d].iter().enumerate() {
                    to.value += 0.5 * weight * z * z;
                    to.gradient[i] += weight * z;
                    to.hessian[i * (d + 1) + i] += weight;
                    // t stays as it is
                    (to.hessian[i * (d + 1) + d], to.hessian[d * (d + 1) + i]) = (0.0, 0.0);
                }
                to.hessian[d * (d + 1) + d] += 1.0;
                to.gradient[d] = 0.0;
            };
            self.follow(&mut z, size, &objective);
        }
        (z[..d].iter().map(|z| z * size).collect(), true)
    }

    /// To the minimum of the barrier with an objective.
    fn follow(&self, z: &mut Vec<f64>, size: f64, objective: &dyn Fn(&[f64], &mut Barrier)) {
        let n = z.len();
        for _ in 0..NEWTON {
            let Some(mut here) = self.barrier(z, size) else { return };
            objective(z, &mut here);
            let down: Vec<f64> = here.gradient.iter().map(|g| -g).collect();
            let step = Elimination::new(here.hessian.clone(), n, SINGULAR).solve(&down);
            let slope = dot(&step, &here.gradient);
            if slope.is_nan() || slope >= -REACHED {
                return;
            }
            let mut length = 1.0;
            let found = (0..HALVINGS).find_map(|_| {
                let at: Vec<f64> = z.iter().zip(&step).map(|(z, s)| z + length * s).collect();
                length *= 0.5;
                let mut there = self.barrier(&at, size)?;
                objective(&at, &mut there);
                (there.value <= here.value + 0.25 * 2.0 * length * slope).then_some(at)
            });
            match found {
                Some(at) => *z = at,
                None => return,
            }
        }
    }

    /// The barrier of levels above `t`, within the bounds; none where one is violated.
    fn barrier(&self, z: &[f64], size: f64) -> Option<Barrier> {
        let d = self.d;
        let mut all = Barrier::new(d + 1);
        let (alpha, t) = (&z[..d], z[d]);
        let at = |(a, s): &AffineLevel| a / size + dot(s, alpha);
        let mut row = vec![0.0; d + 1];
        for level in &self.levels {
            let f = at(level) - t;
            (f > 0.0).then_some(())?;
            row[..d].copy_from_slice(&level.1);
            row[d] = -1.0;
            all.add(f, &row, &[]);
        }
        for [n, x, y] in &self.cones {
            let [most, along, across] = [at(n) - t, at(x), at(y)];
            let f = (most - along.hypot(across)) * (most + along.hypot(across));
            (most > 0.0 && f > 0.0).then_some(())?;
            let rows = [n, x, y].map(|it| {
                let mut row = it.1.clone();
                row.push(0.0);
                row
            });
            let [mut of_n, of_x, of_y] = rows;
            of_n[d] = -1.0;
            for i in 0..=d {
                row[i] = 2.0 * (most * of_n[i] - along * of_x[i] - across * of_y[i]);
            }
            all.add(f, &row, &[(2.0, &of_n), (-2.0, &of_x), (-2.0, &of_y)]);
        }
        row.fill(0.0);
        row[d] = -1.0;
        (CONE_CAP - t > 0.0).then_some(())?;
        all.add(CONE_CAP - t, &row, &[]);
        for i in 0..d {
            for sign in [1.0, -1.0] {
                let f = FAR - sign * z[i];
                (f > 0.0).then_some(())?;
                row.fill(0.0);
                row[i] = -sign;
                all.add(f, &row, &[]);
            }
        }
        Some(all)
    }

    /// Range of one component of the feasible `alpha` within the inequalities.
    pub(crate) fn width(&self, alpha: &[f64], part: usize) -> f64 {
        let largest_slope = self.levels.iter().map(|it| largest(&it.1)).fold(0.0, f64::max);
        let size = self.size().max(largest_slope);
        let reach = |sign: f64| {
            let obeys = |length: f64| {
                let mut at = alpha.to_vec();
                at[part] += sign * length;
                self.least_value(&at) >= -OBEYED * size
            };
            let (mut low, mut high) = (0.0, FAR * size);
            if obeys(high) {
                return f64::INFINITY;
            }
            for _ in 0..HALVINGS {
                let middle = 0.5 * (low + high);
                if obeys(middle) {
                    low = middle;
                } else {
                    high = middle;
                }
            }
            low
        };
        reach(1.0) + reach(-1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Random inequalities of `d` forces, some of which leave them without a bound.
    fn draw(case: u32, d: usize, count: usize) -> Shares {
        let mut random = f64::from(case).mul_add(0.618_033_988_75, 0.1).fract();
        let mut next = || {
            random = (random * 997.0 + 0.1).fract();
            2.0 * random - 1.0
        };
        let mut shares = Shares::new(d);
        for _ in 0..count {
            let row: Vec<f64> = (0..d).map(|_| 1e3 * next()).collect();
            shares.push(next() + 0.3, row.into_iter());
        }
        shares
    }

    /// The largest `t` at the points where three levels of two forces are equal.
    fn margin_by_vertices(shares: &Shares) -> f64 {
        let (count, mut best) = (shares.a.len(), f64::NEG_INFINITY);
        let level = |j: usize, x: [f64; 2]| shares.a[j] + dot(shares.row(j), &x);
        for (i, j, k) in
            (0..count).flat_map(|i| (0..i).flat_map(move |j| (0..j).map(move |k| (i, j, k))))
        {
            let apart = |one: usize, c: usize| shares.row(one)[c] - shares.row(k)[c];
            let (a, b, c, d) = (apart(i, 0), apart(i, 1), apart(j, 0), apart(j, 1));
            let (p, q) = (shares.a[k] - shares.a[i], shares.a[k] - shares.a[j]);
            let det = a * d - b * c;
            let x = [(p * d - b * q) / det, (a * q - c * p) / det];
            let t = level(k, x);
            if (0..count).all(|j| level(j, x) >= t - 1e-9) {
                best = best.max(t);
            }
        }
        best
    }

    #[test]
    fn the_margin_is_that_of_the_best_vertex() {
        let mut bounded = 0;
        for case in 0..300 {
            let shares = draw(case, 2, 3 + case as usize % 6);
            let margin = shares.margin();
            if margin.support.is_empty() {
                // some direction lowers none of them: one along the border of a row is among those
                let raises = (0..shares.a.len()).any(|i| {
                    let [x, y] = [shares.row(i)[0], shares.row(i)[1]];
                    [[y, -x], [-y, x]]
                        .iter()
                        .any(|to| (0..shares.a.len()).all(|j| dot(shares.row(j), to) > -1e-6))
                });
                assert!(raises, "{case}");
                continue;
            }
            bounded += 1;
            let exact = margin_by_vertices(&shares);
            assert!((margin.value - exact).abs() < 1e-11, "{case} {margin:?} {exact}");
            // at a vertex the sum of the levels that determine it is the margin
            let levels: Vec<usize> = margin.support.iter().map(|it| it.0).collect();
            let sum = shares.combined(&levels).unwrap();
            assert!((sum - exact).abs() < 1e-11, "{case}");
        }
        assert!(bounded > 100, "{bounded}");
    }

    #[test]
    fn the_least_forces_obey_the_inequalities_and_pull_at_those_that_they_reach() {
        let mut found = 0;
        for case in 0..400 {
            let (d, count) = (1 + case as usize % 4, 1 + case as usize % 9);
            let shares = draw(case, d, count);
            let Some((alpha, multipliers)) = shares.least() else {
                assert!(shares.margin().value < 0.0, "{case}");
                continue;
            };
            found += 1;
            let level = |j: usize| shares.a[j] + dot(shares.row(j), &alpha);
            assert!((0..count).all(|j| level(j) > -1e-10), "{case}");
            // alpha = S^T u, u >= 0, u . level = 0
            let mut pulled = vec![0.0; d];
            for (j, u) in multipliers {
                assert!(u >= 0.0 && level(j).abs() < 1e-10, "{case}");
                pulled.iter_mut().zip(shares.row(j)).for_each(|(x, s)| *x += u * s);
            }
            let off = pulled.iter().zip(&alpha).map(|(x, y)| (x - y).abs());
            assert!(off.fold(0.0, f64::max) < 1e-13, "{case}");
        }
        assert!(found > 200, "{found}");
    }
}

#[cfg(test)]
mod cone_shares_tests {
    use super::*;

    /// One sticking contact whose normal force and tangential force vary: `(p, x, y) = (1 + a, x_0 + b, 0)`.
    #[test]
    fn the_margin_of_one_cone_is_that_of_its_axis() {
        let mut shares = ConeShares::new(1);
        // n = .5 - .2 a, (x, y) = (a - .3, .1): largest distance to the surface
        shares.push_cone([(0.5, vec![-0.2]), (-0.3, vec![1.0]), (0.1, vec![0.0])]);
        let (margin, alpha) = shares.margin();
        let value = |a: f64| 0.5 - 0.2 * a - (a - 0.3_f64).hypot(0.1);
        // (a - .3)/hypot = -.2
        let a = 0.3 - 0.2 * 0.1 / (1.0_f64 - 0.04).sqrt();
        assert!((margin - value(a)).abs() < 1e-12, "{margin} {}", value(a));
        assert!((alpha[0] - a).abs() < 1e-5);
        let (least, obeys) = shares.least();
        assert!(obeys && value(least[0]).abs() < 1e-9 || least[0] == 0.0);
        assert!((shares.width(&alpha, 0) - 2.0 * 0.3).abs() < 0.7);
    }

    #[test]
    fn shares_without_freedom_in_the_cones_are_violated_by_as_much() {
        let mut shares = ConeShares::new(1);
        shares.push((1.0, vec![1.0]));
        shares.push((1.0, vec![-1.0]));
        shares.push_cone([(0.5, vec![0.0]), (0.6, vec![0.0]), (0.8, vec![0.0])]);
        assert!((shares.margin().0 + 0.5).abs() < 1e-12);
        assert!(!shares.least().1);
        let mut shares = ConeShares::new(1);
        shares.push((-1.0, vec![1.0]));
        shares.push((3.0, vec![-1.0]));
        assert!((shares.margin().0 - 1.0).abs() < 1e-12);
        let (least, obeys) = shares.least();
        assert!(obeys && (least[0] - 1.0).abs() < 1e-6, "{least:?}");
        assert!((shares.width(&least, 0) - 2.0).abs() < 1e-5);
    }
}
