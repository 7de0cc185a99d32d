//! Methods from Python: one class for all, from the list of the library, with the ranges of their
//! settings.

use crate::dynamics::fill;
use crate::interface::{array, list, setup_error, stored, vector, zeros, Array, Matrix};
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::gc::{PyTraverseError, PyVisit};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use std::ops::Bound as Limit;
use std::slice::from_ref;
use zivi::method::{Entry, Settings, Values};
use zivi::{
    AnyMethod, DensePath, Direction, Level, LocatedEvent, Motion, MotionPoint, PathPoint, Physical,
    Solver, SwitchedRk, UserEvent,
};
use zivi_core::setting::{Setting, Value, Values as Range};
use zivi_core::{transform, Branch, ThetaGammaStep};

/// A method with its settings, all of them in range.
#[pyclass(frozen, module = "zivi._zivi", name = "Method")]
pub(crate) struct PyMethod {
    pub(crate) inner: AnyMethod,
}

#[pymethods]
impl PyMethod {
    #[new]
    #[pyo3(signature = (name, **settings))]
    fn new(name: &str, settings: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let Some(entry) = AnyMethod::ALL.iter().find(|entry| entry.name == name) else {
            let names: Vec<_> = AnyMethod::ALL.iter().map(|entry| entry.name).collect();
            let message = format!("name must be one of {}, got {name:?}", names.join(", "));
            return Err(PyValueError::new_err(message));
        };
        let mut values = Values::default();
        for (key, value) in settings.into_iter().flatten() {
            let key: String = key.extract()?;
            let Some(setting) = entry.settings.iter().find(|it| it.name == key) else {
                let message = format!("{name} has no setting {key:?}");
                return Err(PyTypeError::new_err(message));
            };
            if let Some(value) = given(setting, &value)? {
                values.set(setting.name, value);
            }
        }
        let inner = (entry.of)(&values).map_err(setup_error)?;
        inner.check().map_err(setup_error)?;
        Ok(Self { inner })
    }
}

impl PyMethod {
    /// The settings of the switched method, which some work needs.
    pub(crate) fn switched(&self) -> PyResult<SwitchedRk> {
        match self.inner {
            AnyMethod::SwitchedRk(settings) => Ok(settings),
            _ => Err(PyValueError::new_err("method must be SwitchedRK")),
        }
    }
}

/// An error that names a setting, its value and its range.
fn refused(setting: &Setting, value: impl std::fmt::Display) -> PyErr {
    let Setting { name, range, .. } = setting;
    PyValueError::new_err(format!("{name} must be {range}, got {value}"))
}

/// A value of Python's for a setting; none where the run finds it. Ranges of numbers are left to
/// the method.
fn given(setting: &Setting, value: &Bound<'_, PyAny>) -> PyResult<Option<Value>> {
    if value.is_none() && matches!(setting.default, Value::Open(_)) {
        return Ok(None);
    }
    Ok(Some(match setting.values {
        Range::Numbers(..) => Value::Number(value.extract()?),
        Range::Pairs(..) => match value.extract() {
            Ok(both) => Value::Number(both),
            Err(_) => Value::Pair(value.extract()?),
        },
        Range::Choice([Value::Name(_), ..]) => choice(setting, value)?,
        Range::Counts(..) | Range::Choice(_) => Value::Count(count(setting, value.extract()?)?),
    }))
}

/// A whole number, which may arrive below 0.
fn count(setting: &Setting, value: i64) -> PyResult<usize> {
    let found = usize::try_from(value).ok().filter(|it| setting.values.hold_count(*it));
    found.ok_or_else(|| refused(setting, value))
}

/// One of the names that a setting may be.
fn choice(setting: &Setting, value: &Bound<'_, PyAny>) -> PyResult<Value> {
    let Range::Choice(names) = setting.values else { return Err(refused(setting, value.repr()?)) };
    let name = value.extract::<String>().ok();
    let found =
        names.iter().find(|it| matches!(it, Value::Name(it) if Some(*it) == name.as_deref()));
    match found {
        Some(found) => Ok(*found),
        None => Err(refused(setting, value.repr()?)),
    }
}

/// A solver by its name.
pub(crate) fn step_solver(name: &Bound<'_, PyAny>, linearisations: i64) -> PyResult<Solver> {
    let linearisations = count(&Solver::LINEARISATIONS, linearisations)?;
    let Value::Name(found) = choice(&Solver::SETTING, name)? else {
        return Err(refused(&Solver::SETTING, name.repr()?));
    };
    Solver::named(found, linearisations).ok_or_else(|| refused(&Solver::SETTING, found))
}

/// A setting with its range.
#[pyclass(frozen, get_all, module = "zivi._zivi", name = "Setting")]
pub(crate) struct PySetting {
    name: &'static str,
    meaning: &'static str,
    unit: &'static str,
    /// In words.
    range: &'static str,
    /// Bounds of a number that it may not reach.
    above: Option<f64>,
    below: Option<f64>,
    /// Bounds of a number or integer.
    least: Option<Py<PyAny>>,
    most: Option<Py<PyAny>>,
    /// Whether it is a whole number.
    whole: bool,
    /// Whether it may be two numbers, for distance and velocity.
    pair: bool,
    /// The names or numbers that it may be.
    choices: Option<Py<PyTuple>>,
    /// Its default, `None` for a required setting or one that the run determines.
    default: Option<Py<PyAny>>,
    required: bool,
    /// Where its default comes from if that is no value.
    comes: Option<&'static str>,
}

/// A value as a Python object; `None` if absent.
fn plain(py: Python<'_>, value: Value) -> PyResult<Option<Py<PyAny>>> {
    Ok(Some(match value {
        Value::Required | Value::Open(_) => return Ok(None),
        Value::Number(it) => it.into_pyobject(py)?.into_any().unbind(),
        Value::Pair([x, xdot]) => (x, xdot).into_pyobject(py)?.into_any().unbind(),
        Value::Count(it) => it.into_pyobject(py)?.into_any().unbind(),
        Value::Name(it) => it.into_pyobject(py)?.into_any().unbind(),
    }))
}

/// A bound that belongs to the range, and one that does not.
fn limits(limit: Limit<f64>) -> (Option<f64>, Option<f64>) {
    match limit {
        Limit::Included(it) => (Some(it), None),
        Limit::Excluded(it) => (None, Some(it)),
        Limit::Unbounded => (None, None),
    }
}

impl PySetting {
    pub(crate) fn new(py: Python<'_>, of: &Setting) -> PyResult<Self> {
        let Setting { name, meaning, unit, values, range, default } = *of;
        let (mut above, mut below, mut least, mut most, mut choices) =
            (None, None, None, None, None);
        match values {
            Range::Numbers(from, to) | Range::Pairs(from, to) => {
                let ((from, over), (to, under)) = (limits(from), limits(to));
                let number = |it: Option<f64>| it.map(|it| plain(py, Value::Number(it)));
                (above, below) = (over, under);
                least = number(from).transpose()?.flatten();
                most = number(to).transpose()?.flatten();
            }
            Range::Counts(from, to) => {
                least = plain(py, Value::Count(from))?;
                most = if to == usize::MAX { None } else { plain(py, Value::Count(to))? };
            }
            Range::Choice(values) => {
                let all = values.iter().map(|&it| plain(py, it)).collect::<PyResult<Vec<_>>>()?;
                choices = Some(PyTuple::new(py, all)?.unbind());
            }
        }
        let pair = matches!(values, Range::Pairs(..));
        let whole = matches!(values, Range::Counts(..));
        let required = default == Value::Required;
        let comes = if let Value::Open(words) = default { Some(words) } else { None };
        let default = plain(py, default)?;
        Ok(Self {
            name,
            meaning,
            unit,
            range,
            above,
            below,
            least,
            most,
            whole,
            pair,
            choices,
            default,
            required,
            comes,
        })
    }
}

pub(crate) fn described(py: Python<'_>, settings: &[Setting]) -> PyResult<Vec<PySetting>> {
    settings.iter().map(|it| PySetting::new(py, it)).collect()
}

/// A method of the list of the library.
#[pyclass(frozen, get_all, module = "zivi._zivi")]
pub(crate) struct MethodEntry {
    name: &'static str,
    /// Its meaning in a few words.
    meaning: &'static str,
    /// Its settings, in their order.
    settings: Py<PyTuple>,
    /// Whether it knows the motion at its steps only.
    fixed_steps: bool,
    /// Whether a mass may be below the wall at the end of a step.
    penetrates: bool,
    /// Whether it also runs mechanical systems.
    takes_mechanism: bool,
}

/// Every method, by its name, in the order of the library.
pub(crate) fn all_methods(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let all = PyDict::new(py);
    for &Entry { name, meaning, settings, fixed_steps, penetrates, takes_mechanism, .. } in
        AnyMethod::ALL
    {
        let settings = PyTuple::new(py, described(py, settings)?)?.unbind();
        let entry =
            MethodEntry { name, meaning, settings, fixed_steps, penetrates, takes_mechanism };
        all.set_item(name, entry)?;
    }
    Ok(all)
}

/// The settings of every method, by its name.
pub(crate) fn all_settings(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let all = PyDict::new(py);
    for entry in AnyMethod::ALL {
        all.set_item(entry.name, described(py, entry.settings)?)?;
    }
    Ok(all)
}

/// The step size of a fixed-step scheme above a wall: rejects what is out of range.
pub(crate) fn step_of(h: f64, restitution: zivi::Restitution) -> PyResult<ThetaGammaStep> {
    ThetaGammaStep::new(h, 1.0, 1.0, restitution).map_err(|error| setup_error(error.into()))
}

// The motion of a mass between the samples of a run.

/// The motion between the samples of a run.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct MotionPath {
    pub(crate) motion: Motion,
}

type Arrays<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);
/// Constructor of an object and its arguments (pickle).
type Reduced<'py> = (Bound<'py, PyAny>, (Bound<'py, PyArray1<f64>>,));

impl MotionPath {
    /// The motion of the plant of a closed loop.
    pub(crate) fn of_loop(path: DensePath, restitution: zivi::Restitution) -> Self {
        let tails = path.tails().to_vec();
        Self { motion: Motion { path: Some(path), tails, restitution } }
    }

    /// Two quantities of the motion at each time, NaN outside of the span.
    fn sample<'py>(
        &self,
        py: Python<'py>,
        times: &PyReadonlyArray1<'py, f64>,
        of: impl Fn(zivi::PathPoint) -> (f64, f64),
    ) -> PyResult<Arrays<'py>> {
        let mut reader = self.motion.path.as_ref().map(DensePath::reader);
        let mut at = |&t: &f64| {
            let point = reader.as_mut().and_then(|reader| reader.at(t));
            point.map_or((f64::NAN, f64::NAN), &of)
        };
        let mut both = [zeros(times.len())?, zeros(times.len())?];
        for (k, t) in times.as_array().iter().enumerate() {
            (both[0][k], both[1][k]) = at(t);
        }
        let [first, second] = both.map(|it| PyArray1::from_vec(py, it));
        Ok((first, second))
    }
}

#[pymethods]
impl MotionPath {
    /// The complete state as plain numbers.
    fn numbers<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        stored(py, self.motion.to_numbers())
    }

    /// Restores the object from `numbers`; a ValueError for invalid numbers.
    #[staticmethod]
    fn restored(numbers: PyReadonlyArray1<'_, f64>) -> PyResult<Self> {
        let numbers = vector(&numbers)?;
        let motion = Motion::from_numbers(&numbers);
        Ok(Self { motion: motion.map_err(|error| PyValueError::new_err(error.to_string()))? })
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        Ok((py.get_type::<Self>().getattr("restored")?, (self.numbers(py)?,)))
    }

    /// Whether the motion between the samples is known.
    #[getter]
    fn dense(&self) -> bool {
        self.motion.path.is_some()
    }

    /// The times between which the motion is known.
    #[getter]
    fn span(&self) -> Option<(f64, f64)> {
        self.motion.path.as_ref().and_then(DensePath::span)
    }

    /// Where a step, a tail or a rest begins, in order.
    fn starts(&self, py: Python<'_>) -> PyResult<Array> {
        array(py, self.motion.path.iter().flat_map(DensePath::starts))
    }

    /// `(x, xdot)` at the times.
    fn physical<'py>(
        &self,
        py: Python<'py>,
        times: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Arrays<'py>> {
        self.sample(py, &times, |point| (point.x, point.xdot))
    }

    /// `(s, v)` at the times.
    fn lifted<'py>(
        &self,
        py: Python<'py>,
        times: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Arrays<'py>> {
        self.sample(py, &times, |zivi::PathPoint { x, xdot, sigma }| {
            let branch = if sigma > 0.0 { Branch::Positive } else { Branch::Negative };
            let z = transform::lift(Physical { x, xdot }, branch, self.motion.restitution);
            (z.s + 0.0, z.v + 0.0)
        })
    }

    /// Times and velocities of the impacts that Zeno extrapolation skipped, down to a speed after
    /// them and up to a maximal number per accumulation.
    fn skipped_impacts(
        &self,
        py: Python<'_>,
        speed: f64,
        at_most: usize,
    ) -> PyResult<(Array, Array, Array)> {
        let tails = self.motion.tails.iter();
        let impacts = list(tails.flat_map(|tail| tail.impacts_down_to(speed, at_most)))?;
        let column = |of: fn(&zivi::Impact) -> f64| array(py, impacts.iter().map(of));
        Ok((column(|it| it.t)?, column(|it| it.xdot_before)?, column(|it| it.xdot_after)?))
    }

    /// Start and end of the accumulations that were extrapolated.
    #[getter]
    fn tails(&self) -> Vec<(f64, f64)> {
        self.motion.tails.iter().map(|tail| (tail.start(), tail.zeno_time())).collect()
    }
}

// User events: Python functions and their occurrences.

/// An event of the user: where a function of time and state changes its sign.
#[pyclass(frozen, get_all, module = "zivi._zivi", name = "Event")]
pub(crate) struct PyEvent {
    /// `g(t, x, x')`, or `g(t, q, q')` of a mechanical system.
    function: Py<PyAny>,
    /// Upwards only, downwards only (below 0) or both (0).
    direction: i32,
    /// The number of the event that ends the run.
    terminal: Option<usize>,
    /// The level that is crossed, if the function is that simple: one of the position or of the
    /// velocity.
    level_x: Option<f64>,
    level_xdot: Option<f64>,
}

#[pymethods]
impl PyEvent {
    #[new]
    #[pyo3(signature = (function, *, direction, terminal, level_x=None, level_xdot=None))]
    fn new(
        function: Py<PyAny>,
        direction: i32,
        terminal: Option<usize>,
        level_x: Option<f64>,
        level_xdot: Option<f64>,
    ) -> Self {
        Self { function, direction, terminal, level_x, level_xdot }
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        visit.call(&self.function)
    }
}

/// The value of an event function as a number.
fn number(value: &Bound<'_, PyAny>) -> PyResult<f64> {
    value.extract().map_err(|_| {
        let kind = value.get_type();
        PyTypeError::new_err(format!("an event function must return a float, got {kind}"))
    })
}

impl PyEvent {
    fn direction(&self) -> Direction {
        match self.direction {
            0 => Direction::Either,
            below if below < 0 => Direction::Falling,
            _ => Direction::Rising,
        }
    }

    /// As an event of a mass above a wall.
    pub(crate) fn of_point<'py>(&self, py: Python<'py>) -> UserEvent<'py, PyErr> {
        let function = self.function.bind(py).clone();
        let call = move |t: f64, x: f64, xdot: f64| number(&function.call1((t, x, xdot))?);
        let of_x = self.level_x.map(Level::Position);
        let level = of_x.or(self.level_xdot.map(Level::Velocity));
        let (direction, terminal) = (self.direction(), self.terminal);
        UserEvent { direction, terminal, level, ..UserEvent::new(call) }
    }

    /// As an event of a mechanical system of `n` coordinates.
    pub(crate) fn of_mechanism<'py>(
        &self,
        py: Python<'py>,
        n: usize,
    ) -> UserEvent<'py, PyErr, MotionPoint> {
        let function = self.function.bind(py).clone();
        let zeros = || PyArray1::zeros(py, n, false);
        let (of_q, of_w) = (zeros(), zeros());
        let call = move |t: f64, at: &MotionPoint| {
            fill(&of_q, &at.x[..n])?;
            fill(&of_w, &at.v[..n])?;
            number(&function.call1((t, &of_q, &of_w))?)
        };
        let (direction, terminal) = (self.direction(), self.terminal);
        UserEvent { direction, terminal, ..UserEvent::of(call) }
    }
}

/// Where one event of the user happened: its times, and the states there in rows.
#[pyclass(frozen, get_all, module = "zivi._zivi")]
pub(crate) struct Hits {
    t: Array,
    /// Coordinates: one, the distance from the wall, for a mass.
    q: Matrix<f64>,
    qdot: Matrix<f64>,
}

/// A state at which an event happened.
pub(crate) trait EventState {
    /// Coordinates.
    fn q(&self) -> &[f64];
    /// Velocities.
    fn qdot(&self) -> &[f64];
}

impl EventState for PathPoint {
    fn q(&self) -> &[f64] {
        from_ref(&self.x)
    }

    fn qdot(&self) -> &[f64] {
        from_ref(&self.xdot)
    }
}

/// Gaps and their rates follow the coordinates and velocities.
impl EventState for MotionPoint {
    fn q(&self) -> &[f64] {
        &self.x
    }

    fn qdot(&self) -> &[f64] {
        &self.v
    }
}

impl Hits {
    /// Those of each event, at states of `n` coordinates.
    pub(crate) fn of<S: EventState>(
        py: Python<'_>,
        events: &[Vec<LocatedEvent<S>>],
        n: usize,
    ) -> PyResult<Vec<Py<Self>>> {
        let one = |hits: &Vec<LocatedEvent<S>>| {
            let rows = |of: fn(&S) -> &[f64]| -> PyResult<Matrix<f64>> {
                let all = hits.iter().flat_map(|it| of(&it.at)[..n].iter().copied());
                Ok(array(py, all)?.into_bound(py).reshape([hits.len(), n])?.unbind())
            };
            let t = array(py, hits.iter().map(|it| it.t))?;
            Py::new(py, Self { t, q: rows(S::q)?, qdot: rows(S::qdot)? })
        };
        events.iter().map(one).collect()
    }
}
