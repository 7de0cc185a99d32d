//! Box VIs from Python. The lock is held while `F` is a Python callable, released otherwise.

mod callbacks;
mod games;
mod interrupts;
mod scale;
mod settings;

use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pulp::{Simd, WithSimd};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use zivi::numeric::lu::ByBlocks;
use zivi_core::vi::{
    self, Affine, Differenced, InvalidInput, Problem, Report, Scheme, Settings, Status, Workspace,
};

use callbacks::{Callbacks, Watched, WithJacobian};
pub(crate) use games::lemke_howson;
use interrupts::{Interruptible, Interrupts};
pub(crate) use scale::is_off_scale;
use settings::GivenSettings;

/// Code of a solve that its time limit ended; those of the solver itself are smaller.
const TIME_LIMIT: u8 = 10;

/// The outcome of one solve.
#[pyclass(frozen, get_all, module = "zivi._zivi")]
pub(crate) struct ViRecord {
    x: Py<PyArray1<f64>>,
    f: Py<PyArray1<f64>>,
    residual: f64,
    scaled_residual: f64,
    tolerance: f64,
    status: u8,
    message: String,
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

/// A bound as Python hands it over: one number for all components, or one for each.
#[derive(FromPyObject)]
pub(crate) enum Bound1<'py> {
    Common(f64),
    Each(PyReadonlyArray1<'py, f64>),
}

impl Bound1<'_> {
    fn to_vec(&self, n: usize) -> Vec<f64> {
        match self {
            Self::Common(value) => vec![*value; n],
            Self::Each(values) => values.as_array().to_vec(),
        }
    }
}

impl Vectors {
    fn new(lower: &Bound1<'_>, upper: &Bound1<'_>, x0: &PyReadonlyArray1<'_, f64>) -> Self {
        let z = x0.as_array().to_vec();
        Self { lower: lower.to_vec(z.len()), upper: upper.to_vec(z.len()), z }
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
        let problem = &mut ByBlocks(problem);
        let report = vi::solve(problem, bounds, &mut self.z, settings, &mut work)?;
        Ok((report, work.map().to_vec()))
    }

    fn record(
        self,
        py: Python<'_>,
        (report, f): (Report, Vec<f64>),
        nfev: usize,
        interrupts: &Interrupts,
    ) -> ViRecord {
        let timed_out = report.status == Status::Stopped && interrupts.timed_out();
        ViRecord {
            x: PyArray1::from_vec(py, self.z).unbind(),
            f: PyArray1::from_vec(py, f).unbind(),
            residual: report.residual,
            scaled_residual: report.scaled_residual,
            tolerance: report.tolerance,
            status: if timed_out { TIME_LIMIT } else { report.status as u8 },
            message: match timed_out {
                true => "the time limit was reached: allow more time or start nearer".to_owned(),
                false => report.status.message().to_owned(),
            },
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

/// Solves a box VI. `jac` is a callable or `"2-point"` or `"3-point"` for differences; `convert`
/// makes arrays of what `f` and `jac` return where that is not a float64 array of the right shape.
#[pyfunction]
#[pyo3(signature = (f, lower, upper, x0, jac, convert, settings, time_limit=None, observe=None))]
#[allow(clippy::too_many_arguments)]
pub(crate) fn solve_vi<'py>(
    py: Python<'py>,
    f: Bound<'py, PyAny>,
    lower: Bound1<'py>,
    upper: Bound1<'py>,
    x0: PyReadonlyArray1<'py, f64>,
    jac: Bound<'py, PyAny>,
    convert: (Bound<'py, PyAny>, Bound<'py, PyAny>),
    settings: &Bound<'py, PyDict>,
    time_limit: Option<f64>,
    observe: Option<Py<PyAny>>,
) -> PyResult<ViRecord> {
    let _running = crate::leaving::running()?;
    let mut vectors = Vectors::new(&lower, &upper, &x0);
    let given = GivenSettings::from_dict(settings)?;
    let interrupts = Interrupts::new(time_limit, observe);
    let callbacks = Callbacks::new(py, f, convert);
    let scheme = match jac.extract::<&str>() {
        Ok("2-point") => Some(Scheme::TwoPoint),
        Ok(_) => Some(Scheme::ThreePoint),
        Err(_) => None,
    };
    let solved = match scheme {
        None => {
            let problem = WithJacobian::new(&callbacks, jac);
            vectors.solve(&mut Watched::new(problem, &callbacks, &interrupts), &given.get())
        }
        Some(scheme) => {
            let (lower, upper) = (vectors.lower.clone(), vectors.upper.clone());
            let mut work = vec![0.0; 4 * lower.len()];
            let map = |z: &[f64], out: &mut [f64]| callbacks.map(z, out);
            Differenced::new(map, &lower, &upper, &mut work)
                .ok_or(InvalidInput::Workspace)
                .map(|it| it.with_scheme(scheme).with_rounding(&callbacks.rounding))
                .and_then(|problem| {
                    vectors.solve(&mut Watched::new(problem, &callbacks, &interrupts), &given.get())
                })
        }
    };
    if let Some(error) = callbacks.raised.take().or_else(|| interrupts.raised()) {
        return Err(error);
    }
    let end = solved.map_err(invalid)?;
    let mut record = vectors.record(py, end, callbacks.nfev.get(), &interrupts);
    record.message.push_str(&callbacks.undefined());
    Ok(record)
}

/// Whether all are numbers: looked at several at once, as a search for the first that is none
/// cannot be.
fn are_finite(values: &[f64]) -> bool {
    pulp::Arch::new().dispatch(AreFinite(values))
}

struct AreFinite<'a>(&'a [f64]);

impl WithSimd for AreFinite<'_> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> bool {
        const MANY: usize = 64;
        self.0.chunks(MANY).all(|some| some.iter().fold(true, |all, it| all & it.is_finite()))
    }
}

/// Solves the affine VI with `F(x) = matrix x + q`.
#[pyfunction]
#[pyo3(signature = (matrix, q, lower, upper, x0, settings, time_limit=None, observe=None))]
#[allow(clippy::too_many_arguments)]
pub(crate) fn solve_avi<'py>(
    py: Python<'py>,
    matrix: PyReadonlyArray2<'py, f64>,
    q: PyReadonlyArray1<'py, f64>,
    lower: Bound1<'py>,
    upper: Bound1<'py>,
    x0: Option<PyReadonlyArray1<'py, f64>>,
    settings: &Bound<'py, PyDict>,
    time_limit: Option<f64>,
    observe: Option<Py<PyAny>>,
) -> PyResult<ViRecord> {
    let _running = crate::leaving::running()?;
    // the Python layer has made copies: nobody else writes into them
    let (matrix, q) = (matrix.as_slice()?, q.as_slice()?);
    let n = q.len();
    if !are_finite(matrix) {
        let k = matrix.iter().position(|entry| !entry.is_finite()).unwrap_or(0);
        let (i, j, entry) = (k / n, k % n, matrix[k]);
        return Err(PyValueError::new_err(format!("M[{i}, {j}] must be finite, got {entry}")));
    }
    if let Some(i) = q.iter().position(|entry| !entry.is_finite()) {
        return Err(PyValueError::new_err(format!("q[{i}] must be finite, got {}", q[i])));
    }
    let z = x0.map_or_else(|| vec![0.0; n], |x0| x0.as_array().to_vec());
    let mut vectors = Vectors { lower: lower.to_vec(n), upper: upper.to_vec(n), z };
    let given = GivenSettings::from_dict(settings)?;
    let interrupts = Interrupts::new(time_limit, observe);
    let affine = Affine { matrix, q };
    let mut problem = Interruptible { affine, interrupts };
    let solved = py.detach(|| vectors.solve(&mut problem, &given.get()));
    if let Some(error) = problem.interrupts.raised() {
        return Err(error);
    }
    let end = solved.map_err(invalid)?;
    let nfev = end.0.counts.f;
    Ok(vectors.record(py, end, nfev, &problem.interrupts))
}

/// The natural residual of `x`, given `F(x)`.
#[pyfunction]
pub(crate) fn natural_residual<'py>(
    x: PyReadonlyArray1<'py, f64>,
    f: PyReadonlyArray1<'py, f64>,
    lower: Bound1<'py>,
    upper: Bound1<'py>,
) -> PyResult<f64> {
    let _running = crate::leaving::running()?;
    let vectors = Vectors::new(&lower, &upper, &x);
    vi::validate_bounds(vectors.z.len(), &vectors.lower, &vectors.upper).map_err(invalid)?;
    let f = f.as_array().to_vec();
    Ok(vi::natural_residual(&vectors.z, &f, &vectors.lower, &vectors.upper))
}
