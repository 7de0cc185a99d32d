//! Events of the user: functions from Python, and what happened of them.

use std::slice::from_ref;

use numpy::{PyArray1, PyArrayMethods};
use pyo3::exceptions::PyTypeError;
use pyo3::gc::{PyTraverseError, PyVisit};
use pyo3::prelude::*;
use zivi::{Direction, Level, LocatedEvent, MotionPoint, PathPoint, UserEvent};

use crate::arrays::{array, Array, Matrix};
use crate::dynamics::fill;

/// An event of the user: where a function of time and state changes its sign.
#[pyclass(frozen, get_all, module = "zivi._zivi")]
pub(crate) struct Event {
    /// `g(t, x, x')`, or `g(t, q, q')` of a mechanical system.
    function: Py<PyAny>,
    /// Upwards only, downwards only (below 0) or both (0).
    direction: i32,
    /// The number of the event that ends the run.
    terminal: Option<usize>,
    /// The level that is crossed, if the function is that simple: one of the position or of the
    /// velocity.
    level_x: Option<f64>,
    level_xdot: Option<f64>,
}

#[pymethods]
impl Event {
    #[new]
    #[pyo3(signature = (function, *, direction, terminal, level_x=None, level_xdot=None))]
    fn new(
        function: Py<PyAny>,
        direction: i32,
        terminal: Option<usize>,
        level_x: Option<f64>,
        level_xdot: Option<f64>,
    ) -> Self {
        Self { function, direction, terminal, level_x, level_xdot }
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        visit.call(&self.function)
    }
}

/// What a function of an event returned, as a number.
fn number(value: &Bound<'_, PyAny>) -> PyResult<f64> {
    value.extract().map_err(|_| {
        let kind = value.get_type();
        PyTypeError::new_err(format!("an event function must return a float, got {kind}"))
    })
}

impl Event {
    fn direction(&self) -> Direction {
        match self.direction {
            0 => Direction::Either,
            below if below < 0 => Direction::Falling,
            _ => Direction::Rising,
        }
    }

    /// As an event of a mass above a wall.
    pub(crate) fn of_point<'py>(&self, py: Python<'py>) -> UserEvent<'py, PyErr> {
        let function = self.function.bind(py).clone();
        let call = move |t: f64, x: f64, xdot: f64| number(&function.call1((t, x, xdot))?);
        let of_x = self.level_x.map(Level::Position);
        let level = of_x.or(self.level_xdot.map(Level::Velocity));
        let (direction, terminal) = (self.direction(), self.terminal);
        UserEvent { direction, terminal, level, ..UserEvent::new(call) }
    }

    /// As an event of a mechanical system of `n` coordinates.
    pub(crate) fn of_mechanism<'py>(
        &self,
        py: Python<'py>,
        n: usize,
    ) -> UserEvent<'py, PyErr, MotionPoint> {
        let function = self.function.bind(py).clone();
        let zeros = || PyArray1::zeros(py, n, false);
        let (of_q, of_w) = (zeros(), zeros());
        let call = move |t: f64, at: &MotionPoint| {
            fill(&of_q, &at.x[..n])?;
            fill(&of_w, &at.v[..n])?;
            number(&function.call1((t, &of_q, &of_w))?)
        };
        let (direction, terminal) = (self.direction(), self.terminal);
        UserEvent { direction, terminal, ..UserEvent::of(call) }
    }
}

/// Where one event of the user happened: its times, and the states there in rows.
#[pyclass(frozen, get_all, module = "zivi._zivi")]
pub(crate) struct Hits {
    t: Array,
    /// Coordinates: one, the distance from the wall, for a mass.
    q: Matrix<f64>,
    qdot: Matrix<f64>,
}

/// A state at which an event happened.
pub(crate) trait Place {
    /// Coordinates.
    fn q(&self) -> &[f64];
    /// Velocities.
    fn qdot(&self) -> &[f64];
}

impl Place for PathPoint {
    fn q(&self) -> &[f64] {
        from_ref(&self.x)
    }

    fn qdot(&self) -> &[f64] {
        from_ref(&self.xdot)
    }
}

/// Gaps and their rates follow the coordinates and velocities.
impl Place for MotionPoint {
    fn q(&self) -> &[f64] {
        &self.x
    }

    fn qdot(&self) -> &[f64] {
        &self.v
    }
}

impl Hits {
    /// Those of each event, at states of `n` coordinates.
    pub(crate) fn of<S: Place>(
        py: Python<'_>,
        events: &[Vec<LocatedEvent<S>>],
        n: usize,
    ) -> PyResult<Vec<Py<Self>>> {
        let one = |hits: &Vec<LocatedEvent<S>>| {
            let rows = |of: fn(&S) -> &[f64]| -> PyResult<Matrix<f64>> {
                let all = hits.iter().flat_map(|it| of(&it.at)[..n].iter().copied());
                Ok(array(py, all)?.into_bound(py).reshape([hits.len(), n])?.unbind())
            };
            let t = array(py, hits.iter().map(|it| it.t))?;
            Py::new(py, Self { t, q: rows(S::q)?, qdot: rows(S::qdot)? })
        };
        events.iter().map(one).collect()
    }
}
