//! Controllers whose controls act late, and what is under way, as plain numbers.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use zivi::drive::closed_loop::{TickError, UnderWay};
use zivi_core::Physical;

use super::arguments::refused;

/// The controls that do not act yet, the references until then, the oldest first, and the periods by
/// which a reference of its own is not ahead yet.
pub(super) type UnderWayState = (Vec<f64>, Vec<(f64, f64)>, usize);

/// Nothing, for a delay of so many periods; `None` for none.
pub(super) fn nothing_under_way(delay: usize) -> PyResult<Option<Box<UnderWay>>> {
    let nothing = || UnderWay::nothing(delay).map(Box::new).map_err(refused);
    (delay > 0).then(nothing).transpose()
}

pub(super) fn under_way_state(it: &UnderWay) -> UnderWayState {
    let references = it.references.held().map(|Physical { x, xdot }| (x, xdot));
    (it.controls.held().collect(), references.collect(), it.due)
}

pub(super) fn under_way_of((controls, references, due): UnderWayState) -> PyResult<Box<UnderWay>> {
    let mut it = UnderWay::nothing(controls.len()).map_err(refused)?;
    for u in controls {
        it.controls.push(u);
    }
    for (x, xdot) in references {
        it.references.push(Physical { x, xdot });
    }
    it.due = due;
    Ok(Box::new(it))
}

/// What is under way is there for periods `h`.
pub(super) fn only_with(under_way: &Option<Box<UnderWay>>, dt: Option<f64>) -> PyResult<()> {
    match dt {
        Some(_) if under_way.is_some() => {
            let message = "dt must be None with a delay: what is under way acts for periods h";
            Err(PyValueError::new_err(message))
        }
        _ => Ok(()),
    }
}

/// Why a tick gave no control.
pub(super) fn raised(error: TickError<PyErr>) -> PyErr {
    match error {
        TickError::Refused(error) => refused(error),
        TickError::Raised(error) => error,
    }
}
