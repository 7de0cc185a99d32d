//! Batches from Python: many runs on all cores, without the interpreter.

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::gc::{PyTraverseError, PyVisit};
use pyo3::prelude::*;
use pyo3::types::PyList;
use zivi::drive::batch::{
    run_chunks, simulate_batch as run_batch, simulate_batch_to, BatchError, Member, Outcome, Save,
    Stop, Task, Work,
};
use zivi::mechanics::{GapSet, MechanicalOutput, Speeds, Totals};
use zivi::system::dynamics::Dynamics;
use zivi::system::impact_law::newton_impacts;
use zivi::{AnyImpactLaw, AnyMethod, Events, Grid, Physical, Restitution, SetupError, Status};

use crate::dynamics::{is_sound_row, CompiledDynamics};
use crate::force::{AnyNative, Force};
use crate::interface::{array, list, members, setup_error, try_list, vector, with_room, Watch};
use crate::method::PyMethod;
use crate::record::rows_of;
use crate::simulate::run_dynamics;
use crate::system::{from_both, from_e};
use crate::system::{Mechanism, PyImpactLaw};

pub(crate) fn refused(error: BatchError<PyErr>) -> PyErr {
    match error {
        BatchError::Setup(Some(member), error) => {
            PyValueError::new_err(format!("run {member} of the batch: {error}"))
        }
        BatchError::Setup(None, error) => setup_error(error),
        BatchError::Raised(error) => error,
    }
}

/// A name, or a number of samples; with `at` and `steps` the name selects whether events are saved.
fn saving<'a>(
    save: &Bound<'_, PyAny>,
    at: Option<&'a [f64]>,
    steps: Option<&'a [usize]>,
) -> PyResult<Save<'a>> {
    let events = save.extract::<&str>().is_ok_and(|it| it == "events");
    if let Some(times) = at {
        return Ok(Save::At(times, events));
    }
    if let Some(steps) = steps {
        return Ok(Save::Steps(steps, events));
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

/// Members created between two checks of signals.
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

/// A parameter with a value for each run: its index among those of the force and its wall, none for
/// the coefficient of restitution.
type Column<'py> = (Option<usize>, PyReadonlyArray1<'py, f64>);

/// The force and the impact law of run `i`, where columns of parameters differ from run to run.
fn with_values(
    columns: &[Column<'_>],
    i: usize,
    mut force: AnyNative,
    mut law: AnyImpactLaw,
) -> PyResult<(AnyNative, AnyImpactLaw)> {
    let refuse = || PyValueError::new_err("a parameter needs a value for each run");
    for (parameter, values) in columns {
        let value = *values.as_array().get(i).ok_or_else(refuse)?;
        match parameter {
            None => law = from_e(value)?.into(),
            Some(index) => *force.parameter(*index).ok_or_else(refuse)? = value,
        }
    }
    Ok((force, law))
}

/// Many runs. `forces`, `laws` and `tstops` have an entry for each run, or one for all; `columns`, a
/// value of some parameters for each. Saved are the states `at` given times, the samples of
/// `steps`, or the data named by `save`. With `ends` each run of the switched method ends at its
/// own.
#[pyfunction]
#[pyo3(signature = (
    forces, laws, states, method, *, span, save, slowest, threads, at=None, steps=None,
    ends=None, tstops=None, kicks=None, columns=Vec::new(), progress=None
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
    columns: Vec<Column<'_>>,
    progress: Option<Py<PyAny>>,
) -> PyResult<BatchRecord> {
    let _running = crate::interface::running()?;
    let task = Task { method: method.inner, span, slowest };
    let save = saving(save, at.as_deref(), steps.as_deref())?;
    let forces = natives(py, &forces)?;
    let tstops = tstops.iter().flatten().map(|it| it.as_slice()).collect::<Result<Vec<_>, _>>()?;
    let mut members = with_room(states.as_array().nrows())?;
    for (i, state) in states.as_array().rows().into_iter().enumerate() {
        if i % BETWEEN_LOOKS == 0 {
            py.check_signals()?;
        }
        let law = laws[if laws.len() == 1 { 0 } else { i }].get().inner.clone();
        let force = forces[if forces.len() == 1 { 0 } else { i }];
        let (force, law) = with_values(&columns, i, force, law)?;
        members.push(Member {
            law,
            force,
            initial: Physical { x: state[0], xdot: state[1] },
            tstops: tstops.get(if tstops.len() == 1 { 0 } else { i }).copied().unwrap_or_default(),
            kicks: kicks.as_deref().unwrap_or_default(),
        });
    }
    let watch = &mut Watch::reporting(progress);
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

/// Saved data of the runs: one entry or row per run.
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
    /// The lifted states, if step numbers were requested.
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

// Mechanical systems.

/// One run of a batch of mechanical systems that work without the interpreter.
struct MechanicalMember<'a> {
    number: usize,
    mechanism: &'a Mechanism,
    dynamics: CompiledDynamics,
    /// The coefficient of restitution of all gaps, if it differs from the system's.
    e: Option<f64>,
    start: (&'a [f64], &'a [f64]),
    tstops: &'a [f64],
}

/// Result of one run.
struct MechanicalEnd {
    t: f64,
    /// Coordinates and gaps, then their rates.
    state: Vec<f64>,
    closed: GapSet,
    totals: Totals,
    speeds: Speeds,
    status: Status,
    nfev: u64,
    /// Error that prevented or ended it.
    error: Option<PyErr>,
}

impl MechanicalMember<'_> {
    /// The end of a run without data.
    fn lost(&self, t: f64, status: Status) -> MechanicalEnd {
        let (q, w) = self.start;
        let gaps = std::iter::repeat_n(f64::NAN, self.mechanism.m);
        let state = q.iter().copied().chain(gaps.clone()).chain(w.iter().copied()).chain(gaps);
        MechanicalEnd {
            t,
            state: state.collect(),
            closed: GapSet::EMPTY,
            totals: Totals::default(),
            speeds: Speeds { fastest_since: f64::NAN, ..Speeds::default() },
            status,
            nfev: 0,
            error: None,
        }
    }

    fn run(
        &self,
        method: AnyMethod,
        span: (f64, f64),
        slowest: f64,
        stop: Stop<'_>,
    ) -> MechanicalEnd {
        let own = self.e.map(|e| newton_impacts(&vec![e; self.mechanism.m]));
        let laws = match &own {
            Some(Ok(laws)) => laws,
            Some(Err(error)) => return self.refused(span.0, (*error).into()),
            None => &self.mechanism.laws,
        };
        let output = MechanicalOutput {
            tstops: self.tstops,
            ends: true,
            arcs: true,
            ..MechanicalOutput::default()
        };
        let dynamics = &mut self.dynamics.clone();
        let system = (self.mechanism.laws_of_contact(), laws.as_slice());
        let watch = &mut Watch::stopped_by(stop);
        let run = run_dynamics(dynamics, system, method, span, self.start, output, watch);
        let run = match run {
            Ok(run) => run,
            Err(SetupError::Memory(_)) => return self.lost(span.0, Status::OutOfMemory),
            Err(error) => return self.refused(span.0, error),
        };
        let (size, samples, totals) = (run.layout.size(), &run.samples, run.totals(slowest));
        let last = |values: &[f64]| values[values.len().saturating_sub(size)..].to_vec();
        let mut state = last(&samples.x);
        state.extend(last(&samples.v));
        MechanicalEnd {
            t: samples.t.last().copied().unwrap_or(span.0),
            state,
            closed: samples.modes.last().map_or(GapSet::EMPTY, |mode| mode.in_contact()),
            totals,
            speeds: run.speeds.unwrap_or_default(),
            status: run.status,
            nfev: run.counts.nfev,
            error: run.raised,
        }
    }

    fn refused(&self, t: f64, error: SetupError) -> MechanicalEnd {
        let error = refused(BatchError::Setup(Some(self.number), error));
        MechanicalEnd { error: Some(error), ..self.lost(t, Status::Internal) }
    }
}

/// Runs of frictionless mechanical systems without the interpreter, with a mechanism for each run
/// or one for all, as `tstops`. `e` and the rows of `data` (parameters of a compiled function)
/// belong to the runs if given.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct MechanicalRuns {
    mechanisms: Vec<Py<Mechanism>>,
    dynamics: Vec<CompiledDynamics>,
    q: Vec<f64>,
    qdot: Vec<f64>,
    e: Option<Vec<f64>>,
    data: Option<Vec<f64>>,
    tstops: Vec<Vec<f64>>,
}

impl MechanicalRuns {
    fn count(&self) -> usize {
        self.q.len() / self.mechanisms[0].get().n.max(1)
    }

    fn member(&self, i: usize) -> MechanicalMember<'_> {
        /// That of run `i`, or the only one for all.
        fn of<T>(list: &[T], i: usize) -> &T {
            &list[if list.len() == 1 { 0 } else { i }]
        }
        let (mechanism, runs) = (of(&self.mechanisms, i).get(), self.count());
        let row = |values: &'_ [f64]| {
            let width = values.len() / runs;
            i * width..(i + 1) * width
        };
        let dynamics = of(&self.dynamics, i).clone();
        MechanicalMember {
            number: i,
            mechanism,
            dynamics: match &self.data {
                Some(data) => dynamics.called_with(&data[row(data)]),
                None => dynamics,
            },
            e: self.e.as_ref().map(|e| e[i]),
            start: (&self.q[row(&self.q)], &self.qdot[row(&self.qdot)]),
            tstops: of(&self.tstops, i).as_slice(),
        }
    }
}

#[pymethods]
impl MechanicalRuns {
    #[new]
    #[pyo3(signature = (mechanisms, q, qdot, *, tstops, e=None, data=None))]
    fn new(
        mechanisms: Vec<Py<Mechanism>>,
        q: PyReadonlyArray2<'_, f64>,
        qdot: PyReadonlyArray2<'_, f64>,
        tstops: Vec<PyReadonlyArray1<'_, f64>>,
        e: Option<PyReadonlyArray1<'_, f64>>,
        data: Option<PyReadonlyArray2<'_, f64>>,
    ) -> PyResult<Self> {
        let refuse = |what| PyValueError::new_err(format!("{what} do not fit together"));
        let runs = q.as_array().nrows();
        let fits = |count| count == runs || count == 1;
        let rows = data.as_ref().map_or(runs, |it| it.as_array().nrows());
        let numbers = e.as_ref().map_or(runs, |it| it.as_array().len());
        let shapes = q.as_array().dim() == qdot.as_array().dim() && [rows, numbers] == [runs; 2];
        let widths = mechanisms.iter().all(|it| it.get().n == q.as_array().ncols());
        if runs == 0 || !shapes || !widths || !fits(mechanisms.len()) || !fits(tstops.len()) {
            return Err(refuse("the runs of the batch"));
        }
        let native = |it: &Py<Mechanism>| {
            let dynamics = it.get().native_dynamics();
            dynamics.ok_or_else(|| refuse("a batch and a system that needs the interpreter"))
        };
        let matrix = |it: &PyReadonlyArray2<'_, f64>| list(it.as_array().iter().copied());
        Ok(Self {
            dynamics: try_list(mechanisms.iter().map(native))?,
            mechanisms,
            q: matrix(&q)?,
            qdot: matrix(&qdot)?,
            e: e.as_ref().map(vector).transpose()?,
            data: data.as_ref().map(matrix).transpose()?,
            tstops: tstops.iter().map(vector).collect::<PyResult<_>>()?,
        })
    }

    /// The runs whose initial state must be checked: a number is not finite, a gap below zero, a
    /// gradient zero.
    fn unsound_starts(&self, py: Python<'_>, t: f64) -> PyResult<Vec<usize>> {
        let mut found = Vec::new();
        for i in 0..self.count() {
            if i % BETWEEN_LOOKS == 0 {
                py.check_signals()?;
            }
            let mut member = self.member(i);
            let layout = member.mechanism.layout();
            let (mut row, (q, w)) = (vec![0.0; layout.len()], member.start);
            let known = member.dynamics.evaluate(t, q, w, &mut row).is_ok();
            if !known || !is_sound_row(&row, (layout.n, layout.m)) {
                found.push(i);
            }
        }
        Ok(found)
    }

    #[pyo3(signature = (method, *, span, slowest, threads, progress=None))]
    fn run(
        &self,
        py: Python<'_>,
        method: PyRef<'_, PyMethod>,
        span: (f64, f64),
        slowest: f64,
        threads: usize,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<MechanicalEnds> {
        let _running = crate::interface::running()?;
        // results that would not fit into memory are rejected before anything is computed
        let numbers = self.q.len() + self.qdot.len();
        let gaps = 2 * self.count() * self.mechanisms[0].get().m;
        let ends = self.count().saturating_mul(size_of::<MechanicalEnd>());
        let kept = ends.saturating_add((numbers + gaps).saturating_mul(size_of::<f64>()));
        drop(with_room::<u8>(kept.saturating_mul(2))?);
        let (method, numbers) = (method.inner, list(0..self.count())?);
        let work = Work {
            width: 16,
            chunk: |chunk: &[usize], stop: Stop<'_>| {
                Ok(chunk.iter().map(|&i| self.member(i).run(method, span, slowest, stop)).collect())
            },
            lost: |&i: &usize, status| self.member(i).lost(span.0, status),
        };
        let watch = &mut Watch::reporting(progress);
        let ends = py.detach(|| run_chunks(&numbers, threads, watch, work)).map_err(refused)?;
        MechanicalEnds::new(py, self.mechanisms[0].get(), ends)
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        self.mechanisms.iter().try_for_each(|it| visit.call(it))
    }
}

/// The ends of runs of mechanical systems, an entry or a row for each.
#[pyclass(frozen, get_all, module = "zivi._zivi")]
pub(crate) struct MechanicalEnds {
    t: Array,
    q: Py<PyArray2<f64>>,
    gaps: Py<PyArray2<f64>>,
    qdot: Py<PyArray2<f64>>,
    contacts: Py<PyArray2<bool>>,
    /// Numbers of impacts, accumulations, lift-offs, corners and flags.
    totals: Py<PyArray2<i64>>,
    first_impact: Array,
    last_impact: Array,
    /// Time of the last event, and the largest speeds from the start and from that time on.
    speeds: Py<PyArray2<f64>>,
    status: Py<PyArray1<u8>>,
    nfev: Py<PyArray1<i64>>,
}

impl MechanicalEnds {
    fn new(py: Python<'_>, system: &Mechanism, mut ends: Vec<MechanicalEnd>) -> PyResult<Self> {
        if let Some(error) = ends.iter_mut().find_map(|end| end.error.take()) {
            return Err(error);
        }
        let (n, m) = (system.n, system.m);
        let column = |of: fn(&MechanicalEnd) -> f64| array(py, ends.iter().map(of));
        let part = |from: usize, width: usize| -> PyResult<Py<PyArray2<f64>>> {
            let values = ends.iter().flat_map(|end| end.state[from..][..width].iter().copied());
            Ok(array(py, values)?.into_bound(py).reshape([ends.len(), width])?.unbind())
        };
        let totals = ends.iter().flat_map(|end| {
            let Totals { impacts, zeno, liftoffs, corners, flags, .. } = end.totals;
            [impacts, zeno, liftoffs, corners, flags].map(|it| it as i64)
        });
        let speeds = ends.iter().flat_map(|end| {
            let Speeds { since, fastest, fastest_since } = end.speeds;
            [since, fastest, fastest_since]
        });
        let closed: Vec<GapSet> = list(ends.iter().map(|end| end.closed))?;
        Ok(Self {
            t: column(|end| end.t)?,
            q: part(0, n)?,
            gaps: part(n, m)?,
            qdot: part(n + m, n)?,
            contacts: members(py, &closed, m)?,
            totals: array(py, totals)?.into_bound(py).reshape([ends.len(), 5])?.unbind(),
            first_impact: column(|end| end.totals.first_impact)?,
            last_impact: column(|end| end.totals.last_impact)?,
            speeds: array(py, speeds)?.into_bound(py).reshape([ends.len(), 3])?.unbind(),
            status: array(py, ends.iter().map(|end| end.status as u8))?,
            nfev: array(py, ends.iter().map(|end| end.nfev as i64))?,
        })
    }
}

/// The number of cores.
#[pyfunction]
pub(crate) fn available_threads() -> usize {
    zivi::drive::batch::available_threads()
}

/// The times of every n-th step of a grid.
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
