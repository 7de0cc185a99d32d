//! Mechanical systems from Python: runs and their records.

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use zivi::mechanics::{
    simulate_mechanical as simulate, simulate_mechanical_moreau_jean as moreau_jean,
    simulate_mechanical_theta_gamma as theta_gamma, GapSet, MechanicalOutput, MechanicalRun,
    Occurrence, StateEvent, StateHit,
};
use zivi::system::dynamics::Layout;
use zivi::{Direction, Grid, MoreauJean};

use crate::dynamics::{fill, vector, DynamicsSpec};
use crate::motion::MechanicalPath;
use crate::simulate::setup_error;
use crate::switched_rk::{settings, Settings};
use crate::watch::Watch;

pub(crate) type Vector<T> = Py<PyArray1<T>>;
pub(crate) type Matrix<T> = Py<PyArray2<T>>;
/// Times, coordinates and velocities of the events of one function.
type Hits = (Vector<f64>, Matrix<f64>, Matrix<f64>);
/// An event of the user: function, direction, number of the event that ends the run.
type StateEventSpec<'py> = (Bound<'py, PyAny>, i32, Option<usize>);

/// A run of the switched method for a mechanical system.
#[pyfunction]
#[pyo3(signature = (model, method, *, n, m, e, span, q0, qdot0, t_eval, tstops, events, dense, progress=None))]
#[allow(clippy::too_many_arguments)]
pub(crate) fn simulate_mechanical(
    py: Python<'_>,
    model: &Bound<'_, PyTuple>,
    method: Settings,
    n: usize,
    m: usize,
    e: PyReadonlyArray1<'_, f64>,
    span: (f64, f64),
    q0: PyReadonlyArray1<'_, f64>,
    qdot0: PyReadonlyArray1<'_, f64>,
    t_eval: Option<PyReadonlyArray1<'_, f64>>,
    tstops: PyReadonlyArray1<'_, f64>,
    events: Vec<StateEventSpec<'_>>,
    dense: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<MechanicalRecord> {
    let method = settings(method)?;
    let (e, q0, qdot0) = (vector(&e), vector(&q0), vector(&qdot0));
    let (t_eval, tstops) = (t_eval.as_ref().map(vector), vector(&tstops));
    let (t_eval, tstops) = (t_eval.as_deref(), &tstops[..]);
    let watch = &mut Watch { progress };
    let start = (&q0[..], &qdot0[..]);
    let run = match DynamicsSpec::from_tuple(model, Layout { n, m })? {
        DynamicsSpec::Compiled(mut compiled) if events.is_empty() => py.detach(|| {
            let output = MechanicalOutput { t_eval, tstops, dense, events: Vec::new() };
            simulate(method, &mut compiled, &e, span, start, output, watch)
        }),
        // the events need the interpreter
        spec => {
            let events = events.into_iter().map(|it| event(it, n)).collect();
            let output = MechanicalOutput { t_eval, tstops, dense, events };
            match spec {
                DynamicsSpec::Compiled(mut it) => {
                    simulate(method, &mut it, &e, span, start, output, watch)
                }
                DynamicsSpec::Callable(mut it) => {
                    simulate(method, &mut it, &e, span, start, output, watch)
                }
            }
        }
    };
    MechanicalRecord::new(py, run.map_err(setup_error)?)
}

/// A run of Moreau-Jean time stepping for a mechanical system.
#[pyfunction]
#[pyo3(signature = (model, *, n, m, e, h, theta, span, q0, qdot0, events, progress=None))]
#[allow(clippy::too_many_arguments)]
pub(crate) fn simulate_mechanical_moreau_jean(
    py: Python<'_>,
    model: &Bound<'_, PyTuple>,
    n: usize,
    m: usize,
    e: PyReadonlyArray1<'_, f64>,
    h: f64,
    theta: f64,
    span: (f64, f64),
    q0: PyReadonlyArray1<'_, f64>,
    qdot0: PyReadonlyArray1<'_, f64>,
    events: Vec<StateEventSpec<'_>>,
    progress: Option<Py<PyAny>>,
) -> PyResult<MechanicalRecord> {
    let grid = Grid::new(span.0, span.1, h).map_err(|error| setup_error(error.into()))?;
    let method = MoreauJean { theta };
    let (e, q0, qdot0) = (vector(&e), vector(&q0), vector(&qdot0));
    let watch = &mut Watch { progress };
    let start = (&q0[..], &qdot0[..]);
    let run = match DynamicsSpec::from_tuple(model, Layout { n, m })? {
        DynamicsSpec::Compiled(mut it) if events.is_empty() => {
            py.detach(|| moreau_jean(method, &mut it, &e, grid, start, Vec::new(), watch))
        }
        spec => {
            let events = events.into_iter().map(|it| event(it, n)).collect();
            match spec {
                DynamicsSpec::Compiled(mut it) => {
                    moreau_jean(method, &mut it, &e, grid, start, events, watch)
                }
                DynamicsSpec::Callable(mut it) => {
                    moreau_jean(method, &mut it, &e, grid, start, events, watch)
                }
            }
        }
    };
    MechanicalRecord::new(py, run.map_err(setup_error)?)
}

/// A run of the implicit scheme for a mechanical system with one gap or gaps at right angles.
#[pyfunction]
#[pyo3(signature = (model, *, n, m, e, h, span, q0, qdot0, events, progress=None))]
#[allow(clippy::too_many_arguments)]
pub(crate) fn simulate_mechanical_theta_gamma(
    py: Python<'_>,
    model: &Bound<'_, PyTuple>,
    n: usize,
    m: usize,
    e: PyReadonlyArray1<'_, f64>,
    h: f64,
    span: (f64, f64),
    q0: PyReadonlyArray1<'_, f64>,
    qdot0: PyReadonlyArray1<'_, f64>,
    events: Vec<StateEventSpec<'_>>,
    progress: Option<Py<PyAny>>,
) -> PyResult<MechanicalRecord> {
    let grid = Grid::new(span.0, span.1, h).map_err(|error| setup_error(error.into()))?;
    let (e, q0, qdot0) = (vector(&e), vector(&q0), vector(&qdot0));
    let watch = &mut Watch { progress };
    let start = (&q0[..], &qdot0[..]);
    let run = match DynamicsSpec::from_tuple(model, Layout { n, m })? {
        DynamicsSpec::Compiled(mut it) if events.is_empty() => {
            py.detach(|| theta_gamma(&mut it, &e, grid, start, Vec::new(), watch))
        }
        spec => {
            let events = events.into_iter().map(|it| event(it, n)).collect();
            match spec {
                DynamicsSpec::Compiled(mut it) => {
                    theta_gamma(&mut it, &e, grid, start, events, watch)
                }
                DynamicsSpec::Callable(mut it) => {
                    theta_gamma(&mut it, &e, grid, start, events, watch)
                }
            }
        }
    };
    MechanicalRecord::new(py, run.map_err(setup_error)?)
}

fn event<'py>(
    (function, direction, terminal): StateEventSpec<'py>,
    n: usize,
) -> StateEvent<'py, PyErr> {
    let direction = match direction {
        0 => Direction::Either,
        below if below < 0 => Direction::Falling,
        _ => Direction::Rising,
    };
    let zeros = || PyArray1::zeros(function.py(), n, false);
    let (of_q, of_w) = (zeros(), zeros());
    let call = move |t: f64, q: &[f64], w: &[f64]| {
        fill(&of_q, q)?;
        fill(&of_w, w)?;
        let value = function.call1((t, &of_q, &of_w))?;
        value.extract().map_err(|_| {
            let kind = value.get_type();
            PyTypeError::new_err(format!("an event function must return a float, got {kind}"))
        })
    };
    StateEvent { function: Box::new(call), direction, terminal }
}

/// Samples, occurrences and outcome of one run.
#[pyclass(frozen, get_all, module = "zivi._zivi")]
pub(crate) struct MechanicalRecord {
    t: Vector<f64>,
    q: Matrix<f64>,
    qdot: Matrix<f64>,
    gaps: Matrix<f64>,
    gap_rates: Matrix<f64>,
    reactions: Matrix<f64>,
    contacts: Matrix<bool>,
    impact_t: Vector<f64>,
    impact_gap: Vector<i64>,
    impact_speed_before: Vector<f64>,
    impact_speed_after: Vector<f64>,
    impact_impulse: Vector<f64>,
    impact_group: Vector<i64>,
    zeno_t: Vector<f64>,
    zeno_gap: Vector<i64>,
    zeno_closed: Matrix<bool>,
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
    /// Times, coordinates and velocities of each event of the user.
    hits: Vec<Hits>,
    status: u8,
    message: &'static str,
    nfev: u64,
    n_steps: u64,
    n_rejected: u64,
    n_impacts: u64,
    raised: Option<Py<PyAny>>,
    path: Option<Py<MechanicalPath>>,
}

/// Rows of a matrix from one list: the columns `from .. from + width` of rows of length `stride`.
pub(crate) fn columns(
    py: Python<'_>,
    values: &[f64],
    stride: usize,
    from: usize,
    width: usize,
) -> PyResult<Matrix<f64>> {
    let rows = values.len().checked_div(stride).unwrap_or(0);
    let picked = values.chunks_exact(stride.max(1)).flat_map(|row| row[from..][..width].iter());
    let all: Vec<f64> = picked.copied().collect();
    Ok(PyArray1::from_vec(py, all).reshape([rows, width])?.unbind())
}

/// Which gaps are in each of the sets.
pub(crate) fn members(py: Python<'_>, sets: &[GapSet], m: usize) -> PyResult<Matrix<bool>> {
    let all: Vec<bool> = sets.iter().flat_map(|set| (0..m).map(|gap| set.has(gap))).collect();
    Ok(PyArray1::from_vec(py, all).reshape([sets.len(), m])?.unbind())
}

impl MechanicalRecord {
    pub(crate) fn new(py: Python<'_>, run: MechanicalRun<PyErr>) -> PyResult<Self> {
        let Layout { n, m } = run.layout;
        let (samples, all) = (&run.samples, &run.occurrences);
        let count = samples.t.len();
        let picked = |values: &[f64], from, width| columns(py, values, n + m, from, width);
        let reactions: Vec<f64> = samples.lambda.clone();
        let floats = |of: &dyn Fn(&Occurrence) -> Option<f64>| {
            PyArray1::from_vec(py, all.iter().filter_map(of).collect()).unbind()
        };
        let integers = |of: &dyn Fn(&Occurrence) -> Option<i64>| {
            PyArray1::from_vec(py, all.iter().filter_map(of).collect()).unbind()
        };
        let sets = |of: &dyn Fn(&Occurrence) -> Option<GapSet>| {
            let sets: Vec<GapSet> = all.iter().filter_map(of).collect();
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
        let flag_kind = kinds.collect();
        let hits = run.hits.iter().map(|hits| hits_of(py, hits, n)).collect::<PyResult<_>>()?;
        let path = run.path.map(|path| Py::new(py, MechanicalPath { path })).transpose()?;
        Ok(Self {
            t: PyArray1::from_slice(py, &samples.t).unbind(),
            q: picked(&samples.x, 0, n)?,
            qdot: picked(&samples.v, 0, n)?,
            gaps: picked(&samples.x, n, m)?,
            gap_rates: picked(&samples.v, n, m)?,
            reactions: PyArray1::from_vec(py, reactions).reshape([count, m])?.unbind(),
            contacts: members(py, &samples.closed, m)?,
            impact_t: floats(field!(Impact, t)),
            impact_gap: integers(field!(Impact, gap as i64)),
            impact_speed_before: floats(field!(Impact, before)),
            impact_speed_after: floats(field!(Impact, after)),
            impact_impulse: floats(field!(Impact, impulse)),
            impact_group: integers(field!(Impact, group as i64)),
            zeno_t: floats(field!(Zeno, t)),
            zeno_gap: integers(field!(Zeno, gap as i64)),
            zeno_closed: sets(field!(Zeno, closed))?,
            liftoff_t: floats(field!(LiftOff, t)),
            liftoff_gap: integers(field!(LiftOff, gap as i64)),
            opened_t: floats(field!(Opened, t)),
            opened_gap: integers(field!(Opened, gap as i64)),
            corner_t: floats(field!(Corner, t)),
            corner_gaps: sets(field!(Corner, gaps))?,
            flag_kind,
            flag_t: floats(field!(Flag, t)),
            flag_gaps: sets(field!(Flag, gaps))?,
            flag_size: floats(field!(Flag, size)),
            hits,
            status: run.status as u8,
            message: run.status.message(),
            nfev: run.counts.nfev,
            n_steps: run.counts.accepted,
            n_rejected: run.counts.rejected,
            n_impacts: run.counts.impacts,
            raised: run.raised.map(|error| error.into_value(py).into_any()),
            path,
        })
    }
}

fn hits_of(py: Python<'_>, hits: &[StateHit], n: usize) -> PyResult<Hits> {
    let rows = |of: fn(&StateHit) -> &Vec<f64>| -> PyResult<Matrix<f64>> {
        let all: Vec<f64> = hits.iter().flat_map(|hit| of(hit)[..n].iter().copied()).collect();
        Ok(PyArray1::from_vec(py, all).reshape([hits.len(), n])?.unbind())
    };
    let times = PyArray1::from_vec(py, hits.iter().map(|hit| hit.t).collect()).unbind();
    Ok((times, rows(|hit| &hit.x)?, rows(|hit| &hit.v)?))
}

/// A ValueError for numbers of a motion that are none.
pub(crate) fn not_a_motion() -> PyErr {
    PyValueError::new_err("these numbers are none of a motion of a mechanical system")
}
