//! Restitution and transform on arrays.

use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use zivi_core::{transform, Branch, Lifted, Physical, Restitution};

/// `(e, kappa)`: one as it was given, the other its image, so that neither loses digits.
pub(crate) type WallPair = (f64, f64);

pub(crate) fn from_both((e, kappa): WallPair) -> PyResult<Restitution> {
    Restitution::from_both(e, kappa).map_err(|error| PyValueError::new_err(error.to_string()))
}

/// Where only the parameter of the transform matters.
pub(crate) fn restitution_of(kappa: f64) -> PyResult<Restitution> {
    Restitution::from_kappa(kappa).map_err(|error| PyValueError::new_err(error.to_string()))
}

/// `(e, kappa)` from exactly one of them.
#[pyfunction]
#[pyo3(signature = (*, e=None, kappa=None))]
pub(crate) fn restitution(e: Option<f64>, kappa: Option<f64>) -> PyResult<(f64, f64)> {
    let wall = match (e, kappa) {
        (Some(e), None) => Restitution::from_e(e),
        (None, Some(kappa)) => Restitution::from_kappa(kappa),
        _ => {
            let given = if e.is_some() { "both" } else { "neither" };
            return Err(PyValueError::new_err(format!(
                "exactly one of e and kappa must be given, got {given}"
            )));
        }
    };
    let wall = wall.map_err(|error| PyValueError::new_err(error.to_string()))?;
    Ok((wall.e(), wall.kappa()))
}

type Pair<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

fn map_pairs<'py>(
    py: Python<'py>,
    (first, second): (PyReadonlyArray1<'py, f64>, PyReadonlyArray1<'py, f64>),
    map: impl Fn(f64, f64) -> (f64, f64),
) -> Pair<'py> {
    let (first, second) = (first.as_array(), second.as_array());
    let (a, b): (Vec<f64>, Vec<f64>) = first.iter().zip(second).map(|(&a, &b)| map(a, b)).unzip();
    (PyArray1::from_vec(py, a), PyArray1::from_vec(py, b))
}

/// `(s, v)` of physical states on the branch `sigma`.
#[pyfunction]
pub(crate) fn lift<'py>(
    py: Python<'py>,
    x: PyReadonlyArray1<'py, f64>,
    xdot: PyReadonlyArray1<'py, f64>,
    sigma: f64,
    kappa: f64,
) -> PyResult<Pair<'py>> {
    let restitution = restitution_of(kappa)?;
    let branch = if sigma < 0.0 { Branch::Negative } else { Branch::Positive };
    Ok(map_pairs(py, (x, xdot), |x, xdot| {
        let z = transform::lift(Physical { x, xdot }, branch, restitution);
        (z.s, z.v)
    }))
}

/// `(x, xdot)` of lifted states.
#[pyfunction]
pub(crate) fn project<'py>(
    py: Python<'py>,
    s: PyReadonlyArray1<'py, f64>,
    v: PyReadonlyArray1<'py, f64>,
    kappa: f64,
) -> PyResult<Pair<'py>> {
    let restitution = restitution_of(kappa)?;
    Ok(map_pairs(py, (s, v), |s, v| {
        let physical = transform::project(Lifted { s, v }, restitution);
        (physical.x, physical.xdot)
    }))
}
