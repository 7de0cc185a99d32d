//! Runs from Python: the lock is released unless the force is a Python callable.

use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::{PyMemoryError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use zivi::stepping::step_solver::General;
use zivi::Lifted;
use zivi::{
    EventHit, Following, Grid, MoreauJean, Physical, Restitution, Run, SetupError, Solver,
    ThetaGamma,
};
use zivi_core::ThetaGammaStep;

use crate::force::ForceSpec;
use crate::record::RunRecord;
use crate::transform::{wall, wall_of, WallPair};
use crate::user_events::{columns_of, event, EventSpec};
use crate::watch::Watch;

pub(crate) fn setup_error(error: SetupError) -> PyErr {
    match error {
        SetupError::Memory(_) | SetupError::BatchMemory { .. } | SetupError::Threads(_) => {
            PyMemoryError::new_err(error.to_string())
        }
        _ => PyValueError::new_err(error.to_string()),
    }
}

/// The span, the step size and the initial state of a fixed-step run.
#[derive(Clone, Copy)]
pub(crate) struct Course {
    pub(crate) wall: Restitution,
    pub(crate) grid: Grid,
    pub(crate) initial: Physical,
}

impl Course {
    pub(crate) fn new(
        pair: WallPair,
        h: f64,
        span: (f64, f64),
        state: (f64, f64),
    ) -> PyResult<Self> {
        let grid = Grid::new(span.0, span.1, h).map_err(|error| setup_error(error.into()))?;
        let initial = Physical { x: state.0, xdot: state.1 };
        Ok(Self { wall: wall(pair)?, grid, initial })
    }
}

/// One call for every kind of force, so that each is compiled into its own loop.
macro_rules! with_force {
    ($py:expr, $spec:expr, |$force:ident| $run:expr) => {
        match $crate::force::ForceSpec::from_tuple($spec)? {
            $crate::force::ForceSpec::Constant(value) => {
                let $force = &mut zivi::ConstantForce(value);
                $py.detach(|| $run)
            }
            $crate::force::ForceSpec::Linear(mut linear) => {
                let $force = &mut linear;
                $py.detach(|| $run)
            }
            $crate::force::ForceSpec::Compiled(mut compiled) => {
                let $force = &mut compiled;
                $py.detach(|| $run)
            }
            $crate::force::ForceSpec::Callable(mut callable) => {
                let $force = &mut callable;
                $run
            }
            $crate::force::ForceSpec::Moving(moving) => {
                let mut spec = $crate::force::ForceSpec::Moving(moving);
                match spec.native() {
                    Some(mut native) => {
                        let $force = &mut native;
                        $py.detach(|| $run)
                    }
                    None => {
                        let $force = &mut spec;
                        $run
                    }
                }
            }
        }
    };
}

pub(crate) use with_force;

/// A solver by its name.
pub(crate) fn step_solver(name: &str, linearisations: usize) -> PyResult<Solver> {
    match name {
        "exact" => Ok(Solver::Exact),
        "newton" => Ok(Solver::Newton),
        "outer" => Ok(Solver::Outer { linearisations }),
        other => Err(PyValueError::new_err(format!(
            "solver must be 'exact', 'newton' or 'outer', got {other:?}"
        ))),
    }
}

/// A run of fixed steps whose events of the user are followed.
macro_rules! stepped {
    ($py:expr, $spec:expr, $events:expr, $progress:expr, |$force:ident, $watch:ident| $run:expr) => {{
        let mut watch = Watch { progress: $progress };
        if $events.is_empty() {
            let $watch = &mut watch;
            record($py, with_force!($py, $spec, |$force| $run), &[])
        } else {
            // the events need the interpreter
            let $force = &mut ForceSpec::from_tuple($spec)?;
            let mut following =
                Following::new($events.into_iter().map(event).collect(), &mut watch);
            let $watch = &mut following;
            let run = $run;
            record($py, run, &following.into_hits())
        }
    }};
}

fn record(
    py: Python<'_>,
    run: Result<Run<PyErr>, SetupError>,
    hits: &[Vec<EventHit>],
) -> PyResult<RunRecord> {
    let mut record = RunRecord::new(py, run.map_err(setup_error)?)?;
    record.hits = columns_of(py, hits);
    Ok(record)
}

/// Refuses settings of the theta-gamma scheme that are out of range.
#[pyfunction]
pub(crate) fn check_theta_gamma(h: f64, theta: f64, gamma: f64, kappa: f64) -> PyResult<()> {
    let step = ThetaGammaStep::new(h, theta, gamma, wall_of(kappa)?);
    step.map(drop).map_err(|error| setup_error(error.into()))
}

/// The theta-gamma method.
#[pyfunction]
#[pyo3(signature = (force, *, wall, h, theta, gamma, solver, linearisations, span, state, events, progress=None))]
#[allow(clippy::too_many_arguments)]
pub(crate) fn simulate_theta_gamma(
    py: Python<'_>,
    force: &Bound<'_, PyTuple>,
    wall: WallPair,
    h: f64,
    theta: f64,
    gamma: f64,
    solver: &str,
    linearisations: usize,
    span: (f64, f64),
    state: (f64, f64),
    events: Vec<EventSpec<'_>>,
    progress: Option<Py<PyAny>>,
) -> PyResult<RunRecord> {
    let Course { wall, grid, initial } = Course::new(wall, h, span, state)?;
    let solver = step_solver(solver, linearisations)?;
    let method = ThetaGamma { theta, gamma, solver };
    stepped!(py, force, events, progress, |force, watch| zivi::simulate_theta_gamma(
        method, wall, force, grid, initial, watch
    ))
}

/// Multipliers of many independent steps by a general solver, each from the present signs, and
/// whether the inclusion was solved.
#[pyfunction]
#[pyo3(signature = (s, v, f, *, kappa, h, solver, linearisations, fall_backs))]
#[allow(clippy::too_many_arguments, clippy::type_complexity)]
pub(crate) fn solve_steps<'py>(
    py: Python<'py>,
    s: PyReadonlyArray1<'py, f64>,
    v: PyReadonlyArray1<'py, f64>,
    f: PyReadonlyArray1<'py, f64>,
    kappa: f64,
    h: f64,
    solver: &str,
    linearisations: usize,
    fall_backs: bool,
) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<bool>>)> {
    let step = ThetaGammaStep::new(h, 1.0, 1.0, wall_of(kappa)?);
    let step = step.map_err(|error| setup_error(error.into()))?;
    let mut general = match (step_solver(solver, linearisations)?, fall_backs) {
        (Solver::Outer { linearisations }, _) => General::outer(linearisations),
        (_, true) => General::newton(),
        (_, false) => General::newton_without_fall_backs(),
    };
    let (s, v, f) = (s.as_array(), v.as_array(), f.as_array());
    let mut multipliers = [Vec::with_capacity(s.len()), Vec::with_capacity(s.len())];
    let mut solved = Vec::with_capacity(s.len());
    for ((&s, &v), &f) in s.iter().zip(v).zip(f) {
        general.start_from([zivi_core::sgn(s), zivi_core::sgn(v)]);
        solved.push(general.solve_inclusion(&step, Lifted { s, v }, f));
        for (column, lambda) in multipliers.iter_mut().zip(general.lambda()) {
            column.push(lambda);
        }
    }
    let [lambda_s, lambda_v] = multipliers.map(|column| PyArray1::from_vec(py, column));
    Ok((lambda_s, lambda_v, PyArray1::from_vec(py, solved)))
}

/// Explicit Euler with explicit signs.
#[pyfunction]
#[pyo3(signature = (force, *, wall, h, span, state, events, progress=None))]
#[allow(clippy::too_many_arguments)]
pub(crate) fn simulate_explicit_euler(
    py: Python<'_>,
    force: &Bound<'_, PyTuple>,
    wall: WallPair,
    h: f64,
    span: (f64, f64),
    state: (f64, f64),
    events: Vec<EventSpec<'_>>,
    progress: Option<Py<PyAny>>,
) -> PyResult<RunRecord> {
    let Course { wall, grid, initial } = Course::new(wall, h, span, state)?;
    stepped!(py, force, events, progress, |force, watch| zivi::simulate_explicit_euler(
        wall, force, grid, initial, watch
    ))
}

/// Refuses a weight of Moreau-Jean time stepping that is out of range.
#[pyfunction]
pub(crate) fn check_moreau_jean(theta: f64) -> PyResult<()> {
    MoreauJean { theta }.validated().map(drop).map_err(setup_error)
}

/// Moreau-Jean time stepping.
#[pyfunction]
#[pyo3(signature = (force, *, wall, h, theta, span, state, events, progress=None))]
#[allow(clippy::too_many_arguments)]
pub(crate) fn simulate_moreau_jean(
    py: Python<'_>,
    force: &Bound<'_, PyTuple>,
    wall: WallPair,
    h: f64,
    theta: f64,
    span: (f64, f64),
    state: (f64, f64),
    events: Vec<EventSpec<'_>>,
    progress: Option<Py<PyAny>>,
) -> PyResult<RunRecord> {
    let Course { wall, grid, initial } = Course::new(wall, h, span, state)?;
    let method = MoreauJean { theta };
    stepped!(py, force, events, progress, |force, watch| zivi::simulate_moreau_jean(
        method, wall, force, grid, initial, watch
    ))
}
