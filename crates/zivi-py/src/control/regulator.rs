//! The regulator.

use pyo3::prelude::*;
use zivi::drive::closed_loop::{AnyController, Solved};
use zivi::Solver;
use zivi_core::control::{Gains, RegulatorState, TickStatus, TwistingRegulator};

use super::arguments::{gains, landing, port, refused, sample, State};
use crate::method::step_solver;
use crate::transform::restitution_of;

/// The regulator; `zivi.TwistingRegulator` is what users see.
#[pyclass(subclass, module = "zivi._zivi")]
pub(crate) struct Regulator {
    pub(super) inner: TwistingRegulator,
    /// How its steps are solved.
    solver: Solver,
}

impl Regulator {
    pub(super) fn solved(&self) -> Solved<TwistingRegulator> {
        Solved { controller: self.inner, solver: self.solver }
    }

    pub(super) fn any(&self) -> AnyController {
        match self.solver {
            Solver::Exact => AnyController::Regulator(self.inner),
            _ => AnyController::SolvedRegulator(self.solved()),
        }
    }
}

#[pymethods]
impl Regulator {
    #[new]
    #[pyo3(signature = (mu1, mu2, *, h, kappa, bound, depth, actuator, ahead, quiet))]
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
    ) -> PyResult<Self> {
        let restitution = restitution_of(kappa)?;
        let gains = gains(mu1, mu2, restitution, bound, Gains::for_regulation)?;
        let bare = TwistingRegulator::new(gains, h, restitution);
        let inner = bare.map_err(refused)?.with_landing(landing(ahead, h, quiet)?);
        Ok(Self { inner: inner.with_port(port(depth, actuator)?), solver: Solver::Exact })
    }

    /// Give the control for the period that starts with this measurement.
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
    ///     For a sample that is not finite or too deep behind the wall; nothing has changed then,
    ///     and the last control is still `u`.
    #[pyo3(signature = (x, xdot=None, force=0.0, *, dt=None))]
    fn step(
        &mut self,
        x: Option<f64>,
        xdot: Option<f64>,
        force: f64,
        dt: Option<f64>,
    ) -> PyResult<f64> {
        let mut it = self.solved();
        if let Some(dt) = dt {
            it.controller = it.controller.lasting(dt).map_err(refused)?;
        }
        let u = match sample(x, xdot)? {
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

    /// Forget the last tick.
    fn reset(&mut self) {
        self.inner.set_state(RegulatorState::default());
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
