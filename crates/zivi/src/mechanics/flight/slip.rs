//! Where the slip in a channel of friction ends.

use super::Flying;
use crate::mechanics::mode::Next;
use crate::piecewise::flight::SteppedFlight;
use crate::record::failure::Failure;
use crate::system::dynamics::Dynamics;

/// Iterations for the time when a slip ends, and what ends within this part of a step ends together.
const STOPS: usize = 6;
const TOGETHER_SLIPS: f64 = 1e-11;

impl<D> Flying<'_, '_, D> {
    /// Whether the channels that began to slip at the start of the step do so at its end.
    pub(super) fn released_channels_slip<E>(&mut self) -> Result<bool, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let (released, mode) = (self.state.released(), self.state.mode());
        if released.is_empty() {
            return Ok(true);
        }
        self.finish()?;
        let (row, last) = (self.state.kinetics().row(0), self.motion.last());
        let first = self.state.layout().n + row;
        Ok(released.iter().all(|channel| {
            let (sign, c) = (mode.sign(channel), first + channel);
            sign * last.end.xdot[c] > 0.0 && sign * last.end_slope(c) > 0.0
        }))
    }

    /// The first channel whose slip ends in the step, and after which part of it.
    pub(super) fn first_stop<E>(&mut self) -> Result<Option<(f64, usize)>, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let mode = self.state.mode();
        let slipping = mode.slipping().without(self.state.released());
        if slipping.is_empty() {
            return Ok(None);
        }
        self.complete()?;
        let first = self.state.layout().n + self.state.kinetics().row(0);
        let root = |channel: usize| {
            let [_, slip] = self.motion.last().polynomials_of(first + channel);
            let slip = if mode.slip_minus.has(channel) { slip.negated() } else { slip };
            slip.first_negative().map(|theta| (theta, channel))
        };
        let roots = slipping.iter().filter_map(root);
        Ok(roots.min_by(|one, other| one.0.total_cmp(&other.0)))
    }

    /// Steps to where the slip in a channel ends, near `now + length`; that in others ends with it to
    /// rounding.
    pub(super) fn stop_slip<E>(&mut self, length: f64, channel: usize) -> Result<Next, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let first = self.state.layout().n + self.state.kinetics().row(0);
        let whole = self.motion.last().h;
        let rounding = |x: f64, t: f64| 4.0 * f64::EPSILON * (t.abs() + x);
        let mut x = length;
        for _ in 0..STOPS {
            self.attempt(x)?;
            self.finish()?;
            let last = self.motion.last();
            let next = x - last.end.xdot[first + channel] / last.end_slope(first + channel);
            if !next.is_finite() || next <= 0.0 || next > 2.0 * whole {
                break;
            }
            let moved = (next - x).abs();
            x = next;
            if moved <= rounding(x, self.state.now().t) {
                break;
            }
        }
        let near = TOGETHER_SLIPS * whole + rounding(x, self.state.now().t);
        let (last, mode) = (self.motion.last(), self.state.mode());
        let stops = |&other: &usize| {
            let c = first + other;
            other == channel || last.end.xdot[c].abs() <= last.end_slope(c).abs() * near
        };
        let channels = mode.slipping().iter().filter(stops).collect();
        self.arrive(x, x - self.motion.last().h)?;
        Ok(Next::Stop(channels))
    }
}
