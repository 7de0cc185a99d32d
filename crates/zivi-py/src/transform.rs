//! Restitution and transform on arrays.

use crate::interface::zeros;
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use zivi_core::{transform, Branch, Lifted, Physical, Restitution, RestitutionError};

fn refused(error: RestitutionError) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// Restitution of a wall as `e` and as `kappa`: one as given, the other computed, so that neither
/// loses digits.
#[pyclass(frozen, module = "zivi._zivi", name = "Restitution")]
pub(crate) struct PyRestitution {
    pub(crate) inner: Restitution,
}

#[pymethods]
impl PyRestitution {
    /// From exactly one of them.
    #[new]
    #[pyo3(signature = (*, e=None, kappa=None))]
    fn new(e: Option<f64>, kappa: Option<f64>) -> PyResult<Self> {
        let inner = match (e, kappa) {
            (Some(e), None) => Restitution::from_e(e),
            (None, Some(kappa)) => Restitution::from_kappa(kappa),
            _ => {
                let given = if e.is_some() { "both" } else { "neither" };
                return Err(PyValueError::new_err(format!(
                    "exactly one of e and kappa must be given, got {given}"
                )));
            }
        };
        Ok(Self { inner: inner.map_err(refused)? })
    }

    /// From both, which must be each other's image.
    #[staticmethod]
    fn of_both(e: f64, kappa: f64) -> PyResult<Self> {
        Ok(Self { inner: from_both(e, kappa)? })
    }

    #[getter]
    fn e(&self) -> f64 {
        self.inner.e()
    }

    #[getter]
    fn kappa(&self) -> f64 {
        self.inner.kappa()
    }
}

pub(crate) fn from_both(e: f64, kappa: f64) -> PyResult<Restitution> {
    Restitution::from_both(e, kappa).map_err(refused)
}

pub(crate) fn from_e(e: f64) -> PyResult<Restitution> {
    Restitution::from_e(e).map_err(refused)
}

/// Where only the parameter of the transform matters.
pub(crate) fn restitution_of(kappa: f64) -> PyResult<Restitution> {
    Restitution::from_kappa(kappa).map_err(refused)
}

type Pair<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

fn map_pairs<'py>(
    py: Python<'py>,
    (first, second): (PyReadonlyArray1<'py, f64>, PyReadonlyArray1<'py, f64>),
    map: impl Fn(f64, f64) -> (f64, f64),
) -> PyResult<Pair<'py>> {
    let (first, second) = (first.as_array(), second.as_array());
    let (mut a, mut b) = (zeros(first.len())?, zeros(first.len())?);
    for (k, (first, second)) in first.iter().zip(second).enumerate() {
        (a[k], b[k]) = map(*first, *second);
    }
    Ok((PyArray1::from_vec(py, a), PyArray1::from_vec(py, b)))
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
    map_pairs(py, (x, xdot), |x, xdot| {
        let z = transform::lift(Physical { x, xdot }, branch, restitution);
        (z.s, z.v)
    })
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
    map_pairs(py, (s, v), |s, v| {
        let physical = transform::project(Lifted { s, v }, restitution);
        (physical.x, physical.xdot)
    })
}
