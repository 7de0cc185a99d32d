//! The motion of a mechanical system between the samples of a run.

use crate::friction::{modes_of, slips_of};
use crate::interface::{array, columns, list, members, stored, vector, Array, Matrix, Vector};
use crate::transform::PyRestitution;
use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use zivi::mechanics::MechanicalPath;
use zivi::record::gap_set::ContactMode;
use zivi::stepping::ballistic;
use zivi::{Events, Physical};

/// Constructor of an object and its arguments (pickle).
type Reduced<'py> = (Bound<'py, PyAny>, (Bound<'py, PyArray1<f64>>,));
/// Coordinates, velocities, gaps, their rates, and which are closed.
type Motion = (Matrix<f64>, Matrix<f64>, Matrix<f64>, Matrix<f64>, Matrix<bool>);

/// Slip speeds, distances, dissipated work, and modes of the friction channels.
type Rubbed = (Matrix<f64>, Matrix<f64>, Vector<f64>, Matrix<i8>);

/// As many columns of impacts.
type FourArrays = (Array, Array, Array, Array);

/// Positions, rates and modes.
type Points = (Vec<f64>, Vec<f64>, Vec<ContactMode>);

/// The motion of a mechanical system as a function of time.
#[pyclass(frozen, module = "zivi._zivi", name = "MechanicalPath")]
pub(crate) struct PyMechanicalPath {
    pub(crate) path: MechanicalPath,
}

impl PyMechanicalPath {
    /// Positions, rates and modes at the times, one after the other.
    fn points(&self, times: &PyReadonlyArray1<'_, f64>) -> PyResult<Points> {
        let (size, n) = (self.path.layout().size(), times.len());
        let unknown = || list(std::iter::repeat_n(f64::NAN, n * size));
        let (mut x, mut v) = (unknown()?, unknown()?);
        let mut modes = list(std::iter::repeat_n(ContactMode::default(), n))?;
        for (k, &t) in times.as_array().iter().enumerate() {
            if let Some(point) = self.path.at(t) {
                x[k * size..][..size].copy_from_slice(&point.x);
                v[k * size..][..size].copy_from_slice(&point.v);
                modes[k] = point.mode;
            }
        }
        Ok((x, v, modes))
    }
}

#[pymethods]
impl PyMechanicalPath {
    /// The times between which the motion is known.
    #[getter]
    fn span(&self) -> Option<(f64, f64)> {
        self.path.span()
    }

    /// `(q, qdot, gaps, gap_rates, contacts)` at the times, NaN outside of the span.
    fn at(&self, py: Python<'_>, times: PyReadonlyArray1<'_, f64>) -> PyResult<Motion> {
        let (layout, (x, v, modes)) = (self.path.layout(), self.points(&times)?);
        let (n, m) = (layout.n, layout.m);
        let closed = list(modes.iter().map(|mode| mode.in_contact()))?;
        let of = |values: &[f64], from, width| columns(py, values, layout.size(), from, width);
        let (q, qdot) = (of(&x, 0, n)?, of(&v, 0, n)?);
        Ok((q, qdot, of(&x, n, m)?, of(&v, n, m)?, members(py, &closed, m)?))
    }

    /// `(slips, slip_distances, dissipated, modes)` at the times, NaN outside of the span.
    fn friction_at(&self, py: Python<'_>, times: PyReadonlyArray1<'_, f64>) -> PyResult<Rubbed> {
        let (layout, (x, v, modes)) = (self.path.layout(), self.points(&times)?);
        if layout.p == 0 {
            return Err(PyValueError::new_err("the motion has no friction"));
        }
        let (slips, distances, dissipated) = slips_of(py, layout, &x, &v)?;
        Ok((slips, distances, dissipated, modes_of(py, &modes, layout.p)?))
    }

    /// Time, speed before and speed after of the impacts that Zeno extrapolation skipped, down to a
    /// speed after them and up to a maximal number each, and the times of these Zeno points.
    fn skipped_impacts(&self, py: Python<'_>, speed: f64, at_most: usize) -> PyResult<FourArrays> {
        let found = list(self.path.skipped_impacts(speed, at_most))?;
        let column = |of: fn(&(zivi::Impact, f64)) -> f64| array(py, found.iter().map(of));
        Ok((
            column(|(it, _)| it.t)?,
            column(|(it, _)| it.xdot_before)?,
            column(|(it, _)| it.xdot_after)?,
            column(|(_, zeno)| *zeno)?,
        ))
    }

    /// All that it consists of, as plain numbers.
    fn numbers<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        stored(py, self.path.to_numbers())
    }

    /// Restores the object from `numbers`; a ValueError for invalid numbers.
    #[staticmethod]
    fn restored(numbers: PyReadonlyArray1<'_, f64>) -> PyResult<Self> {
        let numbers = vector(&numbers)?;
        let path = MechanicalPath::from_numbers(&numbers);
        Ok(Self { path: path.map_err(|error| PyValueError::new_err(error.to_string()))? })
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        Ok((py.get_type::<Self>().getattr("restored")?, (self.numbers(py)?,)))
    }
}

// Exact motion under constant forces, from Python.

/// Where motions are after a while.
#[pyclass(frozen, get_all, module = "zivi._zivi")]
pub(crate) struct Ballistic {
    x: Array,
    xdot: Array,
    n_impacts: Array,
}

/// The exact motion from states `x, x'` (rows) under accelerations for durations (columns 2 and 3
/// of the rows).
#[pyfunction]
pub(crate) fn ballistic_motion(
    py: Python<'_>,
    rows: PyReadonlyArray2<'_, f64>,
    restitution: PyRef<'_, PyRestitution>,
) -> PyResult<Ballistic> {
    let rows = rows.as_array();
    let motions = rows.rows().into_iter().map(|row| {
        let (state, mut events) = (Physical { x: row[0], xdot: row[1] }, Events::default());
        let span = (0.0, row[3]);
        let end = ballistic::advance(state, row[2], restitution.inner, span, &mut events);
        (end, events.impacts.len())
    });
    let motions = list(motions)?;
    let column = |of: fn(&(Physical, usize)) -> f64| array(py, motions.iter().map(of));
    Ok(Ballistic {
        x: column(|it| it.0.x)?,
        xdot: column(|it| it.0.xdot)?,
        n_impacts: column(|it| it.1 as f64)?,
    })
}
