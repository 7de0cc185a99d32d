//! Box VIs from Python. The lock is held while `F` is a Python callable, released otherwise.

mod callbacks;

use callbacks::{Callbacks, Interruptible, Interrupts, MapWithJacobian, Watched};
use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pulp::{Simd, WithSimd};
use pyo3::exceptions::{PyMemoryError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use zivi::numeric::lu::ByBlocks;
use zivi_core::vi;
use zivi_core::vi::{
    Affine, Differenced, InvalidInput, Problem, Report, RowScale, Scheme, Settings, Start, Status,
    Workspace,
};

use crate::interface::{list, vector, with_aside, zeros, Array};

/// Code of a solve that its time limit ended; those of the solver itself are smaller.
const TIME_LIMIT: u8 = 10;

fn invalid(error: InvalidInput) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// Memory of a solve of `n` unknowns, which grows with `n^2`.
fn workspace_of(n: usize) -> PyResult<(Vec<f64>, Vec<usize>)> {
    // larger than all numbers if it overflows
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

/// A bound as passed by Python: one number for all components, or one for each.
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

    /// The fields of the public result, a number for the status.
    fn entries(
        self,
        py: Python<'_>,
        (report, f): (Report, Vec<f64>),
        nfev: usize,
        (interrupts, undefined): (&Interrupts, &str),
    ) -> PyResult<Py<PyDict>> {
        let timed_out = report.status == Status::Stopped && interrupts.timed_out();
        let status = if timed_out { TIME_LIMIT } else { report.status as u8 };
        let message = match timed_out {
            true => "the time limit was reached: allow more time or start nearer",
            false => report.status.message(),
        };
        let entries = PyDict::new(py);
        macro_rules! set {
            ($($name:literal: $value:expr),* $(,)?) => {
                $(entries.set_item(pyo3::intern!(py, $name), $value)?;)*
            };
        }
        set! {
            "x": PyArray1::from_vec(py, self.z),
            "F": PyArray1::from_vec(py, f),
            "residual": report.residual,
            "status": status,
            "message": pyo3::types::PyString::new(py, message),
            "n_iter": report.counts.iterations,
            "nfev": nfev,
            "njev": report.counts.jacobian,
            "n_pivots": report.counts.pivots,
            "n_semismooth_steps": report.counts.semismooth_steps,
            "n_gradient_steps": report.counts.gradient_steps,
            "n_restarts": report.counts.restarts,
            "stage": pyo3::types::PyString::intern(py, report.stage.name()),
            "scaled_residual": report.scaled_residual,
            "tolerance": report.tolerance,
            "convergence_ratio": report.convergence_ratio,
            "projected": report.projected,
        }
        if !undefined.is_empty() {
            entries.set_item("message", format!("{message}{undefined}"))?;
        }
        Ok(entries.unbind())
    }
}

/// Solves a box VI. `jac` is a callable or `"2-point"` or `"3-point"` for differences; `convert`
/// makes arrays of values of `f` and `jac` that are not float64 arrays of the right shape.
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
) -> PyResult<Py<PyDict>> {
    let _running = crate::interface::running()?;
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
            let problem = MapWithJacobian::new(&callbacks, jac);
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
    vectors.entries(py, end, callbacks.nfev.get(), (&interrupts, &callbacks.undefined()))
}

/// Whether all are finite: several are tested together, which a search for the first one cannot do.
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
) -> PyResult<Py<PyDict>> {
    let _running = crate::interface::running()?;
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
    vectors.entries(py, end, nfev, (&problem.interrupts, ""))
}

/// The natural residual of `x`, given `F(x)`.
#[pyfunction]
pub(crate) fn natural_residual<'py>(
    x: PyReadonlyArray1<'py, f64>,
    f: PyReadonlyArray1<'py, f64>,
    lower: Bound1<'py>,
    upper: Bound1<'py>,
) -> PyResult<f64> {
    let _running = crate::interface::running()?;
    let vectors = Vectors::new(&lower, &upper, &x)?;
    vi::validate_bounds(vectors.z.len(), &vectors.lower, &vectors.upper).map_err(invalid)?;
    let f = vector(&f)?;
    Ok(vi::natural_residual(&vectors.z, &f, &vectors.lower, &vectors.upper))
}

// The settings of a solve, from Python.

/// Settings as passed by Python: a dictionary of those that differ from the default.
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

    fn get(&self) -> Settings<'_> {
        match &self.row_scale {
            Some(scale) => Settings { row_scale: RowScale::Given(scale), ..self.settings },
            None => self.settings,
        }
    }
}

// Bimatrix games from Python.

/// Unscaled strategies at an equilibrium of a game with positive payoffs of equal shape, and the
/// pivots; `None` if none was found within the limit of pivots or of time (s).
#[pyfunction]
#[pyo3(signature = (a, b, limit, time_limit=None))]
pub(crate) fn lemke_howson(
    py: Python<'_>,
    a: PyReadonlyArray2<'_, f64>,
    b: PyReadonlyArray2<'_, f64>,
    limit: usize,
    time_limit: Option<f64>,
) -> PyResult<Option<(Array, Array, usize)>> {
    let (m, n) = a.as_array().dim();
    let payoffs = |of: PyReadonlyArray2<'_, f64>| list(of.as_array().iter().copied());
    let (a, b) = (payoffs(a)?, payoffs(b)?);
    let (reals, indices) = vi::lemke_howson_len(m, n);
    let (mut reals, mut indices) = (zeros(reals)?, list(std::iter::repeat_n(0, indices))?);
    let (mut x, mut y) = (zeros(m)?, zeros(n)?);
    let interrupts = Interrupts::new(time_limit, None);
    let (found, x, y, interrupts) = py.detach(move || {
        let work = (&mut reals[..], &mut indices[..]);
        let poll = &mut || interrupts.look_detached();
        let found = vi::lemke_howson((&a, &b), (&mut x, &mut y), limit, work, poll);
        (found, x, y, interrupts)
    });
    if let Some(error) = interrupts.raised() {
        return Err(error);
    }
    let array = |values| PyArray1::from_vec(py, values).unbind();
    Ok(found.ok().flatten().map(|pivots| (array(x), array(y), pivots)))
}

// How small the numbers of an affine problem are: whether an absolute tolerance means something.

/// Sums that a processor computes in parallel.
const LANES: usize = 8;
/// Multiple of the limit from which on rounding cannot bring a size below it.
const SAFE: f64 = 2.0;

/// Whether some row or unknown of `F(x) = matrix x + q` on a box is smaller than `limit`, judged at
/// the initial point, the point of the box closest to `x0` (zero without one).
///
/// The size of an unknown is the step that balances a row, `max_i |F_i/M_ij|`, at most the width of
/// the box and at least its value; the size of a row is its value and its change by these steps.
/// False for NaN, which the solver rejects.
#[pyfunction]
#[pyo3(signature = (matrix, q, lower, upper, x0, limit))]
pub(crate) fn is_off_scale<'py>(
    matrix: PyReadonlyArray2<'py, f64>,
    q: PyReadonlyArray1<'py, f64>,
    lower: Bound1<'py>,
    upper: Bound1<'py>,
    x0: Option<PyReadonlyArray1<'py, f64>>,
    limit: f64,
) -> PyResult<bool> {
    let (n, rows, q) = (matrix.shape()[0], matrix.as_slice()?, q.as_slice()?);
    let (lower, upper) = (lower.to_vec(n)?, upper.to_vec(n)?);
    if !lower.iter().zip(&upper).all(|(low, high)| low <= high) {
        return Ok(false);
    }
    let start = x0.map_or_else(|| zeros(n), |x0| vector(&x0))?;
    let bounds = lower.iter().zip(&upper);
    let x = list(start.iter().zip(bounds).map(|(x, (l, u))| x.clamp(*l, *u)))?;
    let sizes = ProblemSizes { rows, q, lower: &lower, upper: &upper, x: &x };
    let values = pulp::Arch::new().dispatch(NaturalValues(&sizes));
    if sizes.are_safe(&values, SAFE * limit) {
        return Ok(false);
    }
    let finite = [rows, q, &x].into_iter().all(are_finite);
    Ok(finite && pulp::Arch::new().dispatch(Least(&sizes, &values)) < limit)
}

/// The numbers of a problem, and the point of its box for the test.
struct ProblemSizes<'a> {
    rows: &'a [f64],
    q: &'a [f64],
    lower: &'a [f64],
    upper: &'a [f64],
    x: &'a [f64],
}

/// `|F_i|` at the point.
struct NaturalValues<'a>(&'a ProblemSizes<'a>);

impl WithSimd for NaturalValues<'_> {
    type Output = Vec<f64>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Vec<f64> {
        self.0.values()
    }
}

/// The least size, from the values.
struct Least<'a>(&'a ProblemSizes<'a>, &'a [f64]);

impl WithSimd for Least<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        self.0.least(self.1)
    }
}

fn or_one(size: f64) -> f64 {
    if size > 0.0 {
        size
    } else {
        1.0
    }
}

impl ProblemSizes<'_> {
    #[inline(always)]
    fn values(&self) -> Vec<f64> {
        if self.x.iter().all(|x| *x == 0.0) {
            return self.q.iter().map(|q| q.abs()).collect();
        }
        let rows = self.rows.chunks_exact(self.q.len()).zip(self.q);
        let value = |(row, q): (&[f64], &f64)| {
            let mut sums = [0.0; LANES];
            for (row, x) in row.chunks(LANES).zip(self.x.chunks(LANES)) {
                for (sum, (m, x)) in sums.iter_mut().zip(row.iter().zip(x)) {
                    *sum += m * x;
                }
            }
            (sums.iter().sum::<f64>() + q).abs()
        };
        rows.map(value).collect()
    }

    /// The size of an unknown from the step that balances a row.
    fn unknown(&self, j: usize, moved: f64) -> f64 {
        let width = or_one(self.upper[j] - self.lower[j]);
        or_one(moved).min(width).max(self.x[j].abs())
    }

    /// Whether a sample of entries shows that all are at least `limit`. It is one row
    /// that moves most unknowns, and most rows have a value of that size themselves.
    fn are_safe(&self, values: &[f64], limit: f64) -> bool {
        let n = self.q.len();
        let rows = || self.rows.chunks_exact(n).zip(values);
        let mut unknowns: Vec<f64> = self.x.iter().map(|x| x.abs()).collect();
        let mut open: Vec<usize> = (0..n).filter(|&j| unknowns[j] < limit).collect();
        for (row, value) in rows() {
            if open.is_empty() {
                break;
            }
            open.retain(|&j| {
                let moved = value / row[j].abs();
                if moved > 0.0 && moved < f64::INFINITY {
                    unknowns[j] = self.unknown(j, moved);
                }
                unknowns[j] < limit
            });
        }
        let moves = |row: &[f64]| {
            let mut entries = row.iter().zip(&unknowns);
            entries.any(|(m, unknown)| m.abs() * unknown.min(1.0) >= limit)
        };
        open.is_empty() && rows().all(|(row, value)| *value >= limit || moves(row))
    }

    #[inline(always)]
    fn least(&self, values: &[f64]) -> f64 {
        let n = self.q.len();
        let mut moves = vec![0.0; n];
        for (row, value) in self.rows.chunks_exact(n).zip(values) {
            for (to, m) in moves.iter_mut().zip(row) {
                let moved = if *m == 0.0 { 0.0 } else { value / m.abs() };
                *to = if moved > *to { moved } else { *to };
            }
        }
        let unknowns = moves.iter().enumerate().map(|(j, moved)| self.unknown(j, *moved));
        let unknowns: Vec<f64> = unknowns.collect();
        let mut least = unknowns.iter().copied().fold(f64::INFINITY, f64::min);
        for (row, value) in self.rows.chunks_exact(n).zip(values) {
            let mut most = [*value; LANES];
            for (row, sizes) in row.chunks(LANES).zip(unknowns.chunks(LANES)) {
                for (most, (m, size)) in most.iter_mut().zip(row.iter().zip(sizes)) {
                    let moved = m.abs() * size.min(1.0);
                    *most = if moved > *most { moved } else { *most };
                }
            }
            least = least.min(or_one(most.into_iter().fold(*value, f64::max)));
        }
        least
    }
}

// The order in which a sparse matrix is factorised, found with the interpreter's lock released.

/// Entries of a matrix up to which the work of the ordering is counted by its index type.
const MOST: usize = i32::MAX as usize / 4;

/// Maximal number of bytes of the ordering for each column, some 22 numbers, and for each entry:
/// 2.4 numbers of the matrix with its transpose, and a sorted copy.
const OF_COLUMN: usize = 30 * size_of::<u64>();
const OF_ENTRY: usize = 5 * size_of::<u64>();

/// Whether these are the columns of a square matrix, compressed.
fn is_pattern(starts: &[i32], rows: &[i32]) -> bool {
    let Some((&last, columns)) = starts.split_last() else { return false };
    let n = columns.len();
    columns.first().copied().unwrap_or(last) == 0
        && usize::try_from(last) == Ok(rows.len())
        && rows.len() <= MOST
        && starts.windows(2).all(|pair| pair[0] <= pair[1])
        && rows.iter().all(|&row| usize::try_from(row).is_ok_and(|row| row < n))
}

/// The rows and columns of a square matrix in an order of approximate minimum degree (Amestoy,
/// Davis & Duff), of its pattern and that of its transpose together.
#[pyfunction]
pub(crate) fn minimum_degree<'py>(
    py: Python<'py>,
    starts: PyReadonlyArray1<'py, i32>,
    rows: PyReadonlyArray1<'py, i32>,
) -> PyResult<Bound<'py, PyArray1<i32>>> {
    let (starts, rows) =
        (list(starts.as_array().iter().copied())?, list(rows.as_array().iter().copied())?);
    if !is_pattern(&starts, &rows) {
        return Err(PyValueError::new_err("starts and rows must be those of a square matrix"));
    }
    let n = starts.len() as i32 - 1;
    let needed = (OF_COLUMN * starts.len()).saturating_add(OF_ENTRY * rows.len());
    let found = py.detach(|| {
        with_aside(needed, || amd::order(n, &starts, &rows, &amd::Control::default()))
    })?;
    let (order, _, _) =
        found.map_err(|status| PyValueError::new_err(format!("no order: {status:?}")))?;
    Ok(PyArray1::from_vec(py, order))
}
