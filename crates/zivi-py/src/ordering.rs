//! The order in which a sparse matrix is factorised, found with the interpreter's lock released.

use crate::aside::with_aside;
use crate::interface::list;
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Entries of a matrix up to which the work of the ordering is counted by its index type.
const MOST: usize = i32::MAX as usize / 4;

/// Maximal number of bytes of the ordering for each column, some 22 numbers, and for each entry:
/// 2.4 numbers of the matrix with its transpose, and a sorted copy.
const OF_COLUMN: usize = 30 * size_of::<u64>();
const OF_ENTRY: usize = 5 * size_of::<u64>();

/// Whether these are the columns of a square matrix, compressed.
fn is_pattern(starts: &[i32], rows: &[i32]) -> bool {
    let Some((&last, columns)) = starts.split_last() else { return false };
    let n = columns.len();
    columns.first().copied().unwrap_or(last) == 0
        && usize::try_from(last) == Ok(rows.len())
        && rows.len() <= MOST
        && starts.windows(2).all(|pair| pair[0] <= pair[1])
        && rows.iter().all(|&row| usize::try_from(row).is_ok_and(|row| row < n))
}

/// The rows and columns of a square matrix in an order of approximate minimum degree (Amestoy,
/// Davis & Duff), of its pattern and that of its transpose together.
#[pyfunction]
pub(crate) fn minimum_degree<'py>(
    py: Python<'py>,
    starts: PyReadonlyArray1<'py, i32>,
    rows: PyReadonlyArray1<'py, i32>,
) -> PyResult<Bound<'py, PyArray1<i32>>> {
    let (starts, rows) =
        (list(starts.as_array().iter().copied())?, list(rows.as_array().iter().copied())?);
    if !is_pattern(&starts, &rows) {
        return Err(PyValueError::new_err("starts and rows must be those of a square matrix"));
    }
    let n = starts.len() as i32 - 1;
    let needed = (OF_COLUMN * starts.len()).saturating_add(OF_ENTRY * rows.len());
    let found = py.detach(|| {
        with_aside(needed, || amd::order(n, &starts, &rows, &amd::Control::default()))
    })?;
    let (order, _, _) =
        found.map_err(|status| PyValueError::new_err(format!("no order: {status:?}")))?;
    Ok(PyArray1::from_vec(py, order))
}
