//! How small the numbers of an affine problem are: whether an absolute tolerance means something.

use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pulp::{Simd, WithSimd};
use pyo3::prelude::*;

use super::{are_finite, Bound1};
use crate::arrays::{list, vector, zeros};

/// Sums that a processor has at once.
const LANES: usize = 8;
/// Multiple of the limit from which on rounding cannot bring a size below it.
const SAFE: f64 = 2.0;

/// Whether some row or unknown of `F(x) = matrix x + q` on a box is smaller than `limit`, by what
/// moves it at the start, the point of the box nearest to `x0` (zero without one).
///
/// The size of an unknown is what balances a row, `max_i |F_i/M_ij|`, at most the width of the box,
/// and at least its value; that of a row its value and what those moves change. False where the
/// numbers of the problem are none, which the solver refuses.
#[pyfunction]
#[pyo3(signature = (matrix, q, lower, upper, x0, limit))]
pub(crate) fn is_off_scale<'py>(
    matrix: PyReadonlyArray2<'py, f64>,
    q: PyReadonlyArray1<'py, f64>,
    lower: Bound1<'py>,
    upper: Bound1<'py>,
    x0: Option<PyReadonlyArray1<'py, f64>>,
    limit: f64,
) -> PyResult<bool> {
    let (n, rows, q) = (matrix.shape()[0], matrix.as_slice()?, q.as_slice()?);
    let (lower, upper) = (lower.to_vec(n)?, upper.to_vec(n)?);
    if !lower.iter().zip(&upper).all(|(low, high)| low <= high) {
        return Ok(false);
    }
    let start = x0.map_or_else(|| zeros(n), |x0| vector(&x0))?;
    let bounds = lower.iter().zip(&upper);
    let x = list(start.iter().zip(bounds).map(|(x, (l, u))| x.clamp(*l, *u)))?;
    let sizes = Sizes { rows, q, lower: &lower, upper: &upper, x: &x };
    let values = pulp::Arch::new().dispatch(Values(&sizes));
    if sizes.are_safe(&values, SAFE * limit) {
        return Ok(false);
    }
    let finite = [rows, q, &x].into_iter().all(are_finite);
    Ok(finite && pulp::Arch::new().dispatch(Least(&sizes, &values)) < limit)
}

/// The numbers of a problem, and the point of its box where it is looked at.
struct Sizes<'a> {
    rows: &'a [f64],
    q: &'a [f64],
    lower: &'a [f64],
    upper: &'a [f64],
    x: &'a [f64],
}

/// `|F_i|` at the point.
struct Values<'a>(&'a Sizes<'a>);

impl WithSimd for Values<'_> {
    type Output = Vec<f64>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Vec<f64> {
        self.0.values()
    }
}

/// The least size, from the values.
struct Least<'a>(&'a Sizes<'a>, &'a [f64]);

impl WithSimd for Least<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        self.0.least(self.1)
    }
}

fn or_one(size: f64) -> f64 {
    if size > 0.0 {
        size
    } else {
        1.0
    }
}

impl Sizes<'_> {
    #[inline(always)]
    fn values(&self) -> Vec<f64> {
        if self.x.iter().all(|x| *x == 0.0) {
            return self.q.iter().map(|q| q.abs()).collect();
        }
        let rows = self.rows.chunks_exact(self.q.len()).zip(self.q);
        let value = |(row, q): (&[f64], &f64)| {
            let mut sums = [0.0; LANES];
            for (row, x) in row.chunks(LANES).zip(self.x.chunks(LANES)) {
                for (sum, (m, x)) in sums.iter_mut().zip(row.iter().zip(x)) {
                    *sum += m * x;
                }
            }
            (sums.iter().sum::<f64>() + q).abs()
        };
        rows.map(value).collect()
    }

    /// The size of an unknown that a row moves so far.
    fn unknown(&self, j: usize, moved: f64) -> f64 {
        let width = or_one(self.upper[j] - self.lower[j]);
        or_one(moved).min(width).max(self.x[j].abs())
    }

    /// Whether a look at a few entries shows that nothing is smaller than `limit`. It is one row
    /// that moves most unknowns, and most rows have a value of that size themselves.
    fn are_safe(&self, values: &[f64], limit: f64) -> bool {
        let n = self.q.len();
        let rows = || self.rows.chunks_exact(n).zip(values);
        let mut unknowns: Vec<f64> = self.x.iter().map(|x| x.abs()).collect();
        let mut open: Vec<usize> = (0..n).filter(|&j| unknowns[j] < limit).collect();
        for (row, value) in rows() {
            if open.is_empty() {
                break;
            }
            open.retain(|&j| {
                let moved = value / row[j].abs();
                if moved > 0.0 && moved < f64::INFINITY {
                    unknowns[j] = self.unknown(j, moved);
                }
                unknowns[j] < limit
            });
        }
        let moves = |row: &[f64]| {
            let mut entries = row.iter().zip(&unknowns);
            entries.any(|(m, unknown)| m.abs() * unknown.min(1.0) >= limit)
        };
        open.is_empty() && rows().all(|(row, value)| *value >= limit || moves(row))
    }

    #[inline(always)]
    fn least(&self, values: &[f64]) -> f64 {
        let n = self.q.len();
        let mut moves = vec![0.0; n];
        for (row, value) in self.rows.chunks_exact(n).zip(values) {
            for (to, m) in moves.iter_mut().zip(row) {
                let moved = if *m == 0.0 { 0.0 } else { value / m.abs() };
                *to = if moved > *to { moved } else { *to };
            }
        }
        let unknowns = moves.iter().enumerate().map(|(j, moved)| self.unknown(j, *moved));
        let unknowns: Vec<f64> = unknowns.collect();
        let mut least = unknowns.iter().copied().fold(f64::INFINITY, f64::min);
        for (row, value) in self.rows.chunks_exact(n).zip(values) {
            let mut most = [*value; LANES];
            for (row, sizes) in row.chunks(LANES).zip(unknowns.chunks(LANES)) {
                for (most, (m, size)) in most.iter_mut().zip(row.iter().zip(sizes)) {
                    let moved = m.abs() * size.min(1.0);
                    *most = if moved > *most { moved } else { *most };
                }
            }
            least = least.min(or_one(most.into_iter().fold(*value, f64::max)));
        }
        least
    }
}
