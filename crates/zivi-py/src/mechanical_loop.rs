//! Closed loops of mechanical systems from Python.

use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1, PyUntypedArrayMethods};
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::gc::{PyTraverseError, PyVisit};
use pyo3::prelude::*;
use zivi::mechanics::{Sampling, Ticks};
use zivi::switched::Order;
use zivi::system::driven::{Driven, InputMatrix};
use zivi::{AnyMethod, SetupError, SwitchedRk};

use crate::arrays::{vector, Matrix};
use crate::dynamics::{AnyDynamics, CompiledFunction};
use crate::errors::setup_error;
use crate::friction::Rubbing;
use crate::mechanics::MechanicalRecord;
use crate::method::Method;
use crate::system::{Configuration, Mechanism};
use crate::watch::Watch;

/// The matrix of inputs `B` of a mechanical system.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct Inputs {
    /// How many.
    r: usize,
    kind: Kind,
}

enum Kind {
    Constant(Vec<f64>),
    /// A compiled function, and what owns it.
    Compiled(CompiledFunction, Py<PyAny>),
    /// A function of `(t, q)` that gives an array.
    Callable(Py<PyAny>),
}

#[pymethods]
impl Inputs {
    /// A constant matrix, row by row.
    #[staticmethod]
    fn constant(r: usize, matrix: Vec<f64>) -> Self {
        Self { r, kind: Kind::Constant(matrix) }
    }

    /// As `Model.compiled`; it fills in the matrix row by row.
    #[staticmethod]
    fn compiled(r: usize, address: usize, data: usize, owner: Py<PyAny>) -> Self {
        let function = CompiledFunction::with_data(address, data);
        Self { r, kind: Kind::Compiled(function, owner) }
    }

    /// A function of time and coordinates that gives a contiguous matrix.
    #[staticmethod]
    fn callable(r: usize, function: Py<PyAny>) -> Self {
        Self { r, kind: Kind::Callable(function) }
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        match &self.kind {
            Kind::Constant(_) => Ok(()),
            Kind::Compiled(_, held) | Kind::Callable(held) => visit.call(held),
        }
    }
}

type Matrices<'a> = Box<dyn FnMut(f64, &[f64], &mut [f64]) -> PyResult<()> + 'a>;

impl Inputs {
    fn matrix<'a>(&'a self, py: Python<'a>) -> InputMatrix<Matrices<'a>> {
        match &self.kind {
            Kind::Constant(matrix) => InputMatrix::Constant(matrix.clone()),
            Kind::Compiled(function, _) => {
                let function = *function;
                InputMatrix::Function(Box::new(move |t, q, out| {
                    match function.call(t, q, q, out) {
                        0 => Ok(()),
                        code => Err(PyRuntimeError::new_err(format!(
                            "the compiled inputs failed at t = {t:?} (they returned {code})"
                        ))),
                    }
                }))
            }
            Kind::Callable(function) => {
                let function = function.bind(py).clone();
                InputMatrix::Function(Box::new(move |t, q, out| {
                    let q = PyArray1::from_slice(function.py(), q);
                    let value = function.call1((t, q))?;
                    let array = value.cast::<numpy::PyArray2<f64>>()?;
                    if array.len() != out.len() {
                        let (got, wanted) = (array.len(), out.len());
                        let message = format!("inputs must give {wanted} numbers, got {got}");
                        return Err(PyValueError::new_err(message));
                    }
                    let readable = array.readonly();
                    out.iter_mut().zip(readable.as_array()).for_each(|(to, &from)| *to = from);
                    Ok(())
                }))
            }
        }
    }
}

/// A loop: its run at the samples, and the controls there.
#[pyclass(frozen, get_all, module = "zivi._zivi")]
pub(crate) struct MechanicalLoopRecord {
    run: Py<MechanicalRecord>,
    u: Matrix<f64>,
}

/// A controller of the interpreter: `tick(k, t, q, qdot)` gives an array of the controls.
struct PythonTicks<'py> {
    tick: Bound<'py, PyAny>,
}

impl Ticks<PyErr> for PythonTicks<'_> {
    fn tick(&mut self, k: usize, t: f64, (q, w): (&[f64], &[f64]), u: &mut [f64]) -> PyResult<()> {
        crate::leaving::look()?;
        let py = self.tick.py();
        let (q, w) = (PyArray1::from_slice(py, q), PyArray1::from_slice(py, w));
        let value = self.tick.call1((k, t, q, w))?;
        let array = value.cast::<PyArray1<f64>>()?;
        if array.len() != u.len() {
            return Err(PyValueError::new_err("the tick must give one number for each input"));
        }
        let readable = array.readonly();
        u.iter_mut().zip(readable.as_array()).for_each(|(to, &from)| *to = from);
        Ok(())
    }
}

/// A loop by the switched method, or with one of its steps a period; `u` acts from the start on, and
/// `tick` is called at all samples after it but the last.
#[pyfunction]
#[pyo3(signature = (system, inputs, method, times, stops, start, u, tick, *, dense, one_step, progress=None))]
#[allow(clippy::too_many_arguments)]
pub(crate) fn simulate_mechanical_loop(
    py: Python<'_>,
    system: PyRef<'_, Mechanism>,
    inputs: PyRef<'_, Inputs>,
    method: PyRef<'_, Method>,
    times: PyReadonlyArray1<'_, f64>,
    stops: PyReadonlyArray1<'_, f64>,
    start: PyRef<'_, Configuration>,
    u: PyReadonlyArray1<'_, f64>,
    tick: Bound<'_, PyAny>,
    dense: bool,
    one_step: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<MechanicalLoopRecord> {
    let _running = crate::leaving::running()?;
    let AnyMethod::SwitchedRk(settings) = method.inner else {
        return Err(PyValueError::new_err("a mechanical loop is integrated by SwitchedRK"));
    };
    let (times, stops, u) = (vector(&times), vector(&stops), vector(&u));
    let settings = if one_step { one_step_of(settings, &times) } else { settings };
    let sampling = Sampling { times: &times, stops: &stops };
    let from = (start.q.as_slice(), start.qdot.as_slice());
    let (layout, friction, e) = (system.layout(), system.friction(), system.e.as_slice());
    let ticks = &mut PythonTicks { tick };
    let watch = &mut Watch { progress };
    let r = inputs.r;
    let matrix = inputs.matrix(py);
    let wrong = || PyValueError::new_err("inputs must be a matrix of shape (n, r)");
    macro_rules! run {
        ($dynamics:expr) => {{
            let dynamics = Rubbing { dynamics: $dynamics, friction };
            let mut driven = Driven::new(dynamics, (layout.n, r), matrix).ok_or_else(wrong)?;
            zivi::mechanics::simulate_mechanical_loop(
                settings,
                (&mut driven, e),
                sampling,
                from,
                (&u, ticks),
                dense,
                watch,
            )
        }};
    }
    let done: Result<_, SetupError> = match AnyDynamics::of(py, system.model.get(), layout) {
        AnyDynamics::Compiled(dynamics) => run!(dynamics),
        AnyDynamics::Callable(dynamics) => run!(dynamics),
    };
    let (run, u) = done.map_err(setup_error)?;
    let u = PyArray1::from_vec(py, u).reshape([run.samples.t.len(), r])?.unbind();
    Ok(MechanicalLoopRecord { run: Py::new(py, MechanicalRecord::new(py, run)?)?, u })
}

/// One step of the pair of order 5 a period, whose length no error controls.
fn one_step_of(settings: SwitchedRk, times: &[f64]) -> SwitchedRk {
    let longest = times.windows(2).map(|it| it[1] - it[0]).fold(0.0, f64::max);
    SwitchedRk { adaptive: false, max_step: longest, order: Order::Five, ..settings }
}
