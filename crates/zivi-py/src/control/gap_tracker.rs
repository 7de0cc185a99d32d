//! The tracker of gaps of a mechanical system.

use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::gc::{PyTraverseError, PyVisit};
use pyo3::prelude::*;
use zivi::drive::mechanical::{
    self as law, GapTrackerSettings, GapTrackerState, Latch, Noise, Offsets, SentControls,
};

use super::arguments::{restored, tracker_state, State};
use super::believed::{law_error, Believed};
use super::mechanical_reference::{Sample, Told};
use super::tracker::Tracker;
use crate::arrays::vector;

/// The force with which a contact is pressed.
#[derive(FromPyObject)]
pub(crate) enum Pressing {
    Constant(f64),
    /// A function of time.
    Function(Py<PyAny>),
}

/// All that changes: trackers, contacts held, samples beyond, accelerations, controls under way, the
/// last ones, the place, bits of the status, the least singular value with the directions that have
/// no actuator, the offsets of walls with the measurements behind them and those at rest.
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
    (Vec<f64>, Vec<u32>, Vec<u32>),
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
    #[pyo3(signature = (trackers, *, h, posture, limits, latch, delay, pressing, learn_offsets))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        trackers: Vec<PyRef<'_, Tracker>>,
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
        let of = |told| Sample::of(told, layout, count);
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

    /// What the sensor is like: deviations and steps of coordinates and of velocities.
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

    /// By gap: the acceleration that presses it at rest, and the least that pulls it while it lands.
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
        let GapTrackerState { latch, accelerations, sent, place, status, least, uncontrolled } =
            self.law.state.clone();
        let SentControls { last: u, queue: sent } = sent;
        let trackers = self.law.trackers.iter().map(|it| tracker_state(it.state())).collect();
        let Latch { held, beyond, offsets: Offsets { by, seen, still } } = latch;
        let (rank, offsets) = ((least, uncontrolled), (by, seen, still));
        (trackers, held, beyond, accelerations, sent, u, place, status, rank, offsets)
    }

    #[setter]
    fn set_state(&mut self, state: Changing) -> PyResult<()> {
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
