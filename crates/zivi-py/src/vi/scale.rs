//! How small the numbers of an affine problem are: whether an absolute tolerance means something.

use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pulp::{Simd, WithSimd};
use pyo3::prelude::*;

use super::{are_finite, Bound1};

/// Sums that a processor has at once.
const LANES: usize = 8;

/// The least size of the rows and unknowns of `F(x) = matrix x + q` on a box, from what moves them
/// at the start, the point of the box nearest to `x0` (zero without one).
///
/// Of an unknown it is what balances a row, `max_i |F_i/M_ij|`, at most the width of the box, and
/// at least its value; of a row its value and what those moves change. Infinite where the numbers
/// of the problem are none, which the solver refuses.
#[pyfunction]
#[pyo3(signature = (matrix, q, lower, upper, x0))]
pub(crate) fn least_size<'py>(
    matrix: PyReadonlyArray2<'py, f64>,
    q: PyReadonlyArray1<'py, f64>,
    lower: Bound1<'py>,
    upper: Bound1<'py>,
    x0: Option<PyReadonlyArray1<'py, f64>>,
) -> PyResult<f64> {
    let (n, rows, q) = (matrix.shape()[0], matrix.as_slice()?, q.as_slice()?);
    let (lower, upper) = (lower.to_vec(n), upper.to_vec(n));
    let ordered = lower.iter().zip(&upper).all(|(low, high)| low <= high);
    if !ordered || !are_finite(rows) || !are_finite(q) {
        return Ok(f64::INFINITY);
    }
    let start = x0.map_or_else(|| vec![0.0; n], |x0| x0.as_array().to_vec());
    let bounds = lower.iter().zip(&upper);
    let x: Vec<f64> = start.iter().zip(bounds).map(|(x, (l, u))| x.clamp(*l, *u)).collect();
    if !x.iter().all(|it| it.is_finite()) {
        return Ok(f64::INFINITY);
    }
    Ok(pulp::Arch::new().dispatch(Sizes { rows, q, lower: &lower, upper: &upper, x: &x }))
}

/// The numbers of a problem, and the point of its box where it is looked at.
struct Sizes<'a> {
    rows: &'a [f64],
    q: &'a [f64],
    lower: &'a [f64],
    upper: &'a [f64],
    x: &'a [f64],
}

impl WithSimd for Sizes<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        self.least()
    }
}

impl Sizes<'_> {
    #[inline(always)]
    fn least(self) -> f64 {
        let Self { rows, q, lower, upper, x } = self;
        let n = q.len();
        let mut moves = vec![0.0; n];
        let mut values = Vec::with_capacity(n);
        for (row, q) in rows.chunks_exact(n).zip(q) {
            let mut sums = [0.0; LANES];
            for (row, x) in row.chunks(LANES).zip(x.chunks(LANES)) {
                for (sum, (m, x)) in sums.iter_mut().zip(row.iter().zip(x)) {
                    *sum += m * x;
                }
            }
            let value = (sums.iter().sum::<f64>() + q).abs();
            for (to, m) in moves.iter_mut().zip(row) {
                let moved = if *m == 0.0 { 0.0 } else { value / m.abs() };
                *to = if moved > *to { moved } else { *to };
            }
            values.push(value);
        }
        let or_one = |size: f64| if size > 0.0 { size } else { 1.0 };
        let widths = lower.iter().zip(upper).map(|(low, high)| or_one(high - low));
        let unknowns = moves.iter().zip(widths).zip(x).map(|((moved, width), x)| {
            let size = or_one(*moved).min(width);
            size.max(x.abs())
        });
        let unknowns: Vec<f64> = unknowns.collect();
        let mut least = unknowns.iter().copied().fold(f64::INFINITY, f64::min);
        for (row, value) in rows.chunks_exact(n).zip(values) {
            let mut most = [value; LANES];
            for (row, sizes) in row.chunks(LANES).zip(unknowns.chunks(LANES)) {
                for (most, (m, size)) in most.iter_mut().zip(row.iter().zip(sizes)) {
                    let moved = m.abs() * size.min(1.0);
                    *most = if moved > *most { moved } else { *most };
                }
            }
            least = least.min(or_one(most.into_iter().fold(value, f64::max)));
        }
        least
    }
}
