//! The settings of a solve, from Python.

use crate::arrays::vector;
use numpy::PyReadonlyArray1;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use zivi_core::vi::{RowScale, Settings, Start};

/// Settings as Python hands them over: a dictionary of those that differ from the default.
pub(super) struct GivenSettings {
    settings: Settings<'static>,
    row_scale: Option<Vec<f64>>,
}

impl GivenSettings {
    pub(super) fn from_dict(given: &Bound<'_, PyDict>) -> PyResult<Self> {
        let mut settings = Settings::default();
        let mut row_scale = None;
        for (key, value) in given {
            let key: String = key.extract()?;
            match key.as_str() {
                "tol" => settings.tol = value.extract()?,
                "rtol" => settings.rtol = value.extract()?,
                "max_iterations" => settings.max_iterations = value.extract()?,
                "stage_iterations" => settings.stage_iterations = value.extract()?,
                "max_pivots" => settings.max_pivots = value.extract()?,
                "total_pivots" => settings.total_pivots = value.extract()?,
                "line_search" => settings.line_search = value.extract()?,
                "memory" => settings.memory = value.extract()?,
                "descent_steps" => settings.descent_steps = value.extract()?,
                "active_set" => settings.active_set = value.extract()?,
                "ray_start_first" => {
                    settings.first_start =
                        if value.extract()? { Start::Ray } else { Start::Regular };
                }
                "josephy_newton" => settings.josephy_newton = value.extract()?,
                "smoothing" => settings.smoothing = value.extract()?,
                "semismooth" => settings.semismooth = value.extract()?,
                "proximal" => settings.proximal = value.extract()?,
                "restarts" => settings.restarts = value.extract()?,
                "enumerate_up_to" => settings.enumerate_up_to = value.extract()?,
                "test_isolation" => settings.test_isolation = value.extract()?,
                "scale_by_jacobian" => settings.row_scale = RowScale::Jacobian,
                "row_scale" => {
                    let scale: PyReadonlyArray1<'_, f64> = value.extract()?;
                    row_scale = Some(vector(&scale)?);
                }
                _ => return Err(PyTypeError::new_err(format!("unknown setting {key:?}"))),
            }
        }
        Ok(Self { settings, row_scale })
    }

    pub(super) fn get(&self) -> Settings<'_> {
        match &self.row_scale {
            Some(scale) => Settings { row_scale: RowScale::Given(scale), ..self.settings },
            None => self.settings,
        }
    }
}
