//! Mechanical systems from Python: the record of a run.

use crate::friction::FrictionRecord;
use crate::interface::{array, columns, list, members, vector, Array, EndedBy, Matrix, Vector};
use crate::method::Hits;
use crate::motion::PyMechanicalPath;
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1, PyReadonlyArrayDyn};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use zivi::mechanics::{GapSet, MechanicalRun, Modes, Occurrence};
use zivi::system::dynamics::Layout;

/// Samples, occurrences and outcome of one run.
#[pyclass(frozen, get_all, module = "zivi._zivi")]
pub(crate) struct MechanicalRecord {
    t: Vector<f64>,
    q: Matrix<f64>,
    qdot: Matrix<f64>,
    gaps: Matrix<f64>,
    gap_rates: Matrix<f64>,
    reactions: Matrix<f64>,
    /// Multipliers of the equality rows, where there are any.
    constraint_forces: Option<Matrix<f64>>,
    contacts: Matrix<bool>,
    /// Since when nothing happened, and the largest speeds from the start and from then on, where
    /// only the ends are sampled.
    speeds: Option<(f64, f64, f64)>,
    /// Occurrences at the gaps, if any.
    occurrences: Option<Py<Occurrences>>,
    /// Occurrences of each user event.
    hits: Vec<Py<Hits>>,
    status: u8,
    message: &'static str,
    nfev: u64,
    n_steps: u64,
    n_rejected: u64,
    n_impacts: u64,
    raised: EndedBy,
    path: Option<Py<PyMechanicalPath>>,
    /// Friction results, if any.
    friction: Option<Py<FrictionRecord>>,
}

/// Impacts, accumulations, lift-offs, openings, corners and flags, a column for each field.
#[pyclass(frozen, get_all, module = "zivi._zivi")]
pub(crate) struct Occurrences {
    impact_t: Vector<f64>,
    impact_gap: Vector<i64>,
    impact_speed_before: Vector<f64>,
    impact_speed_after: Vector<f64>,
    impact_impulse: Vector<f64>,
    impact_group: Vector<i64>,
    zeno_t: Vector<f64>,
    zeno_gap: Vector<i64>,
    zeno_closed: Matrix<bool>,
    contact_t: Vector<f64>,
    contact_gap: Vector<i64>,
    liftoff_t: Vector<f64>,
    liftoff_gap: Vector<i64>,
    opened_t: Vector<f64>,
    opened_gap: Vector<i64>,
    corner_t: Vector<f64>,
    corner_gaps: Matrix<bool>,
    flag_kind: Vec<&'static str>,
    flag_t: Vector<f64>,
    flag_gaps: Matrix<bool>,
    flag_size: Vector<f64>,
}

impl MechanicalRecord {
    pub(crate) fn new(py: Python<'_>, run: MechanicalRun<PyErr>) -> PyResult<Self> {
        let (Layout { n, m, .. }, size) = (run.layout, run.layout.size());
        let samples = &run.samples;
        let picked = |values: &[f64], from, width| columns(py, values, size, from, width);
        let closed = list(samples.modes.iter().map(|mode| mode.in_contact()))?;
        let friction = FrictionRecord::of(py, &run)?;
        let forces = run.layout.forces();
        let reactions = match forces {
            0 => PyArray1::from_vec(py, Vec::new()).reshape([samples.t.len(), 0])?.unbind(),
            _ => columns(py, &samples.lambda, forces, 0, m)?,
        };
        let constraint_forces = match run.layout.k {
            0 => None,
            k => Some(columns(py, &samples.lambda, forces, run.layout.rows(), k)?),
        };
        let occurrences = Occurrences::of(py, &run.occurrences, m)?;
        let hits = Hits::of(py, &run.hits, n)?;
        let path = run.path.map(|path| Py::new(py, PyMechanicalPath { path })).transpose()?;
        Ok(Self {
            t: array(py, samples.t.iter().copied())?,
            q: picked(&samples.x, 0, n)?,
            qdot: picked(&samples.v, 0, n)?,
            gaps: picked(&samples.x, n, m)?,
            gap_rates: picked(&samples.v, n, m)?,
            reactions,
            constraint_forces,
            contacts: members(py, &closed, m)?,
            speeds: run.speeds.map(|it| (it.since, it.fastest, it.fastest_since)),
            occurrences,
            hits,
            status: run.status as u8,
            message: run.status.message(),
            nfev: run.counts.nfev,
            n_steps: run.counts.accepted,
            n_rejected: run.counts.rejected,
            n_impacts: run.counts.impacts,
            raised: EndedBy::new(run.raised),
            path,
            friction: friction.map(|it| Py::new(py, it)).transpose()?,
        })
    }
}

impl Occurrences {
    /// `None` without occurrences (most short runs).
    fn of(py: Python<'_>, all: &[Occurrence], m: usize) -> PyResult<Option<Py<Self>>> {
        if all.is_empty() {
            return Ok(None);
        }
        let floats = |of: &dyn Fn(&Occurrence) -> Option<f64>| array(py, all.iter().filter_map(of));
        let integers =
            |of: &dyn Fn(&Occurrence) -> Option<i64>| array(py, all.iter().filter_map(of));
        let sets = |of: &dyn Fn(&Occurrence) -> Option<GapSet>| {
            let sets = list(all.iter().filter_map(of))?;
            members(py, &sets, m)
        };
        /// One field of one kind of occurrence.
        macro_rules! field {
            ($kind:ident, $field:ident $(as $to:ty)?) => {
                &|it| match it {
                    Occurrence::$kind { $field, .. } => Some(*$field $(as $to)?),
                    _ => None,
                }
            };
        }
        let kinds = all.iter().filter_map(|it| match it {
            Occurrence::Flag { kind, .. } => Some(kind.name()),
            _ => None,
        });
        let flag_kind = list(kinds)?;
        Py::new(
            py,
            Self {
                impact_t: floats(field!(Impact, t))?,
                impact_gap: integers(field!(Impact, gap as i64))?,
                impact_speed_before: floats(field!(Impact, before))?,
                impact_speed_after: floats(field!(Impact, after))?,
                impact_impulse: floats(field!(Impact, impulse))?,
                impact_group: integers(field!(Impact, group as i64))?,
                zeno_t: floats(field!(Zeno, t))?,
                zeno_gap: integers(field!(Zeno, gap as i64))?,
                zeno_closed: sets(field!(Zeno, closed))?,
                contact_t: floats(field!(Contact, t))?,
                contact_gap: integers(field!(Contact, gap as i64))?,
                liftoff_t: floats(field!(LiftOff, t))?,
                liftoff_gap: integers(field!(LiftOff, gap as i64))?,
                opened_t: floats(field!(Opened, t))?,
                opened_gap: integers(field!(Opened, gap as i64))?,
                corner_t: floats(field!(Corner, t))?,
                corner_gaps: sets(field!(Corner, gaps))?,
                flag_kind,
                flag_t: floats(field!(Flag, t))?,
                flag_gaps: sets(field!(Flag, gaps))?,
                flag_size: floats(field!(Flag, size))?,
            },
        )
        .map(Some)
    }
}

// Periodic motions of linear systems as impulses, from Python.

fn flat(array: &PyReadonlyArrayDyn<'_, f64>) -> PyResult<Vec<f64>> {
    list(array.as_array().iter().copied())
}

/// The last axis of an array has real and imaginary parts.
fn pairs(array: &PyReadonlyArrayDyn<'_, f64>) -> PyResult<Vec<(f64, f64)>> {
    list(flat(array)?.chunks_exact(2).map(|it| (it[0], it[1])))
}

fn square(py: Python<'_>, values: Vec<f64>, size: usize) -> PyResult<Matrix<f64>> {
    Ok(PyArray1::from_vec(py, values).reshape([size, size])?.unbind())
}

/// The impacts of one word of a linear system, in the order of their times.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct PeriodicImpulses {
    modes: Modes,
    gaps: Vec<usize>,
}

impl PeriodicImpulses {
    fn unknowns(&self, y: &PyReadonlyArray1<'_, f64>) -> PyResult<Vec<f64>> {
        let y = vector(y)?;
        if y.len() == 2 * self.gaps.len() {
            return Ok(y);
        }
        let rows = self.gaps.len();
        Err(PyValueError::new_err(format!("y must have {rows} pairs, got {} numbers", y.len())))
    }
}

#[pymethods]
impl PeriodicImpulses {
    #[new]
    #[pyo3(signature = (gaps, *, period, rates, kernels, vectors, inputs, pushes, forced_gaps, forced_states, omegas, mobilities, e))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        gaps: Vec<usize>,
        period: f64,
        rates: PyReadonlyArrayDyn<'_, f64>,
        kernels: PyReadonlyArrayDyn<'_, f64>,
        vectors: PyReadonlyArrayDyn<'_, f64>,
        inputs: PyReadonlyArrayDyn<'_, f64>,
        pushes: PyReadonlyArrayDyn<'_, f64>,
        forced_gaps: PyReadonlyArrayDyn<'_, f64>,
        forced_states: PyReadonlyArrayDyn<'_, f64>,
        omegas: PyReadonlyArrayDyn<'_, f64>,
        mobilities: PyReadonlyArrayDyn<'_, f64>,
        e: PyReadonlyArrayDyn<'_, f64>,
    ) -> PyResult<Self> {
        let modes = Modes {
            period,
            rates: pairs(&rates)?,
            kernels: pairs(&kernels)?,
            vectors: pairs(&vectors)?,
            inputs: pairs(&inputs)?,
            pushes: flat(&pushes)?,
            forced_gaps: flat(&forced_gaps)?,
            forced_states: flat(&forced_states)?,
            omegas: flat(&omegas)?,
            mobilities: flat(&mobilities)?,
            e: flat(&e)?,
        };
        modes.check(&gaps).map_err(PyValueError::new_err)?;
        Ok(Self { modes, gaps })
    }

    /// Of each impact by how much the speed of its gap rises with its own unit impulse.
    #[getter]
    fn mobilities(&self, py: Python<'_>) -> Array {
        PyArray1::from_iter(py, self.gaps.iter().map(|&gap| self.modes.mobilities[gap])).unbind()
    }

    /// Residual, speeds before the impacts, and the Jacobian, at rows of `P, t`.
    fn equations(
        &self,
        py: Python<'_>,
        y: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<(Array, Array, Matrix<f64>)> {
        let y = self.unknowns(&y)?;
        let it = self.modes.equations(&self.gaps, &y);
        let [residual, rates] = [it.residual, it.rates].map(|v| PyArray1::from_vec(py, v).unbind());
        Ok((residual, rates, square(py, it.matrix, y.len())?))
    }

    /// The parts `R` and `S` of the Jacobian of disturbances with `kappa = cos th`.
    fn turned(
        &self,
        py: Python<'_>,
        y: PyReadonlyArray1<'_, f64>,
        kappa: f64,
    ) -> PyResult<(Matrix<f64>, Matrix<f64>)> {
        let y = self.unknowns(&y)?;
        let [real, sine] = self.modes.turned(&self.gaps, &y, kappa);
        Ok((square(py, real, y.len())?, square(py, sine, y.len())?))
    }

    /// The gradients of `w R v` and `w S v` by the unknowns.
    fn curvature(
        &self,
        py: Python<'_>,
        y: PyReadonlyArray1<'_, f64>,
        kappa: f64,
        w: PyReadonlyArray1<'_, f64>,
        v: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<(Array, Array)> {
        let [y, w, v] = [self.unknowns(&y)?, self.unknowns(&w)?, self.unknowns(&v)?];
        let [real, sine] = self
            .modes
            .curvature(&self.gaps, &y, kappa, (&w, &v))
            .map(|it| PyArray1::from_vec(py, it).unbind());
        Ok((real, sine))
    }

    /// The states after the impacts, a row each.
    fn states(&self, py: Python<'_>, y: PyReadonlyArray1<'_, f64>) -> PyResult<Matrix<f64>> {
        let found = self.modes.states(&self.gaps, &self.unknowns(&y)?);
        let width = found.len() / self.gaps.len();
        Ok(PyArray1::from_vec(py, found).reshape([self.gaps.len(), width])?.unbind())
    }
}
