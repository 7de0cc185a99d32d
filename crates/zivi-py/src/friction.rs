//! Dry friction from Python: what a system has, and what a run leaves of it.

use std::sync::Arc;

use numpy::PyArrayMethods;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use zivi::mechanics::{MechanicalRun, Occurrence};
use zivi::record::gap_set::ContactMode;
use zivi::system::dynamics::{Dynamics, Layout};
use zivi::system::force::{Channel, Friction as Given, FrictionalImpact};
use zivi::system::linear_system::LinearSystem;

use crate::interface::{array, columns, Matrix, Vector};

/// The channels of friction of a system, those of gaps first, and how impacts go on.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct Friction {
    pub(crate) given: Given,
}

#[pymethods]
impl Friction {
    /// For each channel its gap, or None for a joint, and its tangential restitution.
    #[new]
    #[pyo3(signature = (channels, *, law, impact_without_collision))]
    fn new(
        channels: Vec<(Option<usize>, f64)>,
        law: &str,
        impact_without_collision: bool,
    ) -> PyResult<Self> {
        let law = match law {
            "newton" => FrictionalImpact::Newton,
            "poisson" => FrictionalImpact::Poisson,
            "stronge" => FrictionalImpact::Stronge,
            _ => return Err(PyValueError::new_err(format!("no law of impacts is called {law:?}"))),
        };
        let channels = channels.into_iter().map(|(gap, e_t)| Channel { gap, e_t }).collect();
        Ok(Self { given: Given { channels, law, impact_without_collision } })
    }
}

/// A system with its friction.
pub(crate) struct Rubbing<'a, D> {
    pub(crate) dynamics: D,
    pub(crate) friction: &'a Given,
}

impl<E, D: Dynamics<E>> Dynamics<E> for Rubbing<'_, D> {
    fn layout(&self) -> Layout {
        self.dynamics.layout()
    }

    fn friction(&self) -> &Given {
        self.friction
    }

    #[inline]
    fn evaluate(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> Result<(), E> {
        self.dynamics.evaluate(t, q, w, out)
    }

    #[inline]
    fn evaluate_again(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> Result<(), E> {
        self.dynamics.evaluate_again(t, q, w, out)
    }

    #[inline]
    fn evaluate_gaps(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> Result<(), E> {
        self.dynamics.evaluate_gaps(t, q, w, out)
    }

    fn is_steady(&self) -> bool {
        self.dynamics.is_steady()
    }

    fn linear(&self) -> Option<&Arc<LinearSystem>> {
        self.dynamics.linear()
    }
}

/// What friction did in a run.
#[pyclass(frozen, get_all, module = "zivi._zivi")]
pub(crate) struct FrictionRecord {
    slips: Matrix<f64>,
    slip_distances: Matrix<f64>,
    forces: Matrix<f64>,
    modes: Matrix<i8>,
    dissipated: Vector<f64>,
    transition_t: Vector<f64>,
    transition_channel: Vector<i64>,
    transition_before: Vector<i8>,
    transition_after: Vector<i8>,
    tangential_channel: Vector<i64>,
    tangential_group: Vector<i64>,
    tangential_slip_before: Vector<f64>,
    tangential_slip_after: Vector<f64>,
    tangential_impulse: Vector<f64>,
    tangential_sticks: Vector<bool>,
}

impl FrictionRecord {
    /// None of a run without friction.
    pub(crate) fn of(py: Python<'_>, run: &MechanicalRun<PyErr>) -> PyResult<Option<Self>> {
        let (layout, samples, all) = (run.layout, &run.samples, &run.occurrences);
        let Layout { m, p, .. } = layout;
        if p == 0 {
            return Ok(None);
        }
        let (slips, distances, dissipated) = slips_of(py, layout, &samples.x, &samples.v)?;
        /// One field of one kind of occurrence.
        macro_rules! field {
            ($kind:ident, $field:ident $(as $to:ty)?) => {{
                let picked = all.iter().filter_map(|it| match it {
                    Occurrence::$kind { $field, .. } => Some(*$field $(as $to)?),
                    _ => None,
                });
                array(py, picked)?
            }};
        }
        Ok(Some(Self {
            slips,
            slip_distances: distances,
            forces: columns(py, &samples.lambda, layout.rows(), m, p)?,
            modes: modes_of(py, &samples.modes, p)?,
            dissipated,
            transition_t: field!(Transition, t),
            transition_channel: field!(Transition, channel as i64),
            transition_before: field!(Transition, before),
            transition_after: field!(Transition, after),
            tangential_channel: field!(Tangential, channel as i64),
            tangential_group: field!(Tangential, group as i64),
            tangential_slip_before: field!(Tangential, before),
            tangential_slip_after: field!(Tangential, after),
            tangential_impulse: field!(Tangential, impulse),
            tangential_sticks: field!(Tangential, sticks),
        }))
    }
}

/// Slip speeds, distances and dissipated work of samples.
pub(crate) type Slips = (Matrix<f64>, Matrix<f64>, Vector<f64>);

/// What states hold behind coordinates and gaps.
pub(crate) fn slips_of(py: Python<'_>, layout: Layout, x: &[f64], v: &[f64]) -> PyResult<Slips> {
    let (size, from) = (layout.size(), layout.n + layout.m);
    let picked = |values: &[f64]| columns(py, values, size, from, layout.p);
    let work = v.chunks_exact(size).map(|row| row[size - 1]);
    Ok((picked(v)?, picked(x)?, array(py, work)?))
}

/// What each channel does in each mode.
pub(crate) fn modes_of(py: Python<'_>, modes: &[ContactMode], p: usize) -> PyResult<Matrix<i8>> {
    let all = modes.iter().flat_map(|mode| (0..p).map(|channel| mode.number(channel)));
    Ok(array(py, all)?.into_bound(py).reshape([modes.len(), p])?.unbind())
}
