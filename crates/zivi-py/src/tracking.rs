//! Batches of independent steps of the tracker: its exact solution and general solvers.

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use zivi::stepping::step_solver::SignSolver;
use zivi::{Lifted, Solver};
use zivi_core::control::inclusion::{AsProblem, Inclusion, TrackingInclusion};
use zivi_core::control::tracking::{Target, TrackingStep};
use zivi_core::control::Gains;
use zivi_core::ThetaGammaStep;

use crate::interface::{list, setup_error, with_room};
use crate::method::step_solver;
use crate::transform::restitution_of;

/// `s, v, s_r, v_r` at the start of a step.
const STATE: usize = 4;
/// `ls, lv, lsr, lvr, les, lev`.
const SIGNS: usize = 6;

/// The tracker's scheme under constant forces.
struct TrackerScheme {
    step: TrackingStep,
    reference: ThetaGammaStep,
    f: f64,
    f_ref: f64,
}

impl TrackerScheme {
    /// The signs as the tick finds them; `None` where the reference's step has no solution.
    #[inline]
    fn exact(&self, [s, v, s_ref, v_ref]: [f64; STATE]) -> Option<[f64; SIGNS]> {
        let reference = Lifted { s: s_ref, v: v_ref };
        let of_ref = self.reference.solve(reference, self.f_ref, 1.0).ok()?;
        let (lambda_sr, lambda_vr) = (of_ref.lambda_s, of_ref.lambda_v);
        let r = self.reference.restitution().r(lambda_sr, lambda_vr);
        let target = Target { end: of_ref.end(), acceleration: lambda_sr * self.f_ref / r };
        let it = self.step.solve_near(Lifted { s, v }, self.f, target, lambda_vr);
        Some([it.lambda_s, it.lambda_v, lambda_sr, lambda_vr, it.lambda_es, it.lambda_ev])
    }

    /// All six signs as one VI; its rows are divided by as much as their terms can be.
    fn general(&self, solver: &mut SignSolver<SIGNS>, state: [f64; STATE]) -> bool {
        let [s, v, s_ref, v_ref] = state;
        let inclusion = TrackingInclusion {
            step: &self.step,
            restitution_ref: self.reference.restitution(),
            z: Lifted { s, v },
            reference: Lifted { s: s_ref, v: v_ref },
            f: self.f,
            f_ref: self.f_ref,
        };
        solver.solve(&mut AsProblem(inclusion), inclusion.scales([1.0; SIGNS]))
    }
}

/// The rows of a two-dimensional array.
fn rows<const N: usize>(name: &str, array: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<[f64; N]>> {
    let array = array.as_array();
    if array.ncols() != N {
        return Err(PyValueError::new_err(format!("{name} must have {N} columns")));
    }
    list((0..array.nrows()).map(|k| std::array::from_fn(|j| array[[k, j]])))
}

/// Signs of many steps of the tracker (NaN where there are none), and whether the solver calls them
/// solved. `states` has the columns `s, v, s_r, v_r`; `starts` and the result have
/// `ls, lv, lsr, lvr, les, lev`. A solve starts from its initial point or, if that is NaN, from the
/// last signs that solved a step. The solver `"exact"` is the tick's and needs no start.
#[pyfunction]
#[pyo3(signature = (
    states, starts, *, gains, kappa, kappa_ref, h, f, f_ref, solver, linearisations, fall_backs
))]
#[allow(clippy::too_many_arguments, clippy::type_complexity)]
pub(crate) fn solve_tracking_steps<'py>(
    py: Python<'py>,
    states: PyReadonlyArray2<'py, f64>,
    starts: PyReadonlyArray2<'py, f64>,
    gains: (f64, f64),
    kappa: f64,
    kappa_ref: f64,
    h: f64,
    f: f64,
    f_ref: f64,
    solver: &Bound<'_, PyAny>,
    linearisations: i64,
    fall_backs: bool,
) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<bool>>)> {
    let _running = crate::leaving::running()?;
    let refused = |error: zivi_core::SettingError| PyValueError::new_err(error.to_string());
    let gains = Gains::new(gains.0, gains.1).map_err(refused)?;
    let reference = ThetaGammaStep::new(h, 1.0, 1.0, restitution_of(kappa_ref)?);
    let reference = reference.map_err(|error| setup_error(error.into()))?;
    let step = TrackingStep { h, restitution: restitution_of(kappa)?, gains };
    let scheme = TrackerScheme { step, reference, f, f_ref };
    let states = rows::<STATE>("states", &states)?;
    let starts = rows::<SIGNS>("starts", &starts)?;
    if states.len() != starts.len() {
        return Err(PyValueError::new_err("states and starts must be equally many"));
    }
    let mut signs = with_room(SIGNS * states.len())?;
    let mut solved = with_room(states.len())?;
    let mut general = match (step_solver(solver, linearisations)?, fall_backs) {
        (Solver::Exact, _) => None,
        (Solver::Outer { linearisations }, _) => Some(SignSolver::outer(linearisations)),
        (Solver::Newton, true) => Some(SignSolver::newton()),
        (Solver::Newton, false) => Some(SignSolver::newton_without_fall_backs()),
    };
    for (state, start) in states.into_iter().zip(starts) {
        let found = match &mut general {
            None => scheme.exact(state),
            Some(general) => {
                if start.iter().all(|sign| !sign.is_nan()) {
                    general.start_from(start);
                }
                scheme.general(general, state).then(|| general.signs())
            }
        };
        solved.push(found.is_some());
        signs.extend(found.unwrap_or([f64::NAN; SIGNS]));
    }
    let count = solved.len();
    let signs = PyArray1::from_vec(py, signs).reshape([count, SIGNS])?;
    Ok((signs, PyArray1::from_vec(py, solved)))
}
