//! NumPy arrays of what a run leaves.

use std::alloc::{alloc_zeroed, Layout};

use numpy::{Element, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1};
use pyo3::exceptions::PyMemoryError;
use pyo3::prelude::*;
use zivi::mechanics::GapSet;

pub(crate) type Vector<T> = Py<PyArray1<T>>;

pub(crate) type Matrix<T> = Py<PyArray2<T>>;

/// The error for so many numbers that do not fit.
fn no_room(n: usize) -> PyErr {
    PyMemoryError::new_err(format!("an array of {n} numbers does not fit into memory"))
}

/// An empty list with room for so many; a `MemoryError` where there is none.
pub(crate) fn with_room<T>(n: usize) -> PyResult<Vec<T>> {
    let mut list = Vec::new();
    list.try_reserve_exact(n).map_err(|_| no_room(n))?;
    Ok(list)
}

/// A list of values; a `MemoryError` where it does not fit (a `collect` would end the process).
pub(crate) fn list<T>(values: impl IntoIterator<Item = T>) -> PyResult<Vec<T>> {
    let values = values.into_iter();
    let (least, most) = values.size_hint();
    if most != Some(least) {
        return try_list(values.map(Ok));
    }
    let mut list = with_room(least)?;
    list.extend(values);
    Ok(list)
}

/// The same of values each of which may fail.
pub(crate) fn try_list<T>(values: impl IntoIterator<Item = PyResult<T>>) -> PyResult<Vec<T>> {
    let values = values.into_iter();
    let mut list = with_room(values.size_hint().0)?;
    for value in values {
        if list.len() == list.capacity() {
            list.try_reserve(1).map_err(|_| no_room(2 * list.len()))?;
        }
        list.push(value?);
    }
    Ok(list)
}

/// The same as an array.
pub(crate) fn array<T: Element>(
    py: Python<'_>,
    values: impl IntoIterator<Item = T>,
) -> PyResult<Vector<T>> {
    Ok(PyArray1::from_vec(py, list(values)?).unbind())
}

/// So many zeros, which take memory when they are written.
pub(crate) fn zeros(n: usize) -> PyResult<Vec<f64>> {
    let layout = Layout::array::<f64>(n).map_err(|_| no_room(n))?;
    if n == 0 {
        return Ok(Vec::new());
    }
    // SAFETY: the layout is not empty
    let start = unsafe { alloc_zeroed(layout) }.cast::<f64>();
    if start.is_null() {
        return Err(no_room(n));
    }
    // SAFETY: of the global allocator, as long as the layout of as many numbers; zeros are numbers
    Ok(unsafe { Vec::from_raw_parts(start, n, n) })
}

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
    let mut all = with_room(rows * width)?;
    all.extend(picked);
    Ok(PyArray1::from_vec(py, all).reshape([rows, width])?.unbind())
}

/// Which gaps are in each of the sets.
pub(crate) fn members(py: Python<'_>, sets: &[GapSet], m: usize) -> PyResult<Matrix<bool>> {
    let all = sets.iter().flat_map(|set| (0..m).map(|gap| set.has(gap)));
    Ok(array(py, all)?.into_bound(py).reshape([sets.len(), m])?.unbind())
}

pub(crate) type Array = Py<PyArray1<f64>>;

/// A NumPy vector as a slice; a TypeError-free copy where it is not contiguous.
pub(crate) fn vector(array: &PyReadonlyArray1<'_, f64>) -> PyResult<Vec<f64>> {
    list(array.as_array().iter().copied())
}

/// A motion as numbers, if they fit into memory.
pub(crate) fn stored(
    py: Python<'_>,
    numbers: Option<Vec<f64>>,
) -> PyResult<Bound<'_, PyArray1<f64>>> {
    let refused =
        || PyMemoryError::new_err("the motion of a run as numbers does not fit into memory");
    Ok(PyArray1::from_vec(py, numbers.ok_or_else(refused)?))
}
