//! Equality rows: closed chains and prescribed motion, eliminated from the system that contacts act on.
//!
//! ```text
//! M q'' = F + G^T mu + N^T lambda      phi(t, q) = 0      G q' + phi_t = 0      G q'' + c = 0
//! D = G M^-1 G^T      A <- A - M^-1 G^T D^+ (G A + c)      M^-1 n <- M^-1 n - M^-1 G^T D^+ G M^-1 n   (1)
//! q <- q - M^-1 G^T D^+ phi      q' <- q' - M^-1 G^T D^+ (G q' + phi_t)                            (2)
//! ```
//!
//! After (1) free accelerations and mobilities are those of motion on the manifold `phi = 0`: the equations
//! of contact, friction and impacts hold as they are. Rows that follow from others are left out of `D`: the
//! motion is the same, and of the multipliers `mu` those of least norm in units of `D_aa^-1/2` are reported.

use crate::kinetics::shares::orthonormal;
use crate::numeric::cholesky;
use crate::numeric::cholesky::Factor;
use crate::numeric::dense::{axpy, dot, largest};
use crate::system::dynamics::Layout;

/// Left of `D_aa` by other rows: below this part the row follows from them.
const REDUNDANT: f64 = 1e-10;
/// A row whose `D_aa` is below this part of the largest has no gradient but rounding.
const NOTHING: f64 = 1e-24;
/// Largest residual of dependent rows, relative to their terms.
pub(super) const AGREES: f64 = 1e-6;
/// The same where the terms are smaller than one: rounding of terms that cancel, and lengths in metres.
const FLOOR: f64 = 1e-9;
/// Most iterations of a projection (2), and of its velocities at one place.
pub(super) const PROJECTIONS: usize = 8;
pub(super) const VELOCITIES: usize = 3;
/// A row with an error of this number of roundings is satisfied by a state at rest, which is not projected.
const CLEAR: f64 = 32.0;
/// An iteration that starts from this number of roundings is the last one.
pub(super) const SLIGHT: f64 = 100.0;

/// A value in units of its rounding.
fn in_noise((value, noise): (f64, f64)) -> f64 {
    match value == 0.0 {
        true => 0.0,
        false => value.abs() / noise.max(f64::MIN_POSITIVE),
    }
}

/// By how many roundings a state may be off the rows.
pub(super) fn clear(q: &[f64], w: &[f64]) -> f64 {
    match largest(w) <= f64::EPSILON * largest(q) {
        true => CLEAR,
        false => 0.0,
    }
}

/// The equality rows of a system at one state.
#[derive(Clone, Debug)]
pub(crate) struct Equalities {
    pub(super) layout: Layout,
    /// The rows `M^-1 G^T`.
    mobility: Vec<f64>,
    /// `D_aa^-1/2`, zero of a row without a gradient.
    pub(super) scales: Vec<f64>,
    /// Rows from which the others follow, and the factor of `D` on them in units of `D_aa`.
    pub(super) basis: Vec<usize>,
    factor: Vec<f64>,
    /// Whether the next evaluation is on the manifold: it chooses the basis again.
    pub(super) on_manifold: bool,
    /// `A` without the rows, and by coordinate the size of its terms with them.
    pub(super) free: Vec<f64>,
    pub(super) sizes: Vec<f64>,
    /// Contact forces by row, then the multipliers.
    pub(super) forces: Vec<f64>,
}

impl Equalities {
    pub(super) fn new(layout: Layout) -> Self {
        let zeros = |length: usize| vec![0.0; length];
        Self {
            layout,
            mobility: zeros(layout.k * layout.n),
            scales: zeros(layout.k),
            basis: Vec::new(),
            factor: Vec::new(),
            on_manifold: true,
            free: zeros(layout.n),
            sizes: zeros(layout.n),
            forces: zeros(layout.forces()),
        }
    }

    pub(super) fn gradient<'v>(&self, values: &'v [f64], row: usize) -> &'v [f64] {
        let n = self.layout.n;
        &values[self.layout.equality_gradient().start + row * n..][..n]
    }

    pub(super) fn mobility(&self, row: usize) -> &[f64] {
        let n = self.layout.n;
        &self.mobility[row * n..][..n]
    }

    /// `M^-1 G^T` and the factor of `D`.
    pub(super) fn renew(&mut self, values: &[f64], mass: &Factor) {
        let Layout { n, k, .. } = self.layout;
        self.mobility.copy_from_slice(&values[self.layout.equality_gradient()]);
        for (row, column) in self.mobility.chunks_exact_mut(n).enumerate() {
            mass.solve(column);
            let first = self.layout.equality_gradient().start + row * n;
            self.scales[row] = dot(&values[first..][..n], column);
        }
        let most = largest(&self.scales);
        for scale in &mut self.scales {
            *scale = if *scale > NOTHING * most { scale.sqrt().recip() } else { 0.0 };
        }
        if self.on_manifold {
            self.basis.clear();
            self.basis.extend(0..k);
        }
        if !self.factor_basis(values) {
            self.basis = self.independent(values);
            self.factor_basis(values);
        }
    }

    /// `D_ab` in units of the diagonal.
    fn d(&self, values: &[f64], a: usize, b: usize) -> f64 {
        self.scales[a] * self.scales[b] * dot(self.gradient(values, a), self.mobility(b))
    }

    /// Factors `D` on the basis: whether none of its rows follows from others.
    fn factor_basis(&mut self, values: &[f64]) -> bool {
        let size = self.basis.len();
        let mut matrix = std::mem::take(&mut self.factor);
        matrix.clear();
        matrix.resize(size * size, 0.0);
        for (i, &a) in self.basis.iter().enumerate() {
            for (j, &b) in self.basis[..=i].iter().enumerate() {
                matrix[i * size + j] = self.d(values, a, b);
            }
        }
        let left = cholesky::factor(&mut matrix, size);
        self.factor = matrix;
        left >= REDUNDANT
    }

    /// Rows from which all others follow, by a Cholesky factor with pivots.
    fn independent(&self, values: &[f64]) -> Vec<usize> {
        let k = self.layout.k;
        let mut left: Vec<f64> = (0..k).map(|a| self.d(values, a, a)).collect();
        let (mut factor, mut chosen) = (vec![Vec::new(); k], Vec::new());
        while chosen.len() < k {
            let most = left.iter().fold(0.0_f64, |a, b| a.max(*b));
            // of rows that are as independent the one with the largest gradient
            let may = (0..k).filter(|&a| left[a] >= 0.5 * most && left[a] >= REDUNDANT);
            let next = may.reduce(|a, b| if self.scales[b] < self.scales[a] { b } else { a });
            let Some(next) = next else { break };
            let (pivot, length) = (factor[next].clone(), left[next].sqrt());
            for a in 0..k {
                let entry = (self.d(values, a, next) - dot(&factor[a], &pivot)) / length;
                factor[a].push(entry);
                left[a] -= entry * entry;
            }
            left[next] = 0.0;
            chosen.push(next);
        }
        chosen.sort_unstable();
        chosen
    }

    /// `D^+ r` by row, zero at rows that are left out.
    pub(super) fn solve(&self, right: impl Fn(usize) -> f64) -> Vec<f64> {
        let scaled = |&a: &usize| self.scales[a] * right(a);
        let mut x: Vec<f64> = self.basis.iter().map(scaled).collect();
        cholesky::solve(&self.factor, x.len(), &mut x);
        let mut all = vec![0.0; self.layout.k];
        self.basis.iter().zip(&x).for_each(|(&a, x)| all[a] = self.scales[a] * x);
        all
    }

    /// `x <- x - M^-1 G^T D^+ r`.
    pub(super) fn pull(&self, x: &mut [f64], right: impl Fn(usize) -> f64) {
        for (a, size) in self.solve(right).into_iter().enumerate() {
            if size != 0.0 {
                axpy(x, -size, self.mobility(a));
            }
        }
    }

    /// Of all multipliers with the same force those of least norm in units of `D_aa^-1/2`.
    pub(super) fn shorten(&self, values: &[f64], multipliers: &mut [f64]) {
        let k = self.layout.k;
        if self.basis.len() == k {
            return;
        }
        let mut null = Vec::new();
        for last in (0..k).filter(|row| !self.basis.contains(row) && self.scales[*row] > 0.0) {
            let unscaled = self.solve(|row| dot(self.gradient(values, row), self.mobility(last)));
            let each = unscaled.iter().zip(&self.scales);
            let scaled = |(x, scale): (&f64, &f64)| if *x == 0.0 { 0.0 } else { x / scale };
            let mut nu: Vec<f64> = each.map(scaled).collect();
            nu[last] = -1.0 / self.scales[last];
            null.push(nu);
        }
        let mut x: Vec<f64> = multipliers
            .iter()
            .zip(&self.scales)
            .map(|(force, scale)| if *scale > 0.0 { force / scale } else { 0.0 })
            .collect();
        for nu in orthonormal(&null) {
            let along = dot(&nu, &x);
            axpy(&mut x, -along, &nu);
        }
        for ((force, x), scale) in multipliers.iter_mut().zip(&x).zip(&self.scales) {
            *force = x * scale;
        }
    }

    /// `phi` of a row, and the effect of rounding of the coordinates on it.
    pub(super) fn value(&self, values: &[f64], row: usize, q: &[f64]) -> (f64, f64) {
        let size: f64 = self.gradient(values, row).iter().map(|g| g.abs()).sum();
        (values[self.layout.equality().start + row], f64::EPSILON * size * largest(q))
    }

    /// `G q' + phi_t` of a row, and its rounding error.
    pub(super) fn rate(&self, values: &[f64], row: usize, w: &[f64]) -> (f64, f64) {
        let (gradient, by_time) =
            (self.gradient(values, row), values[self.layout.equality_rate().start + row]);
        let size: f64 = gradient.iter().map(|g| g.abs()).sum();
        (dot(gradient, w) + by_time, f64::EPSILON * (size * largest(w) + by_time.abs()))
    }

    /// `G a + c` of a row.
    pub(super) fn acceleration(&self, values: &[f64], row: usize, a: &[f64]) -> f64 {
        dot(self.gradient(values, row), a) + values[self.layout.equality_curvature().start + row]
    }

    /// How far a position is from the manifold, in units of rounding.
    pub(super) fn far(&self, values: &[f64], q: &[f64]) -> f64 {
        (0..self.layout.k).map(|row| in_noise(self.value(values, row, q))).fold(0.0, f64::max)
    }

    /// The same of velocities.
    pub(super) fn fast(&self, values: &[f64], w: &[f64]) -> f64 {
        (0..self.layout.k).map(|row| in_noise(self.rate(values, row, w))).fold(0.0, f64::max)
    }

    /// One iteration of the first of (2).
    pub(super) fn pull_position(&self, values: &[f64], q: &mut [f64]) {
        let phi = self.layout.equality().start;
        self.pull(q, |row| values[phi + row]);
    }

    /// One iteration of the second of (2).
    pub(super) fn pull_velocity(&self, values: &[f64], w: &mut [f64]) {
        let rates: Vec<f64> = (0..self.layout.k).map(|row| self.rate(values, row, w).0).collect();
        self.pull(w, |row| rates[row]);
    }

    /// Whether a state obeys the rows to `AGREES` of their terms, or to `FLOOR` of coordinates of one.
    pub(super) fn obeys(&self, values: &[f64], (q, w): (&[f64], &[f64])) -> bool {
        (0..self.layout.k).all(|row| {
            let size: f64 = self.gradient(values, row).iter().map(|g| g.abs()).sum();
            let floor = FLOOR * size.max(1.0);
            let (value, rate) = (self.value(values, row, q).0, self.rate(values, row, w).0);
            let by_time = values[self.layout.equality_rate().start + row].abs();
            value.abs() <= AGREES * size * largest(q) + floor
                && rate.abs() <= AGREES * (size * largest(w) + by_time) + floor
        })
    }
}
