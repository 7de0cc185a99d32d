//! The tracker of gaps of a mechanical system, what it believes in, and its references.

use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::gc::{PyTraverseError, PyVisit};
use pyo3::prelude::*;
use zivi::drive::mechanical::{
    self as law, BelievedPlant, GapKinetics, GapTrackerSettings, GapTrackerState, Latch, LawError,
    MechanicalReference, Noise, ReferenceSample,
};
use zivi::system::dynamics::Layout;

use super::arguments::{restored, tracker_state, State};
use super::tracker::Tracker;
use crate::arrays::{vector, Array};
use crate::dynamics::AnyDynamics;
use crate::errors::setup_error;
use crate::friction::Rubbing;
use crate::inputs::{Inputs, Matrices};
use crate::system::Mechanism;

/// What a law that gives no controls raises.
pub(crate) fn law_error(error: LawError<PyErr>) -> PyErr {
    match error {
        LawError::Setup(error) => setup_error(error),
        error => error.raised().unwrap_or_else(PyValueError::new_err),
    }
}

/// A system with its controls as a controller believes in it.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct Believed {
    pub(crate) mechanism: Py<Mechanism>,
    pub(crate) inputs: Py<Inputs>,
    /// Length of a period (s).
    pub(crate) h: f64,
}

impl Believed {
    /// Runs something with the plant.
    fn with<R>(
        &self,
        py: Python<'_>,
        run: impl FnOnce(&mut BelievedPlant<'_, Rubbing<'_, AnyDynamics<'_>>, Matrices<'_>>) -> R,
    ) -> PyResult<R> {
        let (mechanism, inputs) = (self.mechanism.get(), self.inputs.get());
        let mut driven = inputs.driven(py, mechanism)?;
        Ok(run(&mut BelievedPlant { driven: &mut driven, laws: &mechanism.laws, h: self.h }))
    }
}

/// Coordinates, velocities and contacts.
type Moved = (Array, Array, Vec<bool>);

#[pymethods]
impl Believed {
    #[new]
    fn new(mechanism: Py<Mechanism>, inputs: Py<Inputs>, h: f64) -> Self {
        Self { mechanism, inputs, h }
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
        let (q, w) = (vector(&q), vector(&qdot));
        let controls: Vec<f64> = controls.as_array().iter().copied().collect();
        let moved = self.with(py, |plant| plant.moved(t, (&q, &w), &controls))?;
        let law::Moved { q, w, closed } = moved.map_err(law_error)?;
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
        let (mut q, mut w) = (vector(&q), vector(&qdot));
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
        visit.call(&self.inputs)
    }
}

/// The controls that make accelerations of the gaps and, as far as they can, of the rest; whether
/// limits act, and the least singular value of `D^-1/2 N M^-1 B` where it was computed.
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
    let (a, wanted) = (vector(&a), vector(&wanted));
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
    let force = law::decoupling_force(&kinetics, &vector(&a), &vector(&wanted));
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
    row.extend(vector(force));
    row.extend(vec![0.0; m]);
    row.extend(gradients.as_array().iter());
    row.extend(vector(curvatures));
    row.extend(vec![0.0; m]);
    if row.len() != layout.len() {
        return Err(PyValueError::new_err("the parts do not fit together"));
    }
    GapKinetics::of(layout, &row, &vec![0.0; n]).map_err(law_error)
}

/// A reference at all samples.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct Reference {
    pub(crate) inner: MechanicalReference,
}

type Rows<'py> = PyReadonlyArray2<'py, f64>;

fn rows(of: &Rows<'_>) -> Vec<f64> {
    of.as_array().iter().copied().collect()
}

#[pymethods]
impl Reference {
    /// Rows of coordinates, velocities and accelerations, then of gaps, rates, accelerations and
    /// sides, and which are closed.
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
    ) -> PyResult<Self> {
        let inner = MechanicalReference {
            q: rows(&q),
            w: rows(&qdot),
            turning: rows(&qddot),
            gaps: rows(&gaps),
            rates: rows(&gap_rates),
            accelerations: rows(&accelerations),
            sides: rows(&sides),
            contacts: contacts.as_array().iter().copied().collect(),
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
/// qddot)`.
type Told<'py> = (
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray1<'py, bool>,
    Option<PyReadonlyArray1<'py, f64>>,
    Option<PyReadonlyArray1<'py, f64>>,
    Option<PyReadonlyArray1<'py, f64>>,
    Option<PyReadonlyArray1<'py, f64>>,
);

/// The same with its numbers.
struct Sample {
    q: Vec<f64>,
    w: Vec<f64>,
    sides: Vec<f64>,
    contacts: Vec<bool>,
    gaps: Option<(Vec<f64>, Vec<f64>)>,
    accelerations: Option<Vec<f64>>,
    turning: Option<Vec<f64>>,
}

impl Sample {
    fn of(told: &Told<'_>, Layout { n, m, .. }: Layout) -> PyResult<Self> {
        let (q, w, sides, contacts, gaps, rates, accelerations, turning) = told;
        let optional = |of: &Option<PyReadonlyArray1<'_, f64>>| of.as_ref().map(vector);
        let sample = Self {
            q: vector(q),
            w: vector(w),
            sides: vector(sides),
            contacts: contacts.as_array().iter().copied().collect(),
            gaps: optional(gaps).zip(optional(rates)),
            accelerations: optional(accelerations),
            turning: optional(turning),
        };
        let is = |of: &Option<Vec<f64>>, size| of.as_ref().is_none_or(|it| it.len() == size);
        let gaps = sample.gaps.as_ref().is_none_or(|(x, v)| x.len() == m && v.len() == m);
        let of_q = sample.q.len() == n && sample.w.len() == n && is(&sample.turning, n);
        let of_gaps = sample.sides.len() == m && sample.contacts.len() == m && gaps;
        if of_q && of_gaps && is(&sample.accelerations, m) {
            return Ok(sample);
        }
        Err(PyValueError::new_err(format!(
            "a sample of the reference must be of {n} coordinates and {m} gaps"
        )))
    }

    fn view(&self) -> ReferenceSample<'_> {
        ReferenceSample {
            q: &self.q,
            w: &self.w,
            sides: &self.sides,
            contacts: &self.contacts,
            gaps: self.gaps.as_ref().map(|(x, v)| (x.as_slice(), v.as_slice())),
            accelerations: self.accelerations.as_deref(),
            turning: self.turning.as_deref(),
        }
    }
}

/// The force with which a contact is pressed.
#[derive(FromPyObject)]
pub(crate) enum Pressing {
    Constant(f64),
    /// A function of time.
    Function(Py<PyAny>),
}

/// All that changes: trackers, contacts held, samples beyond, accelerations, controls under way, the
/// last ones, the place, bits of the status, the least singular value with the directions that have
/// no actuator.
type Changing = (
    Vec<State>,
    Vec<bool>,
    Vec<u32>,
    Vec<f64>,
    Vec<Vec<f64>>,
    Option<Vec<f64>>,
    Option<Vec<f64>>,
    u8,
    (f64, usize),
);

/// The tracker of gaps; `zivi.GapTracker` is what users see.
#[pyclass(module = "zivi._zivi")]
pub(crate) struct GapTracker {
    pub(crate) law: law::GapTracker,
    pub(crate) pressing: Vec<Option<Pressing>>,
}

impl GapTracker {
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

/// What a contact is pressed with at a time.
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
impl GapTracker {
    #[new]
    #[pyo3(signature = (trackers, *, h, posture, limits, latch, delay, pressing))]
    fn new(
        trackers: Vec<PyRef<'_, Tracker>>,
        h: f64,
        posture: (f64, f64),
        limits: Option<Vec<(f64, f64)>>,
        latch: Option<[f64; 2]>,
        delay: usize,
        pressing: Vec<Option<Pressing>>,
    ) -> PyResult<Self> {
        if pressing.len() != trackers.len() {
            return Err(PyValueError::new_err("there must be a force or None for each gap"));
        }
        let trackers = trackers.iter().map(|it| it.inner).collect();
        let settings = GapTrackerSettings { h, posture, limits, latch, delay };
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
        let (q, w) = (vector(&q), vector(&qdot));
        if q.len() != layout.n || w.len() != layout.n {
            let text = format!("q and qdot must have shape ({},)", layout.n);
            return Err(PyValueError::new_err(text));
        }
        let samples = match &ends {
            Some((now, next)) => Some((Sample::of(now, layout)?, Sample::of(next, layout)?)),
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

    /// What the sensor is like: deviations and steps of coordinates and of velocities.
    #[getter]
    fn noise(&self) -> ([f64; 2], [f64; 2]) {
        (self.law.noise.deviations, self.law.noise.steps)
    }

    #[setter]
    fn set_noise(&mut self, noise: ([f64; 2], [f64; 2])) {
        let (deviations, steps) = noise;
        self.law.noise = Noise { deviations, steps };
    }

    fn reset(&mut self) -> PyResult<()> {
        self.law.reset().map_err(super::arguments::refused)
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
    fn state(&self) -> Changing {
        let GapTrackerState { latch, accelerations, sent, u, place, status, least, uncontrolled } =
            self.law.state.clone();
        let trackers = self.law.trackers.iter().map(|it| tracker_state(it.state())).collect();
        let rank = (least, uncontrolled);
        (trackers, latch.held, latch.beyond, accelerations, sent, u, place, status, rank)
    }

    #[setter]
    fn set_state(&mut self, state: Changing) -> PyResult<()> {
        let (trackers, held, beyond, accelerations, sent, u, place, status, rank) = state;
        let m = self.law.trackers.len();
        let sizes = [trackers.len(), held.len(), beyond.len(), accelerations.len()];
        if sizes != [m; 4] || sent.len() > self.law.settings.delay {
            return Err(PyValueError::new_err("state must be what a tracker of these gaps gave"));
        }
        for (tracker, own) in self.law.trackers.iter_mut().zip(trackers) {
            tracker.set_state(restored(own));
        }
        let ((least, uncontrolled), latch) = (rank, Latch { held, beyond });
        self.law.state =
            GapTrackerState { latch, accelerations, sent, u, place, status, least, uncontrolled };
        Ok(())
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        self.pressing.iter().flatten().try_for_each(|it| match it {
            Pressing::Constant(_) => Ok(()),
            Pressing::Function(function) => visit.call(function),
        })
    }
}
