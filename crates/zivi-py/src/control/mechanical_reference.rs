//! References of mechanical systems from Python.

use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use zivi::drive::mechanical::{MechanicalReference, ReferenceSample};
use zivi::system::dynamics::Layout;

use crate::arrays::{list, vector};

/// A reference at all samples.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct Reference {
    pub(crate) inner: MechanicalReference,
}

type Rows<'py> = PyReadonlyArray2<'py, f64>;

fn rows(of: &Rows<'_>) -> PyResult<Vec<f64>> {
    list(of.as_array().iter().copied())
}

#[pymethods]
impl Reference {
    /// Rows of coordinates, velocities and accelerations, then of gaps, rates, accelerations and
    /// sides, and which are closed; of functions that follow, with their derivatives.
    #[new]
    #[allow(clippy::too_many_arguments)]
    fn new(
        q: Rows<'_>,
        qdot: Rows<'_>,
        qddot: Rows<'_>,
        gaps: Rows<'_>,
        gap_rates: Rows<'_>,
        accelerations: Rows<'_>,
        sides: Rows<'_>,
        contacts: PyReadonlyArray2<'_, bool>,
        tasks: Rows<'_>,
    ) -> PyResult<Self> {
        let inner = MechanicalReference {
            q: rows(&q)?,
            w: rows(&qdot)?,
            turning: rows(&qddot)?,
            gaps: rows(&gaps)?,
            rates: rows(&gap_rates)?,
            accelerations: rows(&accelerations)?,
            sides: rows(&sides)?,
            contacts: list(contacts.as_array().iter().copied())?,
            tasks: rows(&tasks)?,
        };
        let of_q = [&inner.w, &inner.turning].iter().all(|it| it.len() == inner.q.len());
        let parts = [&inner.rates, &inner.accelerations, &inner.sides];
        let of_gaps = parts.iter().all(|it| it.len() == inner.gaps.len());
        if inner.q.is_empty() || !of_q || !of_gaps || inner.contacts.len() != inner.gaps.len() {
            return Err(PyValueError::new_err("the parts of a reference do not fit together"));
        }
        Ok(Self { inner })
    }
}

/// A sample of a reference from Python, `(q, qdot, sides, contacts, gaps, gap_rates, accelerations,
/// qddot, tasks)`.
pub(super) type Told<'py> = (
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray1<'py, bool>,
    Option<PyReadonlyArray1<'py, f64>>,
    Option<PyReadonlyArray1<'py, f64>>,
    Option<PyReadonlyArray1<'py, f64>>,
    Option<PyReadonlyArray1<'py, f64>>,
    Option<PyReadonlyArray1<'py, f64>>,
);

/// The same with its numbers.
pub(super) struct Sample {
    q: Vec<f64>,
    w: Vec<f64>,
    sides: Vec<f64>,
    contacts: Vec<bool>,
    gaps: Option<(Vec<f64>, Vec<f64>)>,
    accelerations: Option<Vec<f64>>,
    turning: Option<Vec<f64>>,
    tasks: Option<Vec<f64>>,
}

impl Sample {
    pub(super) fn of(told: &Told<'_>, Layout { n, m, .. }: Layout, count: usize) -> PyResult<Self> {
        let (q, w, sides, contacts, gaps, rates, accelerations, turning, tasks) = told;
        let optional = |of: &Option<PyReadonlyArray1<'_, f64>>| of.as_ref().map(vector).transpose();
        let sample = Self {
            q: vector(q)?,
            w: vector(w)?,
            sides: vector(sides)?,
            contacts: list(contacts.as_array().iter().copied())?,
            gaps: optional(gaps)?.zip(optional(rates)?),
            accelerations: optional(accelerations)?,
            turning: optional(turning)?,
            tasks: optional(tasks)?,
        };
        let is = |of: &Option<Vec<f64>>, size| of.as_ref().is_none_or(|it| it.len() == size);
        let gaps = sample.gaps.as_ref().is_none_or(|(x, v)| x.len() == m && v.len() == m);
        let of_q = sample.q.len() == n && sample.w.len() == n && is(&sample.turning, n);
        let of_gaps = sample.sides.len() == m && sample.contacts.len() == m && gaps;
        if of_q && of_gaps && is(&sample.accelerations, m) && is(&sample.tasks, 3 * count) {
            return Ok(sample);
        }
        Err(PyValueError::new_err(format!(
            "a sample of the reference must be of {n} coordinates, {m} gaps and {count} tasks"
        )))
    }

    pub(super) fn view(&self) -> ReferenceSample<'_> {
        ReferenceSample {
            q: &self.q,
            w: &self.w,
            sides: &self.sides,
            contacts: &self.contacts,
            gaps: self.gaps.as_ref().map(|(x, v)| (x.as_slice(), v.as_slice())),
            accelerations: self.accelerations.as_deref(),
            turning: self.turning.as_deref(),
            tasks: self.tasks.as_deref(),
        }
    }
}
