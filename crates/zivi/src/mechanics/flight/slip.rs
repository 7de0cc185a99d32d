//! Slip in two directions near its end, where the direction converges like a power of the time that is left.
//!
//! ```text
//! rho = |W|    rho' = d . W' = -alpha    rho theta' = d_perp . W'    tau = rho/alpha
//! h <= 0.8 tau near the end      h <= 3 rho/b, b the deceleration by friction          (1)
//! ```
//!
//! Steps of one length would meet the singular end with an error of their own size. Those of (1) shrink with
//! the slip, and the last keeps the direction, once what that could still turn is below the tolerance.

use super::{Flying, Slides, SmoothMotion};
use crate::mechanics::state::MechanicalState;
use crate::numeric::bernstein::Bernstein;
use crate::numeric::dense::largest;
use crate::numeric::stages::Plan;
use crate::piecewise::flight::SteppedFlight;
use crate::record::gap_set::GapSet;
use crate::record::status::Failure;
use crate::system::dynamics::Dynamics;

/// A step near the end of a slip covers so much of the time that is left.
const GRADED: f64 = 0.8;
/// The end is near if a step would cover that time so many times.
const NEAR: f64 = 1.5;
/// The direction turns with the rate `b/rho`: explicit steps are no longer than so many of its inverse.
const STABLE: f64 = 3.0;
/// Implicit steps pay from so many explicit ones on.
const STIFF: f64 = 8.0;
/// The last step is a little longer than the time that is left.
const LAST: f64 = 1.2;
/// What a direction that is kept may leave, relative to the tolerance, and at least.
const KEPT: (f64, f64) = (1e-2, 1e-13);

impl SmoothMotion {
    /// A slip speed that is below the tolerance, beside these velocities.
    pub(super) fn kept(&self, velocities: &[f64]) -> f64 {
        let limits = self.steps.limits();
        let part = if limits.adaptive { KEPT.0 * limits.tolerances.rtol } else { 0.0 };
        part.max(KEPT.1) * (1.0 + largest(velocities))
    }

    /// How the slip goes on in the next step, whose length is limited by it.
    pub(super) fn slides(&self, plan: &mut Plan, state: &MechanicalState) -> Slides {
        let (layout, now, kinetics) = (state.layout(), state.now(), state.kinetics());
        let first = layout.n + layout.m;
        let kept = self.kept(&now.xdot[..layout.n]);
        let (mut stiff, mut ending, mut stopping) = (false, false, GapSet::EMPTY);
        let (mut longest, mut last) = (plan.h, f64::INFINITY);
        for pair in kinetics.cones(state.mode().slipping()) {
            let [x, y] = pair.map(|channel| now.xdot[first + channel]);
            let speed = x.hypot(y);
            if speed == 0.0 {
                return Slides::Stiff;
            }
            let [a, b] = pair.map(|channel| state.slope()[first + channel]);
            let (slows, turns) = (-(x * a + y * b) / speed, (x * b - y * a) / speed);
            let left = if slows > 0.0 { speed / slows } else { f64::INFINITY };
            // also what is left of a slip that ends with another
            let is_straight = turns.abs() * left <= kept || slows > 0.0 && speed <= kept;
            if is_straight && left <= NEAR * plan.h {
                stopping = stopping.with(pair.into_iter().collect());
                last = last.min(LAST * left);
                continue;
            }
            if GRADED * left < NEAR * plan.h {
                ending = true;
                longest = longest.min(GRADED * left);
            }
            let stable = STABLE * speed / state.deceleration(pair);
            stiff |= stable < plan.h / STIFF && GRADED * left >= NEAR * plan.h;
            longest = longest.min(stable);
        }
        if stiff && !ending && stopping.is_empty() {
            return Slides::Stiff;
        }
        // slips that go on may need a shorter step than that to the stop
        if !stopping.is_empty() && (longest >= last / LAST || longest >= plan.h) {
            plan.h = longest.min(last);
            return Slides::Stopping(stopping);
        }
        plan.h = longest.min(GRADED * last / LAST);
        Slides::Turning
    }
}

impl<D> Flying<'_, '_, D> {
    /// From here on the directions of slip in these channels stay as they are.
    pub(super) fn freeze(&mut self, channels: GapSet) {
        let (kinetics, now) = self.state.parts();
        kinetics.freeze(GapSet::EMPTY);
        kinetics.turn(&now.xdot[kinetics.coordinates()..]);
        kinetics.freeze(channels);
        let headings = kinetics.headings();
        self.motion.aside.take_headings(headings);
        self.motion.aside.freeze(channels);
    }

    /// The slip along the direction that is kept over the last step, which is complete.
    pub(super) fn frozen_slip(&self, pair: [usize; 2]) -> Bernstein {
        let first = self.state.layout().n + self.state.kinetics().row(0);
        let [x, y] = pair.map(|channel| {
            let [_, slip] = self.motion.last().polynomials_of(first + channel);
            slip.times(self.state.kinetics().headings()[channel])
        });
        x.sum(&y)
    }

    /// The slip in a channel at the end of the last step, in a cone along its direction, and its rate.
    pub(super) fn slip_at_end(&self, channel: usize) -> [f64; 2] {
        let (kinetics, last) = (self.state.kinetics(), self.motion.last());
        let first = self.state.layout().n + kinetics.row(0);
        let of = |channel: usize| [last.end.xdot[first + channel], last.end_slope(first + channel)];
        let Some(other) = kinetics.other_of(channel) else { return of(channel) };
        let ([w, a], [v, b]) = (of(channel), of(other));
        let [c, s] = [channel, other].map(|channel| kinetics.headings()[channel]);
        [c * w + s * v, c * a + s * b]
    }

    /// Whether all slips whose direction is kept end in the step; if not they turn again.
    pub(super) fn frozen_slip_stops<E>(&mut self) -> Result<bool, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let frozen = self.state.kinetics().frozen();
        if frozen.is_empty() {
            return Ok(true);
        }
        self.complete()?;
        let kinetics = self.state.kinetics();
        let stops = |pair: [usize; 2]| self.frozen_slip(pair).first_negative().is_some();
        if kinetics.cones(frozen).any(stops) {
            return Ok(true);
        }
        self.freeze(GapSet::EMPTY);
        Ok(false)
    }
}
