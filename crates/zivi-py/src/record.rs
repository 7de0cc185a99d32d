//! The record of a run as Python sees it: NumPy arrays that own its memory.

use std::mem::ManuallyDrop;
use std::sync::{Mutex, OnceLock};

use numpy::{
    PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArrayDyn,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyMemoryError, PyValueError};
use pyo3::prelude::*;
use zivi::mechanics::{GapSet, MechanicalPath, MechanicalRun, Modes, Occurrence};
use zivi::record::gap_set::ContactMode;
use zivi::stepping::ballistic;
use zivi::system::dynamics::Layout;
use zivi::{
    Columns, DensePath, Events, Impact, Motion, Physical, PlotSamples, PointRun, Quantity,
    Restitution, Samples, Status, QUANTITIES,
};

use crate::friction::{modes_of, slips_of, FrictionRecord};
use crate::interface::{
    advise, array, columns, list, members, setup_error, stored, vector, Array, EndedBy, Matrix,
    Vector,
};
use crate::method::{Hits, MotionPath};
use crate::system::PyRestitution;

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

// The motion of a mechanical system between the samples of a run.

/// Constructor of an object and its arguments (pickle).
type Reduced<'py> = (Bound<'py, PyAny>, (Bound<'py, PyArray1<f64>>,));
/// Coordinates, velocities, gaps, their rates, and which are closed.
type StateArrays = (Matrix<f64>, Matrix<f64>, Matrix<f64>, Matrix<f64>, Matrix<bool>);

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
    fn at(&self, py: Python<'_>, times: PyReadonlyArray1<'_, f64>) -> PyResult<StateArrays> {
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

    /// The complete state as plain numbers.
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

/// Positions and velocities of motions after a time.
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

// Mechanical systems from Python: the record of a run.

/// Samples, occurrences and outcome of one run.
#[pyclass(frozen, get_all, module = "zivi._zivi")]
pub(crate) struct MechanicalRecord {
    t: Vector<f64>,
    q: Matrix<f64>,
    qdot: Matrix<f64>,
    gaps: Matrix<f64>,
    gap_rates: Matrix<f64>,
    reactions: Matrix<f64>,
    /// Multipliers of the equality rows, where there are any.
    constraint_forces: Option<Matrix<f64>>,
    contacts: Matrix<bool>,
    /// Time of the last event, and the largest speeds from the start and from that time on, where
    /// only the ends are sampled.
    speeds: Option<(f64, f64, f64)>,
    /// Occurrences at the gaps, if any.
    occurrences: Option<Py<Occurrences>>,
    /// Occurrences of each user event.
    hits: Vec<Py<Hits>>,
    status: u8,
    message: &'static str,
    nfev: u64,
    n_steps: u64,
    n_rejected: u64,
    n_impacts: u64,
    raised: EndedBy,
    path: Option<Py<PyMechanicalPath>>,
    /// Friction results, if any.
    friction: Option<Py<FrictionRecord>>,
}

/// Impacts, accumulations, lift-offs, openings, corners and flags, a column for each field.
#[pyclass(frozen, get_all, module = "zivi._zivi")]
pub(crate) struct Occurrences {
    impact_t: Vector<f64>,
    impact_gap: Vector<i64>,
    impact_speed_before: Vector<f64>,
    impact_speed_after: Vector<f64>,
    impact_impulse: Vector<f64>,
    impact_group: Vector<i64>,
    zeno_t: Vector<f64>,
    zeno_gap: Vector<i64>,
    zeno_closed: Matrix<bool>,
    contact_t: Vector<f64>,
    contact_gap: Vector<i64>,
    liftoff_t: Vector<f64>,
    liftoff_gap: Vector<i64>,
    opened_t: Vector<f64>,
    opened_gap: Vector<i64>,
    corner_t: Vector<f64>,
    corner_gaps: Matrix<bool>,
    flag_kind: Vec<&'static str>,
    flag_t: Vector<f64>,
    flag_gaps: Matrix<bool>,
    flag_size: Vector<f64>,
}

impl MechanicalRecord {
    pub(crate) fn new(py: Python<'_>, run: MechanicalRun<PyErr>) -> PyResult<Self> {
        let (Layout { n, m, .. }, size) = (run.layout, run.layout.size());
        let samples = &run.samples;
        let picked = |values: &[f64], from, width| columns(py, values, size, from, width);
        let closed = list(samples.modes.iter().map(|mode| mode.in_contact()))?;
        let friction = FrictionRecord::of(py, &run)?;
        let forces = run.layout.forces();
        let reactions = match forces {
            0 => PyArray1::from_vec(py, Vec::new()).reshape([samples.t.len(), 0])?.unbind(),
            _ => columns(py, &samples.lambda, forces, 0, m)?,
        };
        let constraint_forces = match run.layout.k {
            0 => None,
            k => Some(columns(py, &samples.lambda, forces, run.layout.rows(), k)?),
        };
        let occurrences = Occurrences::of(py, &run.occurrences, m)?;
        let hits = Hits::of(py, &run.hits, n)?;
        let path = run.path.map(|path| Py::new(py, PyMechanicalPath { path })).transpose()?;
        Ok(Self {
            t: array(py, samples.t.iter().copied())?,
            q: picked(&samples.x, 0, n)?,
            qdot: picked(&samples.v, 0, n)?,
            gaps: picked(&samples.x, n, m)?,
            gap_rates: picked(&samples.v, n, m)?,
            reactions,
            constraint_forces,
            contacts: members(py, &closed, m)?,
            speeds: run.speeds.map(|it| (it.since, it.fastest, it.fastest_since)),
            occurrences,
            hits,
            status: run.status as u8,
            message: run.status.message(),
            nfev: run.counts.nfev,
            n_steps: run.counts.accepted,
            n_rejected: run.counts.rejected,
            n_impacts: run.counts.impacts,
            raised: EndedBy::new(run.raised),
            path,
            friction: friction.map(|it| Py::new(py, it)).transpose()?,
        })
    }
}

impl Occurrences {
    /// `None` without occurrences (most short runs).
    fn of(py: Python<'_>, all: &[Occurrence], m: usize) -> PyResult<Option<Py<Self>>> {
        if all.is_empty() {
            return Ok(None);
        }
        let floats = |of: &dyn Fn(&Occurrence) -> Option<f64>| array(py, all.iter().filter_map(of));
        let integers =
            |of: &dyn Fn(&Occurrence) -> Option<i64>| array(py, all.iter().filter_map(of));
        let sets = |of: &dyn Fn(&Occurrence) -> Option<GapSet>| {
            let sets = list(all.iter().filter_map(of))?;
            members(py, &sets, m)
        };
        /// One field of one kind of occurrence.
        macro_rules! field {
            ($kind:ident, $field:ident $(as $to:ty)?) => {
                &|it| match it {
                    Occurrence::$kind { $field, .. } => Some(*$field $(as $to)?),
                    _ => None,
                }
            };
        }
        let kinds = all.iter().filter_map(|it| match it {
            Occurrence::Flag { kind, .. } => Some(kind.name()),
            _ => None,
        });
        let flag_kind = list(kinds)?;
        Py::new(
            py,
            Self {
                impact_t: floats(field!(Impact, t))?,
                impact_gap: integers(field!(Impact, gap as i64))?,
                impact_speed_before: floats(field!(Impact, before))?,
                impact_speed_after: floats(field!(Impact, after))?,
                impact_impulse: floats(field!(Impact, impulse))?,
                impact_group: integers(field!(Impact, group as i64))?,
                zeno_t: floats(field!(Zeno, t))?,
                zeno_gap: integers(field!(Zeno, gap as i64))?,
                zeno_closed: sets(field!(Zeno, closed))?,
                contact_t: floats(field!(Contact, t))?,
                contact_gap: integers(field!(Contact, gap as i64))?,
                liftoff_t: floats(field!(LiftOff, t))?,
                liftoff_gap: integers(field!(LiftOff, gap as i64))?,
                opened_t: floats(field!(Opened, t))?,
                opened_gap: integers(field!(Opened, gap as i64))?,
                corner_t: floats(field!(Corner, t))?,
                corner_gaps: sets(field!(Corner, gaps))?,
                flag_kind,
                flag_t: floats(field!(Flag, t))?,
                flag_gaps: sets(field!(Flag, gaps))?,
                flag_size: floats(field!(Flag, size))?,
            },
        )
        .map(Some)
    }
}

// Periodic motions of linear systems as impulses, from Python.

fn flat(array: &PyReadonlyArrayDyn<'_, f64>) -> PyResult<Vec<f64>> {
    list(array.as_array().iter().copied())
}

/// The last axis of an array has real and imaginary parts.
fn pairs(array: &PyReadonlyArrayDyn<'_, f64>) -> PyResult<Vec<(f64, f64)>> {
    list(flat(array)?.chunks_exact(2).map(|it| (it[0], it[1])))
}

fn square(py: Python<'_>, values: Vec<f64>, size: usize) -> PyResult<Matrix<f64>> {
    Ok(PyArray1::from_vec(py, values).reshape([size, size])?.unbind())
}

/// The impacts of one event sequence of a linear system, in the order of their times.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct PeriodicImpulses {
    modes: Modes,
    gaps: Vec<usize>,
}

impl PeriodicImpulses {
    fn unknowns(&self, y: &PyReadonlyArray1<'_, f64>) -> PyResult<Vec<f64>> {
        let y = vector(y)?;
        if y.len() == 2 * self.gaps.len() {
            return Ok(y);
        }
        let rows = self.gaps.len();
        Err(PyValueError::new_err(format!("y must have {rows} pairs, got {} numbers", y.len())))
    }
}

#[pymethods]
impl PeriodicImpulses {
    #[new]
    #[pyo3(signature = (gaps, *, period, rates, kernels, vectors, inputs, pushes, forced_gaps, forced_states, omegas, mobilities, e))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        gaps: Vec<usize>,
        period: f64,
        rates: PyReadonlyArrayDyn<'_, f64>,
        kernels: PyReadonlyArrayDyn<'_, f64>,
        vectors: PyReadonlyArrayDyn<'_, f64>,
        inputs: PyReadonlyArrayDyn<'_, f64>,
        pushes: PyReadonlyArrayDyn<'_, f64>,
        forced_gaps: PyReadonlyArrayDyn<'_, f64>,
        forced_states: PyReadonlyArrayDyn<'_, f64>,
        omegas: PyReadonlyArrayDyn<'_, f64>,
        mobilities: PyReadonlyArrayDyn<'_, f64>,
        e: PyReadonlyArrayDyn<'_, f64>,
    ) -> PyResult<Self> {
        let modes = Modes {
            period,
            rates: pairs(&rates)?,
            kernels: pairs(&kernels)?,
            vectors: pairs(&vectors)?,
            inputs: pairs(&inputs)?,
            pushes: flat(&pushes)?,
            forced_gaps: flat(&forced_gaps)?,
            forced_states: flat(&forced_states)?,
            omegas: flat(&omegas)?,
            mobilities: flat(&mobilities)?,
            e: flat(&e)?,
        };
        modes.check(&gaps).map_err(PyValueError::new_err)?;
        Ok(Self { modes, gaps })
    }

    /// For each impact the increase of the speed of its gap by its own unit impulse.
    #[getter]
    fn mobilities(&self, py: Python<'_>) -> Array {
        PyArray1::from_iter(py, self.gaps.iter().map(|&gap| self.modes.mobilities[gap])).unbind()
    }

    /// Residual, speeds before the impacts, and the Jacobian, at rows of `P, t`.
    fn equations(
        &self,
        py: Python<'_>,
        y: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<(Array, Array, Matrix<f64>)> {
        let y = self.unknowns(&y)?;
        let it = self.modes.equations(&self.gaps, &y);
        let [residual, rates] = [it.residual, it.rates].map(|v| PyArray1::from_vec(py, v).unbind());
        Ok((residual, rates, square(py, it.matrix, y.len())?))
    }

    /// The parts `R` and `S` of the Jacobian of disturbances with `kappa = cos th`.
    fn turned(
        &self,
        py: Python<'_>,
        y: PyReadonlyArray1<'_, f64>,
        kappa: f64,
    ) -> PyResult<(Matrix<f64>, Matrix<f64>)> {
        let y = self.unknowns(&y)?;
        let [real, sine] = self.modes.turned(&self.gaps, &y, kappa);
        Ok((square(py, real, y.len())?, square(py, sine, y.len())?))
    }

    /// The gradients of `w R v` and `w S v` with respect to the unknowns.
    fn curvature(
        &self,
        py: Python<'_>,
        y: PyReadonlyArray1<'_, f64>,
        kappa: f64,
        w: PyReadonlyArray1<'_, f64>,
        v: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<(Array, Array)> {
        let [y, w, v] = [self.unknowns(&y)?, self.unknowns(&w)?, self.unknowns(&v)?];
        let [real, sine] = self
            .modes
            .curvature(&self.gaps, &y, kappa, (&w, &v))
            .map(|it| PyArray1::from_vec(py, it).unbind());
        Ok((real, sine))
    }

    /// The states after the impacts, a row each.
    fn states(&self, py: Python<'_>, y: PyReadonlyArray1<'_, f64>) -> PyResult<Matrix<f64>> {
        let found = self.modes.states(&self.gaps, &self.unknowns(&y)?);
        let width = found.len() / self.gaps.len();
        Ok(PyArray1::from_vec(py, found).reshape([self.gaps.len(), width])?.unbind())
    }
}
