//! Systems, tables and impact laws from Python, and arguments of runs.
//!
//! Arguments of a run: system, initial state, stored data.

use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1, PyUntypedArrayMethods};
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::gc::{PyTraverseError, PyVisit};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use zivi::mechanics::MotionPoint;
use zivi::system::dynamics::{Driven, InputMatrix, Layout};
use zivi::system::force::Friction;
use zivi::system::impact_law::{newton_impacts, FunctionImpact, TabulatedImpact};
use zivi::{AnyImpactLaw, Kick, PathPoint, Physical};
use zivi_core::{transform, Branch, Lifted, Restitution, RestitutionError};

use crate::dynamics::{AnyDynamics, CompiledDynamics, CompiledFunction, Model};
use crate::force::{compiled_ratio, Force};
use crate::friction::{PyFriction, Rubbing};
use crate::interface::{array, setup_error, vector, zeros, Array};
use crate::method::{PyEvent, PySetting};

/// A mass above a wall.
#[pyclass(frozen, module = "zivi._zivi", name = "PointMass")]
pub(crate) struct PyPointMass {
    pub(crate) force: Py<Force>,
    impact: Py<PyImpactLaw>,
}

impl PyPointMass {
    /// Its impact law.
    pub(crate) fn law(&self) -> &AnyImpactLaw {
        &self.impact.get().inner
    }
}

#[pymethods]
impl PyPointMass {
    #[new]
    fn new(force: Py<Force>, law: Py<PyImpactLaw>) -> Self {
        Self { force, impact: law }
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        visit.call(&self.force)?;
        visit.call(&self.impact)
    }
}

/// Distance from the wall and velocity.
#[pyclass(frozen, module = "zivi._zivi", name = "State")]
pub(crate) struct PyState {
    pub(crate) inner: Physical,
}

#[pymethods]
impl PyState {
    #[new]
    fn new(x: f64, xdot: f64) -> Self {
        Self { inner: Physical { x, xdot } }
    }
}

/// Impact laws of the gaps of a mechanical system: coefficients or laws.
#[derive(FromPyObject)]
enum Restitutions<'py> {
    Newton(PyReadonlyArray1<'py, f64>),
    Laws(Vec<Py<PyImpactLaw>>),
}

/// A mechanical system of `n` coordinates and `m` gaps, with or without friction.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct Mechanism {
    pub(crate) model: Py<Model>,
    pub(crate) n: usize,
    pub(crate) m: usize,
    /// Equality rows.
    k: usize,
    /// An impact law for each gap.
    pub(crate) laws: Vec<AnyImpactLaw>,
    /// Owners of the functions of the laws.
    owners: Vec<Py<PyImpactLaw>>,
    friction: Option<Py<PyFriction>>,
}

impl Mechanism {
    /// Its friction, that of no channels if it has none.
    pub(crate) fn friction(&self) -> &Friction {
        PyFriction::given(self.laws_of_contact())
    }

    /// The same with the laws of its compliant gaps.
    pub(crate) fn laws_of_contact(&self) -> Option<&PyFriction> {
        self.friction.as_ref().map(|it| it.get())
    }

    pub(crate) fn layout(&self) -> Layout {
        Layout { n: self.n, m: self.m, p: self.friction().channels.len(), k: self.k }
    }

    /// Its evaluator.
    pub(crate) fn rubbing<'a>(&'a self, py: Python<'a>) -> Rubbing<'a, AnyDynamics<'a>> {
        let dynamics = AnyDynamics::of(py, self.model.get(), self.layout());
        Rubbing { dynamics, friction: self.laws_of_contact(), moved: &[] }
    }

    /// Its evaluator without friction and without the interpreter; `None` if that is needed.
    pub(crate) fn native_dynamics(&self) -> Option<CompiledDynamics> {
        CompiledDynamics::of(self.model.get(), self.layout())
    }

    /// The same without the interpreter; `None` if the interpreter is needed.
    pub(crate) fn rubbing_alone(&self, py: Python<'_>) -> Option<Rubbing<'_, CompiledDynamics>> {
        match AnyDynamics::of(py, self.model.get(), self.layout()) {
            AnyDynamics::Compiled(dynamics) => {
                Some(Rubbing { dynamics, friction: self.laws_of_contact(), moved: &[] })
            }
            _ => None,
        }
    }
}

#[pymethods]
impl Mechanism {
    #[new]
    #[pyo3(signature = (model, *, n, m, e, friction=None, k=0))]
    fn new(
        model: Py<Model>,
        n: usize,
        m: usize,
        e: Restitutions<'_>,
        friction: Option<Py<PyFriction>>,
        k: usize,
    ) -> PyResult<Self> {
        let (laws, owners) = match e {
            Restitutions::Laws(given) => {
                (given.iter().map(|law| law.get().inner.clone()).collect(), given)
            }
            Restitutions::Newton(e) => {
                let laws = newton_impacts(&vector(&e)?);
                (laws.map_err(|error| setup_error(error.into()))?, Vec::new())
            }
        };
        Ok(Self { model, n, m, k, laws, owners, friction })
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        visit.call(&self.model)?;
        self.owners.iter().try_for_each(|it| visit.call(it))
    }
}

/// Coordinates and velocities.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct Configuration {
    pub(crate) q: Vec<f64>,
    pub(crate) qdot: Vec<f64>,
}

#[pymethods]
impl Configuration {
    #[new]
    fn new(q: PyReadonlyArray1<'_, f64>, qdot: PyReadonlyArray1<'_, f64>) -> PyResult<Self> {
        Ok(Self { q: vector(&q)?, qdot: vector(&qdot)? })
    }
}

/// Data stored by a run, in addition to events at the wall.
#[pyclass(frozen, module = "zivi._zivi", name = "RecordOptions")]
pub(crate) struct PyRecordOptions {
    /// Times of the samples, if given.
    pub(crate) t_eval: Option<Py<PyArray1<f64>>>,
    /// Times where the force is not smooth.
    pub(crate) tstops: Option<Py<PyArray1<f64>>>,
    /// The velocities after an impulse at one of these times, `None` without impulses: a function of the
    /// time, the position and the velocity.
    pub(crate) kicks: Option<Py<PyAny>>,
    pub(crate) events: Vec<Py<PyEvent>>,
    /// Whether without times only the ends are sampled.
    pub(crate) ends: bool,
    /// Whether the motion between the samples is kept.
    pub(crate) dense: bool,
    /// Whether at least the extrapolated flights are kept.
    pub(crate) arcs: bool,
}

#[pymethods]
impl PyRecordOptions {
    #[new]
    #[pyo3(signature = (
        *, t_eval=None, tstops=None, kicks=None, events=Vec::new(), ends=false, dense=false,
        arcs=false
    ))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        t_eval: Option<Py<PyArray1<f64>>>,
        tstops: Option<Py<PyArray1<f64>>>,
        kicks: Option<Py<PyAny>>,
        events: Vec<Py<PyEvent>>,
        ends: bool,
        dense: bool,
        arcs: bool,
    ) -> Self {
        Self { t_eval, tstops, kicks, events, ends, dense, arcs }
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        visit.call(&self.kicks)?;
        self.events.iter().try_for_each(|it| visit.call(it))
    }
}

impl PyRecordOptions {
    /// Whether user functions other than the forces are called.
    pub(crate) fn calls(&self) -> bool {
        !self.events.is_empty() || self.kicks.is_some()
    }

    /// Velocity jumps of a mass.
    pub(crate) fn kicks_of_point<'py>(
        &self,
        py: Python<'py>,
    ) -> Option<Kick<'py, PyErr, PathPoint>> {
        self.kicks.as_ref().map(|function| kick_of_point(py, function))
    }
}

/// A velocity jump of a mass, a function of the time, the position and the velocity.
pub(crate) fn kick_of_point<'py>(
    py: Python<'py>,
    function: &Py<PyAny>,
) -> Kick<'py, PyErr, PathPoint> {
    let function = function.bind(py).clone();
    Box::new(move |t, at| {
        let after: Option<f64> = function.call1((t, at.x, at.xdot))?.extract()?;
        Ok(after.map(|xdot| at.xdot = xdot).is_some())
    })
}

/// Velocity jumps of a mechanical system of `n` coordinates.
pub(crate) fn kicks_of_mechanism(function: &Py<PyAny>, n: usize) -> Kick<'_, PyErr, MotionPoint> {
    Box::new(move |t, at| {
        Python::attach(|py| {
            let q = PyArray1::from_slice(py, &at.x[..n]);
            let w = PyArray1::from_slice(py, &at.v[..n]);
            let after: Option<Vec<f64>> = function.call1(py, (t, q, w))?.extract(py)?;
            Ok(after.map(|after| at.v[..n].copy_from_slice(&after[..n])).is_some())
        })
    })
}

// Impact laws from Python.

/// An impact law.
#[pyclass(frozen, module = "zivi._zivi", name = "ImpactLaw")]
pub(crate) struct PyImpactLaw {
    pub(crate) inner: AnyImpactLaw,
    /// Owner of its compiled functions, if any.
    owner: Option<Py<PyAny>>,
}

impl From<AnyImpactLaw> for PyImpactLaw {
    fn from(inner: AnyImpactLaw) -> Self {
        Self { inner, owner: None }
    }
}

#[pymethods]
impl PyImpactLaw {
    /// By its name, with the values of its parameters in their order.
    #[new]
    fn new(name: &str, values: Vec<f64>) -> PyResult<Self> {
        match AnyImpactLaw::named(name, &values) {
            Some(law) => Ok(law.map_err(|error| setup_error(error.into()))?.into()),
            None => Err(PyValueError::new_err(format!("there is no impact law {name:?}"))),
        }
    }

    /// Newton's, from both coefficients, which must be each other's image.
    #[staticmethod]
    fn newton(e: f64, kappa: f64) -> PyResult<Self> {
        Ok(AnyImpactLaw::from(from_both(e, kappa)?).into())
    }

    /// Linear between speeds, with these coefficients at them.
    #[staticmethod]
    fn table(v: PyReadonlyArray1<'_, f64>, e: PyReadonlyArray1<'_, f64>) -> PyResult<Self> {
        let law = TabulatedImpact::new(&vector(&v)?, &vector(&e)?);
        Ok(AnyImpactLaw::from(law.map_err(|error| setup_error(error.into()))?).into())
    }

    /// A function `double e(double v)` and, if known, its derivative, by their addresses; its limit
    /// as `v -> 0`, the speed up to which it is smooth, and the owner of the code.
    #[staticmethod]
    fn compiled(
        address: usize,
        slope: Option<usize>,
        limit: f64,
        geometric_up_to: f64,
        owner: Py<PyAny>,
    ) -> Self {
        let slope = slope.map(|address| Box::new(compiled_ratio(address)) as Box<_>);
        let law = FunctionImpact::new(compiled_ratio(address), slope, (limit, geometric_up_to));
        Self { inner: law.into(), owner: Some(owner) }
    }

    /// Whether it calls a function of C, which may be one in the interpreter.
    #[getter]
    fn is_compiled(&self) -> bool {
        self.owner.is_some()
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        visit.call(&self.owner)
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
        let of =
            parameters.iter().map(|it| PySetting::new(py, it)).collect::<PyResult<Vec<_>>>()?;
        all.set_item(name, of)?;
    }
    Ok(all)
}

// Restitution and transform on arrays.

fn refused(error: RestitutionError) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// Restitution of a wall as `e` and as `kappa`: one as given, the other computed, so that neither
/// loses digits.
#[pyclass(frozen, module = "zivi._zivi", name = "Restitution")]
pub(crate) struct PyRestitution {
    pub(crate) inner: Restitution,
}

#[pymethods]
impl PyRestitution {
    /// From exactly one of them.
    #[new]
    #[pyo3(signature = (*, e=None, kappa=None))]
    fn new(e: Option<f64>, kappa: Option<f64>) -> PyResult<Self> {
        let inner = match (e, kappa) {
            (Some(e), None) => Restitution::from_e(e),
            (None, Some(kappa)) => Restitution::from_kappa(kappa),
            _ => {
                let given = if e.is_some() { "both" } else { "neither" };
                return Err(PyValueError::new_err(format!(
                    "exactly one of e and kappa must be given, got {given}"
                )));
            }
        };
        Ok(Self { inner: inner.map_err(refused)? })
    }

    /// From both, which must be each other's image.
    #[staticmethod]
    fn of_both(e: f64, kappa: f64) -> PyResult<Self> {
        Ok(Self { inner: from_both(e, kappa)? })
    }

    #[getter]
    fn e(&self) -> f64 {
        self.inner.e()
    }

    #[getter]
    fn kappa(&self) -> f64 {
        self.inner.kappa()
    }
}

pub(crate) fn from_both(e: f64, kappa: f64) -> PyResult<Restitution> {
    Restitution::from_both(e, kappa).map_err(refused)
}

pub(crate) fn from_e(e: f64) -> PyResult<Restitution> {
    Restitution::from_e(e).map_err(refused)
}

/// Where only the parameter of the transform matters.
pub(crate) fn restitution_of(kappa: f64) -> PyResult<Restitution> {
    Restitution::from_kappa(kappa).map_err(refused)
}

type Pair<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

fn map_pairs<'py>(
    py: Python<'py>,
    (first, second): (PyReadonlyArray1<'py, f64>, PyReadonlyArray1<'py, f64>),
    map: impl Fn(f64, f64) -> (f64, f64),
) -> PyResult<Pair<'py>> {
    let (first, second) = (first.as_array(), second.as_array());
    let (mut a, mut b) = (zeros(first.len())?, zeros(first.len())?);
    for (k, (first, second)) in first.iter().zip(second).enumerate() {
        (a[k], b[k]) = map(*first, *second);
    }
    Ok((PyArray1::from_vec(py, a), PyArray1::from_vec(py, b)))
}

/// `(s, v)` of physical states on the branch `sigma`.
#[pyfunction]
pub(crate) fn lift<'py>(
    py: Python<'py>,
    x: PyReadonlyArray1<'py, f64>,
    xdot: PyReadonlyArray1<'py, f64>,
    sigma: f64,
    kappa: f64,
) -> PyResult<Pair<'py>> {
    let restitution = restitution_of(kappa)?;
    let branch = if sigma < 0.0 { Branch::Negative } else { Branch::Positive };
    map_pairs(py, (x, xdot), |x, xdot| {
        let z = transform::lift(Physical { x, xdot }, branch, restitution);
        (z.s, z.v)
    })
}

/// `(x, xdot)` of lifted states.
#[pyfunction]
pub(crate) fn project<'py>(
    py: Python<'py>,
    s: PyReadonlyArray1<'py, f64>,
    v: PyReadonlyArray1<'py, f64>,
    kappa: f64,
) -> PyResult<Pair<'py>> {
    let restitution = restitution_of(kappa)?;
    map_pairs(py, (s, v), |s, v| {
        let physical = transform::project(Lifted { s, v }, restitution);
        (physical.x, physical.xdot)
    })
}

// How controls act on a mechanical system.

/// The matrix of inputs `B` of a mechanical system.
#[pyclass(frozen, module = "zivi._zivi", name = "Inputs")]
pub(crate) struct PyInputs {
    /// How many.
    pub(crate) r: usize,
    kind: InputsKind,
}

enum InputsKind {
    Constant(Vec<f64>),
    /// A compiled function and its owner.
    Compiled(CompiledFunction, Py<PyAny>),
    /// A function of `(t, q)` that returns an array.
    Callable(Py<PyAny>),
}

#[pymethods]
impl PyInputs {
    /// A constant matrix, row by row.
    #[staticmethod]
    fn constant(r: usize, matrix: Vec<f64>) -> Self {
        Self { r, kind: InputsKind::Constant(matrix) }
    }

    /// As `Model.compiled`; it fills in the matrix row by row.
    #[staticmethod]
    fn compiled(r: usize, address: usize, data: usize, owner: Py<PyAny>) -> Self {
        let function = CompiledFunction::with_data(address, data);
        Self { r, kind: InputsKind::Compiled(function, owner) }
    }

    /// A function of time and coordinates that returns a contiguous matrix.
    #[staticmethod]
    fn callable(r: usize, function: Py<PyAny>) -> Self {
        Self { r, kind: InputsKind::Callable(function) }
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        match &self.kind {
            InputsKind::Constant(_) => Ok(()),
            InputsKind::Compiled(_, held) | InputsKind::Callable(held) => visit.call(held),
        }
    }
}

/// The matrix of inputs as a function of time and coordinates.
pub(crate) type Matrices<'a> = Box<dyn FnMut(f64, &[f64], &mut [f64]) -> PyResult<()> + 'a>;

/// The same without the interpreter.
pub(crate) type NativeMatrices = Box<dyn FnMut(f64, &[f64], &mut [f64]) -> PyResult<()> + Send>;

/// A system, evaluated with or without the interpreter, with its controls.
pub(crate) type Evaluated<'a, 'py> = Driven<Rubbing<'a, AnyDynamics<'py>>, Matrices<'a>>;

/// A system that needs no interpreter, with its controls.
pub(crate) type Native<'a> = Driven<Rubbing<'a, CompiledDynamics>, NativeMatrices>;

impl PyInputs {
    /// The matrix; `None` if it needs the interpreter.
    fn native(&self) -> Option<InputMatrix<NativeMatrices>> {
        match &self.kind {
            InputsKind::Constant(matrix) => Some(InputMatrix::Constant(matrix.clone())),
            InputsKind::Compiled(function, _) => {
                let function = *function;
                Some(InputMatrix::Function(Box::new(move |t, q, out| {
                    match function.call(t, q, q, out) {
                        0 => Ok(()),
                        code => Err(PyRuntimeError::new_err(format!(
                            "the compiled inputs failed at t = {t:?} (they returned {code})"
                        ))),
                    }
                })))
            }
            InputsKind::Callable(_) => None,
        }
    }

    fn matrix<'a>(&'a self, py: Python<'a>) -> InputMatrix<Matrices<'a>> {
        if let InputsKind::Callable(function) = &self.kind {
            let function = function.bind(py).clone();
            return InputMatrix::Function(Box::new(move |t, q, out| {
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
            }));
        }
        match self.native() {
            Some(InputMatrix::Function(function)) => InputMatrix::Function(function),
            Some(InputMatrix::Constant(matrix)) => InputMatrix::Constant(matrix),
            None => InputMatrix::Constant(Vec::new()),
        }
    }

    /// A system with these controls.
    pub(crate) fn driven<'a>(
        &'a self,
        py: Python<'a>,
        system: &'a Mechanism,
    ) -> PyResult<Evaluated<'a, 'a>> {
        let size = (system.n, self.r);
        Driven::new(system.rubbing(py), size, self.matrix(py)).ok_or_else(wrong_shape)
    }

    /// The same without the interpreter; `None` if the interpreter is needed.
    pub(crate) fn driven_alone<'a>(
        &self,
        py: Python<'_>,
        system: &'a Mechanism,
    ) -> Option<Native<'a>> {
        Driven::new(system.rubbing_alone(py)?, (system.n, self.r), self.native()?)
    }
}

fn wrong_shape() -> PyErr {
    PyValueError::new_err("inputs must be a matrix of shape (n, r)")
}
