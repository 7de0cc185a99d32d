//! What the constructors and ticks of all controllers read.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use zivi_core::control::{GainError, Gains, Landing, Port, TickStatus, TrackerState};
use zivi_core::{Lifted, Physical, Restitution, SettingError};

pub(super) fn refused(error: SettingError) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// The sample, `None` where it is missing.
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

/// The landing of so many periods, if any, with this dead zone.
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
