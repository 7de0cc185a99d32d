//! Impacts that go on without an accumulation.

use crate::zeno::bounce::Bounce;

/// Impacts below the tolerance at a wall to which the mass is not pulled, in short sequence: where
/// the pull vanishes only at the wall they accumulate, but not as a chain does, and errors of the
/// size of the tolerance keep them going for good.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct StallingImpacts {
    last: f64,
    /// The longest flight so far (s).
    longest: f64,
    count: u32,
}

impl StallingImpacts {
    /// Impacts after which it is called that.
    const MOST: u32 = 50;
    /// What is a short flight, relative to the longest.
    const SHORT: f64 = 0.01;

    pub(super) fn starting_at(t: f64) -> Self {
        Self { last: t, ..Self::default() }
    }

    /// Takes the next impact; whether it is one too many.
    pub(super) fn goes_on(&mut self, bounce: Bounce, speed: f64) -> bool {
        let flight = bounce.t - self.last;
        (self.last, self.longest) = (bounce.t, self.longest.max(flight));
        let stalls = bounce.g <= 0.0 && bounce.u <= speed && flight < Self::SHORT * self.longest;
        self.count = if stalls { self.count + 1 } else { 0 };
        self.count > Self::MOST
    }
}
