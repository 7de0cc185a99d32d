//! Mechanical systems from Python with their partial derivatives.

use std::sync::Arc;

use numpy::PyReadonlyArray1;
use pyo3::gc::{PyTraverseError, PyVisit};
use pyo3::prelude::*;
use zivi::mechanics::sensitivity::{
    mechanical_sensitivity as differentiate, Derivatives, EventRates, FrictionNumber,
    MechanicalWrt, Question,
};
use zivi::mechanics::{MechanicalOutput, MechanicalRun};
use zivi::system::dynamics::{Dynamics, Layout};
use zivi::system::linear_dynamics::LinearPartials;
use zivi::system::partials::{
    DifferencedDynamics, DifferentiableDynamics, Neighbours, TimedState, MOVES,
};
use zivi::system::tree::TreeDynamics;
use zivi::{AnyImpactLaw, SetupError, SwitchedRk};

use crate::dynamics::{AnyDynamics, CompiledDynamics, Model, PythonDynamics};
use crate::friction::{PyFriction, Rubbing};
use crate::interface::{setup_error, vector, Array, Watch};
use crate::mechanics::MechanicalRecord;
use crate::method::PyMethod;
use crate::sensitivity::PyNearest;
use crate::system::{Configuration, Mechanism};

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
}

#[pymethods]
impl MovedModel {
    #[new]
    fn new(step: f64, models: Vec<Py<Model>>) -> Self {
        Self { step, models }
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        self.models.iter().try_for_each(|it| visit.call(it))
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
        let MovedModel { step, models } = moved.get();
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
/// parameter, the number `of` of a channel of friction are 0 to 6.
fn wrt_of((kind, index, of): &(u8, usize, usize)) -> MechanicalWrt {
    match kind {
        0 => MechanicalWrt::Q0(*index),
        1 => MechanicalWrt::Qdot0(*index),
        2 => MechanicalWrt::T0,
        3 => MechanicalWrt::AllE,
        4 => MechanicalWrt::Law { gap: *index, parameter: *of },
        5 => MechanicalWrt::Parameter(*index),
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
        let Self { method, laws, friction, span, start, tstops, dense, question } = self;
        let output = MechanicalOutput { tstops, dense: *dense, ..MechanicalOutput::default() };
        let mut system = Rubbing { dynamics: &mut dynamics, friction: *friction };
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
    let _running = crate::leaving::running()?;
    let (method, laws) = (method.switched()?, &system.laws[..]);
    let (q, qdot) = (start.q.clone(), start.qdot.clone());
    let (sizes, times, tstops) = (vector(&sizes)?, vector(&times)?, vector(&tstops)?);
    let wrt: Vec<MechanicalWrt> = wrt.iter().map(wrt_of).collect();
    let (layout, friction) = (system.layout(), system.laws_of_contact());
    let question = Question { wrt: &wrt, sizes: &sizes, controlled, times: &times };
    let start = (&q[..], &qdot[..]);
    let tstops = &tstops[..];
    let task = RunArguments { method, laws, friction, span, start, tstops, dense, question };
    let model = AnyDynamics::of(py, system.model.get(), layout);
    let watch = &mut Watch::reporting(progress);
    let outcome = task.dispatch(py, model, &partials, layout, watch)?;
    let (run, found) = outcome.map_err(setup_error)?;
    let array = |values: Vec<f64>| numpy::PyArray1::from_vec(py, values).unbind();
    let nearest = found
        .nearest
        .iter()
        .map(|it| it.map(|it| PyNearest { limit: it.limit as u8, t: it.t, depth: it.depth }));
    let EventRates { impact_dt, impact_du, zeno_times, liftoff_times, transition_times } =
        found.events;
    Ok(MechanicalSensitivityRecord {
        nearest: nearest.collect(),
        run: Py::new(py, MechanicalRecord::new(py, run)?)?,
        q: array(found.q),
        qdot: array(found.qdot),
        impact_dt: array(impact_dt),
        impact_du: array(impact_du),
        zeno_times: array(zeno_times),
        liftoff_times: array(liftoff_times),
        transition_times: array(transition_times),
        radius: array(found.radius),
        grazing: found.grazing,
        lost_at: found.lost_at,
        samples: array(found.samples),
        n_slopes: found.n_slopes,
    })
}
