//! The motion of a mass between the samples of a run.

use numpy::{PyArray1, PyReadonlyArray1, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use zivi::{DensePath, Motion, Physical};
use zivi_core::{transform, Branch};

use crate::arrays::{array, list, stored, vector, zeros, Array};

/// The motion between the samples of a run.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct MotionPath {
    pub(crate) motion: Motion,
}

type Arrays<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);
/// What restores an object, and its arguments.
type Reduced<'py> = (Bound<'py, PyAny>, (Bound<'py, PyArray1<f64>>,));

impl MotionPath {
    /// The motion of the plant of a closed loop.
    pub(crate) fn of_loop(path: DensePath, restitution: zivi::Restitution) -> Self {
        let tails = path.tails().to_vec();
        Self { motion: Motion { path: Some(path), tails, restitution } }
    }

    /// Two quantities of the motion at each time, NaN outside of the span.
    fn sample<'py>(
        &self,
        py: Python<'py>,
        times: &PyReadonlyArray1<'py, f64>,
        of: impl Fn(zivi::PathPoint) -> (f64, f64),
    ) -> PyResult<Arrays<'py>> {
        let mut reader = self.motion.path.as_ref().map(DensePath::reader);
        let mut at = |&t: &f64| {
            let point = reader.as_mut().and_then(|reader| reader.at(t));
            point.map_or((f64::NAN, f64::NAN), &of)
        };
        let mut both = [zeros(times.len())?, zeros(times.len())?];
        for (k, t) in times.as_array().iter().enumerate() {
            (both[0][k], both[1][k]) = at(t);
        }
        let [first, second] = both.map(|it| PyArray1::from_vec(py, it));
        Ok((first, second))
    }
}

#[pymethods]
impl MotionPath {
    /// All that it consists of, as plain numbers.
    fn numbers<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        stored(py, self.motion.to_numbers())
    }

    /// What `numbers` came from; a ValueError for numbers that are none of a motion.
    #[staticmethod]
    fn restored(numbers: PyReadonlyArray1<'_, f64>) -> PyResult<Self> {
        let numbers = vector(&numbers)?;
        let motion = Motion::from_numbers(&numbers);
        Ok(Self { motion: motion.map_err(|error| PyValueError::new_err(error.to_string()))? })
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        Ok((py.get_type::<Self>().getattr("restored")?, (self.numbers(py)?,)))
    }

    /// Whether the motion between the samples is known.
    #[getter]
    fn dense(&self) -> bool {
        self.motion.path.is_some()
    }

    /// The times between which the motion is known.
    #[getter]
    fn span(&self) -> Option<(f64, f64)> {
        self.motion.path.as_ref().and_then(DensePath::span)
    }

    /// Where a step, a tail or a rest begins, in order.
    fn starts(&self, py: Python<'_>) -> PyResult<Array> {
        array(py, self.motion.path.iter().flat_map(DensePath::starts))
    }

    /// `(x, xdot)` at the times.
    fn physical<'py>(
        &self,
        py: Python<'py>,
        times: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Arrays<'py>> {
        self.sample(py, &times, |point| (point.x, point.xdot))
    }

    /// `(s, v)` at the times.
    fn lifted<'py>(
        &self,
        py: Python<'py>,
        times: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Arrays<'py>> {
        self.sample(py, &times, |zivi::PathPoint { x, xdot, sigma }| {
            let branch = if sigma > 0.0 { Branch::Positive } else { Branch::Negative };
            let z = transform::lift(Physical { x, xdot }, branch, self.motion.restitution);
            (z.s + 0.0, z.v + 0.0)
        })
    }

    /// Times and velocities before and after of the impacts that jumps to rest skipped, down to
    /// a speed after them, at most so many of each accumulation.
    fn skipped_impacts(
        &self,
        py: Python<'_>,
        speed: f64,
        at_most: usize,
    ) -> PyResult<(Array, Array, Array)> {
        let tails = self.motion.tails.iter();
        let impacts = list(tails.flat_map(|tail| tail.impacts_down_to(speed, at_most)))?;
        let column = |of: fn(&zivi::Impact) -> f64| array(py, impacts.iter().map(of));
        Ok((column(|it| it.t)?, column(|it| it.xdot_before)?, column(|it| it.xdot_after)?))
    }

    /// Start and end of the accumulations that were extrapolated.
    #[getter]
    fn tails(&self) -> Vec<(f64, f64)> {
        self.motion.tails.iter().map(|tail| (tail.start(), tail.zeno_time())).collect()
    }
}
