//! A reference that is given sample by sample, from a curve, a recording or another simulation.
//!
//! The tracker does not advance it: it is told where the reference is at the sample and at the next
//! one. What it plans towards is an implicit Euler step from there under the reference's
//! acceleration `a`, with the velocity of the reference and of the mass both half a period back in
//! the air: the step then ends where a parabola through the given state does, and a mass on the
//! reference is given `u = a - F`.

use super::port::checked_force;
use super::reference_state::Waypoint;
use super::reference_state::{ReferencePeriod, ReferenceSource, ReferenceState};
use super::TwistingTracker;
use crate::Real;
use crate::{transform, Branch, Lifted, Physical, Restitution, SettingError};

impl TwistingTracker {
    /// The control for the period that starts with this measurement, for a reference that is at
    /// `now` at this sample and at `next` at the next one. `acceleration` is the reference's over
    /// the period, `x_r''` (m/s^2). Without it, it is the difference quotient of the velocities in
    /// the air; over an impact of the reference `force`, under which the mass meets the wall too.
    ///
    /// The tracker's own reference becomes `next`.
    ///
    /// # Errors
    /// [`SettingError`] as [`TwistingTracker::tick`], and for a waypoint that is not finite or
    /// behind the wall. Nothing has changed then.
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
    /// [`SettingError`] for a waypoint that is not finite or behind the wall, or an acceleration that
    /// is not finite.
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
