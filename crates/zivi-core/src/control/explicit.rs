//! The explicit twisting controller, the baseline that chatters.

use super::port::checked_force;
use super::{checked, Gains, Port, TickStatus, TrackerState, Waypoint};
use crate::control::reference::{advanced, AdvancedReference, ReferenceState};
use crate::{
    sgn, transform, Branch, Lifted, Physical, Real, Restitution, SettingError, ThetaGammaStep,
};

/// The law (20) with the signs of the sampled state: the same interface as the implicit tracker.
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
    /// As [`super::TwistingTracker::tick`].
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
