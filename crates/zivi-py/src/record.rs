//! The record of a run as Python sees it: NumPy arrays that own its memory.

use crate::interface::{list, Array};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::exceptions::{PyMemoryError, PyValueError};
use pyo3::prelude::*;
use std::mem::ManuallyDrop;
use std::sync::{Mutex, OnceLock};
use zivi::{
    Columns, DensePath, Impact, Motion, PlotSamples, PointRun, Quantity, Restitution, Samples,
    Status, QUANTITIES,
};

use crate::interface::{advise, setup_error, EndedBy};
use crate::method::{Hits, MotionPath};

/// The columns, events and outcome of one run.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct RunRecord {
    /// Cached at first access, for samples stored as recorded.
    columns: OnceLock<Py<PyArray2<f64>>>,
    /// The samples, until columns are made of them.
    rows: Mutex<Option<Samples>>,
    /// How many entries of each column are samples.
    #[pyo3(get)]
    n_samples: usize,
    /// Samples between the steps for drawing, cached at first access; `None` if the motion is
    /// unknown or memory is insufficient.
    plotted: OnceLock<Option<PlotSamples>>,
    /// Their positions, until first access.
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
    /// Occurrences of each user event.
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
    raised: EndedBy,
}

#[pymethods]
impl RunRecord {
    /// A row for each of `t, x, xdot, s, v, lambda_s, lambda_v, residual`.
    #[getter]
    fn columns(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f64>>> {
        if let Some(made) = self.columns.get() {
            return Ok(made.clone_ref(py));
        }
        let columns = {
            let rows = self.rows.lock().map_err(|_| locked())?;
            let restitution = self.path.as_ref().map(|path| path.get().motion.restitution);
            match (rows.as_ref(), restitution) {
                (Some(rows), Some(wall)) => {
                    rows.columns(None, wall, advise).map_err(setup_error)?
                }
                _ => Columns::default(), // another thread made them
            }
        };
        // nothing is locked where Python may run
        let made = block_of(py, columns)?;
        let made = self.columns.get_or_init(|| made).clone_ref(py);
        if let Ok(mut rows) = self.rows.lock() {
            *rows = None;
        }
        Ok(made)
    }

    /// The time of the last sample, of which no columns need be made.
    #[getter]
    fn last(&self, py: Python<'_>) -> PyResult<Option<f64>> {
        if let Ok(Some(rows)) = self.rows.lock().as_deref() {
            return Ok(rows.last());
        }
        let columns = self.columns(py)?;
        let held = columns.bind(py).try_readonly().map_err(|_| locked())?;
        Ok(self.n_samples.checked_sub(1).and_then(|last| held.get([0, last]).copied()))
    }

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
    /// Result of a function of the drawing samples, if any, and of the columns at the steps.
    fn with_plotted<const N: usize>(
        &self,
        py: Python<'_>,
        make: impl FnOnce(Option<Plotted<'_>>, [&[f64]; QUANTITIES]) -> Option<[Vec<f64>; N]>,
    ) -> PyResult<[Array; N]> {
        let columns = self.columns(py)?;
        let held = columns.bind(py).try_readonly().map_err(|_| locked())?;
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
        let PointRun { trajectory, raised, rows, motion, hits, counts, .. } = run;
        let zivi::Trajectory { columns, events, failed_steps, status, nfev, .. } = trajectory;
        let (n_samples, made) = match &rows {
            Some(rows) => (rows.len(), OnceLock::new()),
            None => (columns.len(), OnceLock::from(block_of(py, columns)?)),
        };
        let failed_steps = failed_steps.iter().map(|&k| k as i64);
        Ok(Self {
            columns: made,
            rows: Mutex::new(rows),
            n_samples,
            plotted: OnceLock::new(),
            positions: Mutex::new(None),
            impacts: rows_of(py, events.impacts),
            zeno_times: array(events.zeno_times),
            liftoff_times: array(events.liftoff_times),
            rest_time: events.rest_time,
            failed_steps: crate::interface::array(py, failed_steps)?,
            hits: Hits::of(py, &hits, 1)?,
            n_steps: counts.accepted,
            n_rejected: counts.rejected,
            path: motion.map(|motion| Py::new(py, MotionPath { motion })).transpose()?,
            status: status as u8,
            message: status.message(),
            nfev,
            raised: EndedBy::new(raised),
        })
    }
}

fn locked() -> PyErr {
    PyValueError::new_err("the samples of a run must not be locked")
}

/// The columns of a run as a matrix.
fn block_of(py: Python<'_>, columns: Columns) -> PyResult<Py<PyArray2<f64>>> {
    let (block, room) = columns.into_block();
    Ok(PyArray1::from_vec(py, block).reshape([QUANTITIES, room])?.unbind())
}

/// The impacts in rows of time, velocity before and velocity after: the same memory.
pub(crate) fn rows_of(py: Python<'_>, impacts: Vec<Impact>) -> Array {
    const WIDTH: usize = size_of::<Impact>() / size_of::<f64>();
    const { assert!(WIDTH == 3 && align_of::<Impact>() == align_of::<f64>()) }
    let mut impacts = ManuallyDrop::new(impacts);
    let (len, room) = (WIDTH * impacts.len(), WIDTH * impacts.capacity());
    // SAFETY: an impact is three numbers in this order, so a vector of impacts has the layout of a
    // vector of numbers of triple length; it is freed only here
    let numbers = unsafe { Vec::from_raw_parts(impacts.as_mut_ptr().cast::<f64>(), len, room) };
    PyArray1::from_vec(py, numbers).unbind()
}

/// The message of every status, in the order of their numbers.
pub(crate) fn status_messages() -> Vec<&'static str> {
    Status::ALL.iter().map(|status| status.message()).collect()
}
