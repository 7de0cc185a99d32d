//! The sampled closed loop from Python.

use std::cell::Cell;

use numpy::ndarray::ArrayView1;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::IntoPyDict;
use zivi::drive::batch::{
    simulate_closed_loop_batch as run_batch, LoopMember, LoopOutcome, LoopSettings,
};
use zivi::drive::closed_loop::{
    observe_closed_loop, AnyController, Controller, Forces, Loop, LoopOptions, LoopPath, LoopRun,
    Motion, Reference, ReferencePeriod, ReferencePoint, ReferenceWithWall, Samples, Sensor,
    SignRecord, Tick, TickError, SIGNS,
};
use zivi::drive::Updates;
use zivi::stepping::step_solver::SignSolver;
use zivi::{
    AnyMethod, Branch, FixedSteps, Force, Grid, Kick, Lifted, PathPoint, Physical, Restitution,
    SetupError, Solver, Status, ThetaGamma, UserEvent,
};
use zivi_core::control::inclusion::{AsProblem, Inclusion, TrackingInclusion};
use zivi_core::control::tracking::{Target, TrackingStep};
use zivi_core::control::{Gains, Waypoint};
use zivi_core::observer::ImpactObserver;
use zivi_core::ThetaGammaStep;

use crate::batch::{natives, refused, row_restitution, rows, BETWEEN_LOOKS};
use crate::control::{of_ours, run_copy};
use crate::force::{AnyForce, AnyNative, Force as GivenForce};
use crate::interface::{array, list, setup_error, with_room, EndedBy, Watch};
use crate::method::{step_solver, Hits, MotionPath, PyEvent, PyMethod};
use crate::observer::PyObserver;
use crate::record::rows_of;
use crate::simulate::grid_of;
use crate::system::{kick_of_point, restitution_of, PyRestitution, PyState};

/// Optional members of a controller, and optional arguments of its `step`.
#[derive(Clone, Copy, FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Interface {
    x_ref: bool,
    xdot_ref: bool,
    force_ref: bool,
    t: bool,
}

/// Any object with `step`, and `x_ref`, perhaps `xdot_ref`, if it follows a reference.
struct PythonController<'py> {
    object: Bound<'py, PyAny>,
    interface: Interface,
    /// Exception of reading the reference; the next update raises it.
    raised: Cell<Option<PyErr>>,
}

impl<'py> PythonController<'py> {
    fn number(&self, name: &str) -> PyResult<f64> {
        self.object.getattr(name)?.extract()
    }

    fn step(&self, tick: Tick) -> PyResult<Bound<'py, PyAny>> {
        let Tick { t, measured: Physical { x, xdot }, force, force_ref } = tick;
        let named =
            if self.interface.t { Some([("t", t)].into_py_dict(self.object.py())?) } else { None };
        if self.interface.force_ref {
            self.object.call_method("step", (x, xdot, force, force_ref), named.as_ref())
        } else {
            self.object.call_method("step", (x, xdot, force), named.as_ref())
        }
    }
}

/// The return value of `step` as a number.
fn control(answer: &Bound<'_, PyAny>) -> PyResult<f64> {
    // an array of one number would convert
    let number = if answer.len().is_ok() { None } else { Some(answer.extract::<f64>()) };
    match number {
        Some(Ok(u)) => Ok(u),
        // too large an integer, or an exception of the object itself
        Some(Err(error)) if !error.is_instance_of::<PyTypeError>(answer.py()) => Err(error),
        _ => Err(PyTypeError::new_err(format!(
            "controller.step must return a number, the control (m/s^2), got {} {}",
            answer.get_type().name()?,
            answer.repr()?
        ))),
    }
}

type Place = (f64, f64, f64);

impl Controller<PyErr> for PythonController<'_> {
    fn tick_to(&mut self, tick: Tick, course: ReferencePeriod) -> Result<f64, TickError<PyErr>> {
        let Tick { measured: Physical { x, xdot }, force, .. } = tick;
        let place = |at: Waypoint| -> Place { (at.state.x, at.state.xdot, at.branch.sigma()) };
        let arguments =
            (x, xdot, force, place(course.now), place(course.next), course.acceleration);
        let answer = self.object.call_method1("step_to", arguments);
        answer.and_then(|u| control(&u)).map_err(TickError::Raised)
    }

    fn tick(&mut self, tick: Tick) -> Result<f64, TickError<PyErr>> {
        if let Some(error) = self.raised.take() {
            return Err(TickError::Raised(error));
        }
        self.step(tick).and_then(|u| control(&u)).map_err(TickError::Raised)
    }

    fn reference(&self) -> Option<Physical> {
        let number = |name| {
            self.number(name).unwrap_or_else(|error| {
                self.raised.set(Some(error));
                f64::NAN
            })
        };
        let Interface { x_ref, xdot_ref, .. } = self.interface;
        x_ref.then(|| Physical {
            x: number("x_ref"),
            xdot: if xdot_ref { number("xdot_ref") } else { f64::NAN },
        })
    }

    fn takes_force_ref(&self) -> bool {
        self.interface.force_ref
    }
}

/// A reference that is given.
pub(crate) enum GivenReference<'py> {
    /// A function of time that returns `x, x'` and the acceleration, NaN if unknown.
    Function(Bound<'py, PyAny>),
    /// Its values at the samples.
    Samples(Vec<ReferencePoint>),
}

impl<'py> GivenReference<'py> {
    pub(crate) fn new(given: Bound<'py, PyAny>) -> PyResult<Self> {
        match given.extract::<PyReadonlyArray2<'_, f64>>() {
            Ok(rows) => {
                Ok(Self::Samples(list(rows.as_array().rows().into_iter().map(given_of_row))?))
            }
            Err(_) => Ok(Self::Function(given)),
        }
    }
}

/// `x, x'`, the branch (0 if unknown) and the acceleration (NaN if unknown).
pub(crate) fn given_of_row(row: ArrayView1<'_, f64>) -> ReferencePoint {
    let branch = match row[2] {
        side if side > 0.0 => Some(Branch::Positive),
        side if side < 0.0 => Some(Branch::Negative),
        _ => None,
    };
    let state = Physical { x: row[0], xdot: row[1] };
    ReferencePoint { state, branch, acceleration: Some(row[3]).filter(|it| !it.is_nan()) }
}

impl Reference<PyErr> for GivenReference<'_> {
    fn at(&mut self, k: usize, t: f64) -> PyResult<ReferencePoint> {
        match self {
            Self::Samples(samples) => Reference::<PyErr>::at(&mut Samples(samples), k, t),
            Self::Function(function) => {
                let (x, xdot, acceleration): (f64, f64, f64) = function.call1((t,))?.extract()?;
                let acceleration = Some(acceleration).filter(|it| !it.is_nan());
                Ok(ReferencePoint { state: Physical { x, xdot }, branch: None, acceleration })
            }
        }
    }
}

/// The wall, the steps and the initial state of a loop.
#[derive(Clone, Copy)]
struct RunStart {
    restitution: Restitution,
    grid: Grid,
    initial: Physical,
}

/// The settings of a loop that are the same for every controller and force.
struct Surroundings<'a> {
    start: RunStart,
    motion: Motion,
    sensor: Sensor<'a>,
    observer: Option<ImpactObserver>,
    delay: usize,
    dense: bool,
    restitution_ref: Restitution,
}

/// Times of velocity jumps and the velocities after them, if any.
type Kicks<'a> = Option<(&'a [f64], Kick<'a, PyErr, PathPoint>)>;

type Outcome = Result<LoopRun<PyErr>, SetupError>;

impl Surroundings<'_> {
    fn run<F: Force<PyErr>>(
        &self,
        controller: &mut (impl Controller<PyErr> + ?Sized),
        [plant, model, reference]: &mut [F; 3],
        (events, given): (Vec<UserEvent<'_, PyErr>>, Option<&mut dyn Reference<PyErr>>),
        kicks: Kicks<'_>,
        watch: &mut Watch<'_>,
    ) -> Outcome {
        let RunStart { restitution, grid, initial } = self.start;
        let Self { motion, sensor, observer, delay, dense, .. } = *self;
        let surroundings = Loop { restitution, grid, initial, motion, sensor, observer, delay };
        let forces = Forces { plant, model, reference };
        let restitution = self.restitution_ref;
        let followed = given.map(|reference| ReferenceWithWall { reference, restitution });
        let options = LoopOptions { reference: followed, dense, events, kicks };
        observe_closed_loop(controller, surroundings, forces, options, watch)
    }

    /// A controller of ours: without the interpreter, if the forces allow it.
    fn run_native(
        &self,
        py: Python<'_>,
        controller: &mut (dyn Controller<PyErr> + Send),
        forces: &mut [AnyForce<'_>; 3],
        events: Vec<UserEvent<'_, PyErr>>,
        (mut given, kicks): (Option<GivenReference<'_>>, Kicks<'_>),
        watch: &mut Watch<'_>,
    ) -> Outcome {
        let native: Vec<AnyNative> = forces.iter().filter_map(AnyForce::native).collect();
        match <[AnyNative; 3]>::try_from(native) {
            // events and functions need the interpreter
            Ok(mut native)
                if events.is_empty()
                    && kicks.is_none()
                    && !matches!(given, Some(GivenReference::Function(_))) =>
            {
                let samples = match given {
                    Some(GivenReference::Samples(samples)) => Some(samples),
                    _ => None,
                };
                py.detach(|| {
                    let mut samples = samples.as_deref().map(Samples);
                    let reference = samples.as_mut().map(|it| it as &mut dyn Reference<PyErr>);
                    self.run(controller, &mut native, (Vec::new(), reference), None, watch)
                })
            }
            _ => {
                let reference = given.as_mut().map(|it| it as &mut dyn Reference<PyErr>);
                self.run(controller, forces, (events, reference), kicks, watch)
            }
        }
    }
}

/// How a plant moves between samples: by the theta-gamma scheme on the controller's grid or by the
/// switched method, but exactly where the force is constant and `exact` is set.
pub(crate) fn motion_of(method: &PyMethod, exact: bool) -> PyResult<Motion> {
    Ok(match method.inner {
        AnyMethod::ThetaGamma(FixedSteps { scheme: ThetaGamma { theta, gamma, .. }, .. }) => {
            Motion::Scheme { theta, gamma }
        }
        _ if exact => Motion::Exact(method.switched()?),
        _ => Motion::Switched(method.switched()?),
    })
}

/// A closed loop: `forces` are the plant's, the model's and the reference's; `method` integrates
/// the plant, unless the force is constant and `exact` is set. `ours`: the controller's updates are
/// those of one of our classes, not those of a subclass.
#[pyfunction]
#[pyo3(signature = (
    controller, forces, *, restitution, h, span, start, method, exact, noise, resolution,
    delay, observer, interface, ours, dense, events, given, restitution_ref, kicks=None,
    progress=None
))]
#[allow(clippy::too_many_arguments)]
pub(crate) fn simulate_closed_loop(
    py: Python<'_>,
    controller: &Bound<'_, PyAny>,
    forces: [Py<GivenForce>; 3],
    restitution: PyRef<'_, PyRestitution>,
    h: f64,
    span: (f64, f64),
    start: PyRef<'_, PyState>,
    method: PyRef<'_, PyMethod>,
    exact: bool,
    noise: (PyReadonlyArray1<'_, f64>, PyReadonlyArray1<'_, f64>),
    resolution: (f64, f64),
    delay: usize,
    observer: Option<PyRef<'_, PyObserver>>,
    interface: Interface,
    ours: bool,
    dense: bool,
    events: Vec<PyRef<'_, PyEvent>>,
    given: Option<Bound<'_, PyAny>>,
    restitution_ref: PyRef<'_, PyRestitution>,
    kicks: Option<(PyReadonlyArray1<'_, f64>, Py<PyAny>)>,
    progress: Option<Py<PyAny>>,
) -> PyResult<PyLoopRecord> {
    let _running = crate::interface::running()?;
    let motion = motion_of(&method, exact)?;
    let sensor =
        Sensor { noise_x: noise.0.as_slice()?, noise_xdot: noise.1.as_slice()?, resolution };
    let (restitution, initial) = (restitution.inner, start.inner);
    let start = RunStart { restitution, grid: grid_of(span, h)?, initial };
    let restitution_ref = restitution_ref.inner;
    let observer = observer.map(|it| it.inner);
    let surroundings =
        Surroundings { start, motion, sensor, observer, delay, dense, restitution_ref };
    let mut given = given.map(GivenReference::new).transpose()?;
    let mut forces = forces.each_ref().map(|force| force.get().on(py));
    let mut events: Vec<_> = events.iter().map(|it| it.of_point(py)).collect();
    let mut kicks = match &kicks {
        Some((times, function)) => Some((times.as_slice()?, kick_of_point(py, function))),
        None => None,
    };
    let watch = &mut Watch::reporting(progress);
    if ours {
        let run = run_copy(controller, |copy| {
            let events = std::mem::take(&mut events);
            let more = (given.take(), kicks.take());
            surroundings.run_native(py, copy, &mut forces, events, more, watch)
        });
        if let Some(run) = run {
            return PyLoopRecord::new(py, run.map_err(setup_error)?, start.restitution);
        }
    }
    let raised = Cell::new(None);
    let mut controller = PythonController { object: controller.clone(), interface, raised };
    let run = {
        let given = given.as_mut().map(|it| it as &mut dyn Reference<PyErr>);
        surroundings.run(&mut controller, &mut forces, (events, given), kicks, watch)
    };
    PyLoopRecord::new(py, run.map_err(setup_error)?, start.restitution)
}

/// Control updates: all, rejected, saturated, unsolved, lost contacts.
pub(crate) fn numbers_of(updates: Updates) -> [u64; 5] {
    let Updates { total, rejected, saturated, unsolved, lost, .. } = updates;
    [total, rejected, saturated, unsolved, lost]
}

type Array = Py<PyArray1<f64>>;

/// The columns, events and outcome of a closed loop.
#[pyclass(frozen, get_all, module = "zivi._zivi", name = "LoopRecord")]
pub(crate) struct PyLoopRecord {
    /// An array for each of `t, x, xdot, x_ref, xdot_ref, u`.
    columns: Vec<Array>,
    signs: Py<LoopSigns>,
    /// `x, xdot, d` of the observer; empty arrays without one.
    estimates: Vec<Array>,
    ticks: Py<PyArray1<u8>>,
    /// Control updates: all, rejected, saturated, unsolved, lost contacts.
    updates: [u64; 5],
    /// A row for each: time, velocity before and velocity after.
    impacts: Array,
    zeno_times: Array,
    liftoff_times: Array,
    rest_time: Option<f64>,
    /// Data of the motion between the samples: the plant's own constant force, a path, or
    /// `s` and `v` at the samples.
    own_force: Option<f64>,
    path: Option<Py<MotionPath>>,
    lifted: Option<Py<LiftedSamples>>,
    /// Occurrences of each user event.
    hits: Vec<Py<Hits>>,
    status: u8,
    message: &'static str,
    nfev: u64,
    raised: EndedBy,
}

impl PyLoopRecord {
    fn new(py: Python<'_>, run: LoopRun<PyErr>, restitution: Restitution) -> PyResult<Self> {
        let LoopRun { columns, signs, estimates, ticks, updates, .. } = run;
        let LoopRun { events, path, hits, status, nfev, raised, .. } = run;
        let array = |values: Vec<f64>| PyArray1::from_vec(py, values).unbind();
        let (own_force, path, lifted) = match path {
            None => (None, None, None),
            Some(LoopPath::Ballistic(force)) => (Some(force), None, None),
            Some(LoopPath::Switched(path)) => {
                (None, Some(Py::new(py, MotionPath::of_loop(path, restitution))?), None)
            }
            Some(LoopPath::Lifted(states)) => {
                (None, None, Some(Py::new(py, LiftedSamples::new(py, &states)?)?))
            }
        };
        Ok(Self {
            signs: Py::new(py, LoopSigns(signs))?,
            columns: columns.into_iter().map(array).collect(),
            estimates: estimates.into_iter().map(array).collect(),
            ticks: PyArray1::from_vec(py, ticks).unbind(),
            updates: numbers_of(updates),
            impacts: rows_of(py, events.impacts),
            zeno_times: array(events.zeno_times),
            liftoff_times: array(events.liftoff_times),
            rest_time: events.rest_time,
            own_force,
            path,
            lifted,
            hits: Hits::of(py, &hits, 1)?,
            status: status as u8,
            message: status.message(),
            nfev,
            raised: EndedBy::new(raised),
        })
    }
}

/// The signs of all updates, until their first access.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct LoopSigns(SignRecord);

#[pymethods]
impl LoopSigns {
    /// A row of six for each sample.
    fn rows(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f64>>> {
        let mut numbers: Vec<f64> = Vec::new();
        let refused = |_| setup_error(SetupError::Memory(self.0.len()));
        numbers.try_reserve_exact(self.0.len() * SIGNS).map_err(refused)?;
        numbers.extend(self.0.iter().flatten());
        Ok(PyArray1::from_vec(py, numbers).reshape([self.0.len(), SIGNS])?.unbind())
    }
}

/// `s` and `v` at the samples.
#[pyclass(frozen, get_all, module = "zivi._zivi")]
pub(crate) struct LiftedSamples {
    s: Array,
    v: Array,
}

impl LiftedSamples {
    fn new(py: Python<'_>, states: &[Lifted]) -> PyResult<Self> {
        let column = |of: fn(&Lifted) -> f64| array(py, states.iter().map(of));
        Ok(Self { s: column(|z| z.s)?, v: column(|z| z.v)? })
    }
}

// Batches of closed loops from Python.

fn native(controller: &Bound<'_, PyAny>) -> PyResult<AnyController> {
    of_ours(controller).ok_or_else(|| {
        let kind = controller.get_type();
        PyTypeError::new_err(format!("a batch takes zivi's own controllers, got {kind}"))
    })
}

/// Many closed loops. `forces` are lists of the plants', the models' and the references'; every
/// list has an entry for each loop, or one for all.
#[pyfunction]
#[pyo3(signature = (
    controllers, observers, forces, restitutions, states, *, span, method, exact, resolution,
    delay, within, every, slowest, threads, references=Vec::new(), progress=None
))]
#[allow(clippy::too_many_arguments)]
pub(crate) fn simulate_closed_loop_batch(
    py: Python<'_>,
    controllers: Vec<Bound<'_, PyAny>>,
    observers: Vec<PyRef<'_, PyObserver>>,
    forces: [Vec<Py<GivenForce>>; 3],
    restitutions: PyReadonlyArray2<'_, f64>,
    states: PyReadonlyArray2<'_, f64>,
    span: (f64, f64),
    method: PyRef<'_, PyMethod>,
    exact: bool,
    resolution: (f64, f64),
    delay: usize,
    within: f64,
    every: usize,
    slowest: f64,
    threads: usize,
    references: Vec<(PyReadonlyArray2<'_, f64>, f64)>,
    progress: Option<Py<PyAny>>,
) -> PyResult<LoopBatchRecord> {
    let _running = crate::interface::running()?;
    let shared = LoopSettings {
        motion: motion_of(&method, exact)?,
        resolution,
        delay,
        within,
        every,
        slowest,
    };
    let controllers = controllers.iter().map(native).collect::<PyResult<Vec<_>>>()?;
    let [plants, models, drives] = &forces;
    let (plants, models) = (natives(py, plants)?, natives(py, models)?);
    let drives = natives(py, drives)?;
    let given = references
        .iter()
        .map(|(rows, kappa)| {
            let rows: Vec<ReferencePoint> =
                list(rows.as_array().rows().into_iter().map(given_of_row))?;
            Ok((rows, restitution_of(*kappa)?))
        })
        .collect::<PyResult<Vec<_>>>()?;
    let mut members = with_room(states.as_array().nrows())?;
    for (i, state) in states.as_array().rows().into_iter().enumerate() {
        if i % BETWEEN_LOOKS == 0 {
            py.check_signals()?;
        }
        let which = |n: usize| if n == 1 { 0 } else { i };
        let controller = &controllers[which(controllers.len())];
        members.push(LoopMember {
            controller: controller.clone(),
            observer: observers.get(which(observers.len())).map(|it| it.inner),
            restitution: row_restitution(&restitutions, i)?,
            forces: [
                plants[which(plants.len())],
                models[which(models.len())],
                drives[which(drives.len())],
            ],
            initial: Physical { x: state[0], xdot: state[1] },
            grid: grid_of(span, controller.h())?,
            reference: match given.len() {
                0 => None,
                n => Some((given[which(n)].0.as_slice(), given[which(n)].1)),
            },
        });
    }
    let watch = &mut Watch::reporting(progress);
    let ends = py.detach(|| run_batch(&members, shared, threads, watch)).map_err(refused)?;
    LoopBatchRecord::new(py, &ends)
}

type Rows = Py<PyArray2<f64>>;

/// Saved data of the loops: one entry or row per loop.
#[pyclass(frozen, get_all, module = "zivi._zivi")]
pub(crate) struct LoopBatchRecord {
    /// `t, x, x', x_r, x_r'` at the end, a row for each loop.
    last: Rows,
    settling_time: Array,
    error_max: Array,
    error_rms: Array,
    u_max: Array,
    u_rms: Array,
    u_variation: Array,
    rest_time: Array,
    n_impacts: Py<PyArray1<u64>>,
    n_updates: Py<PyArray1<u64>>,
    n_refused: Py<PyArray1<u64>>,
    n_saturated: Py<PyArray1<u64>>,
    n_unsolved: Py<PyArray1<u64>>,
    status: Py<PyArray1<u8>>,
    samples_x: Rows,
    samples_x_ref: Rows,
    samples_u: Rows,
}

impl LoopBatchRecord {
    fn new(py: Python<'_>, ends: &[LoopOutcome]) -> PyResult<Self> {
        let column = |of: fn(&LoopOutcome) -> f64| array(py, ends.iter().map(of));
        let count = |of: fn(&LoopOutcome) -> u64| array(py, ends.iter().map(of));
        let number = |it: &LoopOutcome| it.status.unwrap_or(Status::Raised) as u8;
        let last = list(ends.iter().flat_map(|it| it.last))?;
        Ok(Self {
            last: PyArray1::from_vec(py, last).reshape([ends.len(), 5])?.unbind(),
            settling_time: column(|it| it.settling_time)?,
            error_max: column(|it| it.error_max)?,
            error_rms: column(|it| it.error_rms)?,
            u_max: column(|it| it.u_max)?,
            u_rms: column(|it| it.u_rms)?,
            u_variation: column(|it| it.u_variation)?,
            rest_time: column(|it| it.rest_time)?,
            n_impacts: count(|it| it.n_impacts)?,
            n_updates: count(|it| it.updates.total)?,
            n_refused: count(|it| it.updates.rejected)?,
            n_saturated: count(|it| it.updates.saturated)?,
            n_unsolved: count(|it| it.updates.unsolved)?,
            status: array(py, ends.iter().map(number))?,
            samples_x: rows(py, ends.iter().map(|it| it.saved[0].as_slice()))?,
            samples_x_ref: rows(py, ends.iter().map(|it| it.saved[1].as_slice()))?,
            samples_u: rows(py, ends.iter().map(|it| it.saved[2].as_slice()))?,
        })
    }
}

// Batches of independent steps of the tracker: its exact solution and general solvers.

/// `s, v, s_r, v_r` at the start of a step.
const STATE: usize = 4;
/// The tracker's scheme under constant forces.
struct TrackerScheme {
    step: TrackingStep,
    reference: ThetaGammaStep,
    f: f64,
    f_ref: f64,
}

impl TrackerScheme {
    /// The signs as the control update finds them; `None` if the reference's step lacks a solution.
    #[inline]
    fn exact(&self, [s, v, s_ref, v_ref]: [f64; STATE]) -> Option<[f64; SIGNS]> {
        let reference = Lifted { s: s_ref, v: v_ref };
        let of_ref = self.reference.solve(reference, self.f_ref, 1.0).ok()?;
        let (lambda_sr, lambda_vr) = (of_ref.lambda_s, of_ref.lambda_v);
        let r = self.reference.restitution().r(lambda_sr, lambda_vr);
        let target = Target { end: of_ref.end(), acceleration: lambda_sr * self.f_ref / r };
        let it = self.step.solve_near(Lifted { s, v }, self.f, target, lambda_vr);
        Some([it.lambda_s, it.lambda_v, lambda_sr, lambda_vr, it.lambda_es, it.lambda_ev])
    }

    /// All six signs as one VI; its rows are divided by the largest possible size of their terms.
    fn general(&self, solver: &mut SignSolver<SIGNS>, state: [f64; STATE]) -> bool {
        let [s, v, s_ref, v_ref] = state;
        let inclusion = TrackingInclusion {
            step: &self.step,
            restitution_ref: self.reference.restitution(),
            z: Lifted { s, v },
            reference: Lifted { s: s_ref, v: v_ref },
            f: self.f,
            f_ref: self.f_ref,
        };
        solver.solve(&mut AsProblem(inclusion), inclusion.scales([1.0; SIGNS]))
    }
}

/// The rows of a two-dimensional array.
fn rows_of_width<const N: usize>(
    name: &str,
    array: &PyReadonlyArray2<'_, f64>,
) -> PyResult<Vec<[f64; N]>> {
    let array = array.as_array();
    if array.ncols() != N {
        return Err(PyValueError::new_err(format!("{name} must have {N} columns")));
    }
    list((0..array.nrows()).map(|k| std::array::from_fn(|j| array[[k, j]])))
}

/// Signs of many steps of the tracker (NaN where there are none), and whether the solver reports them
/// solved. `states` has the columns `s, v, s_r, v_r`; `starts` and the result have
/// `ls, lv, lsr, lvr, les, lev`. A solve starts from its initial point or, if that is NaN, from the
/// last signs that solved a step. The solver `"exact"` is that of the control update and ignores the initial point.
#[pyfunction]
#[pyo3(signature = (
    states, starts, *, gains, kappa, kappa_ref, h, f, f_ref, solver, linearisations, fall_backs
))]
#[allow(clippy::too_many_arguments, clippy::type_complexity)]
pub(crate) fn solve_tracking_steps<'py>(
    py: Python<'py>,
    states: PyReadonlyArray2<'py, f64>,
    starts: PyReadonlyArray2<'py, f64>,
    gains: (f64, f64),
    kappa: f64,
    kappa_ref: f64,
    h: f64,
    f: f64,
    f_ref: f64,
    solver: &Bound<'_, PyAny>,
    linearisations: i64,
    fall_backs: bool,
) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<bool>>)> {
    let _running = crate::interface::running()?;
    let refused = |error: zivi_core::SettingError| PyValueError::new_err(error.to_string());
    let gains = Gains::new(gains.0, gains.1).map_err(refused)?;
    let reference = ThetaGammaStep::new(h, 1.0, 1.0, restitution_of(kappa_ref)?);
    let reference = reference.map_err(|error| setup_error(error.into()))?;
    let step = TrackingStep { h, restitution: restitution_of(kappa)?, gains };
    let scheme = TrackerScheme { step, reference, f, f_ref };
    let states = rows_of_width::<STATE>("states", &states)?;
    let starts = rows_of_width::<SIGNS>("starts", &starts)?;
    if states.len() != starts.len() {
        return Err(PyValueError::new_err("states and starts must be equally many"));
    }
    let mut signs = with_room(SIGNS * states.len())?;
    let mut solved = with_room(states.len())?;
    let mut general = match (step_solver(solver, linearisations)?, fall_backs) {
        (Solver::Exact, _) => None,
        (Solver::Outer { linearisations }, _) => Some(SignSolver::outer(linearisations)),
        (Solver::Newton, true) => Some(SignSolver::newton()),
        (Solver::Newton, false) => Some(SignSolver::newton_without_fall_backs()),
    };
    for (state, start) in states.into_iter().zip(starts) {
        let found = match &mut general {
            None => scheme.exact(state),
            Some(general) => {
                if start.iter().all(|sign| !sign.is_nan()) {
                    general.start_from(start);
                }
                scheme.general(general, state).then(|| general.signs())
            }
        };
        solved.push(found.is_some());
        signs.extend(found.unwrap_or([f64::NAN; SIGNS]));
    }
    let count = solved.len();
    let signs = PyArray1::from_vec(py, signs).reshape([count, SIGNS])?;
    Ok((signs, PyArray1::from_vec(py, solved)))
}
