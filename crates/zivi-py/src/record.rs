//! The record of a run as Python sees it: NumPy arrays that own its memory.

use crate::arrays::{list, zeros, Array};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::exceptions::{PyMemoryError, PyValueError};
use pyo3::prelude::*;
use std::sync::{Mutex, OnceLock};
use zivi::{DensePath, Motion, PlotSamples, PointRun, Quantity, Restitution, Status, QUANTITIES};

use crate::errors::Raised;
use crate::switched_rk::MotionPath;
use crate::user_events::Hits;

/// The columns, events and outcome of one run.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct RunRecord {
    /// A row for each of `t, x, xdot, s, v, lambda_s, lambda_v, residual`.
    #[pyo3(get)]
    columns: Py<PyArray2<f64>>,
    /// How many entries of each row are samples.
    #[pyo3(get)]
    n_samples: usize,
    /// Where samples between the steps draw the motion, once they were asked for; none where the
    /// motion is not known, or there is no memory for more.
    plotted: OnceLock<Option<PlotSamples>>,
    /// The positions there, until they are asked for.
    positions: Mutex<Option<Vec<f64>>>,
    /// A row for each: time, velocity before and velocity after.
    #[pyo3(get)]
    impacts: Array,
    #[pyo3(get)]
    zeno_times: Array,
    #[pyo3(get)]
    liftoff_times: Array,
    #[pyo3(get)]
    rest_time: Option<f64>,
    #[pyo3(get)]
    failed_steps: Py<PyArray1<i64>>,
    /// What happened of each event of the user.
    #[pyo3(get)]
    hits: Vec<Py<Hits>>,
    #[pyo3(get)]
    n_steps: u64,
    #[pyo3(get)]
    n_rejected: u64,
    /// The motion between the samples, for a method that has one of its own.
    #[pyo3(get)]
    path: Option<Py<MotionPath>>,
    #[pyo3(get)]
    status: u8,
    #[pyo3(get)]
    message: &'static str,
    #[pyo3(get)]
    nfev: u64,
    #[pyo3(get)]
    raised: Raised,
}

#[pymethods]
impl RunRecord {
    /// A row of the columns with samples between the steps, so that lines draw the motion; that at
    /// the steps where the motion is not known, or there is no memory for more.
    fn drawn(&self, py: Python<'_>, row: usize) -> PyResult<Array> {
        let quantity = Quantity::ALL.get(row).copied();
        let quantity = quantity.ok_or_else(|| PyValueError::new_err("no such row"))?;
        self.with_plotted(py, |known, steps| {
            let Some((plotted, path, restitution)) = known else {
                return list(steps[row].iter().copied()).ok().map(|it| [it]);
            };
            let taken = match (quantity, self.positions.lock()) {
                (Quantity::X, Ok(mut positions)) => positions.take(),
                _ => None,
            };
            Some([match taken {
                Some(x) => x,
                None => plotted.column(quantity, path, steps, restitution)?,
            }])
        })
        .map(|[column]| column)
    }

    /// The same of `s, v, lambda_s, lambda_v`.
    fn drawn_lifted(&self, py: Python<'_>) -> PyResult<[Array; 4]> {
        self.with_plotted(py, |known, steps| match known {
            Some((plotted, path, restitution)) => plotted.lifted(path, steps, restitution),
            None => {
                let copied = |row: usize| list(steps[row].iter().copied()).ok();
                Some([copied(3)?, copied(4)?, copied(5)?, copied(6)?])
            }
        })
    }
}

/// Where there are samples that draw a motion, it, and its wall.
type Plotted<'a> = (&'a PlotSamples, &'a DensePath, Restitution);

impl RunRecord {
    /// What is made of the samples that draw the motion, if there are any, and of the columns at
    /// the steps.
    fn with_plotted<const N: usize>(
        &self,
        py: Python<'_>,
        make: impl FnOnce(Option<Plotted<'_>>, [&[f64]; QUANTITIES]) -> Option<[Vec<f64>; N]>,
    ) -> PyResult<[Array; N]> {
        let held = self.columns.bind(py).try_readonly();
        let locked = |_| PyValueError::new_err("the samples of a run must not be locked");
        let held = held.map_err(locked)?;
        let room = held.as_array().ncols();
        let rows: Vec<&[f64]> = held.as_slice()?.chunks_exact(room).collect();
        let steps: [&[f64]; QUANTITIES] = std::array::from_fn(|row| &rows[row][..self.n_samples]);
        let motion = self.path.as_ref().map(|path| &path.get().motion);
        let known = motion.and_then(|Motion { path, restitution, .. }| {
            let plotted = self.plotted.get_or_init(|| {
                let mut plotted = path.as_ref()?.plot_samples([steps[0], steps[1]])?;
                if let Ok(mut positions) = self.positions.lock() {
                    *positions = Some(plotted.take_positions());
                }
                Some(plotted)
            });
            Some((plotted.as_ref()?, path.as_ref()?, *restitution))
        });
        let no_memory = || PyMemoryError::new_err("there is no memory for the samples of a run");
        let columns = make(known, steps).ok_or_else(no_memory)?;
        Ok(columns.map(|column| PyArray1::from_vec(py, column).unbind()))
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
            plotted: OnceLock::new(),
            positions: Mutex::new(None),
            impacts: rows_of(py, &events.impacts)?,
            zeno_times: array(events.zeno_times),
            liftoff_times: array(events.liftoff_times),
            rest_time: events.rest_time,
            failed_steps: crate::arrays::array(py, failed_steps)?,
            hits: Hits::of(py, &hits, 1)?,
            n_steps: counts.accepted,
            n_rejected: counts.rejected,
            path: motion.map(|motion| Py::new(py, MotionPath { motion })).transpose()?,
            status: status as u8,
            message: status.message(),
            nfev,
            raised: Raised::new(raised),
        })
    }
}

/// The impacts in rows of time, velocity before and velocity after.
pub(crate) fn rows_of(py: Python<'_>, impacts: &[zivi::Impact]) -> PyResult<Array> {
    let mut rows = zeros(3 * impacts.len())?;
    for (row, it) in rows.chunks_exact_mut(3).zip(impacts) {
        row.copy_from_slice(&[it.t, it.xdot_before, it.xdot_after]);
    }
    Ok(PyArray1::from_vec(py, rows).unbind())
}

/// The message of every status, in the order of their numbers.
pub(crate) fn status_messages() -> Vec<&'static str> {
    Status::ALL.iter().map(|status| status.message()).collect()
}
