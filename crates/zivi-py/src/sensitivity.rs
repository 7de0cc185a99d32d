//! Runs with their derivatives, and single flights, from Python.

use std::sync::Arc;

use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::gc::{PyTraverseError, PyVisit};
use pyo3::prelude::*;
use zivi::drive::batch::{map_impacts, orbits};
use zivi::mechanics::sensitivity::{
    mechanical_sensitivity as differentiate, Derivatives, FrictionNumber, MechanicalWrt,
};
use zivi::mechanics::{MechanicalOutput, MechanicalRun};
use zivi::record::status::Failure;
use zivi::switched::sensitivity::{
    EventRates, Flight, Flown, Hyperplane, ImpactSequence, IndependentFlights, Limits,
    NotCorrected, Question, SequenceEquations, Wrt,
};
use zivi::system::dynamics::{Dynamics, Layout};
use zivi::system::linear_dynamics::LinearPartials;
use zivi::system::partials::{
    DifferencedDynamics, DifferentiableDynamics, MovedLaws, Neighbours, TimedState, MOVES,
};
use zivi::system::slopes::DifferentiableForce;
use zivi::system::tree::TreeDynamics;
use zivi::{AnyImpactLaw, ImpactMap, MapParameter, Output, PointRun, SetupError, SwitchedRk};

use crate::batch::{natives, refused};
use crate::dynamics::{AnyDynamics, CompiledDynamics, Model, PythonDynamics};
use crate::force::kind::with_slopes;
use crate::force::Force;
use crate::friction::{PyFriction, Rubbing};
use crate::interface::{array, list, setup_error, vector, Array, Watch};
use crate::method::PyMethod;
use crate::record::{MechanicalRecord, RunRecord};
use crate::system::{Configuration, Mechanism, PyImpactLaw, PyPointMass, PyState};

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
    let _running = crate::interface::running()?;
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
    let _running = crate::interface::running()?;
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
    let _running = crate::interface::running()?;
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
    let _running = crate::interface::running()?;
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

/// Rejects a system that has no such map.
#[pyfunction]
pub(crate) fn check_impact_map(py: Python<'_>, system: PyRef<'_, PyPointMass>) -> PyResult<()> {
    let _running = crate::interface::running()?;
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
    let _running = crate::interface::running()?;
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
    let _running = crate::interface::running()?;
    let maps = systems.iter().map(|it| map_of(py, it)).collect::<PyResult<Vec<_>>>()?;
    let (starts, watch) = (starts_of(&starts)?, &mut Watch::reporting(progress));
    let all = py.detach(|| orbits(&maps, &starts, (skip, n), threads, watch)).map_err(refused)?;
    let values = all.iter().flatten().flatten().copied();
    array(py, values)?.into_bound(py).reshape([all.len(), n, 2])
}

// Mechanical systems from Python with their partial derivatives.

/// A system, and a function that fills in all its partial derivatives.
struct WithPartials<D, P> {
    dynamics: D,
    partials: P,
    parameters: usize,
    all: Vec<f64>,
}

impl<D: Dynamics<PyErr>, P: Dynamics<PyErr>> WithPartials<D, P> {
    fn new(dynamics: D, partials: P, parameters: usize) -> Self {
        let layout = dynamics.layout();
        let all = vec![0.0; layout.len() * (1 + 2 * layout.n + parameters)];
        Self { dynamics, partials, parameters, all }
    }
}

impl<D: Dynamics<PyErr>, P> Dynamics<PyErr> for WithPartials<D, P> {
    fn layout(&self) -> Layout {
        self.dynamics.layout()
    }

    fn evaluate(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> PyResult<()> {
        self.dynamics.evaluate(t, q, w, out)
    }
}

impl<D: Dynamics<PyErr>, P: Dynamics<PyErr>> DifferentiableDynamics<PyErr> for WithPartials<D, P> {
    fn parameters(&self) -> usize {
        self.parameters
    }

    fn partials(&mut self, at: TimedState<'_>, by: &[usize], out: &mut [f64]) -> PyResult<()> {
        self.partials.evaluate(at.t, at.q, at.w, &mut self.all)?;
        let length = self.layout().len();
        let (state, parameters) = self.all.split_at((1 + 2 * at.q.len()) * length);
        let (of_state, of_parameters) = out.split_at_mut(state.len());
        of_state.copy_from_slice(state);
        for (&parameter, out) in by.iter().zip(of_parameters.chunks_exact_mut(length)) {
            out.copy_from_slice(&parameters[parameter * length..][..length]);
        }
        Ok(())
    }
}

/// Source of the partial derivatives of a model.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct Partials {
    source: PartialsSource,
}

impl Partials {
    /// How parameters move the laws of the gaps.
    fn moved_laws(&self) -> Vec<Option<MovedLaws>> {
        match &self.source {
            PartialsSource::Differences(moved) => moved.iter().map(|it| it.get().laws()).collect(),
            PartialsSource::Function(..) | PartialsSource::Tree(_) => Vec::new(),
        }
    }
}

enum PartialsSource {
    /// Differences: of the model itself by time and state, of moved models by each parameter.
    Differences(Vec<Py<MovedModel>>),
    /// A function that fills in all derivatives: with respect to time, coordinates, velocities and
    /// parameters, in this order.
    Function(Py<Model>, usize),
    /// Of a tree: how each parameter moves its numbers.
    Tree(Arc<Vec<Vec<f64>>>),
}

#[pymethods]
impl Partials {
    #[staticmethod]
    fn differences(moved: Vec<Py<MovedModel>>) -> Self {
        Self { source: PartialsSource::Differences(moved) }
    }

    #[staticmethod]
    fn function(function: Py<Model>, parameters: usize) -> Self {
        Self { source: PartialsSource::Function(function, parameters) }
    }

    #[staticmethod]
    fn tree(directions: Vec<Vec<f64>>) -> Self {
        Self { source: PartialsSource::Tree(Arc::new(directions)) }
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        match &self.source {
            PartialsSource::Differences(moved) => moved.iter().try_for_each(|it| visit.call(it)),
            PartialsSource::Function(function, _) => visit.call(function),
            PartialsSource::Tree(_) => Ok(()),
        }
    }
}

/// A model with a parameter moved by multiples of a step.
#[pyclass(frozen, module = "zivi._zivi", name = "Moved")]
pub(crate) struct MovedModel {
    step: f64,
    models: Vec<Py<Model>>,
    impacts: Vec<(usize, Vec<Py<PyImpactLaw>>)>,
    contacts: Vec<(usize, usize, f64)>,
}

#[pymethods]
impl MovedModel {
    /// The models; the impact laws that move, by gap, in the same order; the derivatives of the numbers of
    /// contact forces: gap, number, derivative.
    #[new]
    #[pyo3(signature = (step, models, impacts=vec![], contacts=vec![]))]
    fn new(
        step: f64,
        models: Vec<Py<Model>>,
        impacts: Vec<(usize, Vec<Py<PyImpactLaw>>)>,
        contacts: Vec<(usize, usize, f64)>,
    ) -> Self {
        Self { step, models, impacts, contacts }
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        let laws = self.impacts.iter().flat_map(|it| &it.1);
        laws.into_iter().try_for_each(|it| visit.call(it))?;
        self.models.iter().try_for_each(|it| visit.call(it))
    }
}

impl MovedModel {
    /// The laws of the gaps, where they move.
    fn laws(&self) -> Option<MovedLaws> {
        let one = |(gap, laws): &(usize, Vec<Py<PyImpactLaw>>)| {
            let laws: Vec<AnyImpactLaw> = laws.iter().map(|law| law.get().inner.clone()).collect();
            Some((*gap, laws.try_into().ok()?))
        };
        let impacts: Option<Vec<_>> = self.impacts.iter().map(one).collect();
        let laws =
            MovedLaws { step: self.step, impacts: impacts?, contacts: self.contacts.clone() };
        (!(laws.impacts.is_empty() && laws.contacts.is_empty())).then_some(laws)
    }
}

/// The same system with moved parameters, of the kind of the system itself.
fn neighbours<'py, D>(
    py: Python<'py>,
    moved: &[Py<MovedModel>],
    layout: Layout,
    of: impl Fn(AnyDynamics<'py>) -> Option<D>,
) -> PyResult<Vec<Neighbours<D>>> {
    let one = |moved: &Py<MovedModel>| {
        let MovedModel { step, models, .. } = moved.get();
        let systems = models.iter().map(|model| of(AnyDynamics::of(py, model.get(), layout)));
        let systems: Option<Vec<D>> = systems.collect();
        let systems = systems.and_then(|systems| <[D; MOVES.len()]>::try_from(systems).ok());
        let systems = systems.ok_or_else(|| {
            pyo3::exceptions::PyValueError::new_err("a parameter needs six systems of one kind")
        })?;
        Ok(Neighbours { step: *step, systems })
    };
    moved.iter().map(one).collect()
}

fn compiled(spec: AnyDynamics<'_>) -> Option<CompiledDynamics> {
    match spec {
        AnyDynamics::Compiled(it) => Some(it),
        AnyDynamics::Callable(_) => None,
    }
}

/// Linear systems that differ in their numbers only.
fn linear(
    model: &CompiledDynamics,
    moved: &[Neighbours<CompiledDynamics>],
) -> Option<LinearPartials> {
    let of = |Neighbours { step, systems }: &Neighbours<CompiledDynamics>| {
        let systems = systems.iter().map(|it| it.linear_system().cloned());
        let systems: Vec<_> = systems.collect::<Option<_>>()?;
        Some(Neighbours { step: *step, systems: systems.try_into().ok()? })
    };
    let system = model.linear_system()?.clone();
    let moved: Vec<_> = moved.iter().map(of).collect::<Option<_>>()?;
    LinearPartials::differenced(system, &moved)
}

fn no_tree() -> PyErr {
    pyo3::exceptions::PyValueError::new_err("these derivatives are those of a tree")
}

fn callable(spec: AnyDynamics<'_>) -> Option<PythonDynamics<'_>> {
    match spec {
        AnyDynamics::Callable(it) => Some(it),
        AnyDynamics::Compiled(_) => None,
    }
}

/// A run and its derivatives: arrays have a row of one number for each column.
#[pyclass(frozen, get_all, module = "zivi._zivi")]
pub(crate) struct MechanicalSensitivityRecord {
    run: Py<MechanicalRecord>,
    /// For each column n numbers.
    q: Array,
    qdot: Array,
    impact_dt: Array,
    impact_du: Array,
    zeno_times: Array,
    liftoff_times: Array,
    touchdown_times: Array,
    transition_times: Array,
    radius: Array,
    /// The event that limits each column.
    nearest: Vec<Option<PyNearest>>,
    grazing: bool,
    lost_at: Option<f64>,
    samples: Array,
    n_slopes: u64,
}

/// The numbers of a channel of friction in their order.
const NUMBERS: [FrictionNumber; 5] = [
    FrictionNumber::Slip,
    FrictionNumber::Static,
    FrictionNumber::Both,
    FrictionNumber::Velocity,
    FrictionNumber::Restitution,
];

/// `(kind, index, of)`: `q0`, `qdot0`, `t0`, `e` of all gaps, the parameter `of` of the law of one, a
/// parameter, the number `of` of a channel of friction or of a compliant gap are 0 to 7.
fn mechanical_wrt_of((kind, index, of): &(u8, usize, usize)) -> MechanicalWrt {
    match kind {
        0 => MechanicalWrt::Q0(*index),
        1 => MechanicalWrt::Qdot0(*index),
        2 => MechanicalWrt::T0,
        3 => MechanicalWrt::AllE,
        4 => MechanicalWrt::Law { gap: *index, parameter: *of },
        5 => MechanicalWrt::Parameter(*index),
        7 => MechanicalWrt::Contact { gap: *index, number: *of },
        _ => MechanicalWrt::Friction {
            channel: *index,
            number: NUMBERS[(*of).min(NUMBERS.len() - 1)],
        },
    }
}

/// Arguments of a run other than the system.
struct RunArguments<'a> {
    method: SwitchedRk,
    laws: &'a [AnyImpactLaw],
    friction: Option<&'a PyFriction>,
    moved: &'a [Option<MovedLaws>],
    span: (f64, f64),
    start: (&'a [f64], &'a [f64]),
    tstops: &'a [f64],
    dense: bool,
    question: Question<'a, MechanicalWrt>,
}

type Outcome = Result<(MechanicalRun<PyErr>, Derivatives), SetupError>;

impl RunArguments<'_> {
    /// Compiled once for all kinds of systems: an evaluation takes many times what it takes to find it.
    fn run(
        &self,
        mut dynamics: &mut dyn DifferentiableDynamics<PyErr>,
        watch: &mut Watch<'_>,
    ) -> Outcome {
        let Self { method, laws, friction, moved, span, start, tstops, dense, question } = self;
        let output = MechanicalOutput { tstops, dense: *dense, ..MechanicalOutput::default() };
        let mut system = Rubbing { dynamics: &mut dynamics, friction: *friction, moved };
        differentiate(*method, &mut system, laws, *span, *start, output, question, watch)
    }

    /// Without the interpreter where nothing needs it.
    fn dispatch<'py>(
        &self,
        py: Python<'py>,
        model: AnyDynamics<'py>,
        partials: &Partials,
        layout: Layout,
        watch: &mut Watch<'_>,
    ) -> PyResult<Outcome> {
        let duration = self.span.1 - self.span.0;
        Ok(match (model, &partials.source) {
            (AnyDynamics::Compiled(model), PartialsSource::Differences(moved)) => {
                let more = neighbours(py, moved, layout, compiled)?;
                if let Some(mut system) = linear(&model, &more) {
                    return Ok(py.detach(|| self.run(&mut system, watch)));
                }
                let mut system = DifferencedDynamics::new(model, more, duration);
                py.detach(|| self.run(&mut system, watch))
            }
            (AnyDynamics::Callable(model), PartialsSource::Differences(moved)) => {
                let more = neighbours(py, moved, layout, callable)?;
                self.run(&mut DifferencedDynamics::new(model, more, duration), watch)
            }
            (AnyDynamics::Compiled(model), PartialsSource::Tree(directions)) => {
                let tree = model.tree().ok_or_else(no_tree)?.clone();
                let mut system = TreeDynamics::with_directions(tree, directions.clone());
                py.detach(|| self.run(&mut system, watch))
            }
            (AnyDynamics::Callable(_), PartialsSource::Tree(_)) => return Err(no_tree()),
            (model, PartialsSource::Function(function, parameters)) => {
                match (model, AnyDynamics::of(py, function.get(), layout)) {
                    (AnyDynamics::Compiled(model), AnyDynamics::Compiled(partials)) => {
                        let mut system = WithPartials::new(model, partials, *parameters);
                        py.detach(|| self.run(&mut system, watch))
                    }
                    (AnyDynamics::Compiled(model), AnyDynamics::Callable(partials)) => {
                        self.run(&mut WithPartials::new(model, partials, *parameters), watch)
                    }
                    (AnyDynamics::Callable(model), AnyDynamics::Compiled(partials)) => {
                        self.run(&mut WithPartials::new(model, partials, *parameters), watch)
                    }
                    (AnyDynamics::Callable(model), AnyDynamics::Callable(partials)) => {
                        self.run(&mut WithPartials::new(model, partials, *parameters), watch)
                    }
                }
            }
        })
    }
}

/// A run of the switched method for a mechanical system, with its derivatives.
#[pyfunction]
#[pyo3(signature = (
    system, partials, method, span, start, *, wrt, sizes, controlled, dense, tstops, times,
    progress=None
))]
#[allow(clippy::too_many_arguments)]
pub(crate) fn mechanical_sensitivity(
    py: Python<'_>,
    system: PyRef<'_, Mechanism>,
    partials: PyRef<'_, Partials>,
    method: PyRef<'_, PyMethod>,
    span: (f64, f64),
    start: PyRef<'_, Configuration>,
    wrt: Vec<(u8, usize, usize)>,
    sizes: PyReadonlyArray1<'_, f64>,
    controlled: bool,
    dense: bool,
    tstops: PyReadonlyArray1<'_, f64>,
    times: PyReadonlyArray1<'_, f64>,
    progress: Option<Py<PyAny>>,
) -> PyResult<MechanicalSensitivityRecord> {
    let _running = crate::interface::running()?;
    let (method, laws) = (method.switched()?, &system.laws[..]);
    let (q, qdot) = (start.q.clone(), start.qdot.clone());
    let (sizes, times, tstops) = (vector(&sizes)?, vector(&times)?, vector(&tstops)?);
    let wrt: Vec<MechanicalWrt> = wrt.iter().map(mechanical_wrt_of).collect();
    let (layout, friction) = (system.layout(), system.laws_of_contact());
    let question = Question { wrt: &wrt, sizes: &sizes, controlled, times: &times };
    let start = (&q[..], &qdot[..]);
    let tstops = &tstops[..];
    let moved = partials.moved_laws();
    let moved = &moved[..];
    let task = RunArguments { method, laws, friction, moved, span, start, tstops, dense, question };
    let model = AnyDynamics::of(py, system.model.get(), layout);
    let watch = &mut Watch::reporting(progress);
    let outcome = task.dispatch(py, model, &partials, layout, watch)?;
    let (run, found) = outcome.map_err(setup_error)?;
    let array = |values: Vec<f64>| numpy::PyArray1::from_vec(py, values).unbind();
    let nearest = found
        .nearest
        .iter()
        .map(|it| it.map(|it| PyNearest { limit: it.limit as u8, t: it.t, depth: it.depth }));
    let EventRates {
        impact_dt,
        impact_du,
        zeno_times,
        liftoff_times,
        touchdown_times,
        transition_times,
    } = found.events;
    Ok(MechanicalSensitivityRecord {
        nearest: nearest.collect(),
        run: Py::new(py, MechanicalRecord::new(py, run)?)?,
        q: array(found.q),
        qdot: array(found.qdot),
        impact_dt: array(impact_dt),
        impact_du: array(impact_du),
        zeno_times: array(zeno_times),
        liftoff_times: array(liftoff_times),
        touchdown_times: array(touchdown_times),
        transition_times: array(transition_times),
        radius: array(found.radius),
        grazing: found.grazing,
        lost_at: found.lost_at,
        samples: array(found.samples),
        n_slopes: found.n_slopes,
    })
}
