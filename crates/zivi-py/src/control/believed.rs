//! A plant as controllers of mechanical systems believe it to be, and what they make of a state of it.

use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::gc::{PyTraverseError, PyVisit};
use pyo3::prelude::*;
use zivi::drive::mechanical::{self as law, BelievedPlant, GapKinetics, LawError, Tasks};
use zivi::system::dynamics::Layout;

use crate::arrays::{vector, Array};
use crate::dynamics::AnyDynamics;
use crate::errors::setup_error;
use crate::friction::Rubbing;
use crate::inputs::{Inputs, Matrices};
use crate::system::Mechanism;

/// What a law that gives no controls raises.
pub(crate) fn law_error(error: LawError<PyErr>) -> PyErr {
    match error {
        LawError::Setup(error) => setup_error(error),
        error => error.raised().unwrap_or_else(PyValueError::new_err),
    }
}

/// A system with its controls as a controller believes in it.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct Believed {
    pub(crate) mechanism: Py<Mechanism>,
    pub(crate) inputs: Py<Inputs>,
    /// The system whose gaps are functions of the coordinates that may follow a reference.
    pub(crate) tasks: Option<Py<Mechanism>>,
    /// Length of a period (s).
    pub(crate) h: f64,
}

impl Believed {
    /// Runs something with the plant.
    pub(super) fn with<R>(
        &self,
        py: Python<'_>,
        run: impl FnOnce(&mut BelievedPlant<'_, Rubbing<'_, AnyDynamics<'_>>, Matrices<'_>>) -> R,
    ) -> PyResult<R> {
        let (mechanism, inputs) = (self.mechanism.get(), self.inputs.get());
        let mut driven = inputs.driven(py, mechanism)?;
        let mut tasks = self.tasks.as_ref().map(|it| Tasks::new::<PyErr>(it.get().rubbing(py)));
        Ok(run(&mut BelievedPlant {
            driven: &mut driven,
            tasks: tasks.as_mut(),
            laws: &mechanism.laws,
            h: self.h,
        }))
    }
}

/// Coordinates, velocities and contacts.
type Moved = (Array, Array, Vec<bool>);

#[pymethods]
impl Believed {
    #[new]
    #[pyo3(signature = (mechanism, inputs, h, tasks=None))]
    fn new(
        mechanism: Py<Mechanism>,
        inputs: Py<Inputs>,
        h: f64,
        tasks: Option<Py<Mechanism>>,
    ) -> Self {
        Self { mechanism, inputs, tasks, h }
    }

    /// Coordinates, velocities and contacts after as many periods as there are controls.
    fn moved(
        &self,
        py: Python<'_>,
        t: f64,
        q: PyReadonlyArray1<'_, f64>,
        qdot: PyReadonlyArray1<'_, f64>,
        controls: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<Moved> {
        let (q, w) = (vector(&q)?, vector(&qdot)?);
        let controls: Vec<f64> = controls.as_array().iter().copied().collect();
        let moved = self.with(py, |plant| plant.moved(t, (&q, &w), &controls))?;
        let law::Moved { q, w, closed, .. } = moved.map_err(law_error)?;
        Ok((PyArray1::from_vec(py, q).unbind(), PyArray1::from_vec(py, w).unbind(), closed))
    }

    /// Coordinates and velocities, M-orthogonally moved to where contacts are closed and no gap is
    /// below 0.
    fn onto(
        &self,
        py: Python<'_>,
        t: f64,
        q: PyReadonlyArray1<'_, f64>,
        qdot: PyReadonlyArray1<'_, f64>,
        closed: PyReadonlyArray1<'_, bool>,
    ) -> PyResult<(Array, Array)> {
        let (mut q, mut w) = (vector(&q)?, vector(&qdot)?);
        let closed: Vec<bool> = closed.as_array().iter().copied().collect();
        let done = self.with(py, |plant| {
            let mut kinetics = GapKinetics::new(plant.layout::<PyErr>());
            plant.onto(t, (&mut q, &mut w), &closed, &mut kinetics)
        })?;
        done.map_err(law_error)?;
        Ok((PyArray1::from_vec(py, q).unbind(), PyArray1::from_vec(py, w).unbind()))
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        visit.call(&self.mechanism)?;
        visit.call(&self.inputs)?;
        self.tasks.as_ref().map_or(Ok(()), |it| visit.call(it))
    }
}

/// The controls that make accelerations of the gaps and, as far as they can, of the rest; whether
/// limits act, and the least singular value of `W^-1/2 N M^-1 B` where it was computed.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub(crate) fn controls<'py>(
    py: Python<'py>,
    mass: PyReadonlyArray2<'_, f64>,
    force: PyReadonlyArray1<'_, f64>,
    gradients: PyReadonlyArray2<'_, f64>,
    curvatures: PyReadonlyArray1<'_, f64>,
    matrix: PyReadonlyArray2<'_, f64>,
    a: PyReadonlyArray1<'_, f64>,
    wanted: PyReadonlyArray1<'_, f64>,
    limits: Option<Vec<(f64, f64)>>,
) -> PyResult<(Bound<'py, PyArray1<f64>>, bool, Option<f64>)> {
    let (n, m) = (force.as_array().len(), a.as_array().len());
    let mut kinetics = kinetics_of((n, m), &mass, &force, &gradients, &curvatures)?;
    let matrix = matrix.as_array();
    let mut u = vec![0.0; matrix.ncols()];
    let matrix: Vec<f64> = matrix.iter().copied().collect();
    let (a, wanted) = (vector(&a)?, vector(&wanted)?);
    if matrix.len() != n * u.len() || wanted.len() != n {
        return Err(PyValueError::new_err("the parts do not fit together"));
    }
    let found = law::controls(&mut kinetics, &matrix, &a, &wanted, limits.as_deref(), &mut u);
    let found = found.map_err(law_error)?;
    Ok((PyArray1::from_vec(py, u), found.limited, found.least))
}

/// The force that makes accelerations of the gaps and of the rest, without contacts.
#[pyfunction]
pub(crate) fn decoupling_force<'py>(
    py: Python<'py>,
    mass: PyReadonlyArray2<'_, f64>,
    gradients: PyReadonlyArray2<'_, f64>,
    curvatures: PyReadonlyArray1<'_, f64>,
    a: PyReadonlyArray1<'_, f64>,
    wanted: PyReadonlyArray1<'_, f64>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let (n, m) = (wanted.as_array().len(), a.as_array().len());
    let kinetics = kinetics_of((n, m), &mass, &wanted, &gradients, &curvatures)?;
    let force = law::decoupling_force(&kinetics, &vector(&a)?, &vector(&wanted)?);
    Ok(PyArray1::from_vec(py, force))
}

fn kinetics_of(
    (n, m): (usize, usize),
    mass: &PyReadonlyArray2<'_, f64>,
    force: &PyReadonlyArray1<'_, f64>,
    gradients: &PyReadonlyArray2<'_, f64>,
    curvatures: &PyReadonlyArray1<'_, f64>,
) -> PyResult<GapKinetics> {
    let layout = Layout::smooth(n, m);
    let mut row: Vec<f64> = mass.as_array().iter().copied().collect();
    row.extend(vector(force)?);
    row.extend(vec![0.0; m]);
    row.extend(gradients.as_array().iter());
    row.extend(vector(curvatures)?);
    row.extend(vec![0.0; m]);
    if row.len() != layout.len() {
        return Err(PyValueError::new_err("the parts do not fit together"));
    }
    GapKinetics::of(layout, &row, &vec![0.0; n]).map_err(law_error)
}
