//! Controllers of mechanical systems: plant model, gap tracker, striker, references.
//!
//! Models of a plant for controllers of mechanical systems, and quantities computed from a state.

use super::mass::PyTracker;
use crate::control::arguments::{restored, tracker_state, State};
use crate::dynamics::AnyDynamics;
use crate::friction::Rubbing;
use crate::interface::{list, setup_error, vector, Array};
use crate::system::Mechanism;
use crate::system::{Matrices, PyInputs};
use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::gc::{PyTraverseError, PyVisit};
use pyo3::prelude::*;
use zivi::drive::mechanical as law;
use zivi::drive::mechanical::{
    BelievedPlant, GapKinetics, GapTrackerSettings, GapTrackerState, Latch, LawError,
    MechanicalReference, Noise, Offsets, ReferenceSample, SentControls, StrikerSettings,
    StrikerState, Tasks,
};
use zivi::system::dynamics::Layout;
use zivi_core::control::{Aim, AimSettings, AimState, Learning, StrikeMeasurement};

/// Exception of a law that failed.
pub(crate) fn law_error(error: LawError<PyErr>) -> PyErr {
    match error {
        LawError::Setup(error) => setup_error(error),
        error => error.raised().unwrap_or_else(PyValueError::new_err),
    }
}

/// The model of a controller: a system with its controls.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct Believed {
    pub(crate) mechanism: Py<Mechanism>,
    pub(crate) inputs: Py<PyInputs>,
    /// The system whose gaps are functions of the coordinates that may follow a reference.
    pub(crate) tasks: Option<Py<Mechanism>>,
    /// Length of a period (s).
    pub(crate) h: f64,
}

impl Believed {
    /// Runs something with the plant.
    pub(super) fn with<R>(
        &self,
        py: Python<'_>,
        run: impl FnOnce(&mut BelievedPlant<'_, Rubbing<'_, AnyDynamics<'_>>, Matrices<'_>>) -> R,
    ) -> PyResult<R> {
        let (mechanism, inputs) = (self.mechanism.get(), self.inputs.get());
        let mut driven = inputs.driven(py, mechanism)?;
        let mut tasks = self.tasks.as_ref().map(|it| Tasks::new::<PyErr>(it.get().rubbing(py)));
        Ok(run(&mut BelievedPlant {
            driven: &mut driven,
            tasks: tasks.as_mut(),
            laws: &mechanism.laws,
            h: self.h,
        }))
    }
}

/// Coordinates, velocities and contacts.
type Moved = (Array, Array, Vec<bool>);

#[pymethods]
impl Believed {
    #[new]
    #[pyo3(signature = (mechanism, inputs, h, tasks=None))]
    fn new(
        mechanism: Py<Mechanism>,
        inputs: Py<PyInputs>,
        h: f64,
        tasks: Option<Py<Mechanism>>,
    ) -> Self {
        Self { mechanism, inputs, tasks, h }
    }

    /// Coordinates, velocities and contacts after as many periods as there are controls.
    fn moved(
        &self,
        py: Python<'_>,
        t: f64,
        q: PyReadonlyArray1<'_, f64>,
        qdot: PyReadonlyArray1<'_, f64>,
        controls: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<Moved> {
        let (q, w) = (vector(&q)?, vector(&qdot)?);
        let controls: Vec<f64> = controls.as_array().iter().copied().collect();
        let moved = self.with(py, |plant| plant.moved(t, (&q, &w), &controls))?;
        let law::Moved { q, w, closed, .. } = moved.map_err(law_error)?;
        Ok((PyArray1::from_vec(py, q).unbind(), PyArray1::from_vec(py, w).unbind(), closed))
    }

    /// Coordinates and velocities, M-orthogonally moved to where contacts are closed and no gap is
    /// below 0.
    fn onto(
        &self,
        py: Python<'_>,
        t: f64,
        q: PyReadonlyArray1<'_, f64>,
        qdot: PyReadonlyArray1<'_, f64>,
        closed: PyReadonlyArray1<'_, bool>,
    ) -> PyResult<(Array, Array)> {
        let (mut q, mut w) = (vector(&q)?, vector(&qdot)?);
        let closed: Vec<bool> = closed.as_array().iter().copied().collect();
        let done = self.with(py, |plant| {
            let mut kinetics = GapKinetics::new(plant.layout::<PyErr>());
            plant.onto(t, (&mut q, &mut w), &closed, &mut kinetics)
        })?;
        done.map_err(law_error)?;
        Ok((PyArray1::from_vec(py, q).unbind(), PyArray1::from_vec(py, w).unbind()))
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        visit.call(&self.mechanism)?;
        visit.call(&self.inputs)?;
        self.tasks.as_ref().map_or(Ok(()), |it| visit.call(it))
    }
}

/// The controls that realise accelerations of the gaps and, as far as possible, of the remaining
/// motion; whether limits act, and the least singular value of `W^-1/2 N M^-1 B` where it was
/// computed.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub(crate) fn controls<'py>(
    py: Python<'py>,
    mass: PyReadonlyArray2<'_, f64>,
    force: PyReadonlyArray1<'_, f64>,
    gradients: PyReadonlyArray2<'_, f64>,
    curvatures: PyReadonlyArray1<'_, f64>,
    matrix: PyReadonlyArray2<'_, f64>,
    a: PyReadonlyArray1<'_, f64>,
    wanted: PyReadonlyArray1<'_, f64>,
    limits: Option<Vec<(f64, f64)>>,
) -> PyResult<(Bound<'py, PyArray1<f64>>, bool, Option<f64>)> {
    let (n, m) = (force.as_array().len(), a.as_array().len());
    let mut kinetics = kinetics_of((n, m), &mass, &force, &gradients, &curvatures)?;
    let matrix = matrix.as_array();
    let mut u = vec![0.0; matrix.ncols()];
    let matrix: Vec<f64> = matrix.iter().copied().collect();
    let (a, wanted) = (vector(&a)?, vector(&wanted)?);
    if matrix.len() != n * u.len() || wanted.len() != n {
        return Err(PyValueError::new_err("the parts do not fit together"));
    }
    let found = law::controls(&mut kinetics, &matrix, &a, &wanted, limits.as_deref(), &mut u);
    let found = found.map_err(law_error)?;
    Ok((PyArray1::from_vec(py, u), found.limited, found.least))
}

/// The force that makes accelerations of the gaps and of the rest, without contacts.
#[pyfunction]
pub(crate) fn decoupling_force<'py>(
    py: Python<'py>,
    mass: PyReadonlyArray2<'_, f64>,
    gradients: PyReadonlyArray2<'_, f64>,
    curvatures: PyReadonlyArray1<'_, f64>,
    a: PyReadonlyArray1<'_, f64>,
    wanted: PyReadonlyArray1<'_, f64>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let (n, m) = (wanted.as_array().len(), a.as_array().len());
    let kinetics = kinetics_of((n, m), &mass, &wanted, &gradients, &curvatures)?;
    let force = law::decoupling_force(&kinetics, &vector(&a)?, &vector(&wanted)?);
    Ok(PyArray1::from_vec(py, force))
}

fn kinetics_of(
    (n, m): (usize, usize),
    mass: &PyReadonlyArray2<'_, f64>,
    force: &PyReadonlyArray1<'_, f64>,
    gradients: &PyReadonlyArray2<'_, f64>,
    curvatures: &PyReadonlyArray1<'_, f64>,
) -> PyResult<GapKinetics> {
    let layout = Layout::smooth(n, m);
    let mut row: Vec<f64> = mass.as_array().iter().copied().collect();
    row.extend(vector(force)?);
    row.extend(vec![0.0; m]);
    row.extend(gradients.as_array().iter());
    row.extend(vector(curvatures)?);
    row.extend(vec![0.0; m]);
    if row.len() != layout.len() {
        return Err(PyValueError::new_err("the parts do not fit together"));
    }
    GapKinetics::of(layout, &row, &vec![0.0; n]).map_err(law_error)
}

// The tracker of gaps of a mechanical system.

/// The force with which a contact is pressed.
#[derive(FromPyObject)]
pub(crate) enum Pressing {
    Constant(f64),
    /// A function of time.
    Function(Py<PyAny>),
}

/// The state: trackers, held contacts, samples outside, accelerations, delayed controls, the last
/// ones, the place, bits of the status, the least singular value with the unactuated directions,
/// the wall offsets with their measurements and those at rest.
type TrackerNumbers = (
    Vec<State>,
    Vec<bool>,
    Vec<u32>,
    Vec<f64>,
    Vec<Vec<f64>>,
    Option<Vec<f64>>,
    Option<Vec<f64>>,
    u8,
    (f64, usize),
    (Vec<f64>, Vec<u32>, Vec<u32>),
);

/// The tracker of gaps; users see its subclass `zivi.GapTracker`.
#[pyclass(module = "zivi._zivi", name = "GapTracker")]
pub(crate) struct PyGapTracker {
    pub(crate) law: law::GapTracker,
    pub(crate) pressing: Vec<Option<Pressing>>,
}

impl PyGapTracker {
    /// The forces that are requested; `None` if the interpreter is needed.
    pub(crate) fn constants(&self) -> Option<Vec<Option<f64>>> {
        let constant = |it: &Option<Pressing>| match it {
            None => Some(None),
            Some(Pressing::Constant(value)) => Some(Some(*value)),
            Some(Pressing::Function(_)) => None,
        };
        self.pressing.iter().map(constant).collect()
    }
}

/// The commanded contact force at a time.
pub(crate) fn pressed(
    py: Python<'_>,
    pressing: &[Option<Pressing>],
    i: usize,
    t: f64,
) -> PyResult<Option<f64>> {
    match &pressing[i] {
        None => Ok(None),
        Some(Pressing::Constant(value)) => Ok(Some(*value)),
        Some(Pressing::Function(function)) => function.call1(py, (t,))?.extract(py).map(Some),
    }
}

#[pymethods]
impl PyGapTracker {
    #[new]
    #[pyo3(signature = (trackers, *, h, posture, limits, latch, delay, pressing, learn_offsets))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        trackers: Vec<PyRef<'_, PyTracker>>,
        h: f64,
        posture: (f64, f64),
        limits: Option<Vec<(f64, f64)>>,
        latch: Option<[f64; 2]>,
        delay: usize,
        pressing: Vec<Option<Pressing>>,
        learn_offsets: bool,
    ) -> PyResult<Self> {
        if pressing.len() != trackers.len() {
            return Err(PyValueError::new_err("there must be a force or None for each gap"));
        }
        let trackers = trackers.iter().map(|it| it.inner).collect();
        let settings = GapTrackerSettings { h, posture, limits, latch, delay, learn_offsets };
        Ok(Self { law: law::GapTracker::new(trackers, settings), pressing })
    }

    /// The controls for the period that starts now, with samples of the reference at its ends or, if
    /// these are None, with all gaps to land.
    #[pyo3(signature = (believed, t, q, qdot, ends))]
    fn step<'py>(
        &mut self,
        py: Python<'py>,
        believed: &Believed,
        t: f64,
        q: PyReadonlyArray1<'_, f64>,
        qdot: PyReadonlyArray1<'_, f64>,
        ends: Option<(Told<'_>, Told<'_>)>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let Self { law, pressing } = self;
        let layout = believed.mechanism.get().layout();
        let (q, w) = (vector(&q)?, vector(&qdot)?);
        if q.len() != layout.n || w.len() != layout.n {
            let text = format!("q and qdot must have shape ({},)", layout.n);
            return Err(PyValueError::new_err(text));
        }
        let count = believed.tasks.as_ref().map_or(0, |it| it.get().m);
        let of = |told| PySample::of(told, layout, count);
        let samples = match &ends {
            Some((now, next)) => Some((of(now)?, of(next)?)),
            None => None,
        };
        let ends = samples.as_ref().map(|(now, next)| [now.view(), next.view()]);
        let u = believed.with(py, |plant| {
            let mut u = vec![0.0; plant.driven.control().len()];
            let asked = &mut |i, t| pressed(py, pressing, i, t);
            law.tick(plant, t, (&q, &w), ends, asked, &mut u).map(|()| u)
        })?;
        Ok(PyArray1::from_vec(py, u.map_err(law_error)?))
    }

    /// Sensor data: standard deviations and resolutions of coordinates and velocities.
    #[getter]
    fn noise(&self) -> ([f64; 2], [f64; 2]) {
        (self.law.noise.deviations, self.law.noise.steps)
    }

    /// Gap and rate that a closed contact may have: without noise, and by it for each unit of the length
    /// of its normal.
    #[getter]
    fn closed_within(&self) -> ([f64; 2], [f64; 2]) {
        (law::EXACT, self.law.noise.of_contacts())
    }

    /// For each gap the acceleration towards the wall at rest, and the least one while contact is established.
    #[getter]
    fn pulls(&self) -> Vec<(f64, f64)> {
        self.law.pulls()
    }

    #[setter]
    fn set_noise(&mut self, noise: ([f64; 2], [f64; 2])) {
        let (deviations, steps) = noise;
        self.law.noise = Noise { deviations, steps };
    }

    fn reset(&mut self) -> PyResult<()> {
        self.law.reset().map_err(crate::control::arguments::refused)
    }

    fn copy(&self, py: Python<'_>) -> Self {
        let pressing = self.pressing.iter().map(|it| {
            it.as_ref().map(|it| match it {
                Pressing::Constant(value) => Pressing::Constant(*value),
                Pressing::Function(function) => Pressing::Function(function.clone_ref(py)),
            })
        });
        Self { law: self.law.clone(), pressing: pressing.collect() }
    }

    #[getter]
    fn state(&self) -> TrackerNumbers {
        let GapTrackerState { latch, accelerations, sent, place, status, least, uncontrolled } =
            self.law.state.clone();
        let SentControls { last: u, queue: sent } = sent;
        let trackers = self.law.trackers.iter().map(|it| tracker_state(it.state())).collect();
        let Latch { held, beyond, offsets: Offsets { by, seen, still } } = latch;
        let (rank, offsets) = ((least, uncontrolled), (by, seen, still));
        (trackers, held, beyond, accelerations, sent, u, place, status, rank, offsets)
    }

    #[setter]
    fn set_state(&mut self, state: TrackerNumbers) -> PyResult<()> {
        let (trackers, held, beyond, accelerations, sent, u, place, status, rank, offsets) = state;
        let (m, (by, seen, still)) = (self.law.trackers.len(), offsets);
        let of_gaps = [trackers.len(), held.len(), beyond.len(), accelerations.len()];
        if of_gaps != [m; 4]
            || [by.len(), seen.len(), still.len()] != [m; 3]
            || sent.len() > self.law.settings.delay
        {
            return Err(PyValueError::new_err("state must be what a tracker of these gaps gave"));
        }
        for (tracker, own) in self.law.trackers.iter_mut().zip(trackers) {
            tracker.set_state(restored(own));
        }
        let ((least, uncontrolled), offsets) = (rank, Offsets { by, seen, still });
        let latch = Latch { held, beyond, offsets };
        let sent = SentControls { last: u, queue: sent };
        self.law.state =
            GapTrackerState { latch, accelerations, sent, place, status, least, uncontrolled };
        Ok(())
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        self.pressing.iter().flatten().try_for_each(|it| match it {
            Pressing::Constant(_) => Ok(()),
            Pressing::Function(function) => visit.call(function),
        })
    }
}

// The striker.

/// The height, or the speed, of each stroke.
#[derive(FromPyObject)]
pub(crate) enum StrokeTarget {
    Constant(f64),
    /// A function of its number.
    Function(Py<PyAny>),
}

impl StrokeTarget {
    pub(crate) fn of(&self, py: Python<'_>, stroke: u32) -> PyResult<f64> {
        match self {
            Self::Constant(value) => Ok(*value),
            Self::Function(function) => function.call1(py, (stroke,))?.extract(py),
        }
    }

    /// The same without the interpreter; `None` if it is needed.
    pub(crate) fn constant(&self) -> Option<f64> {
        match self {
            Self::Constant(value) => Some(*value),
            Self::Function(_) => None,
        }
    }
}

/// Time, gap, rate; place, speed and acceleration of the body; acceleration of the gap.
type Seen = (f64, f64, f64, f64, f64, f64, f64);

fn told(it: StrikeMeasurement) -> Seen {
    let StrikeMeasurement { t, gap, rate, x, v, pull, relative } = it;
    (t, gap, rate, x, v, pull, relative)
}

fn sight((t, gap, rate, x, v, pull, relative): Seen) -> StrikeMeasurement {
    StrikeMeasurement { t, gap, rate, x, v, pull, relative }
}

/// The state: strokes, gamma, the plan, the last measurement, the flight, the next blow; raw
/// measurements, possible accelerations, the unknown one, impacts; the last and the delayed
/// controls, bits of the status.
type StrikerNumbers = (
    u32,
    f64,
    [f64; 2],
    Option<Seen>,
    (u32, f64),
    Option<f64>,
    (Option<Seen>, Vec<f64>, (u32, f64), u32),
    Option<Vec<f64>>,
    Vec<Vec<f64>>,
    u8,
);

/// The law; users see its subclass `zivi.Striker`.
#[pyclass(module = "zivi._zivi", name = "Striker")]
pub(crate) struct PyStriker {
    pub(crate) law: law::Striker,
    pub(crate) target: StrokeTarget,
}

#[pymethods]
impl PyStriker {
    #[new]
    #[pyo3(signature = (
        *, gap, e, of_wall, place, interval, h, learns, learning, limits, posture, delay, target
    ))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        gap: usize,
        e: f64,
        of_wall: bool,
        place: f64,
        interval: f64,
        h: f64,
        learns: bool,
        learning: (f64, f64, [u32; 2], u32),
        limits: Option<Vec<(f64, f64)>>,
        posture: f64,
        delay: usize,
        target: StrokeTarget,
    ) -> Self {
        let (share, least, pushes, mean) = learning;
        let learning = Learning { share, least, pushes, mean };
        let aim = Aim::new(AimSettings { h, of_wall, place, interval, learns, learning });
        let settings = StrikerSettings { gap, body: None, e, limits, posture, delay };
        Self { law: law::Striker::new(aim, settings), target }
    }

    /// The coordinate of the body, which the first sample tells.
    #[getter]
    fn body(&self) -> Option<usize> {
        self.law.settings.body
    }

    #[setter]
    fn set_body(&mut self, body: Option<usize>) {
        self.law.settings.body = body;
    }

    /// Changes of a speed up to this are noise (m/s).
    #[getter]
    fn noise(&self) -> f64 {
        self.law.aim.noise
    }

    #[setter]
    fn set_noise(&mut self, noise: f64) {
        self.law.aim.noise = noise;
    }

    /// The controls for the period that starts now.
    fn step<'py>(
        &mut self,
        py: Python<'py>,
        believed: &Believed,
        t: f64,
        q: PyReadonlyArray1<'_, f64>,
        qdot: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let Self { law, target } = self;
        let layout = believed.mechanism.get().layout();
        let (q, w) = (vector(&q)?, vector(&qdot)?);
        let body = law.settings.body.unwrap_or(0);
        if q.len() != layout.n || w.len() != layout.n || body >= layout.n {
            let text = format!("q must have shape ({},), got ({},)", layout.n, q.len());
            return Err(PyValueError::new_err(text));
        }
        if law.settings.gap >= layout.m {
            return Err(PyValueError::new_err("gap must be one of the system"));
        }
        let u = believed.with(py, |plant| {
            let mut u = vec![0.0; plant.driven.control().len()];
            law.tick(plant, t, (&q, &w), &mut |k| target.of(py, k), &mut u).map(|()| u)
        })?;
        Ok(PyArray1::from_vec(py, u.map_err(law_error)?))
    }

    fn reset(&mut self) {
        self.law.reset();
    }

    fn copy(&self, py: Python<'_>) -> Self {
        let target = match &self.target {
            StrokeTarget::Constant(value) => StrokeTarget::Constant(*value),
            StrokeTarget::Function(function) => StrokeTarget::Function(function.clone_ref(py)),
        };
        Self { law: self.law.clone(), target }
    }

    #[getter]
    fn state(&self) -> StrikerNumbers {
        let AimState { strokes, gamma, plan, last, flight, strike_at, seen, push, impacts } =
            self.law.aim.state;
        let StrikerState { acting, sent, status } = self.law.state.clone();
        let SentControls { last: u, queue } = sent;
        let learnt = (seen.map(told), acting, push, impacts);
        let last = last.map(told);
        (strokes, gamma, plan, last, flight, strike_at, learnt, u, queue, status)
    }

    #[setter]
    fn set_state(&mut self, state: StrikerNumbers) -> PyResult<()> {
        let (strokes, gamma, plan, last, flight, strike_at, learnt, u, queue, status) = state;
        let ((seen, acting, push, impacts), delay) = (learnt, self.law.settings.delay);
        if queue.len() > delay || acting.len() > delay + 1 {
            return Err(PyValueError::new_err("more is under way than the delay allows"));
        }
        let (last, seen) = (last.map(sight), seen.map(sight));
        self.law.aim.state =
            AimState { strokes, gamma, plan, last, flight, strike_at, seen, push, impacts };
        let sent = SentControls { last: u, queue };
        self.law.state = StrikerState { acting, sent, status };
        Ok(())
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        match &self.target {
            StrokeTarget::Constant(_) => Ok(()),
            StrokeTarget::Function(function) => visit.call(function),
        }
    }
}

// References of mechanical systems from Python.

/// A reference at all samples.
#[pyclass(frozen, module = "zivi._zivi", name = "Reference")]
pub(crate) struct PyReference {
    pub(crate) inner: MechanicalReference,
}

type Rows<'py> = PyReadonlyArray2<'py, f64>;

fn rows(of: &Rows<'_>) -> PyResult<Vec<f64>> {
    list(of.as_array().iter().copied())
}

#[pymethods]
impl PyReference {
    /// Rows of coordinates, velocities and accelerations, then of gaps, rates, accelerations and
    /// sides, and which are closed; of functions that follow, with their derivatives.
    #[new]
    #[allow(clippy::too_many_arguments)]
    fn new(
        q: Rows<'_>,
        qdot: Rows<'_>,
        qddot: Rows<'_>,
        gaps: Rows<'_>,
        gap_rates: Rows<'_>,
        accelerations: Rows<'_>,
        sides: Rows<'_>,
        contacts: PyReadonlyArray2<'_, bool>,
        tasks: Rows<'_>,
    ) -> PyResult<Self> {
        let inner = MechanicalReference {
            q: rows(&q)?,
            w: rows(&qdot)?,
            turning: rows(&qddot)?,
            gaps: rows(&gaps)?,
            rates: rows(&gap_rates)?,
            accelerations: rows(&accelerations)?,
            sides: rows(&sides)?,
            contacts: list(contacts.as_array().iter().copied())?,
            tasks: rows(&tasks)?,
        };
        let of_q = [&inner.w, &inner.turning].iter().all(|it| it.len() == inner.q.len());
        let parts = [&inner.rates, &inner.accelerations, &inner.sides];
        let of_gaps = parts.iter().all(|it| it.len() == inner.gaps.len());
        if inner.q.is_empty() || !of_q || !of_gaps || inner.contacts.len() != inner.gaps.len() {
            return Err(PyValueError::new_err("the parts of a reference do not fit together"));
        }
        Ok(Self { inner })
    }
}

/// A sample of a reference from Python, `(q, qdot, sides, contacts, gaps, gap_rates, accelerations,
/// qddot, tasks)`.
pub(super) type Told<'py> = (
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray1<'py, bool>,
    Option<PyReadonlyArray1<'py, f64>>,
    Option<PyReadonlyArray1<'py, f64>>,
    Option<PyReadonlyArray1<'py, f64>>,
    Option<PyReadonlyArray1<'py, f64>>,
    Option<PyReadonlyArray1<'py, f64>>,
);

/// The same with its numbers.
pub(super) struct PySample {
    q: Vec<f64>,
    w: Vec<f64>,
    sides: Vec<f64>,
    contacts: Vec<bool>,
    gaps: Option<(Vec<f64>, Vec<f64>)>,
    accelerations: Option<Vec<f64>>,
    turning: Option<Vec<f64>>,
    tasks: Option<Vec<f64>>,
}

impl PySample {
    pub(super) fn of(told: &Told<'_>, Layout { n, m, .. }: Layout, count: usize) -> PyResult<Self> {
        let (q, w, sides, contacts, gaps, rates, accelerations, turning, tasks) = told;
        let optional = |of: &Option<PyReadonlyArray1<'_, f64>>| of.as_ref().map(vector).transpose();
        let sample = Self {
            q: vector(q)?,
            w: vector(w)?,
            sides: vector(sides)?,
            contacts: list(contacts.as_array().iter().copied())?,
            gaps: optional(gaps)?.zip(optional(rates)?),
            accelerations: optional(accelerations)?,
            turning: optional(turning)?,
            tasks: optional(tasks)?,
        };
        let is = |of: &Option<Vec<f64>>, size| of.as_ref().is_none_or(|it| it.len() == size);
        let gaps = sample.gaps.as_ref().is_none_or(|(x, v)| x.len() == m && v.len() == m);
        let of_q = sample.q.len() == n && sample.w.len() == n && is(&sample.turning, n);
        let of_gaps = sample.sides.len() == m && sample.contacts.len() == m && gaps;
        if of_q && of_gaps && is(&sample.accelerations, m) && is(&sample.tasks, 3 * count) {
            return Ok(sample);
        }
        Err(PyValueError::new_err(format!(
            "a sample of the reference must be of {n} coordinates, {m} gaps and {count} tasks"
        )))
    }

    pub(super) fn view(&self) -> ReferenceSample<'_> {
        ReferenceSample {
            q: &self.q,
            w: &self.w,
            sides: &self.sides,
            contacts: &self.contacts,
            gaps: self.gaps.as_ref().map(|(x, v)| (x.as_slice(), v.as_slice())),
            accelerations: self.accelerations.as_deref(),
            turning: self.turning.as_deref(),
            tasks: self.tasks.as_deref(),
        }
    }
}
