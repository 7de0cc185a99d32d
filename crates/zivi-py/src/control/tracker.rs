//! The implicit tracker.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use zivi::drive::closed_loop::{AnyController, Solved};
use zivi::Solver;
use zivi_core::control::{Approach, Gains, TwistingTracker, Waypoint};
use zivi_core::{Branch, Physical};

use super::arguments::{gains, landing, port, refused, restored, sample, tracker_state, State};
use super::reference::with_reference;
use crate::method::step_solver;
use crate::transform::restitution_of;

/// The implicit tracker; `zivi.TwistingTracker` is what users see.
#[pyclass(subclass, module = "zivi._zivi")]
pub(crate) struct Tracker {
    pub(super) inner: TwistingTracker,
    /// How its steps are solved.
    solver: Solver,
}

impl Tracker {
    pub(super) fn solved(&self) -> Solved<TwistingTracker> {
        Solved { controller: self.inner, solver: self.solver }
    }

    pub(super) fn any(&self) -> AnyController {
        match self.solver {
            Solver::Exact => AnyController::Tracker(self.inner),
            _ => AnyController::SolvedTracker(self.solved()),
        }
    }
}

/// A given reference at one sample, `(x_ref, xdot_ref, branch)`.
fn waypoint(name: &str, (x, xdot, branch): (f64, f64, f64)) -> PyResult<Waypoint> {
    let branch = match branch {
        1.0 => Branch::Positive,
        -1.0 => Branch::Negative,
        _ => {
            let message = format!("branch of {name} must be 1 or -1, got {branch:?}");
            return Err(PyValueError::new_err(message));
        }
    };
    Ok(Waypoint { state: Physical { x, xdot }, branch })
}

with_reference! { Tracker,
    #[new]
    #[pyo3(signature = (
        mu1, mu2, *, h, kappa, kappa_ref, nearest, bound, depth, actuator, ahead, quiet, press,
        horizon, shift
    ))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        mu1: f64,
        mu2: f64,
        h: f64,
        kappa: f64,
        kappa_ref: f64,
        nearest: bool,
        bound: Option<f64>,
        depth: f64,
        actuator: (f64, f64),
        ahead: Option<u32>,
        quiet: f64,
        press: Option<f64>,
        horizon: f64,
        shift: bool,
    ) -> PyResult<Self> {
        let approach = if nearest { Approach::Nearest } else { Approach::Positive };
        let (restitution, restitution_ref) = (restitution_of(kappa)?, restitution_of(kappa_ref)?);
        let gains = gains(mu1, mu2, restitution, bound, Gains::for_tracking)?;
        let bare = TwistingTracker::new(gains, h, restitution, restitution_ref, approach);
        let landing = bare.map_err(refused)?.with_landing(landing(ahead, h, quiet)?);
        let pressing = match press {
            Some(press) => landing.with_press(press, bound.unwrap_or(0.0)),
            None => Ok(landing),
        };
        let pressing = pressing.map_err(|error| PyValueError::new_err(error.to_string()))?;
        let inner = pressing.with_horizon(horizon).map_err(refused)?.with_shift(shift);
        Ok(Self { inner: inner.with_port(port(depth, actuator)?), solver: Solver::Exact })
    }

    /// Give the control for the period that starts with this measurement, for a reference that is
    /// given at this sample and at the next one instead of advanced.
    ///
    /// Parameters
    /// ----------
    /// x, xdot : float or None
    ///     Measured distance from the wall (m) and velocity (m/s). Without `x` the sample is missing:
    ///     the control is held.
    /// force : float
    ///     Force on the mass without control (m/s^2).
    /// now, next : (float, float, float)
    ///     The reference at this sample and at the next one: its distance from the wall, >= 0 (m),
    ///     its velocity (m/s), and the side of the wall on which it is followed, 1 or -1, which
    ///     changes with each of its impacts. At rest all is 0 (but the side).
    /// acceleration : float, optional
    ///     The reference's acceleration over the period (m/s^2). By default the difference quotient
    ///     of its velocities; over an impact `force`.
    /// dt : float, optional
    ///     Length of the period that starts now, > 0 (s); by default `h`.
    ///
    /// Returns
    /// -------
    /// float
    ///     The control, to be held for one period (m/s^2). The reference is `next` then.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     For a sample or a reference that is out of range; nothing has changed then.
    #[pyo3(signature = (x, xdot, force, now, next, acceleration=None, *, dt=None))]
    #[allow(clippy::too_many_arguments)]
    fn step_to(
        &mut self,
        x: Option<f64>,
        xdot: Option<f64>,
        force: f64,
        now: (f64, f64, f64),
        next: (f64, f64, f64),
        acceleration: Option<f64>,
        dt: Option<f64>,
    ) -> PyResult<f64> {
        let (now, next) = (waypoint("now", now)?, waypoint("next", next)?);
        let mut it = self.solved();
        if let Some(dt) = dt {
            it.controller = it.controller.lasting(dt).map_err(refused)?;
        }
        let u = match sample(x, xdot)? {
            Some(measured) => it.tick_to(measured, force, [now, next], acceleration),
            None => it.controller.miss_to(next),
        };
        let u = u.map_err(refused)?;
        self.inner.set_state(it.controller.state());
        Ok(u)
    }

    /// How the steps are solved.
    fn _solve_by(&mut self, solver: &Bound<'_, PyAny>, linearisations: i64) -> PyResult<()> {
        self.solver = step_solver(solver, linearisations)?;
        Ok(())
    }

    /// `D`, `U` and the acceleration at rest, None without a landing.
    fn _accelerations(&self) -> Option<[f64; 3]> {
        self.inner.descent().map(|it| it.accelerations())
    }
}
