//! Runs from Python: the lock is released unless the force is a Python callable.

use pyo3::exceptions::{PyMemoryError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use zivi::{ConstantForce, Grid, Physical, Restitution, Run, SetupError, ThetaGamma};
use zivi_core::ThetaGammaStep;

use crate::force::ForceSpec;
use crate::record::RunRecord;
use crate::transform::wall;
use crate::watch::Watch;

fn setup_error(error: SetupError) -> PyErr {
    match error {
        SetupError::Memory(_) => PyMemoryError::new_err(error.to_string()),
        _ => PyValueError::new_err(error.to_string()),
    }
}

/// The span, the step size and the initial state of a fixed-step run.
struct Course {
    wall: Restitution,
    grid: Grid,
    initial: Physical,
}

impl Course {
    fn new(kappa: f64, h: f64, span: (f64, f64), state: (f64, f64)) -> PyResult<Self> {
        let grid = Grid::new(span.0, span.1, h).map_err(|error| setup_error(error.into()))?;
        let initial = Physical { x: state.0, xdot: state.1 };
        Ok(Self { wall: wall(kappa)?, grid, initial })
    }
}

/// One call for every kind of force, so that each is compiled into its own loop.
macro_rules! with_force {
    ($py:expr, $spec:expr, |$force:ident| $run:expr) => {
        match ForceSpec::from_tuple($spec)? {
            ForceSpec::Constant(value) => {
                let $force = &mut ConstantForce(value);
                $py.detach(|| $run)
            }
            ForceSpec::Linear(mut linear) => {
                let $force = &mut linear;
                $py.detach(|| $run)
            }
            ForceSpec::Compiled(mut compiled) => {
                let $force = &mut compiled;
                $py.detach(|| $run)
            }
            ForceSpec::Callable(mut callable) => {
                let $force = &mut callable;
                $run
            }
        }
    };
}

fn record(py: Python<'_>, run: Result<Run<PyErr>, SetupError>) -> PyResult<RunRecord> {
    Ok(RunRecord::new(py, run.map_err(setup_error)?))
}

/// Refuses settings of the theta-gamma scheme that are out of range.
#[pyfunction]
pub(crate) fn check_theta_gamma(h: f64, theta: f64, gamma: f64, kappa: f64) -> PyResult<()> {
    let step = ThetaGammaStep::new(h, theta, gamma, wall(kappa)?);
    step.map(drop).map_err(|error| setup_error(error.into()))
}

/// The theta-gamma method.
#[pyfunction]
#[pyo3(signature = (force, *, kappa, h, theta, gamma, span, state, progress=None))]
#[allow(clippy::too_many_arguments)]
pub(crate) fn simulate_theta_gamma(
    py: Python<'_>,
    force: &Bound<'_, PyTuple>,
    kappa: f64,
    h: f64,
    theta: f64,
    gamma: f64,
    span: (f64, f64),
    state: (f64, f64),
    progress: Option<Py<PyAny>>,
) -> PyResult<RunRecord> {
    let Course { wall, grid, initial } = Course::new(kappa, h, span, state)?;
    let method = ThetaGamma { theta, gamma };
    let watch = &mut Watch { progress };
    let run = with_force!(py, force, |force| zivi::simulate_theta_gamma(
        method, wall, force, grid, initial, watch
    ));
    record(py, run)
}

/// Explicit Euler with explicit signs.
#[pyfunction]
#[pyo3(signature = (force, *, kappa, h, span, state, progress=None))]
pub(crate) fn simulate_explicit_euler(
    py: Python<'_>,
    force: &Bound<'_, PyTuple>,
    kappa: f64,
    h: f64,
    span: (f64, f64),
    state: (f64, f64),
    progress: Option<Py<PyAny>>,
) -> PyResult<RunRecord> {
    let Course { wall, grid, initial } = Course::new(kappa, h, span, state)?;
    let watch = &mut Watch { progress };
    let run = with_force!(py, force, |force| zivi::simulate_explicit_euler(
        wall, force, grid, initial, watch
    ));
    record(py, run)
}
