//! Systems, tables and impact laws from Python, and arguments of runs.
//!
//! Arguments of a run: system, initial state, stored data.

use crate::dynamics::{AnyDynamics, CompiledDynamics, Model};
use crate::force::{compiled_ratio, Force};
use crate::friction::{PyFriction, Rubbing};
use crate::interface::{array, setup_error, vector, Array};
use crate::method::{PyEvent, PySetting};
use crate::transform::from_both;
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::gc::{PyTraverseError, PyVisit};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use zivi::mechanics::MotionPoint;
use zivi::system::dynamics::Layout;
use zivi::system::force::Friction;
use zivi::system::impact_law::{newton_impacts, FunctionImpact, TabulatedImpact};
use zivi::{AnyImpactLaw, Kick, PathPoint, Physical};

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
        Rubbing { dynamics, friction: self.laws_of_contact() }
    }

    /// Its evaluator without friction and without the interpreter; `None` if that is needed.
    pub(crate) fn native_dynamics(&self) -> Option<CompiledDynamics> {
        CompiledDynamics::of(self.model.get(), self.layout())
    }

    /// The same without the interpreter; `None` if the interpreter is needed.
    pub(crate) fn rubbing_alone(&self, py: Python<'_>) -> Option<Rubbing<'_, CompiledDynamics>> {
        match AnyDynamics::of(py, self.model.get(), self.layout()) {
            AnyDynamics::Compiled(dynamics) => {
                Some(Rubbing { dynamics, friction: self.laws_of_contact() })
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
#[pyclass(frozen, module = "zivi._zivi", name = "Keep")]
pub(crate) struct PyKeep {
    /// Times of the samples, if given.
    pub(crate) t_eval: Option<Py<PyArray1<f64>>>,
    /// Times where the force is not smooth.
    pub(crate) tstops: Option<Py<PyArray1<f64>>>,
    /// The velocities after a kick at one of these times, None without kicks: a function of the
    /// time, the position and the velocity.
    pub(crate) kicks: Option<Py<PyAny>>,
    pub(crate) events: Vec<Py<PyEvent>>,
    /// Whether without times only the ends are sampled.
    pub(crate) ends: bool,
    /// Whether the motion between the samples is kept.
    pub(crate) dense: bool,
    /// Whether at least the arcs of it are kept that jumps skip.
    pub(crate) arcs: bool,
}

#[pymethods]
impl PyKeep {
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

impl PyKeep {
    /// Whether user functions other than the forces are called.
    pub(crate) fn calls(&self) -> bool {
        !self.events.is_empty() || self.kicks.is_some()
    }

    /// Kicks of a mass.
    pub(crate) fn kicks_of_point<'py>(
        &self,
        py: Python<'py>,
    ) -> Option<Kick<'py, PyErr, PathPoint>> {
        self.kicks.as_ref().map(|function| kick_of_point(py, function))
    }
}

/// A kick of a mass, by a function of the time, the position and the velocity.
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

/// Kicks of a mechanical system of `n` coordinates.
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
