//! The implicit tracker.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use zivi::drive::closed_loop::{
    AnyController, Controller, Predicting, ReferencePeriod, Solved, Tick, TickError, UnderWay,
};
use zivi::Solver;
use zivi_core::control::{Approach, Gains, TwistingTracker, Waypoint};
use zivi_core::{Branch, Physical};

use super::arguments::{gains, landing, port, refused, restored, sample, tracker_state, State};
use super::late::{
    nothing_under_way, only_with, raised, under_way_of, under_way_state, UnderWayState,
};
use super::reference::with_reference;
use crate::method::step_solver;
use crate::transform::restitution_of;

/// The implicit tracker; `zivi.TwistingTracker` is what users see.
#[pyclass(subclass, module = "zivi._zivi")]
pub(crate) struct Tracker {
    pub(super) inner: TwistingTracker,
    /// How its steps are solved.
    solver: Solver,
    /// What does not act yet, of one whose controls act late.
    under_way: Option<Box<UnderWay>>,
}

impl Tracker {
    pub(super) fn solved(&self) -> Solved<TwistingTracker> {
        Solved { controller: self.inner, solver: self.solver }
    }

    pub(super) fn any(&self) -> AnyController {
        match (&self.under_way, self.solver) {
            (Some(it), _) => {
                let (controller, under_way) = (self.solved(), it.clone());
                AnyController::LateTracker(Predicting { controller, under_way })
            }
            (None, Solver::Exact) => AnyController::Tracker(self.inner),
            (None, _) => AnyController::SolvedTracker(self.solved()),
        }
    }

    /// Ticks as one whose controls act late; `None` of one whose controls do not.
    fn ticked_late(
        &mut self,
        tick: impl FnOnce(&mut Predicting<Solved<TwistingTracker>>) -> Result<f64, TickError<PyErr>>,
    ) -> Option<PyResult<f64>> {
        let under_way = self.under_way.take()?;
        let mut it = Predicting { controller: self.solved(), under_way };
        let done = tick(&mut it);
        (self.inner, self.under_way) = (it.controller.controller, Some(it.under_way));
        Some(done.map_err(raised))
    }

    /// Nothing is under way any longer.
    fn forget(&mut self) {
        if let Some(it) = &mut self.under_way {
            it.forget();
        }
    }

    /// A tick, or a period without a sample.
    fn stepped(
        &mut self,
        sample: Option<Physical>,
        (force, force_ref): (f64, f64),
        dt: Option<f64>,
    ) -> PyResult<f64> {
        only_with(&self.under_way, dt)?;
        let late = self.ticked_late(|it| match sample {
            Some(measured) => {
                Controller::<PyErr>::tick(it, Tick { t: 0.0, measured, force, force_ref })
            }
            None => Ok(it.miss(force_ref)?),
        });
        if let Some(u) = late {
            return u;
        }
        let mut it = self.solved();
        if let Some(dt) = dt {
            it.controller = it.controller.lasting(dt).map_err(refused)?;
        }
        let u = match sample {
            Some(measured) => it.tick(measured, force, force_ref),
            None => it.controller.miss(force_ref),
        };
        let u = u.map_err(refused)?;
        self.inner.set_state(it.controller.state());
        Ok(u)
    }

    /// Takes over where this one is.
    pub(super) fn restore(&mut self, controller: &AnyController) {
        match controller {
            AnyController::Tracker(it) => self.inner = *it,
            AnyController::SolvedTracker(it) => self.inner = it.controller,
            AnyController::LateTracker(it) => {
                (self.inner, self.under_way) =
                    (it.controller.controller, Some(it.under_way.clone()));
            }
            _ => {}
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
        horizon, shift, delay
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
        delay: usize,
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
        let inner = inner.with_port(port(depth, actuator)?);
        Ok(Self { inner, solver: Solver::Exact, under_way: nothing_under_way(delay)? })
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
        only_with(&self.under_way, dt)?;
        let measured = sample(x, xdot)?;
        let course = ReferencePeriod { now, next, acceleration };
        let late = self.ticked_late(|it| match measured {
            Some(measured) => {
                let tick = Tick { t: 0.0, measured, force, force_ref: 0.0 };
                Controller::<PyErr>::tick_to(it, tick, course)
            }
            None => Ok(it.miss_to(next)?),
        });
        if let Some(u) = late {
            return u;
        }
        let mut it = self.solved();
        if let Some(dt) = dt {
            it.controller = it.controller.lasting(dt).map_err(refused)?;
        }
        let u = match measured {
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

    /// What is under way: the controls, the references and the periods by which they are not ahead.
    #[getter]
    fn _under_way(&self) -> Option<UnderWayState> {
        self.under_way.as_deref().map(under_way_state)
    }

    #[setter(_under_way)]
    fn set_under_way(&mut self, state: UnderWayState) -> PyResult<()> {
        self.under_way = Some(under_way_of(state)?);
        Ok(())
    }

    /// `D`, `U` and the acceleration at rest, None without a landing.
    fn _accelerations(&self) -> Option<[f64; 3]> {
        self.inner.descent().map(|it| it.accelerations())
    }
}
