//! Mechanical systems that come from Python.

use crate::force::wall::PyTimeTable;
use crate::force::{Raised, Wall};
use crate::friction::{PyFriction, Rubbing};
use crate::interface::{vector, Capsule, Function};
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1, PyUntypedArrayMethods};
use pyo3::exceptions::{PyRuntimeError, PyTypeError, PyValueError};
use pyo3::gc::{PyTraverseError, PyVisit};
use pyo3::prelude::*;
use pyo3::types::{PyFloat, PyList, PyTuple};
use std::ffi::{c_int, c_void};
use std::sync::Arc;
use zivi::mechanics::{ContactMode, GapSet};
use zivi::record::status::Failure;
use zivi::system::dynamics::{Dynamics, FunctionDynamics, Layout};
use zivi::system::linear_dynamics::FlatParts;
use zivi::system::linear_dynamics::LinearDynamics;
use zivi::system::linear_system::{GapMotion, LinearGap, LinearSystem, LoadWave};
use zivi::system::tree;
use zivi::system::tree::{Joint, JointKind, TreeConstraint, TreeDynamics, TreeFriction, TreeGap};

type Evaluate = unsafe extern "C" fn(f64, *const f64, *const f64, *mut f64) -> c_int;
type EvaluateWith =
    unsafe extern "C" fn(f64, *const f64, *const f64, *mut f64, *mut c_void) -> c_int;
type Fill = unsafe extern "C" fn(f64, *const f64, *const f64, *mut f64);
type FillWith = unsafe extern "C" fn(f64, *const f64, *const f64, *mut f64, *mut c_void);

/// Argument types of a compiled system, after the return type.
const ARGUMENTS: &str = "(double,double*,double*,double*";

/// The numbers of a mechanical system as a function of time and state, of one of its kinds.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct Model {
    kind: Kind,
}

enum Kind {
    /// A compiled function and the owner of its code.
    Compiled(CompiledRows, Py<PyAny>),
    /// Matrices.
    Linear(Arc<LinearSystem>),
    /// Bodies and joints, functions of time that rows follow, and the owner of their code.
    Tree(Arc<tree::Tree>, Arc<[(usize, CompiledFunction)]>, Option<Py<PyAny>>),
    /// Constants, flat gaps, and functions for the rest.
    Parts(Arc<SystemParts>),
    /// A function, and whether it is constant.
    Callable(Py<PyAny>, bool),
}

#[pymethods]
impl Model {
    /// A function at an address that returns 0 or an error code, and is called with the data,
    /// if there are any. The owner keeps code and data alive. `equalities` is the address of a function that
    /// computes only the numbers of the equality rows; `drives` are rows from which prescribed motion is
    /// taken, of `layout`, the numbers of coordinates, gaps, channels and rows.
    #[staticmethod]
    #[pyo3(signature = (address, *, data=None, owner, equalities=None, drives=vec![], layout=None))]
    fn compiled(
        address: usize,
        data: Option<usize>,
        owner: Py<PyAny>,
        equalities: Option<usize>,
        drives: Vec<(usize, Py<Wall>)>,
        layout: Option<(usize, usize, usize, usize)>,
    ) -> PyResult<Self> {
        let of = |address| CompiledFunction { address, data, returns_int: true };
        let (n, m, p, k) = layout.unwrap_or_default();
        let rows = CompiledRows {
            function: of(address),
            equalities: equalities.map(of),
            drives: drives_of(&drives)?.into(),
            layout: Layout { n, m, p, k },
        };
        if rows.drives.iter().any(|drive| drive.0 >= k) {
            return Err(PyValueError::new_err("drives must be of rows that there are"));
        }
        Ok(Self { kind: Kind::Compiled(rows, owner) })
    }

    /// A function of the interpreter; `steady` if mass, force, gradients and rates are constants.
    #[staticmethod]
    #[pyo3(signature = (function, *, steady=false))]
    fn callable(function: Py<PyAny>, steady: bool) -> Self {
        Self { kind: Kind::Callable(function, steady) }
    }

    /// Whether runs do without the interpreter.
    #[getter]
    fn is_native(&self) -> bool {
        match &self.kind {
            Kind::Compiled(..) | Kind::Linear(_) | Kind::Tree(..) => true,
            Kind::Parts(parts) => !parts.needs_interpreter(),
            Kind::Callable(..) => false,
        }
    }

    /// Constants in the places of an evaluation, flat gaps by number as those of `linear`, moving
    /// surfaces by channel, channels with equal friction limits while sticking and slipping, and functions for the
    /// rest. `steady` and `constant`: whether forces, and whether mass and gradients never change.
    #[staticmethod]
    #[pyo3(signature = (
        sizes, row, *, gaps, belts, without_static, functions, steady, constant, owner
    ))]
    #[allow(clippy::too_many_arguments, clippy::type_complexity)]
    fn parts(
        sizes: (usize, usize, usize, usize),
        row: PyReadonlyArray1<'_, f64>,
        gaps: Vec<(usize, Vec<f64>, f64, Option<Py<Wall>>)>,
        belts: Vec<(usize, Py<Wall>)>,
        without_static: Vec<usize>,
        functions: Vec<Py<PyPart>>,
        steady: bool,
        constant: bool,
        owner: Py<PyAny>,
    ) -> PyResult<Self> {
        let (n, m, p, k) = sizes;
        let motion = |wall: &Py<Wall>| wall.get().motion_of_gap();
        let gap = |(i, normal, offset, wall): (_, _, _, Option<Py<Wall>>)| {
            let motion = wall.as_ref().map_or(Some(GapMotion::Fixed), motion);
            motion.map(|motion| (i, LinearGap { normal, offset, motion }))
        };
        let gaps: Option<Vec<(usize, LinearGap)>> = gaps.into_iter().map(gap).collect();
        let belts: Option<Vec<_>> =
            belts.iter().map(|(channel, wall)| Some((*channel, motion(wall)?))).collect();
        let (row, layout) = (vector(&row)?, Layout { n, m, p, k });
        let fits = functions.iter().all(|it| it.get().fits(layout));
        let flat = gaps
            .zip(belts)
            .filter(|_| fits)
            .and_then(|(gaps, belts)| FlatParts::new(layout, row, gaps, belts, without_static));
        let flat = flat.ok_or_else(|| PyValueError::new_err("the parts do not fit together"))?;
        let flat = if constant { flat.with_constant_matrices() } else { flat };
        let parts = SystemParts { flat, functions, steady, owner };
        Ok(Self { kind: Kind::Parts(Arc::new(parts)) })
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
                // without a check of its values: numbers that are not finite are reported later
                let mut row = vec![0.0; size];
                function.fill(t, q, qdot, &mut row);
                return Ok(PyArray1::from_vec(py, row));
            }
            Kind::Linear(system) => Layout::smooth(system.load.len(), system.gaps.len()),
            Kind::Tree(tree, ..) => tree.layout(),
            Kind::Parts(parts) => parts.flat.layout(),
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

    /// Bodies and joints; rows that follow compiled functions of time, which return position, velocity and
    /// acceleration, by their addresses, and the owner of their code.
    #[staticmethod]
    #[pyo3(signature = (tree, *, drives=vec![], owner=None))]
    fn tree(
        tree: Py<Tree>,
        drives: Vec<(usize, usize)>,
        owner: Option<Py<PyAny>>,
    ) -> PyResult<Self> {
        let tree = tree.get().inner.clone();
        if drives.iter().any(|drive| drive.0 >= tree.layout().k) {
            return Err(PyValueError::new_err("drives must be of rows that there are"));
        }
        let function = |(row, address)| (row, CompiledFunction::with_data(address, 0));
        let drives: Arc<[_]> = drives.into_iter().map(function).collect();
        Ok(Self { kind: Kind::Tree(tree, drives, owner) })
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        match &self.kind {
            Kind::Compiled(_, held) | Kind::Callable(held, _) => visit.call(held),
            Kind::Parts(parts) => {
                visit.call(&parts.owner)?;
                parts.functions.iter().try_for_each(|it| visit.call(it))
            }
            Kind::Tree(_, _, owner) => visit.call(owner),
            Kind::Linear(_) => Ok(()),
        }
    }
}

// Systems of parts: numbers without a function are computed here.

/// A function that computes a slice of the numbers of an evaluation.
#[pyclass(name = "Part", frozen, module = "zivi._zivi")]
pub(crate) struct PyPart {
    start: usize,
    length: usize,
    by: PartKind,
}

enum PartKind {
    /// A compiled function.
    Compiled(CompiledFunction),
    /// A compiled function with the values of a table as additional argument.
    Driven(usize, Arc<zivi::TimeTable>),
    /// A function of time and coordinates, with velocities or without; what reads results that are not
    /// plain numbers, or raises an error that names the part; dimensions of the result.
    Python { function: Py<PyAny>, takes_velocities: bool, read: Py<PyAny>, dimensions: usize },
    /// The motion of a wall: three numbers of the gap with this number.
    Wall { gap: usize, motion: Py<PyAny> },
    /// The friction limit of a channel as a function of its slip speed, and its reader.
    OfSpeed { channel: usize, function: Py<PyAny>, read: Py<PyAny> },
}

#[pymethods]
impl PyPart {
    #[staticmethod]
    #[pyo3(signature = (start, length, address, data=None))]
    fn compiled(start: usize, length: usize, address: usize, data: Option<usize>) -> Self {
        let function = CompiledFunction { address, data, returns_int: false };
        Self { start, length, by: PartKind::Compiled(function) }
    }

    #[staticmethod]
    fn driven(start: usize, length: usize, address: usize, table: Py<PyTimeTable>) -> Self {
        Self { start, length, by: PartKind::Driven(address, table.get().inner.clone()) }
    }

    #[staticmethod]
    #[pyo3(signature = (start, shape, function, *, takes_velocities, read))]
    fn python(
        start: usize,
        shape: Vec<usize>,
        function: Py<PyAny>,
        takes_velocities: bool,
        read: Py<PyAny>,
    ) -> Self {
        let (length, dimensions) = (shape.iter().product(), shape.len());
        Self {
            start,
            length,
            by: PartKind::Python { function, takes_velocities, read, dimensions },
        }
    }

    #[staticmethod]
    fn wall(gap: usize, motion: Py<PyAny>) -> Self {
        Self { start: 0, length: 0, by: PartKind::Wall { gap, motion } }
    }

    #[staticmethod]
    fn of_speed(channel: usize, function: Py<PyAny>, read: Py<PyAny>) -> Self {
        Self { start: 0, length: 0, by: PartKind::OfSpeed { channel, function, read } }
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        match &self.by {
            PartKind::Compiled(_) | PartKind::Driven(..) => Ok(()),
            PartKind::Wall { motion, .. } => visit.call(motion),
            PartKind::Python { function, read, .. } | PartKind::OfSpeed { function, read, .. } => {
                visit.call(function)?;
                visit.call(read)
            }
        }
    }
}

/// `void (double t, double *q, double *qdot, double *u, double *out)`.
type FillDriven = unsafe extern "C" fn(f64, *const f64, *const f64, *const f64, *mut f64);

impl PyPart {
    fn fits(&self, layout: Layout) -> bool {
        match &self.by {
            PartKind::Wall { gap, .. } => *gap < layout.m,
            PartKind::OfSpeed { channel, .. } => *channel < layout.p,
            _ => self.start.checked_add(self.length).is_some_and(|end| end <= layout.len()),
        }
    }

    fn is_native(&self) -> bool {
        matches!(self.by, PartKind::Compiled(_) | PartKind::Driven(..))
    }

    /// Fills in its numbers if it is compiled.
    fn fill(&self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) {
        let to = &mut out[self.start..][..self.length];
        match &self.by {
            PartKind::Compiled(function) => {
                function.call(t, q, w, to);
            }
            PartKind::Driven(address, table) => {
                let mut u = vec![0.0; table.width()];
                table.values(t, &mut u);
                // SAFETY: the Python layer passes a function with this signature, which the owner
                // of the parts keeps alive, and room for its result
                unsafe {
                    let function = std::mem::transmute::<usize, FillDriven>(*address);
                    function(t, q.as_ptr(), w.as_ptr(), u.as_ptr(), to.as_mut_ptr());
                }
            }
            PartKind::Python { .. } | PartKind::Wall { .. } | PartKind::OfSpeed { .. } => (),
        }
    }
}

/// A system of parts.
struct SystemParts {
    flat: FlatParts,
    /// In the order of their calls.
    functions: Vec<Py<PyPart>>,
    steady: bool,
    /// Owner of the compiled code.
    owner: Py<PyAny>,
}

/// Which numbers of an evaluation are written.
#[derive(Clone, Copy, PartialEq)]
enum EvaluationScope {
    All,
    /// Those that may differ from the last evaluation.
    Varying,
    /// Those of the gaps, where mass and gradients never change.
    Gaps,
    /// Those of the equality rows.
    Equalities,
}

impl SystemParts {
    fn needs_interpreter(&self) -> bool {
        !self.functions.iter().all(|it| it.get().is_native())
    }

    /// Writes the numbers that do not depend on a function.
    fn write(&self, scope: EvaluationScope, t: f64, q: &[f64], out: &mut [f64]) {
        match scope {
            EvaluationScope::All => self.flat.write(t, q, out),
            EvaluationScope::Varying => self.flat.write_again(t, q, out),
            EvaluationScope::Gaps => self.flat.write_gaps(t, q, out),
            EvaluationScope::Equalities => (),
        }
    }

    /// Whether a function is called for these numbers.
    fn is_called(&self, part: &PyPart, scope: EvaluationScope) -> bool {
        let layout = self.flat.layout();
        match scope {
            EvaluationScope::All | EvaluationScope::Varying => true,
            EvaluationScope::Gaps => {
                matches!(part.by, PartKind::Wall { .. }) || part.start >= layout.gap().start
            }
            EvaluationScope::Equalities => part.start >= layout.equality().start && part.length > 0,
        }
    }

    /// Evaluates a system of compiled functions.
    fn evaluate(&self, scope: EvaluationScope, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) {
        self.write(scope, t, q, out);
        for part in self.functions.iter().map(Py::get).filter(|it| self.is_called(it, scope)) {
            part.fill(t, q, w, out);
        }
        self.flat.finish(out);
    }
}

/// The Python function of a part, if it has one.
fn callable_of<'py>(py: Python<'py>, part: &Py<PyPart>) -> Option<Function<'py>> {
    match &part.get().by {
        PartKind::Compiled(_) | PartKind::Driven(..) => None,
        PartKind::Wall { motion: it, .. }
        | PartKind::Python { function: it, .. }
        | PartKind::OfSpeed { function: it, .. } => Some(Function::new(it.bind(py).clone())),
    }
}

/// Reads a return value: numbers directly, other objects through Python.
fn read_into(
    value: &Bound<'_, PyAny>,
    dimensions: usize,
    read: &Py<PyAny>,
    out: &mut [f64],
) -> PyResult<()> {
    if let [out] = out {
        if let Ok(number) = value.cast::<PyFloat>() {
            *out = number.value();
            return Ok(());
        }
    }
    if dimensions == 1 {
        if let Ok(array) = value.cast::<PyArray1<f64>>() {
            if array.len() == out.len() {
                let readable = array.readonly();
                out.iter_mut().zip(readable.as_array()).for_each(|(out, value)| *out = *value);
                return Ok(());
            }
        } else if let Ok(items) = value.cast::<PyList>() {
            let number = |it: Bound<'_, PyAny>| it.cast::<PyFloat>().ok().map(|it| it.value());
            if items.len() == out.len() {
                let all = items
                    .iter()
                    .zip(&mut *out)
                    .all(|(item, out)| number(item).map(|value| *out = value).is_some());
                if all {
                    return Ok(());
                }
            }
        }
    }
    let array = read.bind(value.py()).call1((value,))?;
    let array = array.cast::<PyArray1<f64>>()?.readonly();
    let array = array.as_array();
    if array.len() != out.len() {
        return Err(PyValueError::new_err("a part must give as many numbers as it has places"));
    }
    out.iter_mut().zip(array).for_each(|(out, value)| *out = *value);
    Ok(())
}

/// A compiled function that fills in the numbers of a system, or a part of them.
#[pyclass(frozen, get_all, module = "zivi._zivi")]
#[derive(Clone, Copy)]
pub(crate) struct CompiledFunction {
    address: usize,
    /// Its data argument, if any.
    data: Option<usize>,
    /// Whether it returns an int, 0 for success.
    returns_int: bool,
}

impl CompiledFunction {
    /// A function that returns an int and is called with data.
    pub(crate) fn with_data(address: usize, data: usize) -> Self {
        Self { address, data: Some(data), returns_int: true }
    }

    /// Its return code, 0 for void functions.
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

/// A compiled function that computes all numbers of a system.
#[derive(Clone)]
struct CompiledRows {
    function: CompiledFunction,
    /// A compiled function that computes only the equality rows.
    equalities: Option<CompiledFunction>,
    /// Rows from which prescribed motion is taken.
    drives: Arc<[(usize, GapMotion)]>,
    layout: Layout,
}

impl CompiledRows {
    fn fill(&self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> c_int {
        let code = self.function.call(t, q, w, out);
        self.drive(t, out);
        code
    }

    fn fill_equalities(&self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> c_int {
        let Some(function) = &self.equalities else { return self.fill(t, q, w, out) };
        let code = function.call(t, q, w, &mut out[self.layout.equality().start..]);
        self.drive(t, out);
        code
    }

    fn drive(&self, t: f64, out: &mut [f64]) {
        for (row, motion) in self.drives.iter() {
            let [place, rate, acceleration] = motion.at(t);
            out[self.layout.equality().start + row] -= place;
            out[self.layout.equality_rate().start + row] -= rate;
            out[self.layout.equality_curvature().start + row] -= acceleration;
        }
    }
}

/// Removes compiled functions of time from equality rows; returns the last error code of them, or 0.
fn drive_rows(
    drives: &[(usize, CompiledFunction)],
    layout: Layout,
    t: f64,
    out: &mut [f64],
) -> c_int {
    let mut failure = 0;
    for (row, function) in drives {
        let mut motion = [0.0; 3];
        let code = function.call(t, &[], &[], &mut motion);
        failure = if code == 0 { failure } else { code };
        out[layout.equality().start + row] -= motion[0];
        out[layout.equality_rate().start + row] -= motion[1];
        out[layout.equality_curvature().start + row] -= motion[2];
    }
    failure
}

/// Prescribed motion without the interpreter.
fn drives_of(given: &[(usize, Py<Wall>)]) -> PyResult<Vec<(usize, GapMotion)>> {
    let drive = |(row, wall): &(usize, Py<Wall>)| Some((*row, wall.get().motion_of_gap()?));
    let all: Option<Vec<_>> = given.iter().map(drive).collect();
    all.ok_or_else(|| PyValueError::new_err("drives must be tables or harmonic motion"))
}

/// A model that is ready to be evaluated.
pub(crate) enum AnyDynamics<'py> {
    Compiled(CompiledDynamics),
    Callable(PythonDynamics<'py>),
}

impl<'py> AnyDynamics<'py> {
    pub(crate) fn of(py: Python<'py>, model: &Model, layout: Layout) -> Self {
        match model.evaluator() {
            Evaluator::Native(source) => {
                Self::Compiled(CompiledDynamics { layout, source, raised: Raised::now() })
            }
            Evaluator::Parts(parts) => {
                let functions = parts.functions.iter().map(|it| callable_of(py, it)).collect();
                let source = PythonSource::Parts(parts.clone(), functions);
                Self::Callable(PythonDynamics::new(py, layout, source, parts.steady))
            }
            Evaluator::Callable(callable, steady) => {
                let source = PythonSource::Row(callable.bind(py).clone());
                Self::Callable(PythonDynamics::new(py, layout, source, steady))
            }
        }
    }
}

/// Evaluator of a model.
enum Evaluator<'a> {
    /// Works without the interpreter.
    Native(Source),
    Parts(&'a Arc<SystemParts>),
    Callable(&'a Py<PyAny>, bool),
}

impl Model {
    fn evaluator(&self) -> Evaluator<'_> {
        Evaluator::Native(match &self.kind {
            Kind::Compiled(function, _) => Source::Function(function.clone()),
            Kind::Linear(system) => Source::Linear(LinearDynamics::new(system.clone())),
            Kind::Tree(tree, drives, _) => {
                Source::Tree(TreeDynamics::new(tree.clone()), drives.clone())
            }
            Kind::Parts(parts) if !parts.needs_interpreter() => Source::Parts(parts.clone()),
            Kind::Parts(parts) => return Evaluator::Parts(parts),
            Kind::Callable(callable, steady) => return Evaluator::Callable(callable, *steady),
        })
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

    fn evaluate_equalities(
        &mut self,
        t: f64,
        q: &[f64],
        w: &[f64],
        out: &mut [f64],
    ) -> PyResult<()> {
        match self {
            Self::Compiled(it) => it.evaluate_equalities(t, q, w, out),
            Self::Callable(it) => it.evaluate_equalities(t, q, w, out),
        }
    }

    fn has_separate_equalities(&self) -> bool {
        match self {
            Self::Compiled(it) => it.has_separate_equalities(),
            Self::Callable(it) => it.has_separate_equalities(),
        }
    }

    fn is_steady(&self) -> bool {
        match self {
            Self::Compiled(it) => it.is_steady(),
            Self::Callable(it) => it.is_steady(),
        }
    }

    fn is_autonomous(&self) -> bool {
        match self {
            Self::Compiled(it) => it.is_autonomous(),
            Self::Callable(_) => false,
        }
    }

    fn linear(&self) -> Option<&Arc<LinearSystem>> {
        match self {
            Self::Compiled(it) => it.linear(),
            Self::Callable(_) => None,
        }
    }

    fn has_constant_matrices(&self) -> bool {
        match self {
            Self::Compiled(it) => it.has_constant_matrices(),
            Self::Callable(it) => it.has_constant_matrices(),
        }
    }

    fn change_charts(&self, far: f64, q: &mut [f64], w: &mut [f64]) -> bool {
        match self {
            Self::Compiled(it) => it.change_charts(far, q, w),
            Self::Callable(_) => false,
        }
    }
}

/// A system that works without the interpreter. The [`Model`] holds the owner of its code.
#[derive(Clone)]
pub(crate) struct CompiledDynamics {
    layout: Layout,
    source: Source,
    raised: Raised,
}

#[derive(Clone)]
enum Source {
    Function(CompiledRows),
    Linear(LinearDynamics),
    Tree(TreeDynamics, Arc<[(usize, CompiledFunction)]>),
    Parts(Arc<SystemParts>),
}

impl CompiledDynamics {
    /// From a model that works without the interpreter.
    pub(crate) fn of(model: &Model, layout: Layout) -> Option<Self> {
        let Evaluator::Native(source) = model.evaluator() else { return None };
        Some(Self { layout, source, raised: Raised::now() })
    }

    /// The same compiled function, called with other data.
    pub(crate) fn called_with(mut self, data: &[f64]) -> Self {
        if let Source::Function(function) = &mut self.source {
            let address = Some(data.as_ptr() as usize);
            function.function.data = address;
            if let Some(rows) = &mut function.equalities {
                rows.data = address;
            }
        }
        self
    }

    /// The return code of a compiled function at a time, as an error unless it is zero.
    fn checked(&mut self, t: f64, code: c_int) -> PyResult<()> {
        if code != 0 || self.raised.here() {
            return Err(failed(t, code));
        }
        Ok(())
    }

    /// The matrices of a linear system.
    pub(crate) fn linear_system(&self) -> Option<&Arc<LinearSystem>> {
        Dynamics::<PyErr>::linear(self)
    }

    /// The tree of a tree system.
    pub(crate) fn tree(&self) -> Option<&Arc<tree::Tree>> {
        match &self.source {
            Source::Tree(dynamics, _) => Some(dynamics.tree()),
            Source::Function(_) | Source::Linear(_) | Source::Parts(_) => None,
        }
    }
}

/// Evaluates a part of the numbers of a system of compiled parts.
fn evaluate_compiled(
    (parts, raised): (&SystemParts, &mut Raised),
    scope: EvaluationScope,
    (t, q, w): (f64, &[f64], &[f64]),
    out: &mut [f64],
) -> PyResult<()> {
    parts.evaluate(scope, t, q, w, out);
    match raised.here() {
        true => Err(failed(t, 0)),
        false => Ok(()),
    }
}

/// The error of compiled code that failed.
#[cold]
fn failed(t: f64, code: c_int) -> PyErr {
    PyRuntimeError::new_err(format!("the compiled system failed at t = {t:?} (it returned {code})"))
}

impl Dynamics<PyErr> for CompiledDynamics {
    fn layout(&self) -> Layout {
        self.layout
    }

    fn evaluate(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> PyResult<()> {
        match &mut self.source {
            Source::Function(function) => {
                let code = function.fill(t, q, w, out);
                self.checked(t, code)
            }
            Source::Linear(linear) => linear.evaluate(t, q, w, out),
            Source::Tree(tree, drives) => {
                Dynamics::<PyErr>::evaluate(tree, t, q, w, out)?;
                let code = drive_rows(drives, tree.tree().layout(), t, out);
                self.checked(t, code)
            }
            Source::Parts(parts) => {
                let here = (&**parts, &mut self.raised);
                evaluate_compiled(here, EvaluationScope::All, (t, q, w), out)
            }
        }
    }

    fn evaluate_again(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> PyResult<()> {
        match &mut self.source {
            Source::Function(_) | Source::Tree(..) => self.evaluate(t, q, w, out),
            Source::Linear(linear) => linear.evaluate_again(t, q, w, out),
            Source::Parts(parts) => {
                let here = (&**parts, &mut self.raised);
                evaluate_compiled(here, EvaluationScope::Varying, (t, q, w), out)
            }
        }
    }

    fn evaluate_gaps(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> PyResult<()> {
        match &mut self.source {
            Source::Function(_) | Source::Tree(..) => self.evaluate(t, q, w, out),
            Source::Linear(linear) => linear.evaluate_gaps(t, q, w, out),
            Source::Parts(parts) => {
                let here = (&**parts, &mut self.raised);
                evaluate_compiled(here, EvaluationScope::Gaps, (t, q, w), out)
            }
        }
    }

    fn evaluate_equalities(
        &mut self,
        t: f64,
        q: &[f64],
        w: &[f64],
        out: &mut [f64],
    ) -> PyResult<()> {
        match &mut self.source {
            Source::Function(function) => {
                let code = function.fill_equalities(t, q, w, out);
                self.checked(t, code)
            }
            Source::Linear(linear) => linear.evaluate_equalities(t, q, w, out),
            Source::Tree(tree, drives) => {
                Dynamics::<PyErr>::evaluate_equalities(tree, t, q, w, out)?;
                let code = drive_rows(drives, tree.tree().layout(), t, out);
                self.checked(t, code)
            }
            Source::Parts(parts) => {
                let here = (&**parts, &mut self.raised);
                evaluate_compiled(here, EvaluationScope::Equalities, (t, q, w), out)
            }
        }
    }

    fn has_separate_equalities(&self) -> bool {
        match &self.source {
            Source::Function(function) => function.equalities.is_some(),
            Source::Linear(linear) => Dynamics::<PyErr>::has_separate_equalities(linear),
            Source::Tree(tree, _) => Dynamics::<PyErr>::has_separate_equalities(tree),
            Source::Parts(_) => true,
        }
    }

    fn is_steady(&self) -> bool {
        matches!(&self.source, Source::Parts(parts) if parts.steady)
    }

    fn is_autonomous(&self) -> bool {
        match &self.source {
            Source::Tree(tree, drives) => {
                drives.is_empty() && Dynamics::<PyErr>::is_autonomous(tree)
            }
            Source::Function(_) | Source::Linear(_) | Source::Parts(_) => false,
        }
    }

    fn has_constant_matrices(&self) -> bool {
        match &self.source {
            Source::Linear(_) => true,
            Source::Parts(parts) => parts.flat.has_constant_matrices(),
            Source::Function(_) | Source::Tree(..) => false,
        }
    }

    fn change_charts(&self, far: f64, q: &mut [f64], w: &mut [f64]) -> bool {
        match &self.source {
            Source::Tree(tree, _) => Dynamics::<PyErr>::change_charts(tree, far, q, w),
            Source::Function(_) | Source::Linear(_) | Source::Parts(_) => false,
        }
    }

    fn linear(&self) -> Option<&Arc<LinearSystem>> {
        match &self.source {
            Source::Function(_) | Source::Tree(..) | Source::Parts(_) => None,
            Source::Linear(linear) => Dynamics::<PyErr>::linear(linear),
        }
    }
}

/// A system that calls the interpreter, whose lock is held for the whole run.
pub(crate) struct PythonDynamics<'py> {
    layout: Layout,
    source: PythonSource<'py>,
    steady: bool,
    /// Argument arrays of functions.
    q: Bound<'py, PyArray1<f64>>,
    w: Bound<'py, PyArray1<f64>>,
    raised: Raised,
}

enum PythonSource<'py> {
    /// A function that returns all numbers.
    Row(Bound<'py, PyAny>),
    /// Parts, and by part its function of the interpreter.
    Parts(Arc<SystemParts>, Vec<Option<Function<'py>>>),
}

impl<'py> PythonDynamics<'py> {
    fn new(py: Python<'py>, layout: Layout, source: PythonSource<'py>, steady: bool) -> Self {
        let [q, w] = [(); 2].map(|()| PyArray1::zeros(py, layout.n, false));
        Self { layout, source, steady, q, w, raised: Raised::now() }
    }

    /// Calls the functions of the parts, and writes the rest.
    fn evaluate_parts(
        &mut self,
        scope: EvaluationScope,
        (t, q, w): (f64, &[f64], &[f64]),
        out: &mut [f64],
    ) -> PyResult<()> {
        let Self { layout, source, q: coordinates, w: velocities, raised, .. } = self;
        let PythonSource::Parts(parts, functions) = source else { return Ok(()) };
        parts.write(scope, t, q, out);
        let time = PyFloat::new(coordinates.py(), t);
        for (part, function) in parts.functions.iter().map(Py::get).zip(functions) {
            if !parts.is_called(part, scope) {
                continue;
            }
            let Some(function) = function else {
                part.fill(t, q, w, out);
                if raised.here() {
                    return Err(failed(t, 0));
                }
                continue;
            };
            match &part.by {
                PartKind::Python { takes_velocities, read, dimensions, .. } => {
                    hand(coordinates, q)?;
                    let third: Option<&Bound<'py, PyAny>> = match takes_velocities {
                        true => {
                            hand(velocities, w)?;
                            Some(velocities)
                        }
                        false => None,
                    };
                    let value = function.call(&time, coordinates, third)?;
                    read_into(&value, *dimensions, read, &mut out[part.start..][..part.length])?;
                }
                PartKind::Wall { gap, .. } => {
                    let motion: [f64; 3] = function.call_with_one(&time)?.extract()?;
                    out[layout.gap().start + gap] -= motion[0];
                    out[layout.curvature().start + gap] = -motion[2];
                    out[layout.rate().start + gap] = -motion[1];
                }
                PartKind::OfSpeed { channel, read, .. } => {
                    let row = &out[layout.gradient()][(layout.m + channel) * layout.n..];
                    let along: f64 = row.iter().zip(w).map(|(b, w)| b * w).sum();
                    let slip = along + out[layout.rate().start + layout.m + channel];
                    let speed = PyFloat::new(time.py(), slip.abs());
                    let value = function.call_with_one(&speed)?;
                    let to = layout.limit().start + channel;
                    read_into(&value, 0, read, &mut out[to..=to])?;
                }
                PartKind::Compiled(_) | PartKind::Driven(..) => (),
            }
            crate::interface::look()?;
        }
        parts.flat.finish(out);
        Ok(())
    }

    /// All numbers from one function.
    fn evaluate_row(&mut self, (t, q, w): (f64, &[f64], &[f64]), out: &mut [f64]) -> PyResult<()> {
        let PythonSource::Row(callable) = &self.source else { return Ok(()) };
        hand(&mut self.q, q)?;
        hand(&mut self.w, w)?;
        let value = callable.call1((t, &self.q, &self.w))?;
        crate::interface::look()?;
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

    fn evaluate_in(
        &mut self,
        scope: EvaluationScope,
        at: (f64, &[f64], &[f64]),
        out: &mut [f64],
    ) -> PyResult<()> {
        match self.source {
            PythonSource::Row(_) => self.evaluate_row(at, out),
            PythonSource::Parts(..) => self.evaluate_parts(scope, at, out),
        }
    }
}

impl Dynamics<PyErr> for PythonDynamics<'_> {
    fn layout(&self) -> Layout {
        self.layout
    }

    fn evaluate(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> PyResult<()> {
        self.evaluate_in(EvaluationScope::All, (t, q, w), out)
    }

    fn evaluate_again(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> PyResult<()> {
        self.evaluate_in(EvaluationScope::Varying, (t, q, w), out)
    }

    fn evaluate_gaps(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> PyResult<()> {
        self.evaluate_in(EvaluationScope::Gaps, (t, q, w), out)
    }

    fn evaluate_equalities(
        &mut self,
        t: f64,
        q: &[f64],
        w: &[f64],
        out: &mut [f64],
    ) -> PyResult<()> {
        self.evaluate_in(EvaluationScope::Equalities, (t, q, w), out)
    }

    fn has_separate_equalities(&self) -> bool {
        matches!(self.source, PythonSource::Parts(..))
    }

    fn is_steady(&self) -> bool {
        self.steady
    }

    fn has_constant_matrices(&self) -> bool {
        match &self.source {
            PythonSource::Row(_) => false,
            PythonSource::Parts(parts, _) => parts.flat.has_constant_matrices(),
        }
    }
}

/// Writes numbers into an array that a function is called with, a new one where the last was kept.
fn hand(array: &mut Bound<'_, PyArray1<f64>>, values: &[f64]) -> PyResult<()> {
    // SAFETY: of an object that is held here
    if unsafe { pyo3::ffi::Py_REFCNT(array.as_ptr()) } > 1 {
        *array = PyArray1::zeros(array.py(), values.len(), false);
    }
    // SAFETY: nobody else knows the array
    unsafe { array.as_slice_mut()? }.copy_from_slice(values);
    Ok(())
}

/// Writes numbers into an array private to this module and its callees.
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
    Ok(is_sound_row(row.as_slice()?, (n, m)))
}

/// The same of a row of numbers.
pub(crate) fn is_sound_row(row: &[f64], (n, m): (usize, usize)) -> bool {
    let (gaps, gradients) = (n * (n + 1), n * (n + 1) + m);
    let (Some(gaps), Some(gradients)) = (row.get(gaps..gradients), row.get(gradients..)) else {
        return false;
    };
    let mut gradients = gradients.chunks_exact(n.max(1)).take(m);
    row.iter().all(|it| it.is_finite())
        && gaps.iter().all(|&gap| gap >= 0.0)
        && gradients.all(|gradient| gradient.iter().any(|&it| it != 0.0))
}

/// Contact forces by gap, forces of friction by channel, then those of equality rows, at an evaluation of a
/// system with velocities `w`: `friction` are its channels and compliant gaps, `closed` its gaps in contact,
/// `modes` the mode numbers of its channels. None where no forces keep the gaps closed.
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
    let layout = Layout { n: w.len(), m: closed.len(), p: channels, k: 0 };
    let layout = Layout { k: row.len().saturating_sub(layout.len()) / (w.len() + 3), ..layout };
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
    let mut dynamics =
        Rubbing { dynamics: FunctionDynamics { layout, function }, friction, moved: &[] };
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

fn joint_of((parent, kind): &(i64, String)) -> Option<Joint> {
    let kind = match kind.as_str() {
        "hinge" => JointKind::Hinge,
        "slide" => JointKind::Slide,
        "rotation0" => JointKind::Rotation(0),
        "rotation1" => JointKind::Rotation(1),
        "rotation2" => JointKind::Rotation(2),
        _ => return None,
    };
    Some(Joint { parent: joint(*parent), kind })
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

fn constraint_of((kind, a, b): &(String, i64, i64)) -> Option<TreeConstraint> {
    match (kind.as_str(), joint(*a)) {
        ("connect", a) => Some(TreeConstraint::Connect(a, joint(*b))),
        ("weld", a) => Some(TreeConstraint::Weld(a, joint(*b))),
        ("joint", Some(a)) => Some(TreeConstraint::Joint(a, joint(*b))),
        _ => None,
    }
}

fn friction_of((kind, at): &(String, usize)) -> Option<TreeFriction> {
    match kind.as_str() {
        "joint" => Some(TreeFriction::Joint(*at)),
        "plane" => Some(TreeFriction::Plane(*at)),
        "tangent" => Some(TreeFriction::Tangent(*at)),
        "between0" => Some(TreeFriction::Between(*at, 0)),
        "between1" => Some(TreeFriction::Between(*at, 1)),
        _ => None,
    }
}

#[pymethods]
impl Tree {
    /// Parent (-1 for the world) and kind of each joint: "hinge", "slide", or "rotation" and the number of the
    /// coordinate; kind and joints of each gap: "lower", "upper", "plane" or "balls"; kind and number of each
    /// channel of friction: "joint", or "plane", "tangent", "between0" or "between1" with the number of its gap; kind and joints of each constraint: "connect", "weld" or "joint";
    /// rows from which prescribed motion is taken; the numbers as `zivi::system::tree::Tree` has them.
    #[new]
    #[pyo3(signature = (joints, gaps, friction, numbers, constraints=vec![], drives=vec![]))]
    fn new(
        joints: Vec<(i64, String)>,
        gaps: Vec<(String, i64, i64)>,
        friction: Vec<(String, usize)>,
        numbers: PyReadonlyArray1<'_, f64>,
        constraints: Vec<(String, i64, i64)>,
        drives: Vec<(usize, Py<Wall>)>,
    ) -> PyResult<Self> {
        let joints: Option<Vec<Joint>> = joints.iter().map(joint_of).collect();
        let gaps: Option<Vec<TreeGap>> = gaps.iter().map(gap_of).collect();
        let friction: Option<Vec<TreeFriction>> = friction.iter().map(friction_of).collect();
        let constraints: Option<Vec<TreeConstraint>> =
            constraints.iter().map(constraint_of).collect();
        let (numbers, drives) = (vector(&numbers)?, drives_of(&drives)?);
        let parts = joints.zip(gaps).zip(friction).zip(constraints);
        let tree = parts.and_then(|(((joints, gaps), friction), constraints)| {
            tree::Tree { joints, gaps, friction, constraints, drives, numbers }.validated()
        });
        let tree = tree.ok_or_else(|| PyValueError::new_err("the parts do not fit together"))?;
        Ok(Self { inner: Arc::new(tree) })
    }
}
