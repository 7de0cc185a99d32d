//! References of a tracker: computed or given sample by sample.
//!
//! The reference of a tracker: its state, and its motion over a period.

use crate::control::port::checked_force;
use crate::control::regulation::RegulationStep;
use crate::control::tracking::{Target, TrackingStep};
use crate::control::{
    ExplicitTwisting, Port, TickStatus, TrackerState, TwistingRegulator, TwistingTracker,
};
use crate::setting::{is_not_negative, is_positive, require};
use crate::step::{thorough, ImplicitEuler, StepSolution};
use crate::{transform, Branch, Lifted, Physical, Real, Restitution, SettingError, ThetaGammaStep};

/// A reference: its state and its last branch.
#[derive(Clone, Copy, Debug)]
pub(super) struct ReferenceState {
    pub(super) z: Lifted,
    pub(super) side: Real,
}

impl ReferenceState {
    /// At a physical state, on a branch.
    #[inline(never)]
    pub(super) fn at(
        Waypoint { state, branch }: Waypoint,
        restitution: Restitution,
    ) -> Result<Self, SettingError> {
        let Physical { x, xdot } = state;
        let refused = |name, value, range| Err(SettingError { name, value, range });
        if !is_not_negative(x) {
            return refused("x_ref", x, "a finite distance >= 0 from the wall (m)");
        }
        let Lifted { s, v } = transform::lift(state, Branch::Positive, restitution);
        if !v.is_finite() {
            return refused("xdot_ref", xdot, "a finite velocity (m/s)");
        }
        let sigma = branch.sigma();
        // adding 0.0 turns -0.0 into 0.0
        let z = Lifted { s: sigma * s + 0.0, v: sigma * v + 0.0 };
        Ok(Self { z, side: transform::side(z, sigma) })
    }

    /// On the branch `+1`.
    #[inline]
    pub(super) fn folded(self) -> Self {
        let Lifted { s, v } = self.z;
        let z = if self.side < 0.0 { Lifted { s: 0.0 - s, v: 0.0 - v } } else { self.z };
        Self { z, side: 1.0 }
    }
}

/// A given reference at one sample: its state, and the side of the wall on which it is followed,
/// which changes with each of its impacts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Waypoint {
    /// Distance from the wall, `>= 0` (m), and velocity (m/s).
    pub state: Physical,
    /// The side.
    pub branch: Branch,
}

impl From<Physical> for Waypoint {
    /// On the side `+1`.
    fn from(state: Physical) -> Self {
        Self { state, branch: Branch::Positive }
    }
}

/// Where the reference of an update comes from: it is the tracker's own, under this force, or it is given
/// at this sample and at the next one, with its acceleration if that is known.
pub(super) enum ReferenceSource<'a> {
    Own(Real),
    Given(&'a [Waypoint; 2], Option<Real>),
}

/// A period of the reference: from where, under which force.
#[derive(Clone, Copy, Debug)]
pub struct ReferencePeriod {
    pub(super) now: ReferenceState,
    pub(super) force: Real,
    /// Shift of the measured velocity (m/s).
    pub(super) back: Real,
    /// Where it ends, if that is given.
    pub(super) next: Option<ReferenceState>,
}

/// A sample and the target of the plant over the period that starts with it.
#[derive(Clone, Copy, Debug)]
pub struct Planned {
    pub(super) state: Physical,
    /// The same as an implicit step would have it: its velocity taken back.
    pub(super) measured: Physical,
    pub(super) clamped: bool,
    pub(super) force: Real,
    pub(super) now: ReferenceState,
    pub(super) next: ReferenceState,
    /// The signs of the reference's step.
    pub(super) signs: [Real; 2],
    pub(super) target: Target,
    /// The multiplier of `sgn v_r+` at the end that is followed.
    pub(super) lambda_vr: Real,
    /// Acceleration of the reference (m/s^2).
    #[cfg_attr(feature = "single", allow(dead_code, reason = "only the VI asks for it"))]
    pub(super) force_ref: Real,
}

/// The reference after a period with the signs of its step; what the plant has to follow over the
/// horizon, and the multiplier of `sgn v_r+` there.
pub(super) struct ReferenceOutlook {
    pub(super) next: ReferenceState,
    pub(super) signs: [Real; 2],
    pub(super) target: Target,
    pub(super) lambda_vr: Real,
}

/// The end of a step of the reference, its signs, and its acceleration (m/s^2).
pub(super) struct AdvancedReference {
    pub(super) next: ReferenceState,
    pub(super) signs: [Real; 2],
    pub(super) acceleration: Real,
}

/// One implicit Euler step of the reference.
#[inline(always)]
pub(super) fn advanced(
    reference: &ThetaGammaStep,
    from: ReferenceState,
    force_ref: Real,
) -> Result<AdvancedReference, SettingError> {
    checked_force("force_ref", force_ref)?;
    let found = reference.implicit().solve(from.z, force_ref, from.side);
    let found = found.map_err(|_| too_large(force_ref))?;
    let acceleration = pulled(&found, reference.restitution(), force_ref);
    let z = found.end();
    let next = ReferenceState { z, side: transform::side(z, from.side) };
    Ok(AdvancedReference { next, signs: [found.lambda_s, found.lambda_v], acceleration })
}

/// The target of the plant over an `h` other than the reference's period, and the signs of that
/// step; rarely called, therefore not inlined.
#[cold]
#[inline(never)]
pub(super) fn target_over(
    h: Real,
    restitution: Restitution,
    from: ReferenceState,
    force_ref: Real,
) -> Result<(Target, [Real; 2]), SettingError> {
    let found = thorough(h, restitution, ImplicitEuler, from.z, force_ref, from.side);
    let found = found.map_err(|_| too_large(force_ref))?;
    let target = Target { end: found.end(), acceleration: pulled(&found, restitution, force_ref) };
    Ok((target, [found.lambda_s, found.lambda_v]))
}

/// `A = lsr F_r/R_r` of a step of the reference (m/s^2).
#[inline(always)]
fn pulled(found: &StepSolution, restitution: Restitution, force_ref: Real) -> Real {
    found.lambda_s * force_ref / restitution.r(found.lambda_s, found.lambda_v)
}

fn too_large(force_ref: Real) -> SettingError {
    let range = "small enough for the reference to stay finite (m/s^2)";
    SettingError { name: "force_ref", value: force_ref, range }
}

// A reference that is given sample by sample, from a curve, a recording or another simulation.
//
// The tracker does not advance it: its states at this sample and the next one are arguments. The
// target is an implicit Euler step from there under the reference's acceleration `a`, with the
// velocity of the reference and of the mass both shifted by half a period in flight: the step then
// ends on the parabola through the given state, and a mass on the reference gets `u = a - F`.

impl TwistingTracker {
    /// The control for the period that starts with this measurement, for a reference that is at
    /// `now` at this sample and at `next` at the next one. `acceleration` is the reference's over
    /// the period, `x_r''` (m/s^2). Without it, it is the difference quotient of the velocities in
    /// the air; over an impact of the reference `force`, under which the mass meets the wall too.
    ///
    /// The tracker's own reference becomes `next`.
    ///
    /// # Errors
    /// [`SettingError`] of [`TwistingTracker::tick`]; a waypoint that is not finite or has x < 0.
    /// Nothing has changed then.
    ///
    /// ```
    /// use zivi_core::control::{Approach, Gains, TwistingTracker, Waypoint};
    /// use zivi_core::{Branch, Physical, Restitution};
    /// let restitution = Restitution::from_e(0.5)?;
    /// let gains = Gains::new(30.0, 17.0)?;
    /// let mut tracker =
    ///     TwistingTracker::new(gains, 1e-3, restitution, restitution, Approach::Nearest)?;
    /// let at = |x, xdot| Waypoint { state: Physical { x, xdot }, branch: Branch::Positive };
    /// let (now, next) = (at(1.0, 0.5), at(1.0005 - 2e-6, 0.496)); // it brakes with 4 m/s^2
    /// let u = tracker.tick_to(now.state, -9.81, now, next, None)?;
    /// assert!((u - (-4.0 + 9.81)).abs() < 1e-9);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn tick_to(
        &mut self,
        measured: Physical,
        force: Real,
        now: Waypoint,
        next: Waypoint,
        acceleration: Option<Real>,
    ) -> Result<Real, SettingError> {
        self.ticked(measured, force, ReferenceSource::Given(&[now, next], acceleration))
    }
}

impl ReferencePeriod {
    /// A period `h` (s) of a reference from one waypoint to the next, under its own `acceleration` if
    /// that is known; `force` is the one without control: see [`TwistingTracker::tick_to`].
    ///
    /// # Errors
    /// [`SettingError`] for a waypoint that is not finite or has x < 0, or an acceleration that is
    /// not finite.
    #[inline]
    pub fn between(
        (restitution, h): (Restitution, Real),
        force: Real,
        [now, next]: [Waypoint; 2],
        acceleration: Option<Real>,
    ) -> Result<Self, SettingError> {
        let (start, end) =
            (ReferenceState::at(now, restitution)?, ReferenceState::at(next, restitution)?);
        let flies = now.branch == next.branch && now.state.x > 0.0 && next.state.x > 0.0;
        let rests = start.z == end.z && start.z == Lifted::default();
        let differenced = now.branch == next.branch || rests;
        let acceleration = match acceleration {
            Some(given) => given,
            None if differenced => (next.state.xdot - now.state.xdot) / h,
            None => force,
        };
        checked_force("acceleration", acceleration)?;
        let back = if flies { 0.5 * h * acceleration } else { 0.0 };
        let behind = |at: Physical| Physical { xdot: at.xdot - back, ..at };
        let sigma = now.branch.sigma();
        let Lifted { s, v } = transform::lift(behind(now.state), Branch::Positive, restitution);
        let z = Lifted { s: sigma * s, v: sigma * v };
        Ok(ReferencePeriod {
            now: ReferenceState { z, ..start },
            force: acceleration,
            back,
            next: Some(end),
        })
    }
}

// Samples that do not come every `h`: a period of another length, and a sample that is missing.

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
