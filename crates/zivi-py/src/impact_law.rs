//! Impact laws from Python.

use numpy::PyReadonlyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use zivi::AnyImpactLaw;

use crate::arrays::{array, Array};
use crate::errors::setup_error;
use crate::method::Setting;
use crate::transform::from_both;

/// An impact law.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct ImpactLaw {
    pub(crate) inner: AnyImpactLaw,
}

#[pymethods]
impl ImpactLaw {
    /// By its name, with the values of its parameters in their order.
    #[new]
    fn new(name: &str, values: Vec<f64>) -> PyResult<Self> {
        match AnyImpactLaw::named(name, &values) {
            Some(law) => Ok(Self { inner: law.map_err(|error| setup_error(error.into()))? }),
            None => Err(PyValueError::new_err(format!("there is no impact law {name:?}"))),
        }
    }

    /// Newton's, from both coefficients, which must be each other's image.
    #[staticmethod]
    fn newton(e: f64, kappa: f64) -> PyResult<Self> {
        Ok(Self { inner: from_both(e, kappa)?.into() })
    }

    /// Speeds after impacts at speeds.
    fn after<'py>(&self, py: Python<'py>, v: PyReadonlyArray1<'py, f64>) -> PyResult<Array> {
        array(py, v.as_array().iter().map(|&v| self.inner.after(v)))
    }

    /// Their derivatives by the speeds before.
    fn slope<'py>(&self, py: Python<'py>, v: PyReadonlyArray1<'py, f64>) -> PyResult<Array> {
        array(py, v.as_array().iter().map(|&v| self.inner.slope(v)))
    }

    /// The coefficient in the limit of slow impacts.
    #[getter]
    fn limit(&self) -> Option<f64> {
        self.inner.limit()
    }
}

/// The parameters of every law, by its name.
pub(crate) fn all_laws(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let all = PyDict::new(py);
    for &(name, parameters) in AnyImpactLaw::ALL {
        let of = parameters.iter().map(|it| Setting::new(py, it)).collect::<PyResult<Vec<_>>>()?;
        all.set_item(name, of)?;
    }
    Ok(all)
}
