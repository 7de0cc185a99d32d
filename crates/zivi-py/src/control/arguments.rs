//! Common arguments of the constructors and updates of all controllers.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use zivi::drive::closed_loop::{TickError, UnderWay};
use zivi_core::control::{GainError, Gains, Landing, Port, TickStatus, TrackerState};
use zivi_core::{Lifted, Physical, Restitution, SettingError};

pub(super) fn refused(error: SettingError) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// The sample, `None` if missing.
pub(super) fn sample(x: Option<f64>, xdot: Option<f64>) -> PyResult<Option<Physical>> {
    match (x, xdot) {
        (None, _) => Ok(None),
        (Some(x), Some(xdot)) => Ok(Some(Physical { x, xdot })),
        (Some(_), None) => {
            let message = "xdot must be a velocity (m/s) where x is measured, got None";
            Err(PyValueError::new_err(message))
        }
    }
}

/// Gains, by this condition if a bound of the unknown force is given.
pub(super) fn gains(
    mu1: f64,
    mu2: f64,
    restitution: Restitution,
    bound: Option<f64>,
    condition: fn(f64, f64, f64, Restitution) -> Result<Gains, GainError>,
) -> PyResult<Gains> {
    match bound {
        Some(bound) => condition(mu1, mu2, bound, restitution),
        None => Gains::new(mu1, mu2).map_err(GainError::from),
    }
    .map_err(|error| PyValueError::new_err(error.to_string()))
}

pub(super) fn port(depth: f64, (low, high): (f64, f64)) -> PyResult<Port> {
    Port::default()
        .with_depth(depth)
        .and_then(|port| port.with_actuator(low, high))
        .map_err(refused)
}

/// The contact-establishing law with its horizon and dead zone, if any.
pub(super) fn landing(ahead: Option<u32>, h: f64, quiet: f64) -> PyResult<Option<Landing>> {
    let landing = |ahead| Landing::new(ahead, h).and_then(|it| it.with_quiet(quiet));
    ahead.map(landing).transpose().map_err(refused)
}

/// `(s_r, v_r, side, u, signs, status bits)`.
pub(super) type State = (f64, f64, f64, f64, [f64; 6], u8);

pub(super) fn tracker_state(state: TrackerState) -> State {
    let TrackerState { reference: Lifted { s, v }, side, u, signs, status, .. } = state;
    (s, v, side, u, signs, status.bits())
}

pub(super) fn restored((s, v, side, u, signs, bits): State) -> TrackerState {
    let status = TickStatus::from_bits(bits);
    TrackerState { reference: Lifted { s, v }, side, u, signs, status, iterations: 0 }
}

// Controllers with delayed controls, and the delay line as plain numbers.

/// The controls that do not act yet, the references until then, the oldest first, and the periods by
/// which a reference of its own is not ahead yet.
pub(super) type UnderWayState = (Vec<f64>, Vec<(f64, f64)>, usize);

/// An empty delay line of this length; `None` for none.
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

/// Controls in the delay line require periods `h`.
pub(super) fn only_with(under_way: &Option<Box<UnderWay>>, dt: Option<f64>) -> PyResult<()> {
    match dt {
        Some(_) if under_way.is_some() => {
            let message = "dt must be None with a delay: what is under way acts for periods h";
            Err(PyValueError::new_err(message))
        }
        _ => Ok(()),
    }
}

/// The reason why an update returned no control.
pub(super) fn raised(error: TickError<PyErr>) -> PyErr {
    match error {
        TickError::Refused(error) => refused(error),
        TickError::Raised(error) => error,
    }
}
