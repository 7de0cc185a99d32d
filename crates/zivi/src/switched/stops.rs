//! Times at which the force is not smooth, as the user declares them.

use super::stages::Counted;

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

    /// Enters the stretch that begins at `t`: its end, and the force is asked within it only.
    pub(super) fn enter<F>(&mut self, t: f64, force: &mut Counted<'_, F>) -> f64 {
        let passed = self.times.partition_point(|&stop| stop <= t);
        let start = match self.times[..passed].last() {
            Some(&stop) if stop == t => t,
            _ => f64::NEG_INFINITY,
        };
        self.times = &self.times[passed..];
        let stop = self.times.first().copied().filter(|&stop| stop <= self.t1);
        force.is_smooth_between(start, stop.unwrap_or(f64::INFINITY));
        stop.unwrap_or(self.t1)
    }
}
