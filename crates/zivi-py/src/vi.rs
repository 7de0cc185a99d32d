//! Box VIs from Python. The lock is held while `F` is a Python callable, released otherwise.

use std::cell::{Cell, RefCell};

use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use zivi_core::vi::{
    self, Affine, Differenced, EvaluationError, InvalidInput, Problem, Report, RowScale, Settings,
    Start, Workspace,
};

/// The outcome of one solve.
#[pyclass(frozen, get_all, module = "zivi._zivi")]
pub(crate) struct ViRecord {
    x: Py<PyArray1<f64>>,
    f: Py<PyArray1<f64>>,
    residual: f64,
    scaled_residual: f64,
    tolerance: f64,
    status: u8,
    message: &'static str,
    stage: &'static str,
    n_iter: usize,
    nfev: usize,
    njev: usize,
    n_pivots: usize,
    n_semismooth_steps: usize,
    n_gradient_steps: usize,
    n_restarts: usize,
    size: f64,
    convergence_ratio: f64,
    projected: bool,
}

fn invalid(error: InvalidInput) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// Vectors of one solve, owned here.
struct Vectors {
    lower: Vec<f64>,
    upper: Vec<f64>,
    z: Vec<f64>,
}

impl Vectors {
    fn new(
        lower: &PyReadonlyArray1<'_, f64>,
        upper: &PyReadonlyArray1<'_, f64>,
        x0: &PyReadonlyArray1<'_, f64>,
    ) -> Self {
        let vector = |array: &PyReadonlyArray1<'_, f64>| array.as_array().to_vec();
        Self { lower: vector(lower), upper: vector(upper), z: vector(x0) }
    }

    /// Solves in memory of its own; `F` at the end comes with the report.
    fn solve(
        &mut self,
        problem: &mut dyn Problem,
        settings: &Settings<'_>,
    ) -> Result<(Report, Vec<f64>), InvalidInput> {
        let n = self.z.len();
        vi::validate_bounds(n, &self.lower, &self.upper)?;
        let (reals, indices) = vi::workspace_len(n);
        let (mut reals, mut indices) = (vec![0.0; reals], vec![0; indices]);
        let mut work =
            Workspace::new(n, &mut reals, &mut indices).ok_or(InvalidInput::Workspace)?;
        let bounds = (&self.lower[..], &self.upper[..]);
        let report = vi::solve(problem, bounds, &mut self.z, settings, &mut work)?;
        Ok((report, work.map().to_vec()))
    }

    fn record(self, py: Python<'_>, report: Report, f: Vec<f64>, nfev: usize) -> ViRecord {
        ViRecord {
            x: PyArray1::from_vec(py, self.z).unbind(),
            f: PyArray1::from_vec(py, f).unbind(),
            residual: report.residual,
            scaled_residual: report.scaled_residual,
            tolerance: report.tolerance,
            status: report.status as u8,
            message: report.status.message(),
            stage: report.stage.name(),
            n_iter: report.counts.iterations,
            nfev,
            njev: report.counts.jacobian,
            n_pivots: report.counts.pivots,
            n_semismooth_steps: report.counts.semismooth_steps,
            n_gradient_steps: report.counts.gradient_steps,
            n_restarts: report.counts.restarts,
            size: report.size,
            convergence_ratio: report.convergence_ratio,
            projected: report.projected,
        }
    }
}

/// Settings as Python hands them over: a dictionary of those that differ from the default.
struct GivenSettings {
    settings: Settings<'static>,
    row_scale: Option<Vec<f64>>,
}

impl GivenSettings {
    fn from_dict(given: &Bound<'_, PyDict>) -> PyResult<Self> {
        let mut settings = Settings::default();
        let mut row_scale = None;
        for (key, value) in given {
            let key: String = key.extract()?;
            match key.as_str() {
                "tol" => settings.tol = value.extract()?,
                "max_iterations" => settings.max_iterations = value.extract()?,
                "stage_iterations" => settings.stage_iterations = value.extract()?,
                "max_pivots" => settings.max_pivots = value.extract()?,
                "total_pivots" => settings.total_pivots = value.extract()?,
                "line_search" => settings.line_search = value.extract()?,
                "memory" => settings.memory = value.extract()?,
                "descent_steps" => settings.descent_steps = value.extract()?,
                "ray_start_first" => {
                    settings.first_start =
                        if value.extract()? { Start::Ray } else { Start::Regular };
                }
                "josephy_newton" => settings.josephy_newton = value.extract()?,
                "semismooth" => settings.semismooth = value.extract()?,
                "proximal" => settings.proximal = value.extract()?,
                "restarts" => settings.restarts = value.extract()?,
                "enumerate_up_to" => settings.enumerate_up_to = value.extract()?,
                "test_isolation" => settings.test_isolation = value.extract()?,
                "scale_by_jacobian" => settings.row_scale = RowScale::Jacobian,
                "row_scale" => {
                    let scale: PyReadonlyArray1<'_, f64> = value.extract()?;
                    row_scale = Some(scale.as_array().to_vec());
                }
                _ => return Err(PyTypeError::new_err(format!("unknown setting {key:?}"))),
            }
        }
        Ok(Self { settings, row_scale })
    }

    fn get(&self) -> Settings<'_> {
        match &self.row_scale {
            Some(scale) => Settings { row_scale: RowScale::Given(scale), ..self.settings },
            None => self.settings,
        }
    }
}

/// Calls Python; what it raises is kept for the caller and stops the solver.
struct Callbacks<'py> {
    py: Python<'py>,
    raised: RefCell<Option<PyErr>>,
    nfev: Cell<usize>,
}

impl<'py> Callbacks<'py> {
    fn keep<T>(&self, result: PyResult<T>) -> Result<T, EvaluationError> {
        result.map_err(|error| {
            self.raised.replace(Some(error));
            EvaluationError
        })
    }

    fn map(
        &self,
        f: &Bound<'py, PyAny>,
        z: &[f64],
        out: &mut [f64],
    ) -> Result<(), EvaluationError> {
        self.nfev.set(self.nfev.get() + 1);
        self.keep((|| {
            let value = f.call1((PyArray1::from_slice(self.py, z),))?;
            let value: PyReadonlyArray1<'_, f64> = value.extract()?;
            out.copy_from_slice(value.as_slice()?);
            Ok(())
        })())
    }

    fn jacobian(
        &self,
        jac: &Bound<'py, PyAny>,
        z: &[f64],
        out: &mut [f64],
    ) -> Result<(), EvaluationError> {
        self.keep((|| {
            let value = jac.call1((PyArray1::from_slice(self.py, z),))?;
            let value: PyReadonlyArray2<'_, f64> = value.extract()?;
            out.copy_from_slice(value.as_slice()?);
            Ok(())
        })())
    }
}

/// `F` and its Jacobian, both from Python.
struct WithJacobian<'a, 'py> {
    callbacks: &'a Callbacks<'py>,
    f: Bound<'py, PyAny>,
    jac: Bound<'py, PyAny>,
}

impl Problem for WithJacobian<'_, '_> {
    fn map(&mut self, z: &[f64], f: &mut [f64]) -> Result<(), EvaluationError> {
        self.callbacks.map(&self.f, z, f)
    }

    fn jacobian(&mut self, z: &[f64], jacobian: &mut [f64]) -> Result<(), EvaluationError> {
        self.callbacks.jacobian(&self.jac, z, jacobian)
    }
}

/// A problem with callbacks, and an eye on the signals between them.
struct Watched<'a, 'py, P> {
    problem: P,
    callbacks: &'a Callbacks<'py>,
}

impl<P: Problem> Problem for Watched<'_, '_, P> {
    fn map(&mut self, z: &[f64], f: &mut [f64]) -> Result<(), EvaluationError> {
        self.problem.map(z, f)
    }

    fn jacobian(&mut self, z: &[f64], jacobian: &mut [f64]) -> Result<(), EvaluationError> {
        self.problem.jacobian(z, jacobian)
    }

    fn poll(&mut self) -> Result<(), EvaluationError> {
        self.callbacks.keep(self.callbacks.py.check_signals())
    }
}

/// An affine problem, solved without the lock but for a look at the signals.
struct Interruptible<'a> {
    affine: Affine<'a>,
    raised: Option<PyErr>,
}

impl Problem for Interruptible<'_> {
    fn map(&mut self, z: &[f64], f: &mut [f64]) -> Result<(), EvaluationError> {
        self.affine.map(z, f)
    }

    fn jacobian(&mut self, z: &[f64], jacobian: &mut [f64]) -> Result<(), EvaluationError> {
        self.affine.jacobian(z, jacobian)
    }

    fn poll(&mut self) -> Result<(), EvaluationError> {
        Python::attach(|py| py.check_signals()).map_err(|error| {
            self.raised = Some(error);
            EvaluationError
        })
    }
}

/// Solves a box VI. `f` and `jac` map an array to a contiguous float64 array of the right shape.
#[pyfunction]
#[pyo3(signature = (f, lower, upper, x0, jac, settings))]
pub(crate) fn solve_vi<'py>(
    py: Python<'py>,
    f: Bound<'py, PyAny>,
    lower: PyReadonlyArray1<'py, f64>,
    upper: PyReadonlyArray1<'py, f64>,
    x0: PyReadonlyArray1<'py, f64>,
    jac: Option<Bound<'py, PyAny>>,
    settings: &Bound<'py, PyDict>,
) -> PyResult<ViRecord> {
    let mut vectors = Vectors::new(&lower, &upper, &x0);
    let given = GivenSettings::from_dict(settings)?;
    let callbacks = Callbacks { py, raised: RefCell::new(None), nfev: Cell::new(0) };
    let solved = match jac {
        Some(jac) => {
            let problem = WithJacobian { callbacks: &callbacks, f, jac };
            vectors.solve(&mut Watched { problem, callbacks: &callbacks }, &given.get())
        }
        None => {
            let (lower, upper) = (vectors.lower.clone(), vectors.upper.clone());
            let mut work = vec![0.0; 4 * lower.len()];
            let map = |z: &[f64], out: &mut [f64]| callbacks.map(&f, z, out);
            Differenced::new(map, &lower, &upper, &mut work)
                .ok_or(InvalidInput::Workspace)
                .and_then(|problem| {
                    vectors.solve(&mut Watched { problem, callbacks: &callbacks }, &given.get())
                })
        }
    };
    if let Some(error) = callbacks.raised.take() {
        return Err(error);
    }
    let (report, at_end) = solved.map_err(invalid)?;
    Ok(vectors.record(py, report, at_end, callbacks.nfev.get()))
}

/// Solves the affine VI with `F(x) = matrix x + q`.
#[pyfunction]
#[pyo3(signature = (matrix, q, lower, upper, x0, settings))]
pub(crate) fn solve_avi<'py>(
    py: Python<'py>,
    matrix: PyReadonlyArray2<'py, f64>,
    q: PyReadonlyArray1<'py, f64>,
    lower: PyReadonlyArray1<'py, f64>,
    upper: PyReadonlyArray1<'py, f64>,
    x0: PyReadonlyArray1<'py, f64>,
    settings: &Bound<'py, PyDict>,
) -> PyResult<ViRecord> {
    let mut vectors = Vectors::new(&lower, &upper, &x0);
    let given = GivenSettings::from_dict(settings)?;
    let (matrix, q) = (matrix.as_slice()?.to_vec(), q.as_array().to_vec());
    let affine = Affine { matrix: &matrix, q: &q };
    let mut problem = Interruptible { affine, raised: None };
    let solved = py.detach(|| vectors.solve(&mut problem, &given.get()));
    if let Some(error) = problem.raised {
        return Err(error);
    }
    let (report, at_end) = solved.map_err(invalid)?;
    let nfev = report.counts.f;
    Ok(vectors.record(py, report, at_end, nfev))
}

/// The natural residual of `x`, given `F(x)`.
#[pyfunction]
pub(crate) fn natural_residual<'py>(
    x: PyReadonlyArray1<'py, f64>,
    f: PyReadonlyArray1<'py, f64>,
    lower: PyReadonlyArray1<'py, f64>,
    upper: PyReadonlyArray1<'py, f64>,
) -> PyResult<f64> {
    let vectors = Vectors::new(&lower, &upper, &x);
    vi::validate_bounds(vectors.z.len(), &vectors.lower, &vectors.upper).map_err(invalid)?;
    let f = f.as_array().to_vec();
    Ok(vi::natural_residual(&vectors.z, &f, &vectors.lower, &vectors.upper))
}
