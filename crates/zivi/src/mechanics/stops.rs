//! Times at which the forces are not smooth, as the user declares them.

use super::kinetics::Model;

/// The stretches between the declared times, one after the other.
pub(super) struct Stops<'a> {
    /// Increasing.
    times: &'a [f64],
    /// End of the run.
    t1: f64,
}

impl<'a> Stops<'a> {
    pub(super) fn new(times: &'a [f64], t1: f64) -> Self {
        Self { times, t1 }
    }

    /// Enters the stretch that begins at `t`: its end, and the system is asked within it only, by
    /// more than rounding, so that each side of a jump has its own limit.
    pub(super) fn enter<D>(&mut self, t: f64, model: &mut Model<'_, D>) -> f64 {
        let margin = |t: f64| match t.is_finite() {
            true => (4.0 * f64::EPSILON * t.abs()).max(f64::MIN_POSITIVE),
            false => 0.0,
        };
        let passed = self.times.partition_point(|&stop| stop <= t);
        let start = match self.times[..passed].last() {
            Some(&stop) if stop == t => t,
            _ => f64::NEG_INFINITY,
        };
        self.times = &self.times[passed..];
        let stop = self.times.first().copied().filter(|&stop| stop <= self.t1);
        let end = stop.unwrap_or(f64::INFINITY);
        model.smooth = (start + margin(start), end - margin(end));
        stop.unwrap_or(self.t1)
    }
}
