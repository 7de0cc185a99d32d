//! Batches from Python: many runs on all cores, without the interpreter.

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyList;
use zivi::drive::batch::{
    simulate_batch as run_batch, simulate_batch_to, BatchError, Member, Outcome, Save, Task,
};
use zivi::{Events, Grid, Physical, Restitution};

use crate::force::{AnyNative, Force};
use crate::interface::{array, list, setup_error, try_list, with_room, Watch};
use crate::method::PyMethod;
use crate::record::rows_of;
use crate::system::PyImpactLaw;
use crate::transform::from_both;

pub(crate) fn refused(error: BatchError<PyErr>) -> PyErr {
    match error {
        BatchError::Setup(Some(member), error) => {
            PyValueError::new_err(format!("run {member} of the batch: {error}"))
        }
        BatchError::Setup(None, error) => setup_error(error),
        BatchError::Raised(error) => error,
    }
}

/// A name, or a number of samples; `at` and `steps` go before.
fn saving<'a>(
    save: &Bound<'_, PyAny>,
    at: Option<&'a [f64]>,
    steps: Option<&'a [usize]>,
) -> PyResult<Save<'a>> {
    if let Some(times) = at {
        return Ok(Save::At(times));
    }
    if let Some(steps) = steps {
        return Ok(Save::Steps(steps));
    }
    if let Ok(every) = save.extract::<usize>() {
        return Ok(Save::Every(every));
    }
    match save.extract::<String>()?.as_str() {
        "final" => Ok(Save::Final),
        "statistics" => Ok(Save::Statistics),
        "events" => Ok(Save::Events),
        "grazing" => Ok(Save::Grazing),
        other => Err(PyValueError::new_err(format!("unknown kind of save {other:?}"))),
    }
}

/// A force for each run, or one for all.
pub(crate) fn natives(py: Python<'_>, forces: &[Py<Force>]) -> PyResult<Vec<AnyNative>> {
    let native = |(i, force): (usize, &Py<Force>)| -> PyResult<AnyNative> {
        let refuse = || {
            PyValueError::new_err(format!(
                "the force of system {i} needs the interpreter: a batch takes numbers, \
                 LinearForce and compiled callables"
            ))
        };
        force.get().on(py).native().ok_or_else(refuse)
    };
    try_list(forces.iter().enumerate().map(native))
}

/// Members that are made between two looks at signals.
pub(crate) const BETWEEN_LOOKS: usize = 1 << 16;

/// The wall of run `i`, from a row `e, kappa` for each run or one for all.
pub(crate) fn row_restitution(
    restitutions: &PyReadonlyArray2<'_, f64>,
    i: usize,
) -> PyResult<Restitution> {
    let restitutions = restitutions.as_array();
    let row = if restitutions.nrows() == 1 { 0 } else { i };
    from_both(restitutions[[row, 0]], restitutions[[row, 1]])
}

/// Many runs. `forces`, `laws` and `tstops` have an entry for each run, or one for all. What is saved
/// are the states `at` given times, the samples of `steps`, or what `save` says. With `ends` each run
/// of the switched method ends at its own.
#[pyfunction]
#[pyo3(signature = (
    forces, laws, states, method, *, span, save, slowest, threads, at=None, steps=None,
    ends=None, tstops=None, kicks=None, progress=None
))]
#[allow(clippy::too_many_arguments)]
pub(crate) fn simulate_batch(
    py: Python<'_>,
    forces: Vec<Py<Force>>,
    laws: Vec<Py<PyImpactLaw>>,
    states: PyReadonlyArray2<'_, f64>,
    method: PyRef<'_, PyMethod>,
    span: (f64, f64),
    save: &Bound<'_, PyAny>,
    slowest: f64,
    threads: usize,
    at: Option<Vec<f64>>,
    steps: Option<Vec<usize>>,
    ends: Option<Vec<f64>>,
    tstops: Option<Vec<PyReadonlyArray1<'_, f64>>>,
    kicks: Option<Vec<(f64, f64)>>,
    progress: Option<Py<PyAny>>,
) -> PyResult<BatchRecord> {
    let _running = crate::leaving::running()?;
    let task = Task { method: method.inner, span, slowest };
    let save = saving(save, at.as_deref(), steps.as_deref())?;
    let forces = natives(py, &forces)?;
    let tstops = tstops.iter().flatten().map(|it| it.as_slice()).collect::<Result<Vec<_>, _>>()?;
    let mut members = with_room(states.as_array().nrows())?;
    for (i, state) in states.as_array().rows().into_iter().enumerate() {
        if i % BETWEEN_LOOKS == 0 {
            py.check_signals()?;
        }
        members.push(Member {
            law: laws[if laws.len() == 1 { 0 } else { i }].get().inner.clone(),
            force: forces[if forces.len() == 1 { 0 } else { i }],
            initial: Physical { x: state[0], xdot: state[1] },
            tstops: tstops.get(if tstops.len() == 1 { 0 } else { i }).copied().unwrap_or_default(),
            kicks: kicks.as_deref().unwrap_or_default(),
        });
    }
    let watch = &mut Watch { progress };
    let outcomes = match ends {
        None => {
            let outcomes = py.detach(|| run_batch(&members, task, save, threads, watch));
            drop(members); // no room for them beside the arrays
            outcomes
        }
        Some(ends) if ends.len() != members.len() => {
            return Err(PyValueError::new_err(format!(
                "{} ends of {} runs",
                ends.len(),
                members.len()
            )));
        }
        Some(ends) => {
            let members = list(members.into_iter().zip(ends))?;
            py.detach(|| simulate_batch_to(&members, task, save, threads, watch))
        }
    };
    BatchRecord::new(py, outcomes.map_err(refused)?)
}

type Array = Py<PyArray1<f64>>;
type Times = Py<PyList>;

/// What is saved of the runs: an entry, or a row, for each.
#[pyclass(frozen, get_all, module = "zivi._zivi")]
pub(crate) struct BatchRecord {
    t: Array,
    x: Array,
    xdot: Array,
    x_max: Array,
    speed_max: Array,
    first_impact: Array,
    last_impact: Array,
    last_resolved: Array,
    hardest_impact: Array,
    rest_time: Array,
    grazing: Py<PyArray1<bool>>,
    status: Py<PyArray1<u8>>,
    nfev: Py<PyArray1<u64>>,
    /// Numbers of impacts, Zeno points, lift-offs and resolved impacts of each run.
    counts: Py<PyArray2<u64>>,
    /// A row for each run, filled up with NaN where a run ended early.
    samples_x: Py<PyArray2<f64>>,
    samples_xdot: Py<PyArray2<f64>>,
    /// The same of the lifted states, where numbers of steps were asked for.
    samples_s: Py<PyArray2<f64>>,
    samples_v: Py<PyArray2<f64>>,
    /// Of each run the rows of time, velocity before and velocity after, flat.
    impacts: Times,
    /// Those of the impacts that were resolved.
    resolved_impacts: Times,
    zeno_times: Times,
    liftoff_times: Times,
}

impl BatchRecord {
    fn new(py: Python<'_>, mut ends: Vec<Outcome>) -> PyResult<Self> {
        let kept = ends.iter().any(|end| end.events.is_some());
        let mut lists = [(); 4].map(|()| PyList::empty(py));
        for (i, end) in ends.iter_mut().filter(|_| kept).enumerate() {
            if i % BETWEEN_LOOKS == 0 {
                py.check_signals()?;
            }
            let events = end.events.take().unwrap_or_default();
            let Events { impacts, zeno_times, liftoff_times, .. } = events;
            let times = |values| PyArray1::from_vec(py, values).unbind();
            let own = [
                rows_of(py, std::mem::take(&mut end.impacts)),
                rows_of(py, impacts),
                times(zeno_times),
                times(liftoff_times),
            ];
            // one by one: a list of a length that does not fit would end the process
            lists.iter_mut().zip(own).try_for_each(|(list, it)| list.append(it))?;
        }
        let [impacts, resolved_impacts, zeno_times, liftoff_times] = lists.map(Bound::unbind);
        let column = |of: fn(&Outcome) -> f64| {
            py.check_signals()?;
            array(py, ends.iter().map(of))
        };
        Ok(Self {
            t: column(|end| end.summary.t)?,
            x: column(|end| end.summary.x)?,
            xdot: column(|end| end.summary.xdot)?,
            x_max: column(|end| end.summary.x_max)?,
            speed_max: column(|end| end.summary.speed_max)?,
            first_impact: column(|end| end.first_impact)?,
            last_impact: column(|end| end.last_impact)?,
            last_resolved: column(|end| end.last_resolved)?,
            hardest_impact: column(|end| end.hardest_impact)?,
            rest_time: column(|end| end.rest_time)?,
            grazing: array(py, ends.iter().map(|end| end.grazing))?,
            status: array(py, ends.iter().map(|end| end.status as u8))?,
            nfev: array(py, ends.iter().map(|end| end.nfev))?,
            counts: array(py, ends.iter().flat_map(|end| end.counts))?
                .into_bound(py)
                .reshape([ends.len(), 4])?
                .unbind(),
            samples_x: rows(py, ends.iter().map(|end| end.saved.x.as_slice()))?,
            samples_xdot: rows(py, ends.iter().map(|end| end.saved.xdot.as_slice()))?,
            samples_s: rows(py, ends.iter().map(|end| end.saved.s.as_slice()))?,
            samples_v: rows(py, ends.iter().map(|end| end.saved.v.as_slice()))?,
            impacts,
            resolved_impacts,
            zeno_times,
            liftoff_times,
        })
    }
}

/// Rows of one length, the shorter ones filled up with NaN.
pub(crate) fn rows<'a>(
    py: Python<'_>,
    rows: impl Iterator<Item = &'a [f64]> + Clone,
) -> PyResult<Py<PyArray2<f64>>> {
    let (n, longest) =
        rows.clone().fold((0, 0), |(n, longest), row| (n + 1, longest.max(row.len())));
    let mut filled = with_room(longest.saturating_mul(n))?;
    for row in rows {
        filled.extend_from_slice(row);
        filled.extend(std::iter::repeat_n(f64::NAN, longest - row.len()));
    }
    Ok(PyArray1::from_vec(py, filled).reshape([n, longest])?.unbind())
}

/// The number of threads that the machine runs at once.
#[pyfunction]
pub(crate) fn available_threads() -> usize {
    zivi::drive::batch::available_threads()
}

/// The times of every so many steps of a grid, from its start on.
#[pyfunction]
pub(crate) fn grid_times(
    py: Python<'_>,
    t0: f64,
    t1: f64,
    h: f64,
    every: usize,
) -> PyResult<Bound<'_, PyArray1<f64>>> {
    let grid = Grid::new(t0, t1, h).map_err(|error| setup_error(error.into()))?;
    let times = (0..grid.n_steps() + 1).step_by(every.max(1)).map(|k| grid.t(k));
    Ok(array(py, times)?.into_bound(py))
}
