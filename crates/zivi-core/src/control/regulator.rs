//! The twisting regulator: brings the mass to rest at the wall in finite time.

use super::port::checked_force;
use super::regulation::RegulationStep;
use super::{checked, Gains, Port, TickStatus};
use crate::{transform, Branch, Physical, Restitution, SettingError};

/// The regulator `u = -mu1 - mu2 sgn x'` with its signs taken implicitly, at the end of the
/// sampling period.
///
/// Stable in finite time for `|F| <= M` when `M < mu2 < mu1 - M`.
///
/// ```
/// use zivi_core::control::{Gains, TwistingRegulator};
/// use zivi_core::{Physical, Restitution};
/// let wall = Restitution::from_kappa(0.5)?;
/// let mut regulator = TwistingRegulator::new(Gains::new(3.0, 2.0)?, 1e-3, wall)?;
/// let u = regulator.tick(Physical { x: 1.0, xdot: -0.5 }, 0.0)?;
/// assert_eq!(u, -3.0 + 2.0); // falling: -mu1 + mu2
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TwistingRegulator {
    step: RegulationStep,
    port: Port,
    state: RegulatorState,
}

/// What the regulator remembers; it does not influence the next tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RegulatorState {
    /// The last control (m/s^2).
    pub u: f64,
    /// The last `lambda_s`, `lambda_v`.
    pub signs: [f64; 2],
    /// What was done to the last sample and control.
    pub status: TickStatus,
}

impl TwistingRegulator {
    /// A regulator with sampling period `h` (s) for a mass on `wall`.
    ///
    /// # Errors
    /// [`SettingError`] names the setting that is out of range.
    pub fn new(gains: Gains, h: f64, wall: Restitution) -> Result<Self, SettingError> {
        checked(h, wall, "e")?;
        let step = RegulationStep { h, wall, gains };
        Ok(Self { step, port: Port::default(), state: RegulatorState::default() })
    }

    /// The same with limits of the sensor and of the actuator.
    #[must_use]
    pub fn with_port(self, port: Port) -> Self {
        Self { port, ..self }
    }

    /// The control for the period that starts with this measurement; `force` is the force on the
    /// mass without control.
    ///
    /// # Errors
    /// [`SettingError`] for a sample that is not finite or too deep behind the wall. Nothing has
    /// changed then: the last control is still [`RegulatorState::u`].
    pub fn tick(&mut self, measured: Physical, force: f64) -> Result<f64, SettingError> {
        let (state, clamped) = self.port.sense(measured)?;
        checked_force("force", force)?;
        let z = transform::lift(state, Branch::Positive, self.step.wall);
        let found = self.step.solve(z, force);
        let (u, saturated) = self.port.actuate(found.u)?;
        let signs = [found.lambda_s, found.lambda_v];
        self.state = RegulatorState { u, signs, status: TickStatus { clamped, saturated } };
        Ok(u)
    }

    /// The settings that are constant over a run.
    #[must_use]
    pub fn step(&self) -> &RegulationStep {
        &self.step
    }

    /// The limits of the sensor and of the actuator.
    #[must_use]
    pub fn port(&self) -> &Port {
        &self.port
    }

    /// What is remembered.
    #[must_use]
    pub fn state(&self) -> RegulatorState {
        self.state
    }

    /// Restores what [`TwistingRegulator::state`] gave.
    pub fn set_state(&mut self, state: RegulatorState) {
        self.state = state;
    }
}
