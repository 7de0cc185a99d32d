//! Tables of time that come from Python.

use std::ffi::c_void;
use std::sync::Arc;

use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::interface::{array, vector};

/// Piecewise polynomials of time.
#[pyclass(frozen, module = "zivi._zivi", name = "TimeTable")]
pub(crate) struct PyTimeTable {
    pub(crate) inner: Arc<zivi::TimeTable>,
}

/// `void part(double t, double *q, double *qdot, double *out, void *table)`.
type PartOfModel = unsafe extern "C" fn(f64, *const f64, *const f64, *mut f64, *const c_void);

#[pymethods]
impl PyTimeTable {
    /// Knots, and by interval and column `order` coefficients; `ends` are the values outside, of
    /// all columns before and then after; without them the table is periodic.
    #[new]
    #[pyo3(signature = (knots, coefficients, *, order, width, ends=None))]
    fn new(
        knots: PyReadonlyArray1<'_, f64>,
        coefficients: PyReadonlyArray1<'_, f64>,
        order: usize,
        width: usize,
        ends: Option<(PyReadonlyArray1<'_, f64>, PyReadonlyArray1<'_, f64>)>,
    ) -> PyResult<Self> {
        let ends = ends.map(|(first, last)| Ok::<_, PyErr>([vector(&first)?, vector(&last)?]));
        let ends = ends.transpose()?;
        let sizes = (order, width);
        let inner = zivi::TimeTable::new(vector(&knots)?, vector(&coefficients)?, sizes, ends);
        let wrong = || PyValueError::new_err("knots, coefficients and ends do not fit together");
        Ok(Self { inner: Arc::new(inner.ok_or_else(wrong)?) })
    }

    /// All columns at some times, time by time, or their derivatives up to the second.
    #[pyo3(signature = (times, derivative=0))]
    fn values<'py>(
        &self,
        py: Python<'py>,
        times: PyReadonlyArray1<'py, f64>,
        derivative: usize,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        if derivative > 2 {
            return Err(PyValueError::new_err("derivative must be 0, 1 or 2"));
        }
        let (times, width) = (vector(&times)?, self.inner.width());
        let all = times
            .iter()
            .flat_map(|&t| (0..width).map(move |column| self.inner.motion(t, column)[derivative]));
        Ok(array(py, all)?.into_bound(py))
    }

    /// The first column and its two derivatives at a time.
    fn motion(&self, t: f64) -> [f64; 3] {
        self.inner.motion(t, 0)
    }

    /// All columns at a time, into an array.
    fn fill(&self, t: f64, out: &Bound<'_, PyArray1<f64>>) -> PyResult<()> {
        let mut out = out.try_readwrite()?;
        let out = out.as_slice_mut()?;
        if out.len() != self.inner.width() {
            return Err(PyValueError::new_err("out must have a place for each column"));
        }
        self.inner.values(t, out);
        Ok(())
    }

    /// Where a function is that fills in all columns, one for value and derivatives of the first
    /// column, and the data argument of both, which have the lifetime of this object.
    #[getter]
    fn functions(&self) -> (usize, usize, usize) {
        let (values, motion): (PartOfModel, PartOfModel) = (table_values, table_motion);
        (values as usize, motion as usize, Arc::as_ptr(&self.inner) as usize)
    }
}

impl PyTimeTable {
    /// The table, valid while its owner is held.
    pub(crate) fn held(owner: &Py<Self>) -> &'static zivi::TimeTable {
        // SAFETY: the object is frozen and does not move; callers hold it while they use the result
        // (a force in its `owner`).
        unsafe { &*Arc::as_ptr(&owner.get().inner) }
    }
}

unsafe extern "C" fn table_values(
    t: f64,
    _: *const f64,
    _: *const f64,
    out: *mut f64,
    table: *const c_void,
) {
    // SAFETY: the Python layer passes the table of `functions` and room for its columns.
    unsafe {
        let table = &*table.cast::<zivi::TimeTable>();
        table.values(t, std::slice::from_raw_parts_mut(out, table.width()));
    }
}

unsafe extern "C" fn table_motion(
    t: f64,
    _: *const f64,
    _: *const f64,
    out: *mut f64,
    table: *const c_void,
) {
    // SAFETY: as above, with room for three numbers.
    unsafe {
        let motion = (*table.cast::<zivi::TimeTable>()).motion(t, 0);
        std::slice::from_raw_parts_mut(out, 3).copy_from_slice(&motion);
    }
}
