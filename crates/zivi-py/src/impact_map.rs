//! Maps from impact to impact, from Python.

use numpy::{PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use zivi::drive::batch::{map_impacts, orbits};
use zivi::{ImpactMap, MapParameter};

use crate::arrays::{array, list};
use crate::batch::{natives, refused};
use crate::errors::setup_error;
use crate::system::PointMass;
use crate::watch::Watch;

fn map_of(py: Python<'_>, system: &PointMass) -> PyResult<ImpactMap> {
    let native = natives(py, &[system.force.clone_ref(py)])?;
    let Some(restitution) = system.law.constant() else {
        return Err(PyValueError::new_err("e must be a number, Newton's impact law"));
    };
    ImpactMap::new(&native[0], restitution).map_err(setup_error)
}

fn parameter(name: &str) -> PyResult<MapParameter> {
    Ok(match name {
        "stiffness" => MapParameter::Stiffness,
        "damping" => MapParameter::Damping,
        "gravity" => MapParameter::Gravity,
        "amplitude" => MapParameter::Amplitude,
        "omega" => MapParameter::Omega,
        "phase" => MapParameter::Phase,
        "e" => MapParameter::Restitution,
        other => {
            return Err(PyValueError::new_err(format!(
                "parameters must be of 'stiffness', 'damping', 'gravity', 'amplitude', 'omega', \
                 'phase', 'e', got {other:?}"
            )))
        }
    })
}

fn starts_of(given: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<[f64; 2]>> {
    list(given.as_array().rows().into_iter().map(|row| [row[0], row[1]]))
}

/// Refuses a system that has no such map.
#[pyfunction]
pub(crate) fn check_impact_map(py: Python<'_>, system: PyRef<'_, PointMass>) -> PyResult<()> {
    let _running = crate::leaving::running()?;
    map_of(py, &system).map(drop)
}

type Maps<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray3<f64>>, Bound<'py, PyArray3<f64>>);

/// The next impacts of rows `phase, u`: rows `phase, u, duration`, Jacobians, and for each impact
/// and parameter the derivatives of its phase and speed.
#[pyfunction]
#[pyo3(signature = (system, starts, *, parameters, threads, progress=None))]
pub(crate) fn map_of_impacts<'py>(
    py: Python<'py>,
    system: PyRef<'py, PointMass>,
    starts: PyReadonlyArray2<'py, f64>,
    parameters: Vec<String>,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<Maps<'py>> {
    let _running = crate::leaving::running()?;
    let map = map_of(py, &system)?;
    let by = parameters.iter().map(|name| parameter(name)).collect::<PyResult<Vec<_>>>()?;
    let (starts, watch) = (starts_of(&starts)?, &mut Watch { progress });
    let all = py.detach(|| map_impacts(&map, &starts, &by, threads, watch)).map_err(refused)?;
    let n = all.len();
    let next = all.iter().flat_map(|it| [it.next.phase, it.next.u, it.next.duration]);
    let jacobian = all.iter().flat_map(|it| it.jacobian.into_iter().flatten());
    let of_parameters = all.iter().flat_map(|it| it.by.iter().flatten().copied());
    Ok((
        array(py, next)?.into_bound(py).reshape([n, 3])?,
        array(py, jacobian)?.into_bound(py).reshape([n, 2, 2])?,
        array(py, of_parameters)?.into_bound(py).reshape([n, by.len(), 2])?,
    ))
}

/// Orbits from rows `phase, u`: for each start `n` rows `phase, u`, the first after `skip` others.
/// There is a system for each start, or one for all.
#[pyfunction]
#[pyo3(signature = (systems, starts, *, skip, n, threads, progress=None))]
#[allow(clippy::too_many_arguments)]
pub(crate) fn orbits_of_impacts<'py>(
    py: Python<'py>,
    systems: Vec<PyRef<'py, PointMass>>,
    starts: PyReadonlyArray2<'py, f64>,
    skip: usize,
    n: usize,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let _running = crate::leaving::running()?;
    let maps = systems.iter().map(|it| map_of(py, it)).collect::<PyResult<Vec<_>>>()?;
    let (starts, watch) = (starts_of(&starts)?, &mut Watch { progress });
    let all = py.detach(|| orbits(&maps, &starts, (skip, n), threads, watch)).map_err(refused)?;
    let values = all.iter().flatten().flatten().copied();
    array(py, values)?.into_bound(py).reshape([all.len(), n, 2])
}
