//! Dry friction from Python: arguments of systems, results of runs.

use std::sync::Arc;

use numpy::PyArrayMethods;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::gc::{PyTraverseError, PyVisit};
use pyo3::prelude::*;
use zivi::mechanics::{MechanicalRun, Occurrence};
use zivi::record::gap_set::ContactMode;
use zivi::system::dynamics::{Dynamics, Layout};
use zivi::system::force::{Channel, ContactForce, Friction, FrictionalImpact};
use zivi::system::linear_system::LinearSystem;
use zivi::system::partials::{
    DifferentiableDynamics, DirectionalDerivative, MovedLaws, TimedState,
};

use crate::interface::{array, columns, Matrix, Vector};

/// A compliant gap: its number, the name of its law, the numbers of that, or a function.
type CompliantGap = (usize, String, Vec<f64>, Option<Py<PyAny>>);

/// The channels of friction of a system, those of gaps first, how impacts go on, and the compliant gaps.
#[pyclass(frozen, module = "zivi._zivi", name = "Friction")]
pub(crate) struct PyFriction {
    given: Friction,
    /// The contact forces that are functions `(depth, rate)`, by gap.
    functions: Vec<(usize, Py<PyAny>)>,
}

impl PyFriction {
    /// That of a system, of no channels and rigid gaps if it has none.
    pub(crate) fn given(of: Option<&Self>) -> &Friction {
        match of {
            Some(friction) => &friction.given,
            None => Friction::none(),
        }
    }
}

#[pymethods]
impl PyFriction {
    /// For each channel its gap, or None for a joint, and its tangential restitution; the compliant gaps,
    /// ascending.
    #[new]
    #[pyo3(signature = (channels, *, law, impact_without_collision, compliant=vec![]))]
    fn new(
        channels: Vec<(Option<usize>, f64)>,
        law: &str,
        impact_without_collision: bool,
        compliant: Vec<CompliantGap>,
    ) -> PyResult<Self> {
        let law = match law {
            "newton" => FrictionalImpact::Newton,
            "poisson" => FrictionalImpact::Poisson,
            "stronge" => FrictionalImpact::Stronge,
            _ => return Err(PyValueError::new_err(format!("no law of impacts is called {law:?}"))),
        };
        let channels = channels.into_iter().map(|(gap, e_t)| Channel { gap, e_t }).collect();
        let mut functions = Vec::new();
        let mut laws = Vec::new();
        for (gap, kind, numbers, function) in compliant {
            let force = match (kind.as_str(), numbers.as_slice()) {
                ("spring_damper", &[k, c]) => ContactForce::SpringDamper { k, c },
                ("power", &[k, p]) => ContactForce::Power { k, p },
                ("hunt_crossley", &[k, p, alpha]) => ContactForce::HuntCrossley { k, p, alpha },
                _ => ContactForce::Function,
            };
            functions.extend(function.map(|it| (gap, it)));
            laws.push((gap, force));
        }
        let given = Friction { channels, law, impact_without_collision, compliant: laws };
        Ok(Self { given, functions })
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        self.functions.iter().try_for_each(|(_, function)| visit.call(function))
    }
}

/// A system with its friction.
pub(crate) struct Rubbing<'a, D> {
    pub(crate) dynamics: D,
    pub(crate) friction: Option<&'a PyFriction>,
    /// How parameters move the laws of the gaps.
    pub(crate) moved: &'a [Option<MovedLaws>],
}

impl<D: Dynamics<PyErr>> Dynamics<PyErr> for Rubbing<'_, D> {
    fn layout(&self) -> Layout {
        self.dynamics.layout()
    }

    fn friction(&self) -> &Friction {
        PyFriction::given(self.friction)
    }

    fn contact_force(&mut self, gap: usize, depth: f64, rate: f64) -> PyResult<f64> {
        let of_gap = |(number, _): &&(usize, Py<PyAny>)| *number == gap;
        let functions = self.friction.map_or(&[][..], |it| &it.functions);
        let Some((_, function)) = functions.iter().find(of_gap) else { return Ok(0.0) };
        Python::attach(|py| {
            let value = function.bind(py).call1((depth, rate))?;
            crate::interface::look()?;
            value.extract().map_err(|_| {
                let kind = value.get_type();
                PyTypeError::new_err(format!(
                    "contact(depth, rate) must return a float, got {kind}"
                ))
            })
        })
    }

    #[inline]
    fn evaluate(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> PyResult<()> {
        self.dynamics.evaluate(t, q, w, out)
    }

    #[inline]
    fn evaluate_again(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> PyResult<()> {
        self.dynamics.evaluate_again(t, q, w, out)
    }

    #[inline]
    fn evaluate_gaps(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> PyResult<()> {
        self.dynamics.evaluate_gaps(t, q, w, out)
    }

    fn evaluate_equalities(
        &mut self,
        t: f64,
        q: &[f64],
        w: &[f64],
        out: &mut [f64],
    ) -> PyResult<()> {
        self.dynamics.evaluate_equalities(t, q, w, out)
    }

    fn has_separate_equalities(&self) -> bool {
        self.dynamics.has_separate_equalities()
    }

    fn is_steady(&self) -> bool {
        // a linear system has waves and tables for loads: no pulse is hidden in them
        let is_soft = !self.friction().compliant.is_empty();
        self.dynamics.is_steady() || (is_soft && self.dynamics.linear().is_some())
    }

    /// Not with compliant gaps, whose laws may be any functions.
    fn is_autonomous(&self) -> bool {
        self.dynamics.is_autonomous() && self.friction().compliant.is_empty()
    }

    fn change_charts(&self, far: f64, q: &mut [f64], w: &mut [f64]) -> bool {
        self.dynamics.change_charts(far, q, w)
    }

    /// None with compliant gaps: those in contact have another matrix.
    fn linear(&self) -> Option<&Arc<LinearSystem>> {
        self.dynamics.linear().filter(|_| self.friction().compliant.is_empty())
    }

    fn has_constant_matrices(&self) -> bool {
        self.dynamics.has_constant_matrices() && self.friction().compliant.is_empty()
    }
}

impl<D: DifferentiableDynamics<PyErr>> DifferentiableDynamics<PyErr> for Rubbing<'_, D> {
    fn parameters(&self) -> usize {
        self.dynamics.parameters()
    }

    fn set_extent(&mut self, q: &[f64], w: &[f64]) {
        self.dynamics.set_extent(q, w);
    }

    fn partials(&mut self, at: TimedState<'_>, by: &[usize], out: &mut [f64]) -> PyResult<()> {
        self.dynamics.partials(at, by, out)
    }

    fn directional(&self) -> Option<Arc<dyn DirectionalDerivative>> {
        self.dynamics.directional()
    }

    fn linear_rate(&self, parameter: usize) -> Option<&Arc<LinearSystem>> {
        self.dynamics.linear_rate(parameter)
    }

    fn moved_laws(&self, parameter: usize) -> Option<&MovedLaws> {
        self.moved.get(parameter)?.as_ref()
    }

    fn reach(&self, by: &[usize]) -> Option<Vec<f64>> {
        self.dynamics.reach(by)
    }
}

/// Friction results of a run.
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
    /// `None` for a run without friction.
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
            forces: columns(py, &samples.lambda, layout.forces(), m, p)?,
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

/// The part of states after coordinates and gaps.
pub(crate) fn slips_of(py: Python<'_>, layout: Layout, x: &[f64], v: &[f64]) -> PyResult<Slips> {
    let (size, from) = (layout.size(), layout.n + layout.m);
    let picked = |values: &[f64]| columns(py, values, size, from, layout.p);
    let work = v.chunks_exact(size).map(|row| row[size - 1]);
    Ok((picked(v)?, picked(x)?, array(py, work)?))
}

/// Mode of each channel, per contact mode.
pub(crate) fn modes_of(py: Python<'_>, modes: &[ContactMode], p: usize) -> PyResult<Matrix<i8>> {
    let all = modes.iter().flat_map(|mode| (0..p).map(|channel| mode.number(channel)));
    Ok(array(py, all)?.into_bound(py).reshape([modes.len(), p])?.unbind())
}
