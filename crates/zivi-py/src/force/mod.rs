//! Forces from Python: how each kind is given. Its evaluation is in the other files of this folder.

mod callable;
pub(crate) mod kind;
mod native;
pub(crate) mod wall;

use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::gc::{PyTraverseError, PyVisit};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use zivi::system::slopes::Differenced;

use callable::{ParametricForce, WithJacobian};
use kind::{AnySlopes, Callable, Kind, Native};
use wall::AnyWall;
use wall::PyTimeTable;

pub(crate) use callable::{with_force, AnyForce};
pub(crate) use native::{
    compiled_ratio, force_raised, with_native, with_native_slopes, AnyNative, CompiledForce,
    NativeSlopes, Raised,
};
pub(crate) use wall::Wall;

/// A force of one of its kinds.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct Force {
    kind: Box<dyn Kind>,
}

impl Force {
    fn of(kind: impl Kind + 'static) -> Self {
        Self { kind: Box::new(kind) }
    }

    /// Ready to be evaluated.
    pub(crate) fn on<'py>(&self, py: Python<'py>) -> AnyForce<'py> {
        self.kind.on(py)
    }

    /// With its partial derivatives, for a span of a duration (s).
    pub(crate) fn slopes<'py>(&self, py: Python<'py>, duration: f64) -> PyResult<AnySlopes<'py>> {
        self.kind.slopes(py, duration)
    }
}

#[pymethods]
impl Force {
    #[staticmethod]
    fn constant(value: f64) -> Self {
        Self::of(Native { force: AnyNative::Constant(zivi::ConstantForce(value)), owner: None })
    }

    /// A force of the library, by the name of its class and its numbers by theirs.
    #[staticmethod]
    #[pyo3(signature = (name, **numbers))]
    fn native(name: &str, numbers: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let known = AnyNative::CLASSES.iter().flatten().find(|(class, _)| *class == name);
        let Some((_, names)) = known else {
            return Err(PyValueError::new_err(format!("no native force {name:?}")));
        };
        let mut values = Vec::with_capacity(names.len());
        for name in *names {
            let given = numbers.map(|it| it.get_item(name)).transpose()?.flatten();
            let missing = || PyTypeError::new_err(format!("{name} must be given"));
            values.push(given.ok_or_else(missing)?.extract::<f64>()?);
        }
        if numbers.map_or(0, |it| it.len()) > names.len() {
            let message = format!("{name} takes {} only", names.join(", "));
            return Err(PyTypeError::new_err(message));
        }
        let force = AnyNative::of(name, &values);
        let force =
            force.ok_or_else(|| PyValueError::new_err(format!("no native force {name:?}")))?;
        Ok(Self::of(Native { force, owner: None }))
    }

    /// A linear force from its numbers in their order, with an additional excitation table.
    #[staticmethod]
    fn with_table(numbers: [f64; 6], table: Py<PyTimeTable>) -> Self {
        let [stiffness, damping, gravity, amplitude, omega, phase] = numbers;
        let linear = zivi::LinearForce { stiffness, damping, gravity, amplitude, omega, phase };
        let force = zivi::TableForce { linear, table: PyTimeTable::held(&table) };
        Self::of(Native { force: AnyNative::Table(force), owner: Some(table.into_any()) })
    }

    /// A function at an address, called with time, state and the values of its parameters. The
    /// owner keeps its code alive.
    #[staticmethod]
    #[pyo3(signature = (address, *, parameters=Vec::new(), owner, reads_time=true))]
    fn compiled(
        address: usize,
        parameters: Vec<f64>,
        owner: Py<PyAny>,
        reads_time: bool,
    ) -> PyResult<Self> {
        let force = CompiledForce::new(address, None, &parameters)?.reading_time(reads_time);
        Ok(Self::of(Native { force: AnyNative::Compiled(force), owner: Some(owner) }))
    }

    /// The function of a `scipy.LowLevelCallable`, which the error for a wrong signature names.
    #[staticmethod]
    fn low_level(callable: &Bound<'_, PyTuple>, argument: &str) -> PyResult<Self> {
        let force = AnyNative::Compiled(CompiledForce::of_low_level(callable, argument)?);
        Ok(Self::of(Native { force, owner: Some(callable.clone().into_any().unbind()) }))
    }

    /// A function in the interpreter, `f(t, y)` with an array if `of_array`, else `f(t, x, xdot)`.
    #[staticmethod]
    #[pyo3(signature = (function, *, of_array=false, reads_time=true))]
    fn callable(function: Py<PyAny>, of_array: bool, reads_time: bool) -> Self {
        Self::of(Callable { function, of_array, reads_time })
    }

    #[staticmethod]
    #[pyo3(signature = (plain, function, values, jacobian=None))]
    fn parametric(
        plain: Py<Self>,
        function: Py<PyAny>,
        values: Vec<f64>,
        jacobian: Option<Py<PyAny>>,
    ) -> Self {
        Self::of(Parametric { plain, function, values, jacobian })
    }

    #[staticmethod]
    fn above(wall: Py<Wall>, force: Py<Self>) -> PyResult<Self> {
        if force.get().kind.moves() {
            return Err(PyValueError::new_err("a moving wall above a moving wall"));
        }
        Ok(Self::of(Moving { force, wall }))
    }

    /// Whether it is one number, whatever time and state are.
    #[getter]
    fn is_constant(&self) -> bool {
        self.kind.is_constant()
    }

    /// Whether a compiled function is called, which may raise what C cannot hand on.
    #[getter]
    fn is_compiled(&self) -> bool {
        self.address().is_some()
    }

    /// Address of the compiled function, if any.
    #[getter]
    fn address(&self) -> Option<usize> {
        self.kind.address()
    }

    /// Whether runs do without the interpreter.
    #[getter]
    fn is_native(&self) -> bool {
        self.kind.is_native()
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        self.kind.traverse(&visit)
    }
}

/// A force with parameters by which a run can be differentiated.
struct Parametric {
    /// The same for runs without derivatives.
    plain: Py<Force>,
    /// `f(t, x, xdot, *values)`.
    function: Py<PyAny>,
    values: Vec<f64>,
    /// Gives `(f_t, f_x, f_xdot, f_q, ...)`.
    jacobian: Option<Py<PyAny>>,
}

impl Kind for Parametric {
    fn on<'py>(&self, py: Python<'py>) -> AnyForce<'py> {
        self.plain.get().on(py)
    }

    fn slopes<'py>(&self, py: Python<'py>, duration: f64) -> PyResult<AnySlopes<'py>> {
        if self.jacobian.is_none() && self.plain.get().kind.takes_parameters() {
            return self.plain.get().slopes(py, duration);
        }
        let callable = self.function.bind(py).clone();
        let force = ParametricForce { callable, values: self.values.clone() };
        Ok(match &self.jacobian {
            None => AnySlopes::Parametric(Differenced::new(force, duration)),
            Some(jacobian) => {
                AnySlopes::Jacobian(WithJacobian { force, jacobian: jacobian.bind(py).clone() })
            }
        })
    }

    fn is_native(&self) -> bool {
        self.plain.get().is_native()
    }

    fn address(&self) -> Option<usize> {
        self.plain.get().address()
    }

    fn traverse(&self, visit: &PyVisit<'_>) -> Result<(), PyTraverseError> {
        visit.call(&self.plain)?;
        visit.call(&self.function)?;
        visit.call(&self.jacobian)
    }
}

/// A force of the fixed frame, seen from a wall that moves.
struct Moving {
    force: Py<Force>,
    wall: Py<Wall>,
}

impl Kind for Moving {
    fn on<'py>(&self, py: Python<'py>) -> AnyForce<'py> {
        let (force, wall) = (self.force.get().on(py), AnyWall::of(py, self.wall.get()));
        AnyForce::Moving(Box::new(zivi::OnMovingWall { force, wall }))
    }

    fn slopes<'py>(&self, py: Python<'py>, duration: f64) -> PyResult<AnySlopes<'py>> {
        let AnyWall::Harmonic(wall) = AnyWall::of(py, self.wall.get()) else {
            return Ok(AnySlopes::Other(Differenced::new(self.on(py), duration)));
        };
        self.force.get().slopes(py, duration)?.above(wall)
    }

    fn is_native(&self) -> bool {
        self.force.get().is_native() && self.wall.get().is_native()
    }

    fn address(&self) -> Option<usize> {
        self.force.get().address()
    }

    fn moves(&self) -> bool {
        true
    }

    fn traverse(&self, visit: &PyVisit<'_>) -> Result<(), PyTraverseError> {
        visit.call(&self.force)?;
        visit.call(&self.wall)
    }
}

/// The cosine of waves, as the core evaluates it.
#[pyfunction]
pub(crate) fn cosine(x: f64) -> f64 {
    zivi_core::cosine::cos(x)
}
