//! The twisting regulator: brings the mass to rest at the wall in finite time.

#[cfg(not(feature = "single"))]
use crate::control::inclusion::RegulationInclusion;

use crate::control::port::checked_force;
use crate::control::reference::{advanced, AdvancedReference, ReferenceState};
use crate::control::regulation::{Regulation, RegulationStep};
use crate::control::{checked, Gains, Landing, Port, TickStatus, TrackerState, Waypoint};
use crate::{
    sgn, transform, Branch, Lifted, Physical, Real, Restitution, SettingError, ThetaGammaStep,
};

/// The regulator `u = -mu1 - mu2 lv` with `lv` in `sgn x'` taken implicitly, at the end of the
/// sampling period.
///
/// With a [`Landing`] (the default, one period ahead) `lv` is the fraction of the brake that stops
/// the mass at the end of the horizon, and the sampled loop ends in exact rest at every `e < 1`.
/// Without one both signs are those of the paper's implicit step ([`RegulationStep`]). The two
/// have the same bits where the mass neither turns round nor meets the wall within the horizon.
///
/// Stable in finite time for `|F| <= M` under the condition of [`Gains::for_regulation`].
///
/// ```
/// use zivi_core::control::{Gains, TwistingRegulator};
/// use zivi_core::{Physical, Restitution};
/// let restitution = Restitution::from_kappa(0.5)?;
/// let mut regulator = TwistingRegulator::new(Gains::new(3.0, 2.0)?, 1e-3, restitution)?;
/// let u = regulator.tick(Physical { x: 1.0, xdot: -0.5 }, 0.0)?;
/// assert_eq!(u, -3.0 + 2.0); // falling: -mu1 + mu2
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TwistingRegulator {
    pub(super) step: RegulationStep,
    pub(super) landing: Option<Landing>,
    port: Port,
    pub(super) state: RegulatorState,
}

/// State of the regulator; it does not influence the next update.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RegulatorState {
    /// The last control (m/s^2).
    pub u: Real,
    /// The last `lambda_s`, `lambda_v`.
    pub signs: [Real; 2],
    /// Status of the last update.
    pub status: TickStatus,
}

impl TwistingRegulator {
    /// A regulator with sampling period `h` (s) above such a wall, contact-establishing law one period ahead.
    ///
    /// # Errors
    /// [`SettingError`] names the setting that is out of range.
    pub fn new(gains: Gains, h: Real, restitution: Restitution) -> Result<Self, SettingError> {
        checked(h, restitution, "e")?;
        let step = RegulationStep { h, restitution, gains };
        Ok(Self::trusted(step, Some(Landing::new(1, h)?), Port::default()))
    }

    /// A regulator whose settings were checked before and are not checked again.
    #[inline]
    #[must_use]
    pub fn trusted(step: RegulationStep, landing: Option<Landing>, port: Port) -> Self {
        Self { step, landing, port, state: RegulatorState::default() }
    }

    /// The same with another horizon of its contact-establishing law; `None` is the paper's update.
    #[must_use]
    pub fn with_landing(self, landing: Option<Landing>) -> Self {
        Self { landing, ..self }
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
    /// [`SettingError`] for a sample that is not finite or penetrates too deeply. Nothing has
    /// changed then: the last control is still [`RegulatorState::u`].
    pub fn tick(&mut self, measured: Physical, force: Real) -> Result<Real, SettingError> {
        self.ticked(measured, force, |step, z| (step.solve(z, force), false))
    }

    /// The same with the two signs of the step, the VI (23), as `solve` finds them; where it finds
    /// none, they are those of [`TwistingRegulator::tick`], which the status reports. A regulator with the
    /// contact-establishing law does not solve a step.
    ///
    /// # Errors
    /// As [`TwistingRegulator::tick`].
    #[cfg(not(feature = "single"))]
    pub fn tick_by(
        &mut self,
        measured: Physical,
        force: Real,
        solve: impl FnOnce(&RegulationInclusion<'_>) -> Option<[Real; 2]>,
    ) -> Result<Real, SettingError> {
        self.ticked(measured, force, |step, z| {
            match solve(&RegulationInclusion { step, z, f: force }) {
                Some(signs) => (step.of_signs(z, force, signs), false),
                None => (step.solve(z, force), true),
            }
        })
    }

    #[inline(always)]
    fn ticked(
        &mut self,
        measured: Physical,
        force: Real,
        solve: impl FnOnce(&RegulationStep, Lifted) -> (Regulation, bool),
    ) -> Result<Real, SettingError> {
        let (state, clamped) = self.port.sense(measured)?;
        checked_force("force", force)?;
        let (wanted, signs, unsolved) = self.law(state, force, solve);
        let (u, saturated) = self.port.actuate(wanted)?;
        let status = TickStatus { clamped, saturated, unsolved };
        self.state = RegulatorState { u, signs, status };
        Ok(u)
    }

    /// The control and its signs `ls`, `lv`.
    #[inline]
    fn law(
        &self,
        state: Physical,
        force: Real,
        solve: impl FnOnce(&RegulationStep, Lifted) -> (Regulation, bool),
    ) -> (Real, [Real; 2], bool) {
        let RegulationStep { restitution, gains, .. } = self.step;
        if let Some(landing) = self.landing {
            let lambda_v = landing.lambda_v(state.xdot, force, gains);
            return (-gains.mu1() - gains.mu2() * lambda_v, [1.0, lambda_v], false);
        }
        let z = transform::lift(state, Branch::Positive, restitution);
        let (Regulation { u, lambda_s, lambda_v, .. }, unsolved) = solve(&self.step, z);
        (u, [lambda_s, lambda_v], unsolved)
    }

    /// The state of a measurement; true if clamped to the wall.
    ///
    /// # Errors
    /// [`SettingError`] for a sample that is not finite or penetrates too deeply.
    pub fn sense(&self, measured: Physical) -> Result<(Physical, bool), SettingError> {
        self.port.sense(measured)
    }

    /// The contact-establishing law; `None` is the paper's update.
    #[must_use]
    pub fn landing(&self) -> Option<Landing> {
        self.landing
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

    /// The state.
    #[must_use]
    pub fn state(&self) -> RegulatorState {
        self.state
    }

    /// Restores what [`TwistingRegulator::state`] gave.
    pub fn set_state(&mut self, state: RegulatorState) {
        self.state = state;
    }
}

// The explicit twisting controller, the baseline that chatters.

/// The law (7) with the signs of the sampled state: the same interface as the implicit tracker.
///
/// ```text
/// u = R [ -mu1 sgn(s - s_r) - mu2 sgn(v - v_r) + F_r/R_r ] - F        (branch +1, sgn s = 1)
/// ```
///
/// At the wall the side that the mass is on counts as its sign, `sgn 0 = 0` otherwise. The
/// reference is the implicit tracker's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExplicitTwisting {
    gains: Gains,
    restitution: Restitution,
    pub(super) reference: ThetaGammaStep,
    port: Port,
    pub(super) state: TrackerState,
}

impl ExplicitTwisting {
    /// An explicit controller with sampling period `h` (s); the reference starts at rest.
    ///
    /// # Errors
    /// [`SettingError`] names the setting that is out of range.
    pub fn new(
        gains: Gains,
        h: Real,
        restitution: Restitution,
        restitution_ref: Restitution,
    ) -> Result<Self, SettingError> {
        checked(h, restitution, "e")?;
        checked(h, restitution_ref, "e_ref")?;
        let reference = ThetaGammaStep::new(h, 1.0, 1.0, restitution_ref)?;
        let state =
            TrackerState::starting(ReferenceState::at(Waypoint::default(), restitution_ref)?);
        Ok(Self { gains, restitution, reference, port: Port::default(), state })
    }

    /// The same with limits of the sensor and of the actuator.
    #[must_use]
    pub fn with_port(self, port: Port) -> Self {
        Self { port, ..self }
    }

    /// Sets the reference's state and forgets everything else.
    ///
    /// # Errors
    /// [`SettingError`] unless `x_ref >= 0` and both are finite; nothing has changed then.
    pub fn reset(&mut self, reference: Physical) -> Result<(), SettingError> {
        let start = ReferenceState::at(reference.into(), self.reference.restitution())?;
        self.state = TrackerState::starting(start.folded());
        Ok(())
    }

    /// The control for the period that starts with this measurement; the reference advances by
    /// `h`.
    ///
    /// # Errors
    /// As [`crate::control::TwistingTracker::tick`].
    pub fn tick(
        &mut self,
        measured: Physical,
        force: Real,
        force_ref: Real,
    ) -> Result<Real, SettingError> {
        let (state, clamped) = self.port.sense(measured)?;
        checked_force("force", force)?;
        let AdvancedReference { next, .. } =
            advanced(&self.reference, self.state.followed(), force_ref)?;
        let z = transform::lift(state, Branch::Positive, self.restitution);
        let (wanted, signs) = self.law(z, force, force_ref);
        let (u, saturated) = self.port.actuate(wanted)?;
        let ReferenceState { z, side } = next.folded();
        let status = TickStatus { clamped, saturated, unsolved: false };
        self.state = TrackerState { reference: z, side, u, signs, status, iterations: 0 };
        Ok(u)
    }

    fn law(&self, z: Lifted, force: Real, force_ref: Real) -> (Real, [Real; 6]) {
        let reference = self.state.reference;
        let (lambda_s, lambda_sr) = (1.0, 1.0);
        let (lambda_v, lambda_vr) = (sgn(z.v), sgn(reference.v));
        let lambda_es = sgn(z.s - reference.s);
        let lambda_ev = sgn(z.v - reference.v);
        let rests = reference == Lifted::default() && force_ref <= 0.0;
        let r_ref = self.reference.restitution().r(lambda_sr, lambda_vr);
        let acceleration = if rests { 0.0 } else { force_ref / r_ref };
        let pull = acceleration - self.gains.mu1() * lambda_es - self.gains.mu2() * lambda_ev;
        let u = self.restitution.r(lambda_s, lambda_v) * pull - force;
        (u, [lambda_s, lambda_v, lambda_sr, lambda_vr, lambda_es, lambda_ev])
    }

    /// The reference's state: that at the next sample, once an update is done.
    #[must_use]
    pub fn reference(&self) -> Physical {
        transform::project(self.state.reference, self.reference.restitution())
    }

    /// The sampling period (s).
    #[must_use]
    pub fn h(&self) -> Real {
        self.reference.h()
    }

    /// The gains.
    #[must_use]
    pub fn gains(&self) -> Gains {
        self.gains
    }

    /// The plant's wall and the reference's.
    #[must_use]
    pub fn restitutions(&self) -> (Restitution, Restitution) {
        (self.restitution, self.reference.restitution())
    }

    /// The limits of the sensor and of the actuator.
    #[must_use]
    pub fn port(&self) -> &Port {
        &self.port
    }

    /// The state.
    #[must_use]
    pub fn state(&self) -> TrackerState {
        self.state
    }

    /// Restores what [`ExplicitTwisting::state`] gave.
    pub fn set_state(&mut self, state: TrackerState) {
        self.state = state;
    }
}
