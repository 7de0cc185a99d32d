//! The twisting tracker: makes the mass follow a bouncing reference through its Zeno point.

use super::landing::Descent;
use super::port::checked_force;
use super::tracking::{Target, Tracking, TrackingStep};
use super::{checked, GainError, Gains, Landing, Port, TickStatus};
use crate::setting::require;
use crate::{transform, Branch, Lifted, Physical, Restitution, SettingError, ThetaGammaStep};

/// Which of its two preimages the measured state is lifted to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Approach {
    /// The plant and the reference to `s >= 0`, every period (the paper).
    #[default]
    Positive,
    /// The plant to the preimage that is nearer to `(s_r, v_r)`, which itself evolves continuously:
    /// `sigma` such that `sigma (s s_r + v v_r) >= 0`, time in seconds.
    Nearest,
}

/// The implicit twisting tracker (equation 20), with its reference inside.
///
/// While the reference rests it lands ([`Descent`], the default, one period ahead): the sampled
/// loop ends in exact rest at every `e` in `(0, 1)`. Everywhere else, and always without a landing,
/// the control is that of the paper's implicit step ([`TrackingStep`]), to the last bit.
///
/// A *horizon* of `N` periods plans that step over `H = N h` and ticks every `h`: quieter under
/// noise, less sharp within `H` of an impact. The *shift* `x' - h F_r/2` in the air makes the
/// measured velocity that of an implicit Euler step, as the reference's is: positions of these
/// steps lie on the exact parabola, their velocities half a period behind it.
///
/// ```
/// use zivi_core::control::{Approach, Gains, TwistingTracker};
/// use zivi_core::{Physical, Restitution};
/// let wall = Restitution::from_kappa(0.5)?;
/// let gains = Gains::for_tracking(30.0, 17.0, 5.0, wall)?;
/// let mut tracker = TwistingTracker::new(gains, 1e-3, wall, wall, Approach::Positive)?;
/// tracker.reset(Physical { x: 3.0, xdot: 3.0 })?;
/// let u = tracker.tick(Physical { x: 6.0, xdot: 5.0 }, -9.81, -19.81)?;
/// // both errors positive and R = 1/2 for plant and reference: -(30 + 17 + 19.81/R)/2 + 9.81
/// assert!((u + 33.5).abs() < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TwistingTracker {
    /// Over the horizon.
    step: TrackingStep,
    /// Over a period.
    reference: ThetaGammaStep,
    /// Over the horizon, if that is longer than a period.
    outlook: Option<ThetaGammaStep>,
    shift: bool,
    descent: Option<Descent>,
    approach: Approach,
    port: Port,
    state: TrackerState,
}

/// What the tracker remembers between ticks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackerState {
    /// The reference `(s_r, v_r)`.
    pub reference: Lifted,
    /// The side of the wall on which the reference was last, `+1` or `-1`.
    pub side: f64,
    /// The last control (m/s^2).
    pub u: f64,
    /// The last `ls, lv, lsr, lvr, les, lev`.
    pub signs: [f64; 6],
    /// What was done to the last sample and control.
    pub status: TickStatus,
    /// Iterations of the last tick: [`Tracking::iterations`].
    pub iterations: u32,
}

impl TrackerState {
    /// The reference at rest.
    const REST: Self = Self {
        reference: Lifted { s: 0.0, v: 0.0 },
        side: 1.0,
        u: 0.0,
        signs: [0.0; 6],
        status: TickStatus { clamped: false, saturated: false },
        iterations: 0,
    };

    /// The reference set to a physical state.
    pub(super) fn at(reference: Physical, wall: Restitution) -> Result<Self, SettingError> {
        let Physical { x, xdot } = reference;
        let refused = |name, value, range| Err(SettingError { name, value, range });
        if !(x >= 0.0 && x.is_finite()) {
            return refused("x_ref", x, "a finite distance >= 0 from the wall (m)");
        }
        let z = transform::lift(reference, Branch::Positive, wall);
        if !z.v.is_finite() {
            return refused("xdot_ref", xdot, "a finite velocity (m/s)");
        }
        Ok(Self { reference: z, side: transform::side(z, 1.0), ..Self::REST })
    }

    /// On the branch `+1`.
    pub(super) fn folded(self) -> Self {
        let Lifted { s, v } = self.reference;
        let reference =
            if self.side < 0.0 { Lifted { s: 0.0 - s, v: 0.0 - v } } else { self.reference };
        Self { reference, side: 1.0, ..self }
    }
}

impl TwistingTracker {
    /// A tracker with sampling period `h` (s) for a mass on `wall`, following a reference that
    /// bounces on `wall_ref`. Exact tracking needs equal walls. The reference starts at rest: see
    /// [`TwistingTracker::reset`].
    ///
    /// # Errors
    /// [`SettingError`] names the setting that is out of range.
    pub fn new(
        gains: Gains,
        h: f64,
        wall: Restitution,
        wall_ref: Restitution,
        approach: Approach,
    ) -> Result<Self, SettingError> {
        checked(h, wall, "e")?;
        checked(h, wall_ref, "e_ref")?;
        let reference = ThetaGammaStep::new(h, 1.0, 1.0, wall_ref)?;
        let step = TrackingStep { h, wall, gains };
        let descent = Some(Descent::new(Landing::new(1, h)?, gains, wall));
        let (port, state) = (Port::default(), TrackerState::REST);
        let (outlook, shift) = (None, false);
        Ok(Self { step, reference, outlook, shift, descent, approach, port, state })
    }

    /// The same with another horizon of its landing; `None` is the paper's tick. A mass at rest is
    /// pressed with the law's own `D` again.
    #[must_use]
    pub fn with_landing(self, landing: Option<Landing>) -> Self {
        let TrackingStep { gains, wall, .. } = self.step;
        Self { descent: landing.map(|it| Descent::new(it, gains, wall)), ..self }
    }

    /// The same where a mass that rests is pressed with `press` (m/s^2), at least the `bound` of
    /// the unknown force; without a landing nothing changes.
    ///
    /// # Errors
    /// [`GainError`] unless `press` is finite and at least `bound`.
    pub fn with_press(self, press: f64, bound: f64) -> Result<Self, GainError> {
        let descent = self.descent.map(|it| it.with_press(press, bound)).transpose()?;
        Ok(Self { descent, ..self })
    }

    /// The same with its step planned over `horizon` sampling periods.
    ///
    /// # Errors
    /// [`SettingError`] unless `horizon >= 1` and it is finite, also times `h`.
    pub fn with_horizon(self, horizon: f64) -> Result<Self, SettingError> {
        let range = "a finite number of periods >= 1";
        require(horizon >= 1.0 && horizon.is_finite(), "horizon", horizon, range)?;
        let h = horizon * self.reference.h();
        require(h.is_finite(), "horizon", horizon, "such that horizon h is finite")?;
        let outlook = if horizon > 1.0 { Some(self.reference.with_h(h)?) } else { None };
        Ok(Self { step: TrackingStep { h, ..self.step }, outlook, ..self })
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
    pub fn reset(&mut self, reference: Physical) -> Result<(), SettingError> {
        let state = TrackerState::at(reference, self.reference.wall())?;
        self.state = self.on_its_branch(state);
        Ok(())
    }

    /// The control for the period that starts with this measurement; the reference advances by
    /// `h`. `force` acts on the mass without control, `force_ref` on the reference.
    ///
    /// # Errors
    /// [`SettingError`] for a sample that is not finite or too deep behind the wall. Nothing has
    /// changed then: the reference has not advanced, the last control is still
    /// [`TrackerState::u`].
    pub fn tick(
        &mut self,
        measured: Physical,
        force: f64,
        force_ref: f64,
    ) -> Result<f64, SettingError> {
        let (state, clamped) = self.port.sense(measured)?;
        checked_force("force", force)?;
        let (next, target) = self.outlook(&self.state, force_ref)?;
        let back =
            if self.shift && self.flies(force_ref) { 0.5 * self.h() * force_ref } else { 0.0 };
        let planned = Planned { now: self.state.reference, next, target };
        self.decide((state, back, clamped), force, planned)
    }

    /// The reference after a period, and what the plant has to follow over the horizon.
    #[inline]
    pub(super) fn outlook(
        &self,
        state: &TrackerState,
        force_ref: f64,
    ) -> Result<(TrackerState, Target), SettingError> {
        let (next, target) = advanced(&self.reference, state, force_ref)?;
        let target = match &self.outlook {
            Some(step) => advanced(step, state, force_ref)?.1,
            None => target,
        };
        Ok((next, target))
    }

    /// The control for this sample, its velocity taken `back`, and this step of the reference; and
    /// all that is remembered.
    #[inline(always)]
    pub(super) fn decide(
        &mut self,
        (state, back, clamped): (Physical, f64, bool),
        force: f64,
        Planned { now, next, target }: Planned,
    ) -> Result<f64, SettingError> {
        let (wanted, [lambda_s, lambda_v, lambda_es, lambda_ev], iterations) = match &self.descent {
            Some(descent) if now == Lifted::default() && next.reference == Lifted::default() => {
                let g = descent.towards_wall(state);
                let TrackingStep { gains, wall, .. } = self.step;
                (-force - g, Descent::signs(state.xdot, g, gains, wall), 0)
            }
            _ => {
                let z = self.lifted(Physical { xdot: state.xdot - back, ..state }, now);
                let Tracking { u, lambda_s, lambda_v, lambda_es, lambda_ev, iterations, .. } =
                    self.step.solve(z, force, target);
                (u, [lambda_s, lambda_v, lambda_es, lambda_ev], iterations)
            }
        };
        let (u, saturated) = self.port.actuate(wanted)?;
        let [_, _, lambda_sr, lambda_vr, _, _] = next.signs;
        let signs = [lambda_s, lambda_v, lambda_sr, lambda_vr, lambda_es, lambda_ev];
        let status = TickStatus { clamped, saturated };
        let next = TrackerState { u, signs, status, iterations, ..next };
        self.state = self.on_its_branch(next);
        Ok(u)
    }

    /// Whether the reference is in the air at this sample and at the next one.
    fn flies(&self, force_ref: f64) -> bool {
        let (Physical { x, xdot }, h) = (self.reference(), self.h());
        x > 0.0 && x + h * (xdot + h * force_ref) > 0.0
    }

    /// The reference on the branch that the approach keeps it on.
    pub(super) fn on_its_branch(&self, state: TrackerState) -> TrackerState {
        match self.approach {
            Approach::Positive => state.folded(),
            Approach::Nearest => state,
        }
    }

    /// The measured state on the branch that the approach takes beside this reference.
    #[inline]
    fn lifted(&self, state: Physical, reference: Lifted) -> Lifted {
        let Lifted { s, v } = transform::lift(state, Branch::Positive, self.step.wall);
        let mirror = match self.approach {
            Approach::Positive => false,
            Approach::Nearest => s * reference.s + v * reference.v < 0.0,
        };
        if mirror {
            Lifted { s: -s, v: -v }
        } else {
            Lifted { s, v }
        }
    }

    /// The reference's state: that at the next sample, once a tick is done.
    #[must_use]
    pub fn reference(&self) -> Physical {
        transform::project(self.state.reference, self.reference.wall())
    }

    /// The sampling period (s).
    #[must_use]
    pub fn h(&self) -> f64 {
        self.reference.h()
    }

    /// How it lands; `None` is the paper's tick.
    #[must_use]
    pub fn descent(&self) -> Option<Descent> {
        self.descent
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

    /// What is remembered.
    #[must_use]
    pub fn state(&self) -> TrackerState {
        self.state
    }

    /// Restores what [`TwistingTracker::state`] gave: the ticks that follow are the same, to the
    /// last bit.
    pub fn set_state(&mut self, state: TrackerState) {
        self.state = state;
    }
}

/// A period of the reference, and what the plant has to follow.
pub(super) struct Planned {
    pub(super) now: Lifted,
    pub(super) next: TrackerState,
    pub(super) target: Target,
}

/// One implicit Euler step of the reference, with its signs in their places, and what the plant
/// has to follow.
#[inline]
pub(super) fn advanced(
    reference: &ThetaGammaStep,
    state: &TrackerState,
    force_ref: f64,
) -> Result<(TrackerState, Target), SettingError> {
    checked_force("force_ref", force_ref)?;
    let Ok(found) = reference.solve(state.reference, force_ref, state.side) else {
        let range = "small enough for the reference to stay finite (m/s^2)";
        return Err(SettingError { name: "force_ref", value: force_ref, range });
    };
    let r = reference.wall().r(found.lambda_s, found.lambda_v);
    let acceleration = found.lambda_s * force_ref / r;
    let end = found.end();
    let next = TrackerState {
        reference: end,
        side: transform::side(end, state.side),
        signs: [0.0, 0.0, found.lambda_s, found.lambda_v, 0.0, 0.0],
        ..*state
    };
    Ok((next, Target { end, acceleration }))
}
