//! Walls that move.

use std::ffi::c_void;
use std::sync::Arc;

use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::gc::{PyTraverseError, PyVisit};
use pyo3::prelude::*;
use zivi::system::linear_system::GapMotion;
use zivi::{HarmonicWall, WallMotion};

use crate::interface::{array, vector};

/// The motion of a wall, of one of its kinds.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct Wall {
    kind: Kind,
}

enum Kind {
    Harmonic(HarmonicWall),
    /// Moves as the first column.
    Table(Py<PyTimeTable>),
    /// Gives position, velocity and acceleration.
    Callable(Py<PyAny>),
}

#[pymethods]
impl Wall {
    #[staticmethod]
    #[pyo3(signature = (*, amplitude, omega, phase, offset))]
    fn harmonic(amplitude: f64, omega: f64, phase: f64, offset: f64) -> Self {
        Self { kind: Kind::Harmonic(HarmonicWall { amplitude, omega, phase, offset }) }
    }

    #[staticmethod]
    fn table(table: Py<PyTimeTable>) -> Self {
        Self { kind: Kind::Table(table) }
    }

    #[staticmethod]
    fn callable(motion: Py<PyAny>) -> Self {
        Self { kind: Kind::Callable(motion) }
    }

    /// Whether runs do without the interpreter.
    #[getter]
    pub(crate) fn is_native(&self) -> bool {
        matches!(self.kind, Kind::Harmonic(_))
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        match &self.kind {
            Kind::Harmonic(_) => Ok(()),
            Kind::Table(table) => visit.call(table),
            Kind::Callable(motion) => visit.call(motion),
        }
    }
}

impl Wall {
    /// The motion of the wall of a gap, without the interpreter.
    pub(crate) fn motion_of_gap(&self) -> Option<GapMotion> {
        match &self.kind {
            Kind::Harmonic(wall) => Some(GapMotion::Harmonic(*wall)),
            Kind::Table(table) => Some(GapMotion::Table(table.get().inner.clone())),
            Kind::Callable(_) => None,
        }
    }
}

/// A wall prepared for evaluation.
pub(crate) enum AnyWall<'py> {
    Harmonic(HarmonicWall),
    Table(Bound<'py, PyTimeTable>),
    Callable(Bound<'py, PyAny>),
}

impl<'py> AnyWall<'py> {
    pub(crate) fn of(py: Python<'py>, wall: &Wall) -> Self {
        match &wall.kind {
            Kind::Harmonic(wall) => Self::Harmonic(*wall),
            Kind::Table(table) => Self::Table(table.bind(py).clone()),
            Kind::Callable(motion) => Self::Callable(motion.bind(py).clone()),
        }
    }
}

impl WallMotion<PyErr> for AnyWall<'_> {
    fn at(&mut self, t: f64) -> PyResult<[f64; 3]> {
        match self {
            Self::Harmonic(wall) => wall.at(t),
            Self::Table(table) => Ok(table.get().inner.motion(t, 0)),
            Self::Callable(motion) => {
                let (w, wdot, wddot) = motion.call1((t,))?.extract()?;
                Ok([w, wdot, wddot])
            }
        }
    }

    fn harmonic(&self) -> Option<HarmonicWall> {
        match self {
            Self::Harmonic(wall) => Some(*wall),
            Self::Table(_) | Self::Callable(_) => None,
        }
    }
}

// Tables of time that come from Python.

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
