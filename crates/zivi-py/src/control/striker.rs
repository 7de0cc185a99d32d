//! The law that aims at impacts.

use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::gc::{PyTraverseError, PyVisit};
use pyo3::prelude::*;
use zivi::drive::mechanical::{self as law, SentControls, StrikerSettings, StrikerState};
use zivi_core::control::{Aim, AimSettings, AimState, Learning, Sight};

use super::believed::{law_error, Believed};
use crate::arrays::vector;

/// The height, or the speed, of each stroke.
#[derive(FromPyObject)]
pub(crate) enum Target {
    Constant(f64),
    /// A function of its number.
    Function(Py<PyAny>),
}

impl Target {
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

fn told(it: Sight) -> Seen {
    let Sight { t, gap, rate, x, v, pull, relative } = it;
    (t, gap, rate, x, v, pull, relative)
}

fn sight((t, gap, rate, x, v, pull, relative): Seen) -> Sight {
    Sight { t, gap, rate, x, v, pull, relative }
}

/// All that changes: strokes, gamma, the plan, what was seen at the last tick, the flight, the next
/// blow; what was measured, accelerations that may act, the unknown one, impacts; the last controls,
/// those under way, bits of the status.
type Changing = (
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

/// The law; `zivi.Striker` is what users see.
#[pyclass(module = "zivi._zivi")]
pub(crate) struct Striker {
    pub(crate) law: law::Striker,
    pub(crate) target: Target,
}

#[pymethods]
impl Striker {
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
        target: Target,
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
            Target::Constant(value) => Target::Constant(*value),
            Target::Function(function) => Target::Function(function.clone_ref(py)),
        };
        Self { law: self.law.clone(), target }
    }

    #[getter]
    fn state(&self) -> Changing {
        let AimState { strokes, gamma, plan, last, flight, strike_at, seen, push, impacts } =
            self.law.aim.state;
        let StrikerState { acting, sent, status } = self.law.state.clone();
        let SentControls { last: u, queue } = sent;
        let learnt = (seen.map(told), acting, push, impacts);
        let last = last.map(told);
        (strokes, gamma, plan, last, flight, strike_at, learnt, u, queue, status)
    }

    #[setter]
    fn set_state(&mut self, state: Changing) -> PyResult<()> {
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
            Target::Constant(_) => Ok(()),
            Target::Function(function) => visit.call(function),
        }
    }
}
