//! The regulator.

use pyo3::prelude::*;
use zivi::drive::closed_loop::{AnyController, Controller, Predicting, Solved, Tick, UnderWay};
use zivi::Solver;
use zivi_core::control::{Gains, RegulatorState, TickStatus, TwistingRegulator};

use super::arguments::{gains, landing, port, refused, sample, State};
use super::late::{
    nothing_under_way, only_with, raised, under_way_of, under_way_state, UnderWayState,
};
use crate::method::step_solver;
use crate::transform::restitution_of;

/// The regulator; `zivi.TwistingRegulator` is what users see.
#[pyclass(subclass, module = "zivi._zivi")]
pub(crate) struct Regulator {
    pub(super) inner: TwistingRegulator,
    /// How its steps are solved.
    solver: Solver,
    /// What does not act yet, of one whose controls act late.
    under_way: Option<Box<UnderWay>>,
}

impl Regulator {
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

    /// Takes over where this one is.
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
impl Regulator {
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

    /// Forget the last tick.
    fn reset(&mut self) {
        self.inner.set_state(RegulatorState::default());
        if let Some(it) = &mut self.under_way {
            it.forget();
        }
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
