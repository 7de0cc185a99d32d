//! Periodic motions of linear systems as impulses, from Python.

use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1, PyReadonlyArrayDyn};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use zivi::mechanics::Modes;

use crate::arrays::{list, vector, Array, Matrix};

fn flat(array: &PyReadonlyArrayDyn<'_, f64>) -> PyResult<Vec<f64>> {
    list(array.as_array().iter().copied())
}

/// The last axis of an array has real and imaginary parts.
fn pairs(array: &PyReadonlyArrayDyn<'_, f64>) -> PyResult<Vec<(f64, f64)>> {
    list(flat(array)?.chunks_exact(2).map(|it| (it[0], it[1])))
}

fn square(py: Python<'_>, values: Vec<f64>, size: usize) -> PyResult<Matrix<f64>> {
    Ok(PyArray1::from_vec(py, values).reshape([size, size])?.unbind())
}

/// The impacts of one word of a linear system, in the order of their times.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct PeriodicImpulses {
    modes: Modes,
    gaps: Vec<usize>,
}

impl PeriodicImpulses {
    fn unknowns(&self, y: &PyReadonlyArray1<'_, f64>) -> PyResult<Vec<f64>> {
        let y = vector(y)?;
        if y.len() == 2 * self.gaps.len() {
            return Ok(y);
        }
        let rows = self.gaps.len();
        Err(PyValueError::new_err(format!("y must have {rows} pairs, got {} numbers", y.len())))
    }
}

#[pymethods]
impl PeriodicImpulses {
    #[new]
    #[pyo3(signature = (gaps, *, period, rates, kernels, vectors, inputs, pushes, forced_gaps, forced_states, omegas, mobilities, e))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        gaps: Vec<usize>,
        period: f64,
        rates: PyReadonlyArrayDyn<'_, f64>,
        kernels: PyReadonlyArrayDyn<'_, f64>,
        vectors: PyReadonlyArrayDyn<'_, f64>,
        inputs: PyReadonlyArrayDyn<'_, f64>,
        pushes: PyReadonlyArrayDyn<'_, f64>,
        forced_gaps: PyReadonlyArrayDyn<'_, f64>,
        forced_states: PyReadonlyArrayDyn<'_, f64>,
        omegas: PyReadonlyArrayDyn<'_, f64>,
        mobilities: PyReadonlyArrayDyn<'_, f64>,
        e: PyReadonlyArrayDyn<'_, f64>,
    ) -> PyResult<Self> {
        let modes = Modes {
            period,
            rates: pairs(&rates)?,
            kernels: pairs(&kernels)?,
            vectors: pairs(&vectors)?,
            inputs: pairs(&inputs)?,
            pushes: flat(&pushes)?,
            forced_gaps: flat(&forced_gaps)?,
            forced_states: flat(&forced_states)?,
            omegas: flat(&omegas)?,
            mobilities: flat(&mobilities)?,
            e: flat(&e)?,
        };
        modes.check(&gaps).map_err(PyValueError::new_err)?;
        Ok(Self { modes, gaps })
    }

    /// Of each impact by how much the speed of its gap rises with its own unit impulse.
    #[getter]
    fn mobilities(&self, py: Python<'_>) -> Array {
        PyArray1::from_iter(py, self.gaps.iter().map(|&gap| self.modes.mobilities[gap])).unbind()
    }

    /// Residual, speeds before the impacts, and the Jacobian, at rows of `P, t`.
    fn equations(
        &self,
        py: Python<'_>,
        y: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<(Array, Array, Matrix<f64>)> {
        let y = self.unknowns(&y)?;
        let it = self.modes.equations(&self.gaps, &y);
        let [residual, rates] = [it.residual, it.rates].map(|v| PyArray1::from_vec(py, v).unbind());
        Ok((residual, rates, square(py, it.matrix, y.len())?))
    }

    /// The parts `R` and `S` of the Jacobian of disturbances with `kappa = cos th`.
    fn turned(
        &self,
        py: Python<'_>,
        y: PyReadonlyArray1<'_, f64>,
        kappa: f64,
    ) -> PyResult<(Matrix<f64>, Matrix<f64>)> {
        let y = self.unknowns(&y)?;
        let [real, sine] = self.modes.turned(&self.gaps, &y, kappa);
        Ok((square(py, real, y.len())?, square(py, sine, y.len())?))
    }

    /// The gradients of `w R v` and `w S v` by the unknowns.
    fn curvature(
        &self,
        py: Python<'_>,
        y: PyReadonlyArray1<'_, f64>,
        kappa: f64,
        w: PyReadonlyArray1<'_, f64>,
        v: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<(Array, Array)> {
        let [y, w, v] = [self.unknowns(&y)?, self.unknowns(&w)?, self.unknowns(&v)?];
        let [real, sine] = self
            .modes
            .curvature(&self.gaps, &y, kappa, (&w, &v))
            .map(|it| PyArray1::from_vec(py, it).unbind());
        Ok((real, sine))
    }

    /// The states after the impacts, a row each.
    fn states(&self, py: Python<'_>, y: PyReadonlyArray1<'_, f64>) -> PyResult<Matrix<f64>> {
        let found = self.modes.states(&self.gaps, &self.unknowns(&y)?);
        let width = found.len() / self.gaps.len();
        Ok(PyArray1::from_vec(py, found).reshape([self.gaps.len(), width])?.unbind())
    }
}
