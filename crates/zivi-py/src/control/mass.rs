//! Controllers of one mass: tracker, regulator, explicit law.
//!
//! Common part of the two controllers with a reference.

use crate::control::arguments::{
    gains, landing, nothing_under_way, only_with, port, raised, refused, restored, sample,
    tracker_state, under_way_of, under_way_state, State, UnderWayState,
};
use crate::method::step_solver;
use crate::system::restitution_of;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use zivi::drive::closed_loop::{
    AnyController, Controller, Predicting, ReferencePeriod, Solved, Tick, TickError, UnderWay,
};
use zivi::Solver;
use zivi_core::control::{
    Approach, ExplicitTwisting, Gains, RegulatorState, TickStatus, TwistingRegulator,
    TwistingTracker, Waypoint,
};
use zivi_core::{Branch, Physical};

/// Common part of the two controllers with a reference.
macro_rules! with_reference {
    ($class:ident, $($own:tt)*) => {
        #[pymethods]
        impl $class {
            $($own)*

            /// Return the control for the period that starts with this measurement, and advance the
            /// reference by one period.
            ///
            /// Parameters
            /// ----------
            /// x, xdot : float or None
            ///     Measured distance from the wall (m) and velocity (m/s). Without `x` the sample is
            ///     missing: the control is held, the reference advances.
            /// force : float
            ///     Force on the mass without control (m/s^2).
            /// force_ref : float
            ///     Force on the reference (m/s^2).
            /// dt : float, optional
            ///     Length of the period that starts now, > 0 (s); by default `h`. The step is planned,
            ///     and the reference advances, over it.
            ///
            /// Returns
            /// -------
            /// float
            ///     The control, to be held for one period (m/s^2).
            ///
            /// Raises
            /// ------
            /// ValueError
            ///     If the sample is not finite or penetrates the wall too far. The controller is then
            ///     unchanged: the reference has not advanced, the last control is still `u`.
            #[pyo3(signature = (x, xdot=None, force=0.0, force_ref=0.0, *, dt=None))]
            fn step(
                &mut self,
                x: Option<f64>,
                xdot: Option<f64>,
                force: f64,
                force_ref: f64,
                dt: Option<f64>,
            ) -> PyResult<f64> {
                self.stepped(sample(x, xdot)?, (force, force_ref), dt)
            }

            /// Set the reference's distance from its wall, >= 0 (m), and its velocity (m/s), and
            /// forget everything else.
            fn reset(&mut self, x_ref: f64, xdot_ref: f64) -> PyResult<()> {
                self.inner.reset(Physical { x: x_ref, xdot: xdot_ref }).map_err(refused)?;
                self.forget();
                Ok(())
            }

            /// Distance of the reference from its wall: that at the next sample (m).
            #[getter]
            fn x_ref(&self) -> f64 {
                self.inner.reference().x
            }

            /// Velocity of the reference (m/s).
            #[getter]
            fn xdot_ref(&self) -> f64 {
                self.inner.reference().xdot
            }

            /// The last control (m/s^2).
            #[getter]
            fn u(&self) -> f64 {
                self.inner.state().u
            }

            #[getter]
            fn _signs(&self) -> [f64; 6] {
                self.inner.state().signs
            }

            #[getter]
            fn _status(&self) -> u8 {
                self.inner.state().status.bits()
            }

            fn _get_state(&self) -> State {
                tracker_state(self.inner.state())
            }

            fn _set_state(&mut self, state: State) {
                self.inner.set_state(restored(state));
            }
        }
    };
}

// The implicit tracker.

/// The implicit tracker; users see its subclass `zivi.TwistingTracker`.
#[pyclass(subclass, module = "zivi._zivi", name = "Tracker")]
pub(crate) struct PyTracker {
    pub(super) inner: TwistingTracker,
    /// How its steps are solved.
    solver: Solver,
    /// Delay line of a controller with delayed controls.
    under_way: Option<Box<UnderWay>>,
}

impl PyTracker {
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

    /// Control update with delayed controls; `None` without delay.
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

    /// Empties the delay line.
    fn forget(&mut self) {
        if let Some(it) = &mut self.under_way {
            it.forget();
        }
    }

    /// A control update, or a period without a sample.
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

    /// Takes over the state of this controller.
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

with_reference! { PyTracker,
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

    /// Return the control for the period that starts with this measurement, for a reference that is
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
    ///     If the sample or the reference is out of range. The controller is then unchanged.
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

    /// The delay line: controls, references and their lag in periods.
    #[getter]
    fn _under_way(&self) -> Option<UnderWayState> {
        self.under_way.as_deref().map(under_way_state)
    }

    #[setter(_under_way)]
    fn set_under_way(&mut self, state: UnderWayState) -> PyResult<()> {
        self.under_way = Some(under_way_of(state)?);
        Ok(())
    }

    /// `D`, `U` and the acceleration at rest, None without the contact-establishing law.
    fn _accelerations(&self) -> Option<[f64; 3]> {
        self.inner.descent().map(|it| it.accelerations())
    }
}

// The regulator.

/// The regulator; users see its subclass `zivi.TwistingRegulator`.
#[pyclass(subclass, module = "zivi._zivi", name = "Regulator")]
pub(crate) struct PyRegulator {
    pub(super) inner: TwistingRegulator,
    /// How its steps are solved.
    solver: Solver,
    /// Delay line of a controller with delayed controls.
    under_way: Option<Box<UnderWay>>,
}

impl PyRegulator {
    pub(super) fn solved(&self) -> Solved<TwistingRegulator> {
        Solved { controller: self.inner, solver: self.solver }
    }

    pub(super) fn any(&self) -> AnyController {
        match (&self.under_way, self.solver) {
            (Some(it), _) => {
                let (controller, under_way) = (self.solved(), it.clone());
                AnyController::LateRegulator(Predicting { controller, under_way })
            }
            (None, Solver::Exact) => AnyController::Regulator(self.inner),
            (None, _) => AnyController::SolvedRegulator(self.solved()),
        }
    }

    /// Takes over the state of this controller.
    pub(super) fn restore(&mut self, controller: &AnyController) {
        match controller {
            AnyController::Regulator(it) => self.inner = *it,
            AnyController::SolvedRegulator(it) => self.inner = it.controller,
            AnyController::LateRegulator(it) => {
                (self.inner, self.under_way) =
                    (it.controller.controller, Some(it.under_way.clone()));
            }
            _ => {}
        }
    }
}

#[pymethods]
impl PyRegulator {
    #[new]
    #[pyo3(signature = (mu1, mu2, *, h, kappa, bound, depth, actuator, ahead, quiet, delay))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        mu1: f64,
        mu2: f64,
        h: f64,
        kappa: f64,
        bound: Option<f64>,
        depth: f64,
        actuator: (f64, f64),
        ahead: Option<u32>,
        quiet: f64,
        delay: usize,
    ) -> PyResult<Self> {
        let restitution = restitution_of(kappa)?;
        let gains = gains(mu1, mu2, restitution, bound, Gains::for_regulation)?;
        let bare = TwistingRegulator::new(gains, h, restitution);
        let inner = bare.map_err(refused)?.with_landing(landing(ahead, h, quiet)?);
        let inner = inner.with_port(port(depth, actuator)?);
        Ok(Self { inner, solver: Solver::Exact, under_way: nothing_under_way(delay)? })
    }

    /// Return the control for the period that starts with this measurement.
    ///
    /// Parameters
    /// ----------
    /// x, xdot : float or None
    ///     Measured distance from the wall (m) and velocity (m/s). Without `x` the sample is missing:
    ///     the control is held.
    /// force : float
    ///     Force on the mass without control (m/s^2).
    /// dt : float, optional
    ///     Length of the period that starts now, > 0 (s); by default `h`.
    ///
    /// Returns
    /// -------
    /// float
    ///     The control, to be held for one period (m/s^2).
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If the sample is not finite or penetrates the wall too far. The controller is then unchanged,
    ///     and the last control is still `u`.
    #[pyo3(signature = (x, xdot=None, force=0.0, *, dt=None))]
    fn step(
        &mut self,
        x: Option<f64>,
        xdot: Option<f64>,
        force: f64,
        dt: Option<f64>,
    ) -> PyResult<f64> {
        only_with(&self.under_way, dt)?;
        let measured = sample(x, xdot)?;
        if let Some(under_way) = self.under_way.take() {
            let mut it = Predicting { controller: self.solved(), under_way };
            let done = match measured {
                Some(measured) => {
                    let tick = Tick { t: 0.0, measured, force, force_ref: 0.0 };
                    Controller::<PyErr>::tick(&mut it, tick)
                }
                None => Ok(it.miss()),
            };
            (self.inner, self.under_way) = (it.controller.controller, Some(it.under_way));
            return done.map_err(raised);
        }
        let mut it = self.solved();
        if let Some(dt) = dt {
            it.controller = it.controller.lasting(dt).map_err(refused)?;
        }
        let u = match measured {
            Some(measured) => it.tick(measured, force).map_err(refused)?,
            None => it.controller.miss(),
        };
        self.inner.set_state(it.controller.state());
        Ok(u)
    }

    /// How the steps are solved.
    fn _solve_by(&mut self, solver: &Bound<'_, PyAny>, linearisations: i64) -> PyResult<()> {
        self.solver = step_solver(solver, linearisations)?;
        Ok(())
    }

    /// Forget the last update.
    fn reset(&mut self) {
        self.inner.set_state(RegulatorState::default());
        if let Some(it) = &mut self.under_way {
            it.forget();
        }
    }

    /// The delay line: controls, references and their lag in periods.
    #[getter]
    fn _under_way(&self) -> Option<UnderWayState> {
        self.under_way.as_deref().map(under_way_state)
    }

    #[setter(_under_way)]
    fn set_under_way(&mut self, state: UnderWayState) -> PyResult<()> {
        self.under_way = Some(under_way_of(state)?);
        Ok(())
    }

    /// The last control (m/s^2).
    #[getter]
    fn u(&self) -> f64 {
        self.inner.state().u
    }

    #[getter]
    fn _signs(&self) -> [f64; 2] {
        self.inner.state().signs
    }

    #[getter]
    fn _status(&self) -> u8 {
        self.inner.state().status.bits()
    }

    fn _get_state(&self) -> State {
        let RegulatorState { u, signs: [lambda_s, lambda_v], status } = self.inner.state();
        (0.0, 0.0, 1.0, u, [lambda_s, lambda_v, 0.0, 0.0, 0.0, 0.0], status.bits())
    }

    fn _set_state(&mut self, state: State) {
        let (_, _, _, u, [lambda_s, lambda_v, ..], bits) = state;
        let status = TickStatus::from_bits(bits);
        self.inner.set_state(RegulatorState { u, signs: [lambda_s, lambda_v], status });
    }
}

// The explicit baseline.

/// The explicit baseline; users see its subclass `zivi.ExplicitTwisting`.
#[pyclass(subclass, module = "zivi._zivi")]
pub(crate) struct Explicit {
    pub(super) inner: ExplicitTwisting,
}

impl Explicit {
    /// Its signs are those of the sample, without a solve.
    pub(super) fn solved(&self) -> Solved<ExplicitTwisting> {
        Solved { controller: self.inner, solver: Solver::Exact }
    }

    pub(super) fn any(&self) -> AnyController {
        AnyController::Explicit(self.inner)
    }

    /// Takes over the state of this controller.
    pub(super) fn restore(&mut self, controller: &AnyController) {
        if let AnyController::Explicit(it) = controller {
            self.inner = *it;
        }
    }

    fn forget(&mut self) {}

    /// A control update, or a period without a sample.
    fn stepped(
        &mut self,
        sample: Option<Physical>,
        (force, force_ref): (f64, f64),
        dt: Option<f64>,
    ) -> PyResult<f64> {
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
}

with_reference! { Explicit,
    #[new]
    #[pyo3(signature = (mu1, mu2, *, h, kappa, kappa_ref, bound, depth, actuator))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        mu1: f64,
        mu2: f64,
        h: f64,
        kappa: f64,
        kappa_ref: f64,
        bound: Option<f64>,
        depth: f64,
        actuator: (f64, f64),
    ) -> PyResult<Self> {
        let (restitution, restitution_ref) = (restitution_of(kappa)?, restitution_of(kappa_ref)?);
        let gains = gains(mu1, mu2, restitution, bound, Gains::for_tracking)?;
        let bare = ExplicitTwisting::new(gains, h, restitution, restitution_ref).map_err(refused)?;
        Ok(Self { inner: bare.with_port(port(depth, actuator)?) })
    }
}
