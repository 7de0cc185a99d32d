//! Closed loops of mechanical systems from Python.

use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::gc::{PyTraverseError, PyVisit};
use pyo3::prelude::*;
use zivi::drive::mechanical::{
    one_step_each, BelievedPlant, MechanicalController, MechanicalSensor, Observing, SampledLoop,
    Striking, Tasks, TickRecord, Tracking,
};
use zivi::drive::Updates;
use zivi::mechanics::{MechanicalRun, Sampling, Ticks};
use zivi::system::dynamics::{Driven, Dynamics, Layout};
use zivi::{AnyImpactLaw, AnyMethod, SetupError, SwitchedRk};

use crate::closed_loop::numbers_of;
use crate::control::mechanical::{
    law_error, pressed, Believed, PyGapTracker, PyReference, PyStriker,
};
use crate::interface::{list, setup_error, vector, Matrix, Watch};
use crate::method::PyMethod;
use crate::record::MechanicalRecord;
use crate::system::PyInputs;
use crate::system::{kicks_of_mechanism, Configuration, Mechanism};

/// A loop: its run at the samples, the controls, and the status of the updates.
#[pyclass(frozen, get_all, module = "zivi._zivi")]
pub(crate) struct MechanicalLoopRecord {
    run: Py<MechanicalRecord>,
    u: Matrix<f64>,
    /// Status bits of each control update.
    tick_status: Py<PyArray1<u8>>,
    /// Control updates: all, rejected, saturated, unsolved, lost contacts.
    updates: [u64; 5],
    latched: Matrix<bool>,
    /// The estimates passed to the controller.
    q_est: Matrix<f64>,
    qdot_est: Matrix<f64>,
}

impl MechanicalLoopRecord {
    fn new(
        py: Python<'_>,
        (mut run, u): (MechanicalRun<PyErr>, Vec<f64>),
        ticks: TickRecord,
        r: usize,
    ) -> PyResult<Self> {
        let (Layout { n, m, .. }, count) = (run.layout, ticks.status.len());
        let u = PyArray1::from_vec(py, u).reshape([run.samples.t.len(), r])?.unbind();
        let [q, w] = ticks.told.map(|it| PyArray1::from_vec(py, it).reshape([count, n]));
        let latched = PyArray1::from_vec(py, ticks.latched).reshape([count, m])?.unbind();
        let updates = Updates::of(&ticks.status);
        run.status = updates.ending(run.status);
        Ok(Self {
            run: Py::new(py, MechanicalRecord::new(py, run)?)?,
            u,
            tick_status: PyArray1::from_vec(py, ticks.status).unbind(),
            updates: numbers_of(updates),
            latched,
            q_est: q?.unbind(),
            qdot_est: w?.unbind(),
        })
    }
}

/// A gap tracker in a loop: law, model, reference.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct GapLoop {
    law: Py<PyGapTracker>,
    believed: Py<Believed>,
    reference: Option<Py<PyReference>>,
}

#[pymethods]
impl GapLoop {
    #[new]
    fn new(
        law: Py<PyGapTracker>,
        believed: Py<Believed>,
        reference: Option<Py<PyReference>>,
    ) -> Self {
        Self { law, believed, reference }
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        visit.call(&self.law)?;
        visit.call(&self.believed)?;
        self.reference.as_ref().map_or(Ok(()), |it| visit.call(it))
    }
}

/// A striker in a loop: law and model.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct StrikeLoop {
    law: Py<PyStriker>,
    believed: Py<Believed>,
}

#[pymethods]
impl StrikeLoop {
    #[new]
    fn new(law: Py<PyStriker>, believed: Py<Believed>) -> Self {
        Self { law, believed }
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        visit.call(&self.law)?;
        visit.call(&self.believed)
    }
}

/// A controller of the interpreter.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct CalledLoop {
    /// `step(t, q, qdot)`, or `step(k, t, q, qdot)`.
    step: Py<PyAny>,
    counts: bool,
    /// The objects with `status` and `latched`, if any.
    status: Option<Py<PyAny>>,
    latched: Option<Py<PyAny>>,
    /// Description of the expected control.
    expected: String,
}

#[pymethods]
impl CalledLoop {
    #[new]
    fn new(
        step: Py<PyAny>,
        counts: bool,
        status: Option<Py<PyAny>>,
        latched: Option<Py<PyAny>>,
        expected: String,
    ) -> Self {
        Self { step, counts, status, latched, expected }
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        visit.call(&self.step)?;
        [&self.status, &self.latched].into_iter().flatten().try_for_each(|it| visit.call(it))
    }
}

impl CalledLoop {
    /// Error for an invalid control.
    fn wrong(&self, value: &Bound<'_, PyAny>) -> PyErr {
        let name = if self.counts { "step_to" } else { "step" };
        let given = value.repr().map_or_else(|_| String::from("?"), |it| it.to_string());
        let expected = &self.expected;
        PyTypeError::new_err(format!("controller.{name} must return {expected}, got {given}"))
    }
}

/// The same in a run.
struct Called<'a, 'py> {
    py: Python<'py>,
    given: &'a CalledLoop,
}

/// The object converted to an array by NumPy; `None` if that fails.
fn array_of<'py>(value: &Bound<'py, PyAny>, kind: &str) -> PyResult<Option<Bound<'py, PyAny>>> {
    let py = value.py();
    let numpy = py.import("numpy")?;
    match numpy
        .call_method1("asarray", (value, kind))
        .and_then(|it| numpy.call_method1("atleast_1d", (it,)))
    {
        Ok(array) => Ok(Some(array)),
        Err(error) if error.is_instance_of::<PyTypeError>(py) => Ok(None),
        Err(error) if error.is_instance_of::<PyValueError>(py) => Ok(None),
        Err(error) => Err(error),
    }
}

/// Copies an array of this size; whether it is one.
fn copied<T: numpy::Element + Copy>(value: &Bound<'_, PyAny>, to: &mut [T]) -> bool {
    let Ok(array) = value.cast::<PyArray1<T>>() else { return false };
    let Ok(readable) = array.try_readonly() else { return false };
    let fits = array.len() == to.len();
    if fits {
        to.iter_mut().zip(readable.as_array()).for_each(|(to, &from)| *to = from);
    }
    fits
}

impl MechanicalController<PyErr> for Called<'_, '_> {
    fn tick(&mut self, k: usize, t: f64, (q, w): (&[f64], &[f64]), u: &mut [f64]) -> PyResult<u8> {
        crate::interface::look()?;
        let (py, given) = (self.py, self.given);
        let (q, w) = (PyArray1::from_slice(py, q), PyArray1::from_slice(py, w));
        let value = match given.counts {
            true => given.step.bind(py).call1((k, t, q, w))?,
            false => given.step.bind(py).call1((t, q, w))?,
        };
        if !copied(&value, u) {
            match array_of(&value, "float64")? {
                Some(array) if !value.is_none() && copied(&array, u) => {}
                _ => return Err(given.wrong(&value)),
            }
        }
        match &given.status {
            Some(it) => it.bind(py).getattr("status")?.extract(),
            None => Ok(0),
        }
    }

    fn latched(&self, to: &mut [bool]) -> PyResult<()> {
        let Some(it) = &self.given.latched else { return Ok(()) };
        let value = it.bind(self.py).getattr("latched")?;
        match copied(&value, to) || array_of(&value, "bool")?.is_some_and(|it| copied(&it, to)) {
            true => Ok(()),
            false => Err(PyValueError::new_err(format!(
                "latched must have {} entries, got {value}",
                to.len()
            ))),
        }
    }
}

/// An observer of the interpreter: `step(t, q, qdot, u)` returns coordinates and velocities.
struct CalledObserver<'py>(Bound<'py, PyAny>);

impl Observing<PyErr> for CalledObserver<'_> {
    fn estimate(&mut self, t: f64, (q, w): (&mut [f64], &mut [f64]), u: &[f64]) -> PyResult<()> {
        let py = self.0.py();
        let (at, u) = (PyArray1::from_slice(py, q), PyArray1::from_slice(py, u));
        let (at, speed): (Bound<'_, PyAny>, Bound<'_, PyAny>) =
            self.0.call1((t, at, u))?.extract()?;
        match copied(&at, q) && copied(&speed, w) {
            true => Ok(()),
            false => Err(PyValueError::new_err("the observer must give coordinates, velocities")),
        }
    }
}

/// No observer.
struct Nobody;

impl Observing<PyErr> for Nobody {
    fn estimate(&mut self, _: f64, _: (&mut [f64], &mut [f64]), _: &[f64]) -> PyResult<()> {
        Ok(())
    }
}

/// Arguments of a run, without system, controller and observer.
struct LoopArguments<'a> {
    settings: SwitchedRk,
    laws: &'a [AnyImpactLaw],
    sampling: Sampling<'a>,
    from: (&'a [f64], &'a [f64]),
    sensor: MechanicalSensor<'a>,
    /// Numbers of gaps, of controls and of periods of delay.
    sizes: (usize, usize, usize),
    dense: bool,
    /// Velocities after impulses.
    kicks: Option<&'a Py<PyAny>>,
}

type Done = PyResult<Result<((MechanicalRun<PyErr>, Vec<f64>), TickRecord), SetupError>>;

impl LoopArguments<'_> {
    fn run<D, F, C, O>(
        self,
        driven: &mut Driven<D, F>,
        controller: C,
        observer: Option<O>,
        watch: &mut Watch<'_>,
    ) -> Done
    where
        D: Dynamics<PyErr>,
        Driven<D, F>: Dynamics<PyErr>,
        C: MechanicalController<PyErr>,
        O: Observing<PyErr>,
    {
        let Self { settings, laws, sampling, from, sensor, sizes, dense, kicks } = self;
        let mut ticks = SampledLoop::new(controller, observer, sensor, sizes);
        let mut u = vec![0.0; sizes.1];
        ticks.tick(0, sampling.times[0], from, &mut u)?;
        let start = (u.as_slice(), &mut ticks);
        let kicks = kicks.map(|it| kicks_of_mechanism(it, from.0.len()));
        let done = zivi::mechanics::simulate_mechanical_loop(
            settings,
            (driven, laws),
            sampling,
            from,
            start,
            (dense, kicks),
            watch,
        );
        Ok(done.map(|run| (run, ticks.record)))
    }
}

/// A loop by the switched method, with free steps or one step per period. The lock is released if
/// no part of it needs the interpreter.
#[pyfunction]
#[pyo3(signature = (
    system, inputs, method, times, stops, start, controller, *, observer, noise, steps, delay, dense,
    one_step, kicks=None, progress=None
))]
#[allow(clippy::too_many_arguments)]
pub(crate) fn simulate_mechanical_loop(
    py: Python<'_>,
    system: PyRef<'_, Mechanism>,
    inputs: PyRef<'_, PyInputs>,
    method: PyRef<'_, PyMethod>,
    times: PyReadonlyArray1<'_, f64>,
    stops: PyReadonlyArray1<'_, f64>,
    start: PyRef<'_, Configuration>,
    controller: &Bound<'_, PyAny>,
    observer: Option<Bound<'_, PyAny>>,
    noise: Option<PyReadonlyArray3<'_, f64>>,
    steps: [f64; 2],
    delay: usize,
    dense: bool,
    one_step: bool,
    kicks: Option<Py<PyAny>>,
    progress: Option<Py<PyAny>>,
) -> PyResult<MechanicalLoopRecord> {
    let _running = crate::interface::running()?;
    let AnyMethod::SwitchedRk(settings) = method.inner else {
        return Err(PyValueError::new_err("a mechanical loop is integrated by SwitchedRK"));
    };
    let (times, stops) = (vector(&times)?, vector(&stops)?);
    let settings = if one_step { one_step_each(settings, &times) } else { settings };
    let noise: Vec<f64> =
        noise.map(|it| list(it.as_array().iter().copied())).transpose()?.unwrap_or_default();
    let (system, inputs, r) = (&*system, &*inputs, inputs.r);
    let course = LoopArguments {
        settings,
        laws: &system.laws,
        sampling: Sampling { times: &times, stops: &stops },
        from: (&start.q, &start.qdot),
        sensor: MechanicalSensor { noise: &noise, steps },
        sizes: (system.m, r, delay),
        dense,
        kicks: kicks.as_ref(),
    };
    let watch = &mut Watch::reporting(progress);
    let done = if let Ok(own) = controller.cast::<GapLoop>() {
        run_tracker(py, course, own.get(), (system, inputs), observer, watch)
    } else if let Ok(own) = controller.cast::<StrikeLoop>() {
        run_striker(py, course, own.get(), (system, inputs), observer, watch)
    } else {
        let given = controller.cast::<CalledLoop>()?.get();
        let mut driven = inputs.driven(py, system)?;
        course.run(&mut driven, Called { py, given }, observer.map(CalledObserver), watch)
    };
    let (run, record) = done?.map_err(setup_error)?;
    MechanicalLoopRecord::new(py, run, record, r)
}

/// A loop with a gap tracker.
fn run_tracker(
    py: Python<'_>,
    course: LoopArguments<'_>,
    own: &GapLoop,
    (system, inputs): (&Mechanism, &PyInputs),
    observer: Option<Bound<'_, PyAny>>,
    watch: &mut Watch<'_>,
) -> Done {
    let (believed, reference) = (own.believed.get(), own.reference.as_ref().map(Py::get));
    let reference = reference.map(|it| &it.inner);
    let (mechanism, through, h) = (believed.mechanism.get(), believed.inputs.get(), believed.h);
    let tracker = own.law.borrow(py);
    let (law, laws, wrong) =
        (tracker.law.clone(), mechanism.laws.as_slice(), law_error as fn(_) -> _);
    let functions = believed.tasks.as_ref().map(Py::get);
    if let (Some(plant), Some(model), Some(alone), Some(asked), None) = (
        inputs.driven_alone(py, system),
        through.driven_alone(py, mechanism),
        functions.map_or(Some(None), |it| it.rubbing_alone(py).map(Some)),
        tracker.constants(),
        &observer,
    ) {
        let (mut plant, mut model) = (plant, model);
        let mut tasks = alone.map(Tasks::new::<PyErr>);
        drop(tracker);
        return py.detach(|| {
            let (driven, tasks) = (&mut model, tasks.as_mut());
            let plant_of = BelievedPlant { driven, tasks, laws, h };
            let asked = |i: usize, _: f64| Ok(asked[i]);
            let tracking = Tracking { law, plant: plant_of, reference, asked, wrong };
            course.run(&mut plant, tracking, None::<Nobody>, watch)
        });
    }
    let (mut driven, mut model) = (inputs.driven(py, system)?, through.driven(py, mechanism)?);
    let mut tasks = functions.map(|it| Tasks::new::<PyErr>(it.rubbing(py)));
    let plant = BelievedPlant { driven: &mut model, tasks: tasks.as_mut(), laws, h };
    let asked = |i: usize, t: f64| pressed(py, &tracker.pressing, i, t);
    let tracking = Tracking { law, plant, reference, asked, wrong };
    course.run(&mut driven, tracking, observer.map(CalledObserver), watch)
}

/// A loop with a striker.
fn run_striker(
    py: Python<'_>,
    course: LoopArguments<'_>,
    own: &StrikeLoop,
    (system, inputs): (&Mechanism, &PyInputs),
    observer: Option<Bound<'_, PyAny>>,
    watch: &mut Watch<'_>,
) -> Done {
    let believed = own.believed.get();
    let (mechanism, through, h) = (believed.mechanism.get(), believed.inputs.get(), believed.h);
    let striker = own.law.borrow(py);
    let (law, laws, wrong) =
        (striker.law.clone(), mechanism.laws.as_slice(), law_error as fn(_) -> _);
    if let (Some(plant), Some(model), Some(target), None) = (
        inputs.driven_alone(py, system),
        through.driven_alone(py, mechanism),
        striker.target.constant(),
        &observer,
    ) {
        let (mut plant, mut model) = (plant, model);
        drop(striker);
        return py.detach(|| {
            let believed = BelievedPlant { driven: &mut model, tasks: None, laws, h };
            let target = |_: u32| Ok(target);
            let striking = Striking { law, plant: believed, target, wrong };
            course.run(&mut plant, striking, None::<Nobody>, watch)
        });
    }
    let (mut driven, mut model) = (inputs.driven(py, system)?, through.driven(py, mechanism)?);
    let plant = BelievedPlant { driven: &mut model, tasks: None, laws, h };
    let target = |stroke: u32| striker.target.of(py, stroke);
    let striking = Striking { law, plant, target, wrong };
    course.run(&mut driven, striking, observer.map(CalledObserver), watch)
}
