//! Times at which the forces are not smooth, as the user declares them.

/// Times between which a system is smooth: it is evaluated at no others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Smooth {
    from: f64,
    to: f64,
}

impl Smooth {
    pub(crate) const ALWAYS: Self = Self { from: f64::NEG_INFINITY, to: f64::INFINITY };

    /// From here on up to there, by more than rounding within, so that each side of a jump has its
    /// own limit.
    fn between(start: f64, end: f64) -> Self {
        let margin = |t: f64| match t.is_finite() {
            true => (4.0 * f64::EPSILON * t.abs()).max(f64::MIN_POSITIVE),
            false => 0.0,
        };
        Self { from: start + margin(start), to: end - margin(end) }
    }

    /// The time at which the system is evaluated instead of `t`.
    #[inline(always)]
    pub(crate) fn nearest(self, t: f64) -> f64 {
        let t = if t < self.from { self.from } else { t };
        if t > self.to {
            self.to
        } else {
            t
        }
    }

    /// Its ends.
    pub(crate) fn ends(self) -> (f64, f64) {
        (self.from, self.to)
    }
}

/// The stretches between the declared times, one after the other.
#[derive(Debug)]
pub(crate) struct Stops<'a> {
    /// Increasing.
    times: &'a [f64],
    /// End of the run.
    t1: f64,
}

impl<'a> Stops<'a> {
    pub(crate) fn new(times: &'a [f64], t1: f64) -> Self {
        Self { times, t1 }
    }

    /// Enters the stretch that begins at `t`: its end. The system is evaluated within it only.
    pub(crate) fn enter(&mut self, t: f64, smooth: &mut Smooth) -> f64 {
        let passed = self.times.partition_point(|&stop| stop <= t);
        let start = match self.times[..passed].last() {
            Some(&stop) if stop == t => t,
            _ => f64::NEG_INFINITY,
        };
        self.times = &self.times[passed..];
        let stop = self.times.first().copied().filter(|&stop| stop <= self.t1);
        *smooth = Smooth::between(start, stop.unwrap_or(f64::INFINITY));
        stop.unwrap_or(self.t1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_stretch_is_asked_on_its_own_side() {
        let (mut stops, mut smooth) = (Stops::new(&[1.0, 2.0], 1.5), Smooth::ALWAYS);
        assert_eq!((smooth.nearest(-1e300), smooth.nearest(1e300)), (-1e300, 1e300));
        assert_eq!(stops.enter(0.0, &mut smooth), 1.0);
        assert!(smooth.nearest(1.0) < 1.0 && smooth.nearest(-5.0) == -5.0);
        // the next one is beyond the end of the run
        assert_eq!(stops.enter(1.0, &mut smooth), 1.5);
        assert!(smooth.nearest(1.0) > 1.0 && smooth.nearest(9.0) == 9.0);
        assert_eq!(smooth.ends().1, f64::INFINITY);
    }
}
