//! Runs from Python: one entry for all methods and systems. The lock is released unless the force
//! or an event is a Python callable.

use crate::interface::setup_error;
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use zivi::mechanics::{MechanicalOutput, MechanicalRun};
use zivi::stepping::step_solver::General;
use zivi::system::dynamics::Dynamics;
use zivi::{
    AnyImpactLaw, AnyMethod, Grid, Lifted, Method as _, Output, Physical, PointRun, SetupError,
    Solver,
};

use crate::dynamics::AnyDynamics;
use crate::force::with_force;
use crate::friction::{PyFriction, Rubbing};
use crate::interface::{with_room, Watch};
use crate::method::{step_of, step_solver, PyMethod};
use crate::record::MechanicalRecord;
use crate::record::RunRecord;
use crate::system::restitution_of;
use crate::system::{
    kicks_of_mechanism, Configuration, Mechanism, PyPointMass, PyRecordOptions, PyState,
};

/// An array of times as a slice with the lifetime of the array.
pub(crate) struct Times<'py>(Option<PyReadonlyArray1<'py, f64>>);

impl<'py> Times<'py> {
    fn new(py: Python<'py>, given: Option<&Py<PyArray1<f64>>>) -> PyResult<Self> {
        let held = given.map(|times| times.bind(py).try_readonly()).transpose();
        let locked = |_| PyValueError::new_err("the times of a run must not be locked");
        Ok(Self(held.map_err(locked)?))
    }

    fn given(&self) -> PyResult<Option<&[f64]>> {
        Ok(match &self.0 {
            Some(times) => Some(times.as_slice()?),
            None => None,
        })
    }
}

/// A run of any method: of a mass above a wall from a `PyState`, of a mechanical system from a
/// `Configuration`.
#[pyfunction]
#[pyo3(signature = (system, method, span, start, keep, progress=None))]
pub(crate) fn simulate(
    py: Python<'_>,
    system: &Bound<'_, PyAny>,
    method: PyRef<'_, PyMethod>,
    span: (f64, f64),
    start: &Bound<'_, PyAny>,
    keep: PyRef<'_, PyRecordOptions>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Py<PyAny>> {
    let _running = crate::interface::running()?;
    let (method, watch) = (method.inner, &mut Watch::reporting(progress));
    if let (Ok(system), Ok(start)) = (system.cast::<PyPointMass>(), start.cast::<PyState>()) {
        let run = run_point(py, system.get(), method, span, start.get().inner, &keep, watch)?;
        let record = RunRecord::new(py, run.map_err(setup_error)?)?;
        return Ok(Py::new(py, record)?.into_any());
    }
    if let (Ok(system), Ok(start)) = (system.cast::<Mechanism>(), start.cast::<Configuration>()) {
        let run = run_mechanism(py, system.get(), method, span, start.get(), &keep, watch)?;
        let record = MechanicalRecord::new(py, run.map_err(setup_error)?)?;
        return Ok(Py::new(py, record)?.into_any());
    }
    Err(PyTypeError::new_err(
        "simulate takes a PyPointMass and a PyState, or a Mechanism and a Configuration",
    ))
}

type Ran<R> = PyResult<Result<R, SetupError>>;

fn run_point(
    py: Python<'_>,
    system: &PyPointMass,
    method: AnyMethod,
    span: (f64, f64),
    start: Physical,
    keep: &PyRecordOptions,
    watch: &mut Watch<'_>,
) -> Ran<PointRun<PyErr>> {
    let (t_eval, tstops) =
        (Times::new(py, keep.t_eval.as_ref())?, Times::new(py, keep.tstops.as_ref())?);
    let (t_eval, tstops) = (t_eval.given()?, tstops.given()?.unwrap_or_default());
    let (law, dense) = (system.law(), keep.dense);
    let given = system.force.get();
    if !keep.calls() {
        return Ok(with_force!(py, given, |force| {
            let output = Output { t_eval, tstops, dense, in_rows: true, ..Output::default() };
            method.run(zivi::PointMass { force, law: law.clone() }, span, start, output, watch)
        }));
    }
    // the events need the interpreter
    let events = keep.events.iter().map(|it| it.get().of_point(py)).collect();
    let kicks = keep.kicks_of_point(py);
    let output =
        Output { t_eval, tstops, dense, events, kicks, in_rows: true, ..Output::default() };
    let force = &mut given.on(py);
    Ok(method.run(zivi::PointMass { force, law: law.clone() }, span, start, output, watch))
}

fn run_mechanism(
    py: Python<'_>,
    system: &Mechanism,
    method: AnyMethod,
    span: (f64, f64),
    start: &Configuration,
    keep: &PyRecordOptions,
    watch: &mut Watch<'_>,
) -> Ran<MechanicalRun<PyErr>> {
    let (t_eval, tstops) =
        (Times::new(py, keep.t_eval.as_ref())?, Times::new(py, keep.tstops.as_ref())?);
    let (t_eval, tstops) = (t_eval.given()?, tstops.given()?.unwrap_or_default());
    let PyRecordOptions { ends, dense, arcs, .. } = *keep;
    let laws = system.laws.as_slice();
    let start = (start.q.as_slice(), start.qdot.as_slice());
    let (layout, friction) = (system.layout(), system.laws_of_contact());
    let dynamics = AnyDynamics::of(py, system.model.get(), layout);
    let output =
        |(events, kicks)| MechanicalOutput { t_eval, tstops, ends, dense, arcs, events, kicks };
    let run = |dynamics: &mut dyn Dynamics<PyErr>, calls, watch: &mut Watch<'_>| {
        run_dynamics(dynamics, (friction, laws), method, span, start, output(calls), watch)
    };
    Ok(match dynamics {
        AnyDynamics::Compiled(mut dynamics) if !keep.calls() => {
            py.detach(|| run(&mut dynamics, (Vec::new(), None), watch))
        }
        // the events need the interpreter
        mut dynamics => {
            let events = keep.events.iter().map(|it| it.get().of_mechanism(py, layout.n)).collect();
            let kicks = keep.kicks.as_ref().map(|it| kicks_of_mechanism(it, layout.n));
            run(&mut dynamics, (events, kicks), watch)
        }
    })
}

/// A run of a mechanical system, compiled once for all kinds of them.
pub(crate) fn run_dynamics(
    mut dynamics: &mut dyn Dynamics<PyErr>,
    (friction, laws): (Option<&PyFriction>, &[AnyImpactLaw]),
    method: AnyMethod,
    span: (f64, f64),
    start: (&[f64], &[f64]),
    output: MechanicalOutput<'_, PyErr>,
    watch: &mut Watch<'_>,
) -> Result<MechanicalRun<PyErr>, SetupError> {
    let mut rubbing = Rubbing { dynamics: &mut dynamics, friction, moved: &[] };
    let system = zivi::Mechanism { dynamics: &mut rubbing, laws };
    method.run(system, span, start, output, watch)
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
    solver: &Bound<'_, PyAny>,
    linearisations: i64,
    fall_backs: bool,
) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<bool>>)> {
    let _running = crate::interface::running()?;
    let step = step_of(h, restitution_of(kappa)?)?;
    let mut general = match (step_solver(solver, linearisations)?, fall_backs) {
        (Solver::Outer { linearisations }, _) => General::outer(linearisations),
        (_, true) => General::newton(),
        (_, false) => General::newton_without_fall_backs(),
    };
    let (s, v, f) = (s.as_array(), v.as_array(), f.as_array());
    let mut multipliers = [with_room(s.len())?, with_room(s.len())?];
    let mut solved = with_room(s.len())?;
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

/// The grid of a run of fixed steps.
pub(crate) fn grid_of(span: (f64, f64), h: f64) -> PyResult<Grid> {
    Grid::new(span.0, span.1, h).map_err(|error| setup_error(error.into()))
}
