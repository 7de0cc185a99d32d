//! Samples that do not come every `h`: a period of another length, and a sample that is missing.

use super::regulation::RegulationStep;
use super::tracking::TrackingStep;
use super::{
    ExplicitTwisting, Port, TickStatus, TrackerState, TwistingRegulator, TwistingTracker, Waypoint,
};
use crate::control::reference::{advanced, AdvancedReference, ReferenceState};
use crate::setting::{is_positive, require};
use crate::{Real, SettingError, ThetaGammaStep};

/// The reference over a period whose sample is missing: it moves on, the control is held.
fn missed(
    reference: &ThetaGammaStep,
    port: &Port,
    state: TrackerState,
    force_ref: Real,
) -> Result<(ReferenceState, TrackerState), SettingError> {
    let AdvancedReference { next, signs: [lambda_sr, lambda_vr], .. } =
        advanced(reference, state.followed(), force_ref)?;
    let [lambda_s, lambda_v, _, _, lambda_es, lambda_ev] = state.signs;
    let signs = [lambda_s, lambda_v, lambda_sr, lambda_vr, lambda_es, lambda_ev];
    Ok((next, TrackerState { signs, ..held(port, state) }))
}

/// Without a sample: the control of before, within the limits of the actuator also before the first.
fn held(port: &Port, state: TrackerState) -> TrackerState {
    let (u, status) = (port.clipped(state.u), TickStatus::default());
    TrackerState { u, status, iterations: 0, ..state }
}

/// `Ok` if `dt` is the length of a period.
fn checked_period(dt: Real) -> Result<(), SettingError> {
    require(is_positive(dt), "dt", dt, "a finite time > 0 (s)")
}

impl TwistingTracker {
    /// The same, its next period `dt` (s) long: the step is planned over it, the control is to be held
    /// as long, and the reference advances by it. The horizons keep their numbers of periods.
    ///
    /// # Errors
    /// [`SettingError`] unless `dt` is positive and finite.
    pub fn lasting(&self, dt: Real) -> Result<Self, SettingError> {
        checked_period(dt)?;
        let mut it = *self;
        it.reference = it.reference.with_h(dt)?;
        it.step = TrackingStep { h: it.horizon * dt, ..it.step };
        it.landing = it.landing.map(|landing| landing.of_periods(dt));
        Ok(it)
    }

    /// A sample is missing: the reference advances by a period, the control is held.
    ///
    /// # Errors
    /// [`SettingError`] for a force that is not finite or too large; nothing has changed then.
    pub fn miss(&mut self, force_ref: Real) -> Result<Real, SettingError> {
        let (next, state) = missed(&self.reference, self.port(), self.state, force_ref)?;
        self.hold(next, state);
        Ok(state.u)
    }

    /// The same of a reference that is given, at `next` with the next sample.
    ///
    /// # Errors
    /// [`SettingError`] for a waypoint that is not finite or has x < 0.
    pub fn miss_to(&mut self, next: Waypoint) -> Result<Real, SettingError> {
        let next = ReferenceState::at(next, self.reference.restitution())?;
        let state = held(self.port(), self.state);
        self.hold(next, state);
        Ok(state.u)
    }

    fn hold(&mut self, next: ReferenceState, state: TrackerState) {
        let ReferenceState { z, side } = self.on_its_branch(next);
        self.state = TrackerState { reference: z, side, ..state };
    }
}

impl ExplicitTwisting {
    /// [`TwistingTracker::lasting`].
    ///
    /// # Errors
    /// The same.
    pub fn lasting(&self, dt: Real) -> Result<Self, SettingError> {
        checked_period(dt)?;
        let mut it = *self;
        it.reference = it.reference.with_h(dt)?;
        Ok(it)
    }

    /// [`TwistingTracker::miss`].
    ///
    /// # Errors
    /// The same.
    pub fn miss(&mut self, force_ref: Real) -> Result<Real, SettingError> {
        let (next, state) = missed(&self.reference, self.port(), self.state, force_ref)?;
        let ReferenceState { z, side } = next.folded();
        self.state = TrackerState { reference: z, side, ..state };
        Ok(state.u)
    }
}

impl TwistingRegulator {
    /// [`TwistingTracker::lasting`].
    ///
    /// # Errors
    /// The same.
    pub fn lasting(&self, dt: Real) -> Result<Self, SettingError> {
        checked_period(dt)?;
        let mut it = *self;
        it.step = RegulationStep { h: dt, ..it.step };
        it.landing = it.landing.map(|landing| landing.of_periods(dt));
        Ok(it)
    }

    /// A sample is missing: the control is held.
    pub fn miss(&mut self) -> Real {
        self.state.status = TickStatus::default();
        self.state.u = self.port().clipped(self.state.u);
        self.state.u
    }
}
