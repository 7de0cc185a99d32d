//! The twisting tracker: makes the mass follow a bouncing reference through its Zeno point.

use crate::control::gains::{checked_press, Descent};
use crate::control::port::checked_force;
use crate::control::reference::{
    advanced, target_over, AdvancedReference, Planned, ReferenceOutlook, ReferencePeriod,
    ReferenceSource, ReferenceState,
};
use crate::control::tracking::{Target, Tracking, TrackingStep};
use crate::control::{checked, GainError, Gains, Landing, Port, TickStatus};
use crate::setting::{require, Setting, Value, Values};
use crate::{transform, Branch, Lifted, Physical, Real, Restitution, SettingError, ThetaGammaStep};
use core::ops::Bound;

#[cfg(not(feature = "single"))]
use crate::control::inclusion::TrackingInclusion;

/// The time `horizon h` (s).
///
/// # Errors
/// [`SettingError`] unless `horizon >= 1` and it is finite, also times `h`.
#[inline]
pub fn checked_horizon(horizon: Real, h: Real) -> Result<Real, SettingError> {
    let time = horizon * h;
    TwistingTracker::HORIZON.check(horizon)?;
    require(time <= Real::MAX, "horizon", horizon, "such that horizon h is finite")?;
    Ok(time)
}

/// The implicit twisting tracker (equation 20), with its reference inside.
///
/// While the reference is at rest it establishes contact ([`Descent`], the default, one period ahead): the sampled
/// loop ends in exact rest at every `e` in `(0, 1)`. Everywhere else, and always without a contact-establishing law,
/// the control is that of the paper's implicit step ([`TrackingStep`]), to the last bit.
///
/// A *horizon* of `N` periods plans that step over `H = N h` and updates every `h`: quieter under
/// noise, less sharp within `H` of an impact. The *shift* `x' - h F_r/2` in flight turns the
/// measured velocity into that of an implicit Euler step, like the reference's: positions of these
/// steps lie on the exact parabola, their velocities lag by half a period.
///
/// ```
/// use zivi_core::control::{Approach, Gains, TwistingTracker};
/// use zivi_core::{Physical, Restitution};
/// let restitution = Restitution::from_kappa(0.5)?;
/// let gains = Gains::for_tracking(30.0, 17.0, 5.0, restitution)?;
/// let mut tracker = TwistingTracker::new(gains, 1e-3, restitution, restitution, Approach::Positive)?;
/// tracker.reset(Physical { x: 3.0, xdot: 3.0 })?;
/// let u = tracker.tick(Physical { x: 6.0, xdot: 5.0 }, -9.81, -19.81)?;
/// // both errors positive and R = 1/2 for plant and reference: -(30 + 17 + 19.81/R)/2 + 9.81
/// assert!((u + 33.5).abs() < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TwistingTracker {
    /// Over the horizon.
    pub(super) step: TrackingStep,
    /// Over a period.
    pub(super) reference: ThetaGammaStep,
    /// Periods that the step is planned over.
    pub(super) horizon: Real,
    shift: bool,
    pub(super) landing: Option<Landing>,
    /// Acceleration towards the wall of a mass at rest, unless it is the law's own (m/s^2).
    press: Option<Real>,
    approach: Approach,
    port: Port,
    pub(super) state: TrackerState,
}

impl TwistingTracker {
    /// A tracker with sampling period `h` (s) for a mass that bounces with `restitution`, following a
    /// reference that bounces with `restitution_ref`. Exact tracking needs equal ones. The reference
    /// starts at rest: see [`TwistingTracker::reset`].
    ///
    /// # Errors
    /// [`SettingError`] names the setting that is out of range.
    pub fn new(
        gains: Gains,
        h: Real,
        restitution: Restitution,
        restitution_ref: Restitution,
        approach: Approach,
    ) -> Result<Self, SettingError> {
        checked(h, restitution, "e")?;
        checked(h, restitution_ref, "e_ref")?;
        let landing = Some(Landing::new(1, h)?);
        let (press, horizon, shift, port) = (None, 1.0, false, Port::default());
        let settings = TrackerSettings {
            gains,
            h,
            restitution,
            restitution_ref,
            approach,
            landing,
            press,
            horizon,
            shift,
            port,
        };
        Ok(Self::trusted(settings, TrackerState::REST))
    }

    /// A tracker whose settings and state were checked before and are not checked again.
    #[inline(always)]
    #[must_use]
    pub fn trusted(settings: TrackerSettings, state: TrackerState) -> Self {
        let TrackerSettings { gains, h, restitution, horizon, shift, landing, press, .. } =
            settings;
        let TrackerSettings { approach, port, .. } = settings;
        let reference = ThetaGammaStep::trusted(h, 1.0, 1.0, settings.restitution_ref);
        let step = TrackingStep { h: horizon * h, restitution, gains };
        Self { step, reference, horizon, shift, landing, press, approach, port, state }
    }

    /// The same with another horizon of its contact-establishing law; `None` is the paper's update. A mass at rest is
    /// pressed with the law's own `D` again.
    #[must_use]
    pub fn with_landing(self, landing: Option<Landing>) -> Self {
        Self { landing, press: None, ..self }
    }

    /// The same where a mass that rests is pressed with `press` (m/s^2), at least the `bound` of
    /// the unknown force; without a contact-establishing law nothing changes.
    ///
    /// # Errors
    /// [`GainError`] unless `press` is finite and at least `bound`.
    pub fn with_press(self, press: Real, bound: Real) -> Result<Self, GainError> {
        if self.landing.is_some() {
            checked_press(press, bound)?;
        }
        Ok(Self { press: Some(press), ..self })
    }

    /// The periods that a step is planned over.
    pub const HORIZON: Setting = Setting {
        name: "horizon",
        meaning: "periods over which a step is planned",
        unit: "1",
        values: Values::Numbers(Bound::Included(1.0), Bound::Excluded(Real::INFINITY)),
        range: "a finite number of periods >= 1",
        default: Value::Number(1.0),
    };

    /// The same with its step planned over `horizon` sampling periods.
    ///
    /// # Errors
    /// [`SettingError`] unless `horizon >= 1` and it is finite, also times `h`.
    pub fn with_horizon(self, horizon: Real) -> Result<Self, SettingError> {
        let h = checked_horizon(horizon, self.reference.h())?;
        Ok(Self { step: TrackingStep { h, ..self.step }, horizon, ..self })
    }

    /// The same with the measured velocity taken half a period back in the air.
    #[must_use]
    pub fn with_shift(self, shift: bool) -> Self {
        Self { shift, ..self }
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
    #[inline]
    pub fn reset(&mut self, reference: Physical) -> Result<(), SettingError> {
        let start = ReferenceState::at(reference.into(), self.reference.restitution())?;
        self.state = TrackerState::starting(self.on_its_branch(start));
        Ok(())
    }

    /// The control for the period that starts with this measurement; the reference advances by
    /// `h`. `force` acts on the mass without control, `force_ref` on the reference.
    ///
    /// # Errors
    /// [`SettingError`] for a sample that is not finite or penetrates too deeply. Nothing has
    /// changed then: the reference has not advanced, the last control is still
    /// [`TrackerState::u`].
    pub fn tick(
        &mut self,
        measured: Physical,
        force: Real,
        force_ref: Real,
    ) -> Result<Real, SettingError> {
        self.ticked(measured, force, ReferenceSource::Own(force_ref))
    }

    /// An update of either kind.
    #[inline(never)]
    pub(super) fn ticked(
        &mut self,
        measured: Physical,
        force: Real,
        guide: ReferenceSource<'_>,
    ) -> Result<Real, SettingError> {
        let planned = self.plan(measured, force, |it| match guide {
            ReferenceSource::Own(force_ref) => Ok(it.own_period(force_ref)),
            ReferenceSource::Given(waypoints, acceleration) => {
                let of = (it.reference.restitution(), it.h());
                let course = ReferencePeriod::between(of, force, *waypoints, acceleration);
                course.map(|given| it.given_period(given))
            }
        })?;
        self.follow(&planned)
    }

    /// The first half of an update, over this period of the reference, which is only asked for when the
    /// sample is a good one: what the second half, [`TwistingTracker::follow`], has to follow.
    ///
    /// # Errors
    /// As [`TwistingTracker::tick`], and those of the course.
    #[inline]
    pub fn plan<E: From<SettingError>>(
        &self,
        measured: Physical,
        force: Real,
        course: impl FnOnce(&Self) -> Result<ReferencePeriod, E>,
    ) -> Result<Planned, E> {
        let (state, clamped) = self.port.sense(measured)?;
        checked_force("force", force)?;
        let course = course(self)?;
        let ReferenceOutlook { next, signs, target, lambda_vr } = self.outlook(&course)?;
        let (now, measured) = (course.now, Physical { xdot: state.xdot - course.back, ..state });
        let force_ref = course.force;
        Ok(Planned {
            state,
            measured,
            clamped,
            force,
            now,
            next,
            signs,
            target,
            lambda_vr,
            force_ref,
        })
    }

    /// A period of its own reference, under this force (m/s^2).
    #[inline(always)]
    #[must_use]
    pub fn own_period(&self, force: Real) -> ReferencePeriod {
        let back = if self.shift && self.flies(force) { 0.5 * self.h() * force } else { 0.0 };
        ReferencePeriod { now: self.state.followed(), force, back, next: None }
    }

    /// A period of a reference that is given, on the branch that the approach keeps it on.
    #[inline(always)]
    #[must_use]
    pub fn given_period(&self, course: ReferencePeriod) -> ReferencePeriod {
        ReferencePeriod { now: self.on_its_branch(course.now), ..course }
    }

    /// The reference after a period, and the target of the plant over the horizon.
    #[inline(always)]
    fn outlook(
        &self,
        &ReferencePeriod { now, force, next, .. }: &ReferencePeriod,
    ) -> Result<ReferenceOutlook, SettingError> {
        let restitution = self.reference.restitution();
        let beyond = self.step.h > self.reference.h();
        if let (Some(next), true) = (next, beyond) {
            let (target, signs) = target_over(self.step.h, restitution, now, force)?;
            return Ok(ReferenceOutlook { next, signs, target, lambda_vr: signs[1] });
        }
        let AdvancedReference { next: reached, signs, acceleration } =
            advanced(&self.reference, now, force)?;
        let (target, [_, lambda_vr]) = if beyond {
            target_over(self.step.h, restitution, now, force)?
        } else {
            (Target { end: reached.z, acceleration }, signs)
        };
        Ok(ReferenceOutlook { next: next.unwrap_or(reached), signs, target, lambda_vr })
    }

    /// The second half of an update: the control for this sample and this period of the reference; and
    /// all that is remembered.
    ///
    /// # Errors
    /// [`SettingError`] where the control is not finite; nothing has changed then.
    #[inline]
    pub fn follow(&mut self, planned: &Planned) -> Result<Real, SettingError> {
        let Planned { force, target, lambda_vr, .. } = *planned;
        self.followed_by(planned, |step, z| (step.solve_near(z, force, target, lambda_vr), false))
    }

    /// The same with the six signs of the step, the VI (24), as `solve` finds them; where it finds
    /// none, they are those of [`TwistingTracker::follow`], and the status says so.
    ///
    /// # Errors
    /// As [`TwistingTracker::follow`].
    #[cfg(not(feature = "single"))]
    pub fn follow_by(
        &mut self,
        planned: &Planned,
        solve: impl FnOnce(&TrackingInclusion<'_>) -> Option<[Real; 6]>,
    ) -> Result<Real, SettingError> {
        let Planned { force: f, target, lambda_vr, now, force_ref: f_ref, .. } = *planned;
        let (restitution_ref, reference) = (self.reference.restitution(), now.z);
        self.followed_by(planned, |step, z| {
            let inclusion = TrackingInclusion { step, restitution_ref, z, reference, f, f_ref };
            match solve(&inclusion) {
                Some([ls, lv, _, _, les, lev]) => {
                    (step.of_signs(z, f, target, [ls, lv, les, lev]), false)
                }
                None => (step.solve_near(z, f, target, lambda_vr), true),
            }
        })
    }

    /// The control of this step, unless the contact-establishing law applies.
    #[inline(always)]
    fn followed_by(
        &mut self,
        planned: &Planned,
        solve: impl FnOnce(&TrackingStep, Lifted) -> (Tracking, bool),
    ) -> Result<Real, SettingError> {
        let Planned { state, measured, clamped, force, now, next, signs, .. } = *planned;
        let mut unsolved = false;
        let (wanted, [lambda_s, lambda_v, lambda_es, lambda_ev], iterations) = match self.landing {
            Some(landing) if now.z == Lifted::default() && next.z == Lifted::default() => {
                let descent = self.descent_of(landing);
                let g = descent.towards_wall(state);
                let TrackingStep { gains, restitution, .. } = self.step;
                (-force - g, Descent::signs(state.xdot, g, gains, restitution), 0)
            }
            _ => {
                let z = self.lifted(measured, now);
                let step = self.step; // as above
                let (found, failed) = solve(&step, z);
                unsolved = failed;
                let Tracking { u, lambda_s, lambda_v, lambda_es, lambda_ev, iterations, .. } =
                    found;
                (u, [lambda_s, lambda_v, lambda_es, lambda_ev], iterations)
            }
        };
        let (u, saturated) = self.port.actuate(wanted)?;
        let [lambda_sr, lambda_vr] = signs;
        let signs = [lambda_s, lambda_v, lambda_sr, lambda_vr, lambda_es, lambda_ev];
        let status = TickStatus { clamped, saturated, unsolved };
        let ReferenceState { z, side } = self.on_its_branch(next);
        self.state = TrackerState { reference: z, side, u, signs, status, iterations };
        Ok(u)
    }

    /// Whether the reference is in the air at this sample and at the next one.
    #[inline(always)]
    fn flies(&self, force_ref: Real) -> bool {
        let (Physical { x, xdot }, h) = (self.reference(), self.h());
        x > 0.0 && x + h * (xdot + h * force_ref) > 0.0
    }

    /// The reference on the branch that the approach keeps it on.
    #[inline]
    pub(super) fn on_its_branch(&self, reference: ReferenceState) -> ReferenceState {
        match self.approach {
            Approach::Positive => reference.folded(),
            Approach::Nearest => reference,
        }
    }

    /// The measured state on the branch of the approach to this reference.
    #[inline]
    pub(super) fn lifted(&self, state: Physical, reference: ReferenceState) -> Lifted {
        let Lifted { s, v } = transform::lift(state, Branch::Positive, self.step.restitution);
        let mirror = match self.approach {
            Approach::Positive => false,
            Approach::Nearest => {
                let ReferenceState { z, side } = reference;
                // half of the energy of the error on the other side, less that on this one
                // (both numbers are finite: `min` and `max` would ask)
                let cut = if z.s < s { z.s } else { s };
                let cut = if cut > -s { cut } else { -s };
                let nearer = self.step.gains.mu1() * cut + v * z.v;
                let way = if nearer == 0.0 { side } else { nearer };
                way < 0.0
            }
        };
        if mirror {
            Lifted { s: -s, v: -v }
        } else {
            Lifted { s, v }
        }
    }

    /// The reference's state: that at the next sample, once an update is done.
    #[inline(always)]
    #[must_use]
    pub fn reference(&self) -> Physical {
        transform::project(self.state.reference, self.reference.restitution())
    }

    /// The sampling period (s).
    #[must_use]
    pub fn h(&self) -> Real {
        self.reference.h()
    }

    /// The plant's wall.
    #[must_use]
    pub fn restitution(&self) -> Restitution {
        self.step.restitution
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
    pub fn descent(&self) -> Option<Descent> {
        self.landing.map(|it| self.descent_of(it))
    }

    #[inline(always)]
    fn descent_of(&self, landing: Landing) -> Descent {
        let TrackingStep { gains, restitution, .. } = self.step;
        Descent::new(landing, gains, restitution, self.press)
    }

    /// The plant's part of the step, over the horizon.
    #[must_use]
    pub fn step(&self) -> &TrackingStep {
        &self.step
    }

    /// The reference's step.
    #[must_use]
    pub fn reference_step(&self) -> &ThetaGammaStep {
        &self.reference
    }

    /// How measurements are lifted.
    #[must_use]
    pub fn approach(&self) -> Approach {
        self.approach
    }

    /// The limits of the sensor and of the actuator.
    #[must_use]
    pub fn port(&self) -> &Port {
        &self.port
    }

    /// The state.
    #[inline]
    #[must_use]
    pub fn state(&self) -> TrackerState {
        self.state
    }

    /// Restores what [`TwistingTracker::state`] gave: the updates that follow are the same, to the
    /// last bit.
    pub fn set_state(&mut self, state: TrackerState) {
        self.state = state;
    }
}

// Settings and state of a tracker as plain numbers.

/// Which of its two preimages the measured state is lifted to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Approach {
    /// The plant and the reference to `s >= 0`, every period (the paper).
    #[default]
    Positive,
    /// The plant to the image `sigma (s, v)` that is nearer to `(s_r, v_r)`, which itself evolves
    /// continuously, by the energy of the error `mu1 |e_s| + e_v^2/2`: the same in all units. Of two
    /// at equal distance the one on the side of the reference.
    Nearest,
}

/// Everything that a tracker is made of, for one that is stored as plain numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackerSettings {
    /// The gains.
    pub gains: Gains,
    /// Sampling period (s).
    pub h: Real,
    /// The plant's wall.
    pub restitution: Restitution,
    /// The reference's wall.
    pub restitution_ref: Restitution,
    /// How measurements are lifted.
    pub approach: Approach,
    /// The contact-establishing law; `None` is the paper's update.
    pub landing: Option<Landing>,
    /// Acceleration towards the wall of a mass at rest (m/s^2), `None` for the law's own.
    pub press: Option<Real>,
    /// Periods that a step is planned over.
    pub horizon: Real,
    /// Whether the measured velocity is taken half a period back in the air.
    pub shift: bool,
    /// The limits of the sensor and of the actuator.
    pub port: Port,
}

/// State of the tracker between updates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackerState {
    /// The reference `(s_r, v_r)`.
    pub reference: Lifted,
    /// The side of the wall on which the reference was last, `+1` or `-1`.
    pub side: Real,
    /// The last control (m/s^2).
    pub u: Real,
    /// The last `ls, lv, lsr, lvr, les, lev`.
    pub signs: [Real; 6],
    /// Status of the last update.
    pub status: TickStatus,
    /// Iterations of the last update: [`Tracking::iterations`].
    pub iterations: u32,
}

impl TrackerState {
    /// The reference at rest.
    pub(super) const REST: Self = Self {
        reference: Lifted { s: 0.0, v: 0.0 },
        side: 1.0,
        u: 0.0,
        signs: [0.0; 6],
        status: TickStatus { clamped: false, saturated: false, unsolved: false },
        iterations: 0,
    };

    /// Nothing done yet, the reference here.
    pub(super) fn starting(ReferenceState { z, side }: ReferenceState) -> Self {
        Self { reference: z, side, ..Self::REST }
    }

    /// The reference.
    #[inline]
    pub(super) fn followed(&self) -> ReferenceState {
        ReferenceState { z: self.reference, side: self.side }
    }
}
