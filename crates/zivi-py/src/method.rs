//! Methods from Python: a class for the settings of each, and what the settings may be.

use std::ops::Bound as Limit;

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use zivi::method::Settings;
use zivi::{AnyMethod, FixedSteps, Flights, Order, Solver, SwitchedRk};
use zivi_core::control::{Port, TwistingTracker};
use zivi_core::observer::ObserverSettings;
use zivi_core::setting::{Setting as Described, Value, Values};
use zivi_core::ThetaGammaStep;

use crate::errors::setup_error;

/// A method with its settings, all of them in range.
#[pyclass(frozen, subclass, module = "zivi._zivi")]
pub(crate) struct Method {
    pub(crate) inner: AnyMethod,
}

impl Method {
    /// The method, unless a setting is out of range.
    fn checked(inner: impl Into<AnyMethod>) -> PyResult<Self> {
        let inner = inner.into();
        inner.check().map_err(setup_error)?;
        Ok(Self { inner })
    }

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

/// A whole number, which may arrive below 0.
fn count(setting: &Described, value: i64) -> PyResult<usize> {
    let found = usize::try_from(value).ok().filter(|it| setting.values.hold_count(*it));
    found.ok_or_else(|| refused(setting, value))
}

/// One of the names that a setting may be, as `named` reads it.
fn choice<T>(
    setting: &Described,
    value: &Bound<'_, PyAny>,
    named: impl FnOnce(&str) -> Option<T>,
) -> PyResult<T> {
    let found = value.extract::<String>().ok().and_then(|name| named(&name));
    match found {
        Some(found) => Ok(found),
        None => Err(refused(setting, value.repr()?)),
    }
}

/// The switched Runge-Kutta method.
#[pyclass(frozen, extends = Method, module = "zivi._zivi")]
pub(crate) struct SwitchedRK;

#[pymethods]
impl SwitchedRK {
    #[new]
    #[pyo3(signature = (*, rtol, atol, order, max_step, first_step, max_steps, max_impacts, flights))]
    #[allow(clippy::too_many_arguments)] // each by its name
    fn new(
        rtol: f64,
        atol: [f64; 2],
        order: i64,
        max_step: f64,
        first_step: Option<f64>,
        max_steps: i64,
        max_impacts: i64,
        flights: &Bound<'_, PyAny>,
    ) -> PyResult<PyClassInitializer<Self>> {
        let settings = SwitchedRk {
            rtol,
            atol,
            order: Order::of(order).ok_or_else(|| refused(&SwitchedRk::ORDER, order))?,
            max_step,
            first_step,
            max_steps: count(&SwitchedRk::MAX_STEPS, max_steps)?,
            max_impacts: count(&SwitchedRk::MAX_IMPACTS, max_impacts)?,
            flights: choice(&SwitchedRk::FLIGHTS, flights, Flights::named)?,
            adaptive: true,
        };
        Ok(PyClassInitializer::from(Method::checked(settings)?).add_subclass(Self))
    }
}

/// A solver by its name.
pub(crate) fn step_solver(name: &Bound<'_, PyAny>, linearisations: i64) -> PyResult<Solver> {
    let linearisations = count(&Solver::LINEARISATIONS, linearisations)?;
    choice(&Solver::SETTING, name, |name| Solver::named(name, linearisations))
}

/// The theta-gamma scheme.
#[pyclass(frozen, extends = Method, module = "zivi._zivi")]
pub(crate) struct ThetaGamma;

#[pymethods]
impl ThetaGamma {
    #[new]
    #[pyo3(signature = (*, h, theta, gamma, solver, linearisations))]
    fn new(
        h: f64,
        theta: f64,
        gamma: f64,
        solver: &Bound<'_, PyAny>,
        linearisations: i64,
    ) -> PyResult<PyClassInitializer<Self>> {
        let solver = step_solver(solver, linearisations)?;
        let scheme = zivi::ThetaGamma { theta, gamma, solver };
        let method = Method::checked(FixedSteps { h, scheme })?;
        Ok(PyClassInitializer::from(method).add_subclass(Self))
    }
}

/// Moreau-Jean time stepping.
#[pyclass(frozen, extends = Method, module = "zivi._zivi")]
pub(crate) struct MoreauJean;

#[pymethods]
impl MoreauJean {
    #[new]
    #[pyo3(signature = (*, h, theta))]
    fn new(h: f64, theta: f64) -> PyResult<PyClassInitializer<Self>> {
        let scheme = zivi::MoreauJean { theta };
        let method = Method::checked(FixedSteps { h, scheme })?;
        Ok(PyClassInitializer::from(method).add_subclass(Self))
    }
}

/// Explicit Euler with explicit signs.
#[pyclass(frozen, extends = Method, module = "zivi._zivi")]
pub(crate) struct ExplicitEuler;

#[pymethods]
impl ExplicitEuler {
    #[new]
    #[pyo3(signature = (*, h))]
    fn new(h: f64) -> PyResult<PyClassInitializer<Self>> {
        let method = Method::checked(FixedSteps { h, scheme: zivi::ExplicitEuler })?;
        Ok(PyClassInitializer::from(method).add_subclass(Self))
    }
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
    fn new(py: Python<'_>, of: &Described) -> PyResult<Self> {
        let Described { name, meaning, unit, values, range, default } = *of;
        let (mut above, mut below, mut least, mut most, mut choices) =
            (None, None, None, None, None);
        match values {
            Values::Numbers(from, to) => {
                let ((from, over), (to, under)) = (limits(from), limits(to));
                let number = |it: Option<f64>| it.map(|it| plain(py, Value::Number(it)));
                (above, below) = (over, under);
                least = number(from).transpose()?.flatten();
                most = number(to).transpose()?.flatten();
            }
            Values::Counts(from, to) => {
                least = plain(py, Value::Count(from))?;
                most = if to == usize::MAX { None } else { plain(py, Value::Count(to))? };
            }
            Values::Choice(values) => {
                let all = values.iter().map(|&it| plain(py, it)).collect::<PyResult<Vec<_>>>()?;
                choices = Some(PyTuple::new(py, all)?.unbind());
            }
        }
        let whole = matches!(values, Values::Counts(..));
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
            choices,
            default,
            required,
            comes,
        })
    }
}

/// The settings of every method, by its name.
pub(crate) fn all_settings(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let all = PyDict::new(py);
    for &(name, settings) in AnyMethod::ALL {
        let of = settings.iter().map(|it| Setting::new(py, it)).collect::<PyResult<Vec<_>>>()?;
        // Python writes its initials large
        all.set_item(if name == "SwitchedRk" { "SwitchedRK" } else { name }, of)?;
    }
    Ok(all)
}

/// The settings of controllers and of the observer that are numbers with a default.
pub(crate) fn control_settings(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let observer = [
        ObserverSettings::NOISE_X,
        ObserverSettings::NOISE_XDOT,
        ObserverSettings::Q_D,
        ObserverSettings::SE,
        ObserverSettings::DMAX,
        ObserverSettings::Q_E,
    ];
    let classes: [(&str, &[Described]); 4] = [
        ("TwistingRegulator", &[Port::DEPTH]),
        ("TwistingTracker", &[Port::DEPTH, TwistingTracker::HORIZON]),
        ("ExplicitTwisting", &[Port::DEPTH]),
        ("ImpactObserver", &observer),
    ];
    let all = PyDict::new(py);
    for (name, settings) in classes {
        let of = settings.iter().map(|it| Setting::new(py, it)).collect::<PyResult<Vec<_>>>()?;
        all.set_item(name, of)?;
    }
    Ok(all)
}

/// The step size of a fixed-step scheme above a wall: refuses what is out of range.
pub(crate) fn step_of(h: f64, restitution: zivi::Restitution) -> PyResult<ThetaGammaStep> {
    ThetaGammaStep::new(h, 1.0, 1.0, restitution).map_err(|error| setup_error(error.into()))
}
