//! Box VIs from Python. The lock is held while `F` is a Python callable, released otherwise.

mod callbacks;
mod games;
mod interrupts;
mod scale;
mod settings;

use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pulp::{Simd, WithSimd};
use pyo3::exceptions::{PyMemoryError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use zivi::numeric::lu::ByBlocks;
use zivi_core::vi::{
    self, Affine, Differenced, InvalidInput, Problem, Report, Scheme, Settings, Status, Workspace,
};

use crate::arrays::{list, vector, zeros};
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

/// Memory of a solve of `n` unknowns, which grows with `n^2`.
fn workspace_of(n: usize) -> PyResult<(Vec<f64>, Vec<usize>)> {
    // beyond all numbers where it overflows
    let (reals, indices) = if n < 1 << 24 { vi::workspace_len(n) } else { (usize::MAX, n) };
    let found = zeros(reals).and_then(|reals| Ok((reals, list(std::iter::repeat_n(0, indices))?)));
    found.map_err(|_| {
        PyMemoryError::new_err(format!(
            "n must be small enough for dense matrices, got {n} unknowns, whose {:.1} GB do not fit \
             into memory; give a sparse matrix, or a jac that returns one (scipy.sparse)",
            reals as f64 * 8e-9
        ))
    })
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
    fn to_vec(&self, n: usize) -> PyResult<Vec<f64>> {
        match self {
            Self::Common(value) => list(std::iter::repeat_n(*value, n)),
            Self::Each(values) => vector(values),
        }
    }
}

impl Vectors {
    fn new(
        lower: &Bound1<'_>,
        upper: &Bound1<'_>,
        x0: &PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Self> {
        let z = vector(x0)?;
        Ok(Self { lower: lower.to_vec(z.len())?, upper: upper.to_vec(z.len())?, z })
    }

    /// Solves in memory of its own; `F` at the end comes with the report.
    fn solve(
        &mut self,
        problem: &mut dyn Problem,
        settings: &Settings<'_>,
    ) -> PyResult<(Report, Vec<f64>)> {
        let n = self.z.len();
        vi::validate_bounds(n, &self.lower, &self.upper).map_err(invalid)?;
        let (mut reals, mut indices) = workspace_of(n)?;
        let mut f = zeros(n)?;
        let work = Workspace::new(n, &mut reals, &mut indices).ok_or(InvalidInput::Workspace);
        let mut work = work.map_err(invalid)?;
        let bounds = (&self.lower[..], &self.upper[..]);
        let problem = &mut ByBlocks(problem);
        let report = vi::solve(problem, bounds, &mut self.z, settings, &mut work);
        f.copy_from_slice(work.map());
        Ok((report.map_err(invalid)?, f))
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
    let mut vectors = Vectors::new(&lower, &upper, &x0)?;
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
            let n = vectors.z.len();
            let (lower, upper) = (lower.to_vec(n)?, upper.to_vec(n)?);
            let mut work = zeros(4 * n)?;
            let map = |z: &[f64], out: &mut [f64]| callbacks.map(z, out);
            Differenced::new(map, &lower, &upper, &mut work)
                .ok_or_else(|| invalid(InvalidInput::Workspace))
                .map(|it| it.with_scheme(scheme).with_rounding(&callbacks.rounding))
                .and_then(|problem| {
                    vectors.solve(&mut Watched::new(problem, &callbacks, &interrupts), &given.get())
                })
        }
    };
    if let Some(error) = callbacks.raised.take().or_else(|| interrupts.raised()) {
        return Err(error);
    }
    let end = solved?;
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
    let z = x0.map_or_else(|| zeros(n), |x0| vector(&x0))?;
    let mut vectors = Vectors { lower: lower.to_vec(n)?, upper: upper.to_vec(n)?, z };
    let given = GivenSettings::from_dict(settings)?;
    let interrupts = Interrupts::new(time_limit, observe);
    let affine = Affine { matrix, q };
    let mut problem = Interruptible { affine, interrupts };
    let solved = py.detach(|| vectors.solve(&mut problem, &given.get()));
    if let Some(error) = problem.interrupts.raised() {
        return Err(error);
    }
    let end = solved?;
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
    let vectors = Vectors::new(&lower, &upper, &x)?;
    vi::validate_bounds(vectors.z.len(), &vectors.lower, &vectors.upper).map_err(invalid)?;
    let f = vector(&f)?;
    Ok(vi::natural_residual(&vectors.z, &f, &vectors.lower, &vectors.upper))
}
