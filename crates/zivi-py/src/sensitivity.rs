//! Runs with their derivatives, and single flights, from Python.

use crate::batch::{natives, refused};
use crate::force::kind::with_slopes;
use crate::force::Force;
use crate::interface::{array, list, setup_error, Array, Watch};
use crate::method::PyMethod;
use crate::record::RunRecord;
use crate::system::{PyPointMass, PyState};
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use zivi::drive::batch::{map_impacts, orbits};
use zivi::record::status::Failure;
use zivi::switched::sensitivity::{
    EventRates, Flight, Flown, Hyperplane, ImpactSequence, IndependentFlights, Limits,
    NotCorrected, Question, SequenceEquations, Wrt,
};
use zivi::system::slopes::DifferentiableForce;
use zivi::{ImpactMap, MapParameter, Output, PointRun, SwitchedRk};

/// A run and its derivatives; arrays of events have a row of one number for each column.
#[pyclass(frozen, get_all, module = "zivi._zivi")]
pub(crate) struct SensitivityRecord {
    run: Py<RunRecord>,
    x: Array,
    xdot: Array,
    impact_dt: Array,
    impact_du: Array,
    zeno_times: Array,
    liftoff_times: Array,
    radius: Array,
    /// The event that limits each column.
    nearest: Vec<Option<PyNearest>>,
    grazing: bool,
    samples: Array,
    n_slopes: u64,
}

/// The event that is nearest to another order of events.
#[pyclass(frozen, get_all, module = "zivi._zivi", name = "Nearest")]
#[derive(Clone, Copy)]
pub(crate) struct PyNearest {
    /// Which of the limits of a derivative it is.
    pub(crate) limit: u8,
    pub(crate) t: f64,
    /// How far from it the run passes.
    pub(crate) depth: f64,
}

/// `x0`, `xdot0`, `t0` are -1 to -3, parameters of the impact law go down from -4; those of the force
/// have their numbers.
fn wrt_of(code: i64) -> PyResult<Wrt> {
    match code {
        -1 => Ok(Wrt::X0),
        -2 => Ok(Wrt::Xdot0),
        -3 => Ok(Wrt::T0),
        ..=-4 => Ok(Wrt::Law(code.abs_diff(-4) as usize)),
        _ => usize::try_from(code)
            .map(Wrt::Parameter)
            .map_err(|_| PyValueError::new_err(format!("unknown code {code}"))),
    }
}

/// A run of the switched method with its derivatives.
#[pyfunction]
#[pyo3(signature = (system, method, span, start, *, wrt, sizes, controlled, dense, drawn, tstops, times, progress=None))]
#[allow(clippy::too_many_arguments)]
pub(crate) fn sensitivity(
    py: Python<'_>,
    system: PyRef<'_, PyPointMass>,
    method: PyRef<'_, PyMethod>,
    span: (f64, f64),
    start: PyRef<'_, PyState>,
    wrt: Vec<i64>,
    sizes: PyReadonlyArray1<'_, f64>,
    controlled: bool,
    dense: bool,
    drawn: bool,
    tstops: PyReadonlyArray1<'_, f64>,
    times: PyReadonlyArray1<'_, f64>,
    progress: Option<Py<PyAny>>,
) -> PyResult<SensitivityRecord> {
    let _running = crate::leaving::running()?;
    let (method, law, initial) = (method.switched()?, system.law(), start.inner);
    let wrt: Vec<Wrt> = wrt.into_iter().map(wrt_of).collect::<PyResult<_>>()?;
    let (sizes, times, tstops) = (sizes.as_slice()?, times.as_slice()?, tstops.as_slice()?);
    let question = &Question { wrt: &wrt, sizes, controlled, times };
    let watch = &mut Watch::reporting(progress);
    let result = with_slopes!(py, system.force.get(), span.1 - span.0, |force| {
        let output = Output { tstops, dense, drawn, ..Output::default() };
        // compiled once for all kinds of forces
        let force: &mut &mut dyn DifferentiableForce<PyErr> = &mut (force as _);
        zivi::switched::sensitivity::sensitivity(
            method,
            law.clone(),
            force,
            span,
            initial,
            output,
            question,
            watch,
        )
    });
    let (run, derivatives) = result.map_err(setup_error)?;
    let array = |values: Vec<f64>| PyArray1::from_vec(py, values).unbind();
    let EventRates { impact_dt, impact_du, zeno_times, liftoff_times, .. } = derivatives.events;
    let nearest = derivatives
        .nearest
        .iter()
        .map(|it| it.map(|it| PyNearest { limit: it.limit as u8, t: it.t, depth: it.depth }));
    Ok(SensitivityRecord {
        run: Py::new(py, RunRecord::new(py, PointRun::switched(run, law))?)?,
        x: array(derivatives.q),
        xdot: array(derivatives.qdot),
        impact_dt: array(impact_dt),
        impact_du: array(impact_du),
        zeno_times: array(zeno_times),
        liftoff_times: array(liftoff_times),
        radius: array(derivatives.radius),
        nearest: nearest.collect(),
        grazing: derivatives.grazing,
        samples: array(derivatives.samples),
        n_slopes: derivatives.n_slopes,
    })
}

/// Flights of known length, one after the other: for each `x, xdot, pull at the start, pull at
/// the end, time and height of the lowest minimum`, then the derivatives of `x` and those of
/// `xdot` by the initial state and the parameters. With a status instead where one cannot be flown.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub(crate) fn fly_apart(
    py: Python<'_>,
    force: PyRef<'_, Force>,
    method: PyRef<'_, PyMethod>,
    flights: PyReadonlyArray1<'_, f64>,
    by: Vec<usize>,
    sizes: PyReadonlyArray1<'_, f64>,
    minima: bool,
) -> PyResult<(u8, Array)> {
    let _running = crate::leaving::running()?;
    let settings = method.switched()?;
    let flights: Vec<Flight> = flights
        .as_slice()?
        .chunks_exact(4)
        .map(|it| Flight { from: it[0], x: it[1], xdot: it[2], to: it[3] })
        .collect();
    let apart = &IndependentFlights { settings, by: &by, sizes: sizes.as_slice()?, minima };
    let longest = flights.iter().fold(0.0_f64, |longest, it| longest.max(it.to - it.from));
    let flown: Result<Vec<Flown>, Failure<PyErr>> = with_slopes!(py, &force, longest, |force| {
        let force: &mut &mut dyn DifferentiableForce<PyErr> = &mut (force as _);
        zivi::switched::sensitivity::fly_apart(force, &flights, apart)
    });
    let (status, flown) = status_of(flown)?;
    Ok((status, PyArray1::from_vec(py, numbers_of(flown)).unbind()))
}

/// A status, 0 with the result; exceptions of a force are re-raised.
fn status_of<T: Default>(found: Result<T, Failure<PyErr>>) -> PyResult<(u8, T)> {
    match found {
        Err(Failure::Raised(error)) => Err(error),
        Err(Failure::Status(status)) => Ok((status as u8, T::default())),
        Ok(found) => Ok((0, found)),
    }
}

fn numbers_of(flown: Vec<Flown>) -> Vec<f64> {
    let mut numbers = Vec::new();
    for it in flown {
        let [first, last] = it.pull;
        numbers.extend([it.x, it.xdot, first, last, it.lowest.0, it.lowest.1]);
        numbers.extend(it.dx);
        numbers.extend(it.dv);
    }
    numbers
}

/// The equations of a periodic impact sequence, rows `P, t`, with the `last` impact of the previous
/// period: the flights of `fly_apart` with their minima, the residual, its derivative, separately
/// the derivative with respect to the last impact, row by row, and with respect to a parameter,
/// whose code and magnitude are `wrt`.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub(crate) fn sequence_equations(
    py: Python<'_>,
    force: PyRef<'_, Force>,
    method: PyRef<'_, PyMethod>,
    unknowns: PyReadonlyArray1<'_, f64>,
    last: [f64; 2],
    period: f64,
    e: f64,
    wrt: Option<(i64, f64)>,
) -> PyResult<(u8, [Array; 5])> {
    let _running = crate::leaving::running()?;
    let (settings, unknowns) = (method.switched()?, unknowns.as_slice()?);
    let wrt = wrt.map(|(code, size)| Ok::<_, PyErr>((wrt_of(code)?, size))).transpose()?;
    let sequence = ImpactSequence { unknowns, last, length: period, e };
    let (status, found) = status_of(evaluated(py, &force, sequence, (settings, wrt)))?;
    Ok((status, arrays_of(py, found)))
}

fn arrays_of(py: Python<'_>, found: SequenceEquations) -> [Array; 5] {
    let SequenceEquations { flights, residual, own, before, by } = found;
    [numbers_of(flights), residual, own, before, by]
        .map(|values| PyArray1::from_vec(py, values).unbind())
}

/// Result of `correct_sequence`: scaled unknowns with the parameter, tangent, steps, scaled
/// residual, and the result of `sequence_equations`.
type Solution = (Array, Array, usize, f64, [Array; 5]);

/// Seeks the solution of the equations of a sequence and a parameter in a hyperplane, a point and
/// the normal of which are given, scaled by the magnitudes. `at` tells the force, the period, the
/// coefficient of restitution and the derivative of the period at a value of the parameter; a
/// `ValueError` of it is no solution. `limits` are the required residual, the residual accepted if
/// rounding stalls, and the decrease for which the derivative with respect to the parameter is
/// reused. Gives how many times the equations were evaluated, and the solution.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub(crate) fn correct_sequence(
    py: Python<'_>,
    at: Bound<'_, PyAny>,
    method: PyRef<'_, PyMethod>,
    code: i64,
    guess: PyReadonlyArray1<'_, f64>,
    normal: PyReadonlyArray1<'_, f64>,
    scale: PyReadonlyArray1<'_, f64>,
    sizes: PyReadonlyArray1<'_, f64>,
    evaluations: usize,
    limits: [f64; 3],
) -> PyResult<(usize, Option<Solution>)> {
    let _running = crate::leaving::running()?;
    let (settings, wrt) = (method.switched()?, wrt_of(code)?);
    let (guess, normal, scale) = (guess.as_slice()?, normal.as_slice()?, scale.as_slice()?);
    let sizes = sizes.as_slice()?;
    let size = sizes.len() + 1;
    if size % 2 == 0 || size < 3 || [guess, normal, scale].iter().any(|it| it.len() != size) {
        return Err(PyValueError::new_err("rows of P, t and a parameter are expected"));
    }
    let plane = Hyperplane { guess, normal, scale, sizes };
    let [tolerance, enough, stale] = limits;
    let (limits, mut count) = (Limits { evaluations, tolerance, enough, stale }, 0);
    let found = zivi::switched::sensitivity::correct(plane, limits, |y, value, derives| {
        count += 1;
        let told = at.call1((value,)).map_err(Failure::Raised)?;
        let (force, length, e, longer): (PyRef<'_, Force>, f64, f64, f64) =
            told.extract().map_err(Failure::Raised)?;
        let magnitude = if value == 0.0 { 1.0 } else { value.abs() };
        let wrt = derives.then_some((wrt, magnitude));
        let sequence =
            ImpactSequence { unknowns: y, last: [y[y.len() - 2], y[y.len() - 1]], length, e };
        let equations = evaluated(py, &force, sequence, (settings, wrt))?;
        let column = equations.by_parameter(longer);
        Ok((equations, column))
    });
    let it = match found {
        Ok(it) => it,
        Err(NotCorrected::Flight(Failure::Raised(error)))
            if !error.is_instance_of::<PyValueError>(py) =>
        {
            return Err(error);
        }
        Err(_) => return Ok((count, None)),
    };
    let [z, tangent] = [it.z, it.tangent].map(|it| PyArray1::from_vec(py, it).unbind());
    Ok((count, Some((z, tangent, it.steps, it.residual, arrays_of(py, it.equations)))))
}

fn evaluated(
    py: Python<'_>,
    force: &Force,
    sequence: ImpactSequence<'_>,
    (settings, wrt): (SwitchedRk, Option<(Wrt, f64)>),
) -> Result<SequenceEquations, Failure<PyErr>> {
    let evaluated = || {
        Ok(with_slopes!(py, force, sequence.length, |force| {
            let force: &mut &mut dyn DifferentiableForce<PyErr> = &mut (force as _);
            zivi::switched::sensitivity::sequence_equations(force, sequence, settings, wrt)
        }))
    };
    evaluated().map_err(Failure::Raised)?
}

// Maps from impact to impact, from Python.

fn map_of(py: Python<'_>, system: &PyPointMass) -> PyResult<ImpactMap> {
    let native = natives(py, &[system.force.clone_ref(py)])?;
    let Some(restitution) = system.law().constant() else {
        return Err(PyValueError::new_err("e must be a number, Newton's impact law"));
    };
    ImpactMap::new(&native[0], restitution).map_err(setup_error)
}

fn parameter(name: &str) -> PyResult<MapParameter> {
    Ok(match name {
        "stiffness" => MapParameter::Stiffness,
        "damping" => MapParameter::Damping,
        "gravity" => MapParameter::Gravity,
        "amplitude" => MapParameter::Amplitude,
        "omega" => MapParameter::Omega,
        "phase" => MapParameter::Phase,
        "e" => MapParameter::Restitution,
        other => {
            return Err(PyValueError::new_err(format!(
                "parameters must be of 'stiffness', 'damping', 'gravity', 'amplitude', 'omega', \
                 'phase', 'e', got {other:?}"
            )));
        }
    })
}

fn starts_of(given: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<[f64; 2]>> {
    list(given.as_array().rows().into_iter().map(|row| [row[0], row[1]]))
}

/// Refuses a system that has no such map.
#[pyfunction]
pub(crate) fn check_impact_map(py: Python<'_>, system: PyRef<'_, PyPointMass>) -> PyResult<()> {
    let _running = crate::leaving::running()?;
    map_of(py, &system).map(drop)
}

type Maps<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray3<f64>>, Bound<'py, PyArray3<f64>>);

/// The next impacts of rows `phase, u`: rows `phase, u, duration`, Jacobians, and for each impact
/// and parameter the derivatives of its phase and speed.
#[pyfunction]
#[pyo3(signature = (system, starts, *, parameters, threads, progress=None))]
pub(crate) fn map_of_impacts<'py>(
    py: Python<'py>,
    system: PyRef<'py, PyPointMass>,
    starts: PyReadonlyArray2<'py, f64>,
    parameters: Vec<String>,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<Maps<'py>> {
    let _running = crate::leaving::running()?;
    let map = map_of(py, &system)?;
    let by = parameters.iter().map(|name| parameter(name)).collect::<PyResult<Vec<_>>>()?;
    let (starts, watch) = (starts_of(&starts)?, &mut Watch::reporting(progress));
    let all = py.detach(|| map_impacts(&map, &starts, &by, threads, watch)).map_err(refused)?;
    let n = all.len();
    let next = all.iter().flat_map(|it| [it.next.phase, it.next.u, it.next.duration]);
    let jacobian = all.iter().flat_map(|it| it.jacobian.into_iter().flatten());
    let of_parameters = all.iter().flat_map(|it| it.by.iter().flatten().copied());
    Ok((
        array(py, next)?.into_bound(py).reshape([n, 3])?,
        array(py, jacobian)?.into_bound(py).reshape([n, 2, 2])?,
        array(py, of_parameters)?.into_bound(py).reshape([n, by.len(), 2])?,
    ))
}

/// Orbits from rows `phase, u`: for each start `n` rows `phase, u`, the first after `skip` others.
/// There is a system for each start, or one for all.
#[pyfunction]
#[pyo3(signature = (systems, starts, *, skip, n, threads, progress=None))]
#[allow(clippy::too_many_arguments)]
pub(crate) fn orbits_of_impacts<'py>(
    py: Python<'py>,
    systems: Vec<PyRef<'py, PyPointMass>>,
    starts: PyReadonlyArray2<'py, f64>,
    skip: usize,
    n: usize,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let _running = crate::leaving::running()?;
    let maps = systems.iter().map(|it| map_of(py, it)).collect::<PyResult<Vec<_>>>()?;
    let (starts, watch) = (starts_of(&starts)?, &mut Watch::reporting(progress));
    let all = py.detach(|| orbits(&maps, &starts, (skip, n), threads, watch)).map_err(refused)?;
    let values = all.iter().flatten().flatten().copied();
    array(py, values)?.into_bound(py).reshape([all.len(), n, 2])
}
