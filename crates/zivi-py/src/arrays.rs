//! NumPy arrays of what a run leaves.

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1};
use pyo3::prelude::*;
use zivi::mechanics::GapSet;

pub(crate) type Vector<T> = Py<PyArray1<T>>;

pub(crate) type Matrix<T> = Py<PyArray2<T>>;

/// Rows of a matrix from one list: the columns `from .. from + width` of rows of length `stride`.
pub(crate) fn columns(
    py: Python<'_>,
    values: &[f64],
    stride: usize,
    from: usize,
    width: usize,
) -> PyResult<Matrix<f64>> {
    let rows = values.len().checked_div(stride).unwrap_or(0);
    let picked = values.chunks_exact(stride.max(1)).flat_map(|row| row[from..][..width].iter());
    let all: Vec<f64> = picked.copied().collect();
    Ok(PyArray1::from_vec(py, all).reshape([rows, width])?.unbind())
}

/// Which gaps are in each of the sets.
pub(crate) fn members(py: Python<'_>, sets: &[GapSet], m: usize) -> PyResult<Matrix<bool>> {
    let all: Vec<bool> = sets.iter().flat_map(|set| (0..m).map(|gap| set.has(gap))).collect();
    Ok(PyArray1::from_vec(py, all).reshape([sets.len(), m])?.unbind())
}

pub(crate) type Array = Py<PyArray1<f64>>;

/// A NumPy vector as a slice; a TypeError-free copy where it is not contiguous.
pub(crate) fn vector(array: &PyReadonlyArray1<'_, f64>) -> Vec<f64> {
    array.as_array().iter().copied().collect()
}
