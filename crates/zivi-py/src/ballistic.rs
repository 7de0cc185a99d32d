//! Exact motion under constant forces, from Python.

use numpy::PyReadonlyArray2;
use pyo3::prelude::*;
use zivi::stepping::ballistic;
use zivi::{Events, Physical};

use crate::arrays::{array, list, Array};
use crate::transform::Restitution;

/// Where motions are after a while.
#[pyclass(frozen, get_all, module = "zivi._zivi")]
pub(crate) struct Ballistic {
    x: Array,
    xdot: Array,
    n_impacts: Array,
}

/// The exact motion from states `x, x'` (rows) under accelerations for durations (columns 2 and 3
/// of the rows).
#[pyfunction]
pub(crate) fn ballistic_motion(
    py: Python<'_>,
    rows: PyReadonlyArray2<'_, f64>,
    restitution: PyRef<'_, Restitution>,
) -> PyResult<Ballistic> {
    let rows = rows.as_array();
    let motions = rows.rows().into_iter().map(|row| {
        let (state, mut events) = (Physical { x: row[0], xdot: row[1] }, Events::default());
        let span = (0.0, row[3]);
        let end = ballistic::advance(state, row[2], restitution.inner, span, &mut events);
        (end, events.impacts.len())
    });
    let motions = list(motions)?;
    let column = |of: fn(&(Physical, usize)) -> f64| array(py, motions.iter().map(of));
    Ok(Ballistic {
        x: column(|it| it.0.x)?,
        xdot: column(|it| it.0.xdot)?,
        n_impacts: column(|it| it.1 as f64)?,
    })
}
