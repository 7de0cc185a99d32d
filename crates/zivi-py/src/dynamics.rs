//! Mechanical systems that come from Python.

use crate::force::{Raised, Wall};
use crate::friction::{PyFriction, Rubbing};
use crate::interface::{vector, Capsule};
use crate::time_table::PyTimeTable;
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1, PyUntypedArrayMethods};
use pyo3::exceptions::{PyRuntimeError, PyTypeError, PyValueError};
use pyo3::gc::{PyTraverseError, PyVisit};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use std::ffi::{c_int, c_void};
use std::sync::Arc;
use zivi::mechanics::{ContactMode, GapSet};
use zivi::record::status::Failure;
use zivi::system::dynamics::{Dynamics, FunctionDynamics, Layout};
use zivi::system::linear_dynamics::LinearDynamics;
use zivi::system::linear_system::{GapMotion, LinearGap, LinearSystem, LoadWave};
use zivi::system::tree;
use zivi::system::tree::{Joint, JointKind, TreeDynamics, TreeFriction, TreeGap};

type Evaluate = unsafe extern "C" fn(f64, *const f64, *const f64, *mut f64) -> c_int;
type EvaluateWith =
    unsafe extern "C" fn(f64, *const f64, *const f64, *mut f64, *mut c_void) -> c_int;
type Fill = unsafe extern "C" fn(f64, *const f64, *const f64, *mut f64);
type FillWith = unsafe extern "C" fn(f64, *const f64, *const f64, *mut f64, *mut c_void);

/// What a compiled system is called with, after what it returns.
const ARGUMENTS: &str = "(double,double*,double*,double*";

/// The numbers of a mechanical system as a function of time and state, of one of its kinds.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct Model {
    kind: Kind,
}

enum Kind {
    /// A compiled function, and what owns its code.
    Compiled(CompiledFunction, Py<PyAny>),
    /// Matrices.
    Linear(Arc<LinearSystem>),
    /// Bodies and joints.
    Tree(Arc<tree::Tree>),
    /// A function, and whether it gives constants.
    Callable(Py<PyAny>, bool),
}

#[pymethods]
impl Model {
    /// A function at an address that returns 0, or else an error code, and is called with the data,
    /// if there are any. The owner of code and data lives as long as this.
    #[staticmethod]
    #[pyo3(signature = (address, *, data=None, owner))]
    fn compiled(address: usize, data: Option<usize>, owner: Py<PyAny>) -> Self {
        let function = CompiledFunction { address, data, returns_int: true };
        Self { kind: Kind::Compiled(function, owner) }
    }

    /// A function of the interpreter; `steady` if mass, force, gradients and rates are constants.
    #[staticmethod]
    #[pyo3(signature = (function, *, steady=false))]
    fn callable(function: Py<PyAny>, steady: bool) -> Self {
        Self { kind: Kind::Callable(function, steady) }
    }

    /// Where the compiled function is, if there is one, and the data that it is called with.
    #[getter]
    fn function(&self) -> Option<CompiledFunction> {
        match self.kind {
            Kind::Compiled(function, _) => Some(function),
            Kind::Linear(_) | Kind::Tree(_) | Kind::Callable(..) => None,
        }
    }

    /// The row of numbers at a state, `size` of them, which no other call writes over.
    fn evaluate<'py>(
        &self,
        t: f64,
        q: PyReadonlyArray1<'py, f64>,
        qdot: PyReadonlyArray1<'py, f64>,
        size: usize,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let (py, q, qdot) = (q.py(), q.as_slice()?, qdot.as_slice()?);
        let layout = match &self.kind {
            Kind::Compiled(function, _) => {
                // without a look at what it returns: numbers that are not finite are named later
                let mut row = vec![0.0; size];
                function.call(t, q, qdot, &mut row);
                return Ok(PyArray1::from_vec(py, row));
            }
            Kind::Linear(system) => Layout::smooth(system.load.len(), system.gaps.len()),
            Kind::Tree(tree) => tree.layout(),
            Kind::Callable(..) => {
                return Err(PyTypeError::new_err("a callable model is evaluated by its function"))
            }
        };
        if [q.len(), qdot.len()] != [layout.n; 2] || layout.len() != size {
            let n = layout.n;
            return Err(PyValueError::new_err(format!("q and qdot must have {n} entries")));
        }
        let mut row = vec![0.0; size];
        AnyDynamics::of(py, self, layout).evaluate(t, q, qdot, &mut row)?;
        Ok(PyArray1::from_vec(py, row))
    }

    /// Matrices row by row, the constant load, amplitude, frequency and phase of its waves, its
    /// tables; normal, offset and motion of each gap.
    #[staticmethod]
    #[pyo3(signature = (mass, damping, stiffness, *, load, waves, tables, gaps))]
    fn linear(
        mass: Vec<f64>,
        damping: Vec<f64>,
        stiffness: Vec<f64>,
        load: Vec<f64>,
        waves: Vec<(Vec<f64>, f64, f64)>,
        tables: Vec<Py<PyTimeTable>>,
        gaps: Vec<(Vec<f64>, f64, Option<Py<Wall>>)>,
    ) -> PyResult<Self> {
        let wave = |(amplitude, omega, phase)| LoadWave { amplitude, omega, phase };
        let waves = waves.into_iter().map(wave).collect();
        let tables = tables.iter().map(|table| table.get().inner.clone()).collect();
        let gap = |(normal, offset, wall): (_, _, Option<Py<Wall>>)| {
            let motion = match wall {
                None => Some(GapMotion::Fixed),
                Some(wall) => wall.get().motion_of_gap(),
            };
            motion.map(|motion| LinearGap { normal, offset, motion })
        };
        let gaps: Option<Vec<LinearGap>> = gaps.into_iter().map(gap).collect();
        let system = gaps.and_then(|gaps| {
            LinearSystem { mass, damping, stiffness, load, waves, tables, gaps }.validated()
        });
        let system =
            system.ok_or_else(|| PyValueError::new_err("the parts do not fit together"))?;
        Ok(Self { kind: Kind::Linear(Arc::new(system)) })
    }

    /// Bodies and joints.
    #[staticmethod]
    fn tree(tree: Py<Tree>) -> Self {
        Self { kind: Kind::Tree(tree.get().inner.clone()) }
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        match &self.kind {
            Kind::Compiled(_, held) | Kind::Callable(held, _) => visit.call(held),
            Kind::Linear(_) | Kind::Tree(_) => Ok(()),
        }
    }
}

/// A compiled function that fills in the numbers of a system, or a part of them.
#[pyclass(frozen, get_all, module = "zivi._zivi")]
#[derive(Clone, Copy)]
pub(crate) struct CompiledFunction {
    address: usize,
    /// What it is called with, if anything.
    data: Option<usize>,
    /// Whether it returns an int, 0 for success.
    returns_int: bool,
}

impl CompiledFunction {
    /// A function that returns an int and is called with data.
    pub(crate) fn with_data(address: usize, data: usize) -> Self {
        Self { address, data: Some(data), returns_int: true }
    }

    /// What it returns, 0 if nothing.
    pub(crate) fn call(self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> c_int {
        let Self { address, data, returns_int } = self;
        let (q, w, to) = (q.as_ptr(), w.as_ptr(), out.as_mut_ptr());
        // SAFETY: the Python layer passes only the address of a function whose signature was
        // checked or declared, and the `Model` holds the object that owns the code; `q` and `w` have n numbers, `out` as many as the layout says.
        unsafe {
            match (data.map(|data| data as *mut c_void), returns_int) {
                (None, true) => std::mem::transmute::<usize, Evaluate>(address)(t, q, w, to),
                (Some(data), true) => {
                    std::mem::transmute::<usize, EvaluateWith>(address)(t, q, w, to, data)
                }
                (None, false) => {
                    std::mem::transmute::<usize, Fill>(address)(t, q, w, to);
                    0
                }
                (Some(data), false) => {
                    std::mem::transmute::<usize, FillWith>(address)(t, q, w, to, data);
                    0
                }
            }
        }
    }
}

/// A model that is ready to be evaluated.
pub(crate) enum AnyDynamics<'py> {
    Compiled(CompiledDynamics),
    Callable(PythonDynamics<'py>),
}

impl<'py> AnyDynamics<'py> {
    pub(crate) fn of(py: Python<'py>, model: &Model, layout: Layout) -> Self {
        match &model.kind {
            Kind::Compiled(function, _) => {
                let (source, raised) = (Source::Function(*function), Raised::now());
                Self::Compiled(CompiledDynamics { layout, source, raised })
            }
            Kind::Linear(system) => {
                let source = Source::Linear(LinearDynamics::new(system.clone()));
                Self::Compiled(CompiledDynamics { layout, source, raised: Raised::now() })
            }
            Kind::Tree(tree) => {
                let source = Source::Tree(TreeDynamics::new(tree.clone()));
                Self::Compiled(CompiledDynamics { layout, source, raised: Raised::now() })
            }
            Kind::Callable(callable, steady) => {
                let zeros = || PyArray1::zeros(py, layout.n, false);
                let (callable, q, w) = (callable.bind(py).clone(), zeros(), zeros());
                Self::Callable(PythonDynamics { layout, callable, steady: *steady, q, w })
            }
        }
    }
}

impl Dynamics<PyErr> for AnyDynamics<'_> {
    fn layout(&self) -> Layout {
        match self {
            Self::Compiled(it) => it.layout(),
            Self::Callable(it) => it.layout(),
        }
    }

    fn evaluate(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> PyResult<()> {
        match self {
            Self::Compiled(it) => it.evaluate(t, q, w, out),
            Self::Callable(it) => it.evaluate(t, q, w, out),
        }
    }

    fn evaluate_again(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> PyResult<()> {
        match self {
            Self::Compiled(it) => it.evaluate_again(t, q, w, out),
            Self::Callable(it) => it.evaluate_again(t, q, w, out),
        }
    }

    fn evaluate_gaps(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> PyResult<()> {
        match self {
            Self::Compiled(it) => it.evaluate_gaps(t, q, w, out),
            Self::Callable(it) => it.evaluate_gaps(t, q, w, out),
        }
    }

    fn is_steady(&self) -> bool {
        match self {
            Self::Compiled(it) => it.is_steady(),
            Self::Callable(it) => it.is_steady(),
        }
    }

    fn linear(&self) -> Option<&Arc<LinearSystem>> {
        match self {
            Self::Compiled(it) => it.linear(),
            Self::Callable(_) => None,
        }
    }
}

/// A system that needs no interpreter. The [`Model`] holds what owns its code.
#[derive(Clone)]
pub(crate) struct CompiledDynamics {
    layout: Layout,
    source: Source,
    raised: Raised,
}

#[derive(Clone)]
enum Source {
    Function(CompiledFunction),
    Linear(LinearDynamics),
    Tree(TreeDynamics),
}

impl CompiledDynamics {
    /// The matrices, if it is a linear system.
    pub(crate) fn linear_system(&self) -> Option<&Arc<LinearSystem>> {
        Dynamics::<PyErr>::linear(self)
    }

    /// The tree, if it is one.
    pub(crate) fn tree(&self) -> Option<&Arc<tree::Tree>> {
        match &self.source {
            Source::Tree(dynamics) => Some(dynamics.tree()),
            Source::Function(_) | Source::Linear(_) => None,
        }
    }
}

impl Dynamics<PyErr> for CompiledDynamics {
    fn layout(&self) -> Layout {
        self.layout
    }

    fn evaluate(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> PyResult<()> {
        let function = match &mut self.source {
            Source::Function(function) => *function,
            Source::Linear(linear) => return linear.evaluate(t, q, w, out),
            Source::Tree(tree) => return tree.evaluate(t, q, w, out),
        };
        let code = function.call(t, q, w, out);
        if code != 0 || self.raised.here() {
            return Err(PyRuntimeError::new_err(format!(
                "the compiled system failed at t = {t:?} (it returned {code})"
            )));
        }
        Ok(())
    }

    fn evaluate_again(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> PyResult<()> {
        match &mut self.source {
            Source::Function(_) | Source::Tree(_) => self.evaluate(t, q, w, out),
            Source::Linear(linear) => linear.evaluate_again(t, q, w, out),
        }
    }

    fn evaluate_gaps(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> PyResult<()> {
        match &mut self.source {
            Source::Function(_) | Source::Tree(_) => self.evaluate(t, q, w, out),
            Source::Linear(linear) => linear.evaluate_gaps(t, q, w, out),
        }
    }

    fn linear(&self) -> Option<&Arc<LinearSystem>> {
        match &self.source {
            Source::Function(_) | Source::Tree(_) => None,
            Source::Linear(linear) => Dynamics::<PyErr>::linear(linear),
        }
    }
}

/// A Python callable; the interpreter lock is held for the whole run.
pub(crate) struct PythonDynamics<'py> {
    layout: Layout,
    callable: Bound<'py, PyAny>,
    steady: bool,
    /// What it is called with.
    q: Bound<'py, PyArray1<f64>>,
    w: Bound<'py, PyArray1<f64>>,
}

impl Dynamics<PyErr> for PythonDynamics<'_> {
    fn layout(&self) -> Layout {
        self.layout
    }

    fn evaluate(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> PyResult<()> {
        fill(&self.q, q)?;
        fill(&self.w, w)?;
        let value = self.callable.call1((t, &self.q, &self.w))?;
        crate::leaving::look()?;
        let array = value.cast::<PyArray1<f64>>().map_err(|_| {
            let kind = value.get_type();
            PyTypeError::new_err(format!("the system must return an array of float64, got {kind}"))
        })?;
        if array.len() != out.len() {
            let (got, wanted) = (array.len(), out.len());
            return Err(PyValueError::new_err(format!(
                "the system must return {wanted} numbers, got {got}"
            )));
        }
        let readable = array.readonly();
        for (out, value) in out.iter_mut().zip(readable.as_array()) {
            *out = *value;
        }
        Ok(())
    }

    fn is_steady(&self) -> bool {
        self.steady
    }
}

/// Writes numbers into an array that only this module and what it calls know.
pub(crate) fn fill(array: &Bound<'_, PyArray1<f64>>, values: &[f64]) -> PyResult<()> {
    let mut writable = array.try_readwrite().map_err(|_| {
        PyRuntimeError::new_err("the arrays that a system is called with must not be locked")
    })?;
    for (to, value) in writable.as_array_mut().iter_mut().zip(values) {
        *to = *value;
    }
    Ok(())
}

/// The function of a `scipy.LowLevelCallable`, after a check of its signature.
#[pyfunction]
pub(crate) fn compiled_model(
    callable: &Bound<'_, PyTuple>,
    argument: &str,
) -> PyResult<CompiledFunction> {
    let Capsule { address, data, signature } = Capsule::of(callable, argument)?;
    let written = signature.replace("const", "").replace(' ', "");
    for (returns, returns_int) in [("int", true), ("void", false)] {
        if written == format!("{returns}{ARGUMENTS})") {
            return Ok(CompiledFunction { address, data: None, returns_int });
        }
        if written == format!("{returns}{ARGUMENTS},void*)") {
            return Ok(CompiledFunction { address, data: Some(data), returns_int });
        }
    }
    Err(PyTypeError::new_err(format!(
        "{argument} must have the signature \"int (double, double *, double *, double *)\" (or \
         void, or with a last \"void *\"), got {signature:?}"
    )))
}

/// Whether all numbers of a model of `n` coordinates and `m` gaps are finite, its gaps open and no
/// gradient of them zero.
#[pyfunction]
pub(crate) fn is_sound(row: PyReadonlyArray1<'_, f64>, n: usize, m: usize) -> PyResult<bool> {
    let row = row.as_slice()?;
    let (gaps, gradients) = (n * (n + 1), n * (n + 1) + m);
    let (Some(gaps), Some(gradients)) = (row.get(gaps..gradients), row.get(gradients..)) else {
        return Ok(false);
    };
    let mut gradients = gradients.chunks_exact(n.max(1)).take(m);
    Ok(row.iter().all(|it| it.is_finite())
        && gaps.iter().all(|&gap| gap >= 0.0)
        && gradients.all(|gradient| gradient.iter().any(|&it| it != 0.0)))
}

/// Contact forces by gap, then forces of friction by channel, at an evaluation of a system with velocities
/// `w`: `friction` are its channels and compliant gaps, `closed` its gaps in contact, `modes` the numbers of
/// what its channels do. None where no forces keep the gaps closed.
#[pyfunction]
pub(crate) fn contact_forces<'py>(
    py: Python<'py>,
    row: PyReadonlyArray1<'_, f64>,
    w: PyReadonlyArray1<'_, f64>,
    friction: Option<&PyFriction>,
    closed: Vec<bool>,
    modes: Vec<i8>,
) -> PyResult<Option<Bound<'py, PyArray1<f64>>>> {
    let channels = PyFriction::given(friction).channels.len();
    let (row, w) = (row.as_slice()?, w.as_slice()?);
    let layout = Layout { n: w.len(), m: closed.len(), p: channels };
    if row.len() != layout.len() || modes.len() != layout.p || layout.rows() > GapSet::MOST {
        return Err(PyValueError::new_err(
            "row, closed and modes must have the sizes of one system",
        ));
    }
    let closed: GapSet = (0..layout.m).filter(|&gap| closed[gap]).collect();
    let acts = |(mode, (channel, number)): (ContactMode, (usize, i8))| match number {
        2 => mode,
        sign => mode.with_channel(channel, f64::from(sign)),
    };
    let each = modes.into_iter().enumerate();
    let mode = each.fold(ContactMode::from(closed), |mode, it| acts((mode, it)));
    let function = |_: f64, _: &[f64], _: &[f64], out: &mut [f64]| {
        out.copy_from_slice(row);
        Ok(())
    };
    let mut dynamics = Rubbing { dynamics: FunctionDynamics { layout, function }, friction };
    match py.detach(|| zivi::mechanics::contact_forces(&mut dynamics, w, mode)) {
        Ok(forces) => Ok(Some(PyArray1::from_vec(py, forces))),
        Err(Failure::Status(_)) => Ok(None),
        Err(Failure::Raised(error)) => Err(error),
    }
}

// Trees of bodies from Python.

/// Joints and gaps of a tree, and their numbers.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct Tree {
    pub(crate) inner: Arc<tree::Tree>,
}

/// The number of a joint; -1 is the world.
fn joint(number: i64) -> Option<usize> {
    usize::try_from(number).ok()
}

fn gap_of((kind, a, b): &(String, i64, i64)) -> Option<TreeGap> {
    match (kind.as_str(), joint(*a)) {
        ("lower", Some(a)) => Some(TreeGap::Lower(a)),
        ("upper", Some(a)) => Some(TreeGap::Upper(a)),
        ("plane", Some(a)) => Some(TreeGap::Plane(a)),
        ("balls", a) => Some(TreeGap::Balls(a, joint(*b))),
        _ => None,
    }
}

fn friction_of((kind, at): &(String, usize)) -> Option<TreeFriction> {
    match kind.as_str() {
        "joint" => Some(TreeFriction::Joint(*at)),
        "plane" => Some(TreeFriction::Plane(*at)),
        _ => None,
    }
}

#[pymethods]
impl Tree {
    /// Parent (-1 for the world) and whether it is a slide, of each joint; kind and joints of each
    /// gap: "lower", "upper", "plane" or "balls"; kind and number of each channel of friction: "joint", or
    /// "plane" with the number of its gap; the numbers as `zivi::system::tree::Tree` has them.
    #[new]
    #[pyo3(signature = (joints, gaps, friction, numbers))]
    fn new(
        joints: Vec<(i64, bool)>,
        gaps: Vec<(String, i64, i64)>,
        friction: Vec<(String, usize)>,
        numbers: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Self> {
        let kind = |slide| if slide { JointKind::Slide } else { JointKind::Hinge };
        let joints = joints
            .into_iter()
            .map(|(parent, slide)| Joint { parent: joint(parent), kind: kind(slide) })
            .collect();
        let gaps: Option<Vec<TreeGap>> = gaps.iter().map(gap_of).collect();
        let friction: Option<Vec<TreeFriction>> = friction.iter().map(friction_of).collect();
        let numbers = vector(&numbers)?;
        let tree = gaps.zip(friction).and_then(|(gaps, friction)| {
            tree::Tree { joints, gaps, friction, numbers }.validated()
        });
        let tree = tree.ok_or_else(|| PyValueError::new_err("the parts do not fit together"))?;
        Ok(Self { inner: Arc::new(tree) })
    }
}
