//! Events of the user: functions from Python, and what happened of them.

use numpy::PyArray1;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use zivi::{Direction, EventHit, Level, UserEvent};

use crate::record::Array;

/// An event of the user: function, direction, number of the event that ends the run, level (of the
/// velocity or the position, and which).
pub(crate) type EventSpec<'py> = (Bound<'py, PyAny>, i32, Option<usize>, Option<(bool, f64)>);

pub(crate) fn event<'py>(
    (function, direction, terminal, level): EventSpec<'py>,
) -> UserEvent<'py, PyErr> {
    let direction = match direction {
        0 => Direction::Either,
        below if below < 0 => Direction::Falling,
        _ => Direction::Rising,
    };
    let call = move |t: f64, x: f64, xdot: f64| {
        let value = function.call1((t, x, xdot))?;
        value.extract().map_err(|_| {
            let kind = value.get_type();
            PyTypeError::new_err(format!("an event function must return a float, got {kind}"))
        })
    };
    let level = level.map(|(of_velocity, value)| match of_velocity {
        true => Level::Velocity(value),
        false => Level::Position(value),
    });
    UserEvent { direction, terminal, level, ..UserEvent::new(call) }
}

/// Times, positions and velocities of each event.
pub(crate) fn columns_of(py: Python<'_>, hits: &[Vec<EventHit>]) -> Vec<(Array, Array, Array)> {
    let column = |hits: &[EventHit], of: fn(&EventHit) -> f64| {
        PyArray1::from_vec(py, hits.iter().map(of).collect()).unbind()
    };
    hits.iter()
        .map(|hits| (column(hits, |it| it.t), column(hits, |it| it.x), column(hits, |it| it.xdot)))
        .collect()
}
