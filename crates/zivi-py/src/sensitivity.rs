//! Runs with their derivatives, and flights apart, from Python.

use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use zivi::record::failure::Failure;
use zivi::switched::sensitivity::{
    EventRates, Flight, Flown, ImpactSequence, IndependentFlights, Question, Wrt,
};
use zivi::system::slopes::DifferentiableForce;
use zivi::{Output, PointRun};

use crate::arrays::Array;
use crate::errors::setup_error;
use crate::force::slopes::with_slopes;
use crate::force::Force;
use crate::method::Method;
use crate::record::RunRecord;
use crate::system::{PointMass, State};
use crate::watch::Watch;

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
    nearest: Vec<Option<Nearest>>,
    grazing: bool,
    samples: Array,
    n_slopes: u64,
}

/// The event that is nearest to another order of events.
#[pyclass(frozen, get_all, module = "zivi._zivi")]
#[derive(Clone, Copy)]
pub(crate) struct Nearest {
    /// Which of the limits of a derivative it is.
    pub(crate) limit: u8,
    pub(crate) t: f64,
    /// How far from it the run passes.
    pub(crate) depth: f64,
}

/// `x0`, `xdot0`, `t0` are -1 to -3, parameters of the impact law go down from -4; those of the force
/// have their numbers.
fn wrt_of(codes: &[i64]) -> PyResult<Vec<Wrt>> {
    let one = |&code: &i64| match code {
        -1 => Ok(Wrt::X0),
        -2 => Ok(Wrt::Xdot0),
        -3 => Ok(Wrt::T0),
        code @ ..=-4 => Ok(Wrt::Law(code.abs_diff(-4) as usize)),
        code => usize::try_from(code)
            .map(Wrt::Parameter)
            .map_err(|_| PyValueError::new_err(format!("unknown code {code}"))),
    };
    codes.iter().map(one).collect()
}

/// A run of the switched method with its derivatives.
#[pyfunction]
#[pyo3(signature = (system, method, span, start, *, wrt, sizes, controlled, dense, drawn, tstops, times, progress=None))]
#[allow(clippy::too_many_arguments)]
pub(crate) fn sensitivity(
    py: Python<'_>,
    system: PyRef<'_, PointMass>,
    method: PyRef<'_, Method>,
    span: (f64, f64),
    start: PyRef<'_, State>,
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
    let (method, law, initial) = (method.switched()?, system.law, start.inner);
    let wrt = wrt_of(&wrt)?;
    let (sizes, times, tstops) = (sizes.as_slice()?, times.as_slice()?, tstops.as_slice()?);
    let question = &Question { wrt: &wrt, sizes, controlled, times };
    let watch = &mut Watch { progress };
    let result = with_slopes!(py, system.force.get(), span.1 - span.0, |force| {
        let output = Output { tstops, dense, drawn, ..Output::default() };
        // compiled once for all kinds of forces
        let force: &mut &mut dyn DifferentiableForce<PyErr> = &mut (force as _);
        zivi::switched::sensitivity::sensitivity(
            method, law, force, span, initial, output, question, watch,
        )
    });
    let (run, derivatives) = result.map_err(setup_error)?;
    let array = |values: Vec<f64>| PyArray1::from_vec(py, values).unbind();
    let EventRates { impact_dt, impact_du, zeno_times, liftoff_times } = derivatives.events;
    let nearest = derivatives
        .nearest
        .iter()
        .map(|it| it.map(|it| Nearest { limit: it.limit as u8, t: it.t, depth: it.depth }));
    Ok(SensitivityRecord {
        run: Py::new(py, RunRecord::new(py, PointRun::switched(run, &law))?)?,
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
    method: PyRef<'_, Method>,
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

/// A status, 0 with what was computed; what a force raised is raised.
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

/// The equations of a sequence of impacts that repeats, rows `P, t` one after the other, the `last`
/// one a period ago: the flights as `fly_apart` gives them with their minima, what must vanish, its
/// derivative and apart from that the one by the last impact, row by row.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub(crate) fn sequence_equations(
    py: Python<'_>,
    force: PyRef<'_, Force>,
    method: PyRef<'_, Method>,
    unknowns: PyReadonlyArray1<'_, f64>,
    last: [f64; 2],
    period: f64,
    e: f64,
    by: Vec<usize>,
    sizes: PyReadonlyArray1<'_, f64>,
) -> PyResult<(u8, [Array; 4])> {
    let _running = crate::leaving::running()?;
    let (settings, unknowns) = (method.switched()?, unknowns.as_slice()?);
    let apart = &IndependentFlights { settings, by: &by, sizes: sizes.as_slice()?, minima: true };
    let sequence = ImpactSequence { unknowns, last, length: period, e };
    let found = with_slopes!(py, &force, period, |force| {
        let force: &mut &mut dyn DifferentiableForce<PyErr> = &mut (force as _);
        zivi::switched::sensitivity::sequence_equations(force, sequence, apart)
    });
    let (status, found) = status_of(found)?;
    let array = |values: Vec<f64>| PyArray1::from_vec(py, values).unbind();
    let flights = numbers_of(found.flights);
    Ok((status, [flights, found.residual, found.own, found.before].map(array)))
}
