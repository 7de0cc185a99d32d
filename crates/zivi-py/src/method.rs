//! Methods from Python: one class for all, by the list of the library, and what their settings may be.

use std::ops::Bound as Limit;

use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use zivi::method::{Entry, Settings, Values};
use zivi::{AnyMethod, Solver, SwitchedRk};
use zivi_core::setting::{Setting as Described, Value, Values as Range};
use zivi_core::ThetaGammaStep;

use crate::errors::setup_error;

/// A method with its settings, all of them in range.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct Method {
    pub(crate) inner: AnyMethod,
}

#[pymethods]
impl Method {
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

impl Method {
    /// The settings of the switched method, which some work needs.
    pub(crate) fn switched(&self) -> PyResult<SwitchedRk> {
        match self.inner {
            AnyMethod::SwitchedRk(settings) => Ok(settings),
            _ => Err(PyValueError::new_err("method must be SwitchedRK")),
        }
    }
}

/// An error that names a setting, its value and its range.
fn refused(setting: &Described, value: impl std::fmt::Display) -> PyErr {
    let Described { name, range, .. } = setting;
    PyValueError::new_err(format!("{name} must be {range}, got {value}"))
}

/// A value of Python's for a setting; none where the run finds it. Ranges of numbers are left to
/// the method.
fn given(setting: &Described, value: &Bound<'_, PyAny>) -> PyResult<Option<Value>> {
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
fn count(setting: &Described, value: i64) -> PyResult<usize> {
    let found = usize::try_from(value).ok().filter(|it| setting.values.hold_count(*it));
    found.ok_or_else(|| refused(setting, value))
}

/// One of the names that a setting may be.
fn choice(setting: &Described, value: &Bound<'_, PyAny>) -> PyResult<Value> {
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

/// What a setting is and may be.
#[pyclass(frozen, get_all, module = "zivi._zivi")]
pub(crate) struct Setting {
    name: &'static str,
    meaning: &'static str,
    unit: &'static str,
    /// In words.
    range: &'static str,
    /// Bounds of a number that it may not reach.
    above: Option<f64>,
    below: Option<f64>,
    /// Bounds of a number, or of a whole number, that it may.
    least: Option<Py<PyAny>>,
    most: Option<Py<PyAny>>,
    /// Whether it is a whole number.
    whole: bool,
    /// Whether it may be two numbers, for distance and velocity.
    pair: bool,
    /// The names or numbers that it may be.
    choices: Option<Py<PyTuple>>,
    /// What it is unless told otherwise: nothing where it must be given or is found by the run.
    default: Option<Py<PyAny>>,
    required: bool,
    /// Where its default comes from if that is no value.
    comes: Option<&'static str>,
}

/// A value as Python has it, nothing where there is none.
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

impl Setting {
    pub(crate) fn new(py: Python<'_>, of: &Described) -> PyResult<Self> {
        let Described { name, meaning, unit, values, range, default } = *of;
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

pub(crate) fn described(py: Python<'_>, settings: &[Described]) -> PyResult<Vec<Setting>> {
    settings.iter().map(|it| Setting::new(py, it)).collect()
}

/// A method of the list of the library.
#[pyclass(frozen, get_all, module = "zivi._zivi")]
pub(crate) struct MethodEntry {
    name: &'static str,
    /// What it is, in a few words.
    meaning: &'static str,
    /// Its settings, in their order.
    settings: Py<PyTuple>,
    /// Whether it knows the motion at its steps only.
    fixed_steps: bool,
    /// Whether a mass may be below the wall at the end of a step.
    penetrates: bool,
    /// Whether it runs mechanical systems, too.
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

/// The step size of a fixed-step scheme above a wall: refuses what is out of range.
pub(crate) fn step_of(h: f64, restitution: zivi::Restitution) -> PyResult<ThetaGammaStep> {
    ThetaGammaStep::new(h, 1.0, 1.0, restitution).map_err(|error| setup_error(error.into()))
}
