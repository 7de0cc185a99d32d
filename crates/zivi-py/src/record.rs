//! The record of a run as Python sees it: NumPy arrays that own its memory.

use crate::arrays::Array;
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use zivi::{Motion, PointRun, Status, QUANTITIES};

use crate::switched_rk::MotionPath;
use crate::user_events::Hits;
use crate::watch::advise;

/// The columns, events and outcome of one run.
#[pyclass(frozen, get_all, module = "zivi._zivi")]
pub(crate) struct RunRecord {
    /// A row for each of `t, x, xdot, s, v, lambda_s, lambda_v, residual`.
    columns: Py<PyArray2<f64>>,
    /// How many entries of each row are samples.
    n_samples: usize,
    /// A row for each: time, velocity before and velocity after.
    impacts: Array,
    zeno_times: Array,
    liftoff_times: Array,
    rest_time: Option<f64>,
    failed_steps: Py<PyArray1<i64>>,
    /// What happened of each event of the user.
    hits: Vec<Py<Hits>>,
    n_steps: u64,
    n_rejected: u64,
    /// The motion between the samples, for a method that has one of its own.
    path: Option<Py<MotionPath>>,
    status: u8,
    message: &'static str,
    nfev: u64,
    raised: Option<Py<PyAny>>,
}

#[pymethods]
impl RunRecord {
    /// The columns with samples between the steps, so that lines draw the motion, and how many
    /// entries of each row are samples; those at the steps where the motion is not known, or there
    /// is no memory for more.
    fn drawn(&self, py: Python<'_>) -> PyResult<(Py<PyArray2<f64>>, usize)> {
        let held = self.columns.bind(py).try_readonly();
        let locked = |_| PyValueError::new_err("the samples of a run must not be locked");
        let held = held.map_err(locked)?;
        let room = held.as_array().ncols();
        let rows: Vec<&[f64]> = held.as_slice()?.chunks_exact(room).collect();
        let steps = std::array::from_fn(|row| &rows[row][..self.n_samples]);
        let motion = self.path.as_ref().map(|path| &path.get().motion);
        let drawn = motion.and_then(|Motion { path, restitution, .. }| {
            path.as_ref()?.drawn(steps, *restitution, advise)
        });
        let Some(columns) = drawn else {
            return Ok((self.columns.clone_ref(py), self.n_samples));
        };
        let n_samples = columns.len();
        let (block, room) = columns.into_block();
        Ok((PyArray1::from_vec(py, block).reshape([QUANTITIES, room])?.unbind(), n_samples))
    }
}

impl RunRecord {
    pub(crate) fn new(py: Python<'_>, run: PointRun<PyErr>) -> PyResult<Self> {
        let array = |values: Vec<f64>| PyArray1::from_vec(py, values).unbind();
        let PointRun { trajectory, raised, motion, hits, counts, .. } = run;
        let zivi::Trajectory { columns, events, failed_steps, status, nfev, .. } = trajectory;
        let n_samples = columns.len();
        let (block, room) = columns.into_block();
        let failed_steps = failed_steps.iter().map(|&k| k as i64);
        Ok(Self {
            columns: PyArray1::from_vec(py, block).reshape([QUANTITIES, room])?.unbind(),
            n_samples,
            impacts: rows_of(py, &events.impacts),
            zeno_times: array(events.zeno_times),
            liftoff_times: array(events.liftoff_times),
            rest_time: events.rest_time,
            failed_steps: PyArray1::from_iter(py, failed_steps).unbind(),
            hits: Hits::of(py, &hits, 1)?,
            n_steps: counts.accepted,
            n_rejected: counts.rejected,
            path: motion.map(|motion| Py::new(py, MotionPath { motion })).transpose()?,
            status: status as u8,
            message: status.message(),
            nfev,
            raised: raised.map(|error| error.into_value(py).into_any()),
        })
    }
}

/// The impacts in rows of time, velocity before and velocity after.
pub(crate) fn rows_of(py: Python<'_>, impacts: &[zivi::Impact]) -> Array {
    let rows = impacts.iter().flat_map(|it| [it.t, it.xdot_before, it.xdot_after]);
    PyArray1::from_vec(py, rows.collect()).unbind()
}

/// The message of every status, in the order of their numbers.
pub(crate) fn status_messages() -> Vec<&'static str> {
    Status::ALL.iter().map(|status| status.message()).collect()
}
