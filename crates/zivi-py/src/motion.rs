//! The motion of a mechanical system between the samples of a run.

use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use zivi::mechanics::{GapSet, MechanicalPath as Path};
use zivi::record::contact_mode::ContactMode;

use crate::arrays::{columns, members, Matrix, Vector};
use crate::friction::{modes_of, slips_of};

/// What restores an object, and its arguments.
type Reduced<'py> = (Bound<'py, PyAny>, (Bound<'py, PyArray1<f64>>,));
/// Coordinates, velocities, gaps, their rates, and which are closed.
type Motion = (Matrix<f64>, Matrix<f64>, Matrix<f64>, Matrix<f64>, Matrix<bool>);

/// Slip speeds, distances, dissipated work, and what the channels of friction do.
type Rubbed = (Matrix<f64>, Matrix<f64>, Vector<f64>, Matrix<i8>);

/// As many columns of impacts.
type FourArrays<'py> = (Column<'py>, Column<'py>, Column<'py>, Column<'py>);
type Column<'py> = Bound<'py, PyArray1<f64>>;

/// The motion of a mechanical system as a function of time.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct MechanicalPath {
    pub(crate) path: Path,
}

impl MechanicalPath {
    /// Positions, rates and modes at the times, one after the other.
    fn points(&self, times: &PyReadonlyArray1<'_, f64>) -> (Vec<f64>, Vec<f64>, Vec<ContactMode>) {
        let size = self.path.layout().size();
        let (mut x, mut v, mut modes) = (Vec::new(), Vec::new(), Vec::new());
        for &t in times.as_array() {
            match self.path.at(t) {
                Some(point) => {
                    x.extend(point.x);
                    v.extend(point.v);
                    modes.push(point.mode);
                }
                None => {
                    x.resize(x.len() + size, f64::NAN);
                    v.resize(v.len() + size, f64::NAN);
                    modes.push(ContactMode::default());
                }
            }
        }
        (x, v, modes)
    }
}

#[pymethods]
impl MechanicalPath {
    /// The times between which the motion is known.
    #[getter]
    fn span(&self) -> Option<(f64, f64)> {
        self.path.span()
    }

    /// `(q, qdot, gaps, gap_rates, contacts)` at the times, NaN outside of the span.
    fn at(&self, py: Python<'_>, times: PyReadonlyArray1<'_, f64>) -> PyResult<Motion> {
        let (layout, (x, v, modes)) = (self.path.layout(), self.points(&times));
        let (n, m) = (layout.n, layout.m);
        let closed: Vec<GapSet> = modes.iter().map(|mode| mode.closed).collect();
        let of = |values: &[f64], from, width| columns(py, values, layout.size(), from, width);
        let (q, qdot) = (of(&x, 0, n)?, of(&v, 0, n)?);
        Ok((q, qdot, of(&x, n, m)?, of(&v, n, m)?, members(py, &closed, m)?))
    }

    /// `(slips, slip_distances, dissipated, modes)` at the times, NaN outside of the span.
    fn friction_at(&self, py: Python<'_>, times: PyReadonlyArray1<'_, f64>) -> PyResult<Rubbed> {
        let (layout, (x, v, modes)) = (self.path.layout(), self.points(&times));
        if layout.p == 0 {
            return Err(PyValueError::new_err("the motion has no friction"));
        }
        let (slips, distances, dissipated) = slips_of(py, layout, &x, &v)?;
        Ok((slips, distances, dissipated, modes_of(py, &modes, layout.p)?))
    }

    /// Time, speed before and speed after of the impacts that jumps to Zeno points skipped, down
    /// to a speed after them and at most so many of each, and the times of these Zeno points.
    fn skipped_impacts<'py>(&self, py: Python<'py>, speed: f64, at_most: usize) -> FourArrays<'py> {
        let found: Vec<_> = self.path.skipped_impacts(speed, at_most).collect();
        let column = |of: fn(&(zivi::Impact, f64)) -> f64| -> Column<'py> {
            PyArray1::from_vec(py, found.iter().map(of).collect())
        };
        (
            column(|(it, _)| it.t),
            column(|(it, _)| it.xdot_before),
            column(|(it, _)| it.xdot_after),
            column(|(_, zeno)| *zeno),
        )
    }

    /// All that it consists of, as plain numbers.
    fn numbers<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.path.to_numbers())
    }

    /// What `numbers` came from; a ValueError for numbers that are none of a motion.
    #[staticmethod]
    fn restored(numbers: PyReadonlyArray1<'_, f64>) -> PyResult<Self> {
        let numbers: Vec<f64> = numbers.as_array().iter().copied().collect();
        let path = Path::from_numbers(&numbers);
        Ok(Self { path: path.map_err(|error| PyValueError::new_err(error.to_string()))? })
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        Ok((py.get_type::<Self>().getattr("restored")?, (self.numbers(py),)))
    }
}
