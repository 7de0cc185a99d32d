//! Batches of closed loops from Python.

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use zivi::drive::batch::{
    simulate_closed_loop_batch as run_batch, LoopMember, LoopOutcome, LoopSettings,
};
use zivi::drive::closed_loop::{AnyController, ReferencePoint};
use zivi::{Physical, Status};

use crate::batch::{natives, refused, row_restitution, rows, BETWEEN_LOOKS};
use crate::closed_loop::{given_of_row, motion_of};
use crate::control::of_ours;
use crate::force::Force;
use crate::interface::{array, list, with_room, Watch};
use crate::method::PyMethod;
use crate::observer::PyObserver;
use crate::simulate::grid_of;
use crate::transform::restitution_of;

fn native(controller: &Bound<'_, PyAny>) -> PyResult<AnyController> {
    of_ours(controller).ok_or_else(|| {
        let kind = controller.get_type();
        PyTypeError::new_err(format!("a batch takes zivi's own controllers, got {kind}"))
    })
}

/// Many closed loops. `forces` are lists of the plants', the models' and the references'; every
/// list has an entry for each loop, or one for all.
#[pyfunction]
#[pyo3(signature = (
    controllers, observers, forces, restitutions, states, *, span, method, exact, resolution,
    delay, within, every, slowest, threads, references=Vec::new(), progress=None
))]
#[allow(clippy::too_many_arguments)]
pub(crate) fn simulate_closed_loop_batch(
    py: Python<'_>,
    controllers: Vec<Bound<'_, PyAny>>,
    observers: Vec<PyRef<'_, PyObserver>>,
    forces: [Vec<Py<Force>>; 3],
    restitutions: PyReadonlyArray2<'_, f64>,
    states: PyReadonlyArray2<'_, f64>,
    span: (f64, f64),
    method: PyRef<'_, PyMethod>,
    exact: bool,
    resolution: (f64, f64),
    delay: usize,
    within: f64,
    every: usize,
    slowest: f64,
    threads: usize,
    references: Vec<(PyReadonlyArray2<'_, f64>, f64)>,
    progress: Option<Py<PyAny>>,
) -> PyResult<LoopBatchRecord> {
    let _running = crate::leaving::running()?;
    let shared = LoopSettings {
        motion: motion_of(&method, exact)?,
        resolution,
        delay,
        within,
        every,
        slowest,
    };
    let controllers = controllers.iter().map(native).collect::<PyResult<Vec<_>>>()?;
    let [plants, models, drives] = &forces;
    let (plants, models) = (natives(py, plants)?, natives(py, models)?);
    let drives = natives(py, drives)?;
    let given = references
        .iter()
        .map(|(rows, kappa)| {
            let rows: Vec<ReferencePoint> =
                list(rows.as_array().rows().into_iter().map(given_of_row))?;
            Ok((rows, restitution_of(*kappa)?))
        })
        .collect::<PyResult<Vec<_>>>()?;
    let mut members = with_room(states.as_array().nrows())?;
    for (i, state) in states.as_array().rows().into_iter().enumerate() {
        if i % BETWEEN_LOOKS == 0 {
            py.check_signals()?;
        }
        let which = |n: usize| if n == 1 { 0 } else { i };
        let controller = &controllers[which(controllers.len())];
        members.push(LoopMember {
            controller: controller.clone(),
            observer: observers.get(which(observers.len())).map(|it| it.inner),
            restitution: row_restitution(&restitutions, i)?,
            forces: [
                plants[which(plants.len())],
                models[which(models.len())],
                drives[which(drives.len())],
            ],
            initial: Physical { x: state[0], xdot: state[1] },
            grid: grid_of(span, controller.h())?,
            reference: match given.len() {
                0 => None,
                n => Some((given[which(n)].0.as_slice(), given[which(n)].1)),
            },
        });
    }
    let watch = &mut Watch::reporting(progress);
    let ends = py.detach(|| run_batch(&members, shared, threads, watch)).map_err(refused)?;
    LoopBatchRecord::new(py, &ends)
}

type Array = Py<PyArray1<f64>>;
type Rows = Py<PyArray2<f64>>;

/// Saved data of the loops: one entry or row per loop.
#[pyclass(frozen, get_all, module = "zivi._zivi")]
pub(crate) struct LoopBatchRecord {
    /// `t, x, x', x_r, x_r'` at the end, a row for each loop.
    last: Rows,
    settling_time: Array,
    error_max: Array,
    error_rms: Array,
    u_max: Array,
    u_rms: Array,
    u_variation: Array,
    rest_time: Array,
    n_impacts: Py<PyArray1<u64>>,
    n_updates: Py<PyArray1<u64>>,
    n_refused: Py<PyArray1<u64>>,
    n_saturated: Py<PyArray1<u64>>,
    n_unsolved: Py<PyArray1<u64>>,
    status: Py<PyArray1<u8>>,
    samples_x: Rows,
    samples_x_ref: Rows,
    samples_u: Rows,
}

impl LoopBatchRecord {
    fn new(py: Python<'_>, ends: &[LoopOutcome]) -> PyResult<Self> {
        let column = |of: fn(&LoopOutcome) -> f64| array(py, ends.iter().map(of));
        let count = |of: fn(&LoopOutcome) -> u64| array(py, ends.iter().map(of));
        let number = |it: &LoopOutcome| it.status.unwrap_or(Status::Raised) as u8;
        let last = list(ends.iter().flat_map(|it| it.last))?;
        Ok(Self {
            last: PyArray1::from_vec(py, last).reshape([ends.len(), 5])?.unbind(),
            settling_time: column(|it| it.settling_time)?,
            error_max: column(|it| it.error_max)?,
            error_rms: column(|it| it.error_rms)?,
            u_max: column(|it| it.u_max)?,
            u_rms: column(|it| it.u_rms)?,
            u_variation: column(|it| it.u_variation)?,
            rest_time: column(|it| it.rest_time)?,
            n_impacts: count(|it| it.n_impacts)?,
            n_updates: count(|it| it.updates.total)?,
            n_refused: count(|it| it.updates.rejected)?,
            n_saturated: count(|it| it.updates.saturated)?,
            n_unsolved: count(|it| it.updates.unsolved)?,
            status: array(py, ends.iter().map(number))?,
            samples_x: rows(py, ends.iter().map(|it| it.saved[0].as_slice()))?,
            samples_x_ref: rows(py, ends.iter().map(|it| it.saved[1].as_slice()))?,
            samples_u: rows(py, ends.iter().map(|it| it.saved[2].as_slice()))?,
        })
    }
}
