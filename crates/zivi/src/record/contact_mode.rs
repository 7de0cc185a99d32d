//! Which contacts are closed, and what friction does in each of its channels.

use super::gap_set::GapSet;

/// The mode of a mechanical system: between events its motion obeys one differential equation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ContactMode {
    /// The gaps that are closed.
    pub closed: GapSet,
    /// The channels of friction that slip with a speed above zero,
    pub slip_plus: GapSet,
    /// those that slip with one below zero,
    pub slip_minus: GapSet,
    /// and those that stick. Those in none of these sets belong to open gaps.
    pub stick: GapSet,
}

impl From<GapSet> for ContactMode {
    fn from(closed: GapSet) -> Self {
        Self { closed, ..Self::default() }
    }
}

impl ContactMode {
    /// Whether there is friction in no channel.
    #[must_use]
    pub fn is_frictionless(&self) -> bool {
        self.slipping().with(self.stick).is_empty()
    }

    /// The channels that slip.
    #[must_use]
    pub fn slipping(&self) -> GapSet {
        self.slip_plus.with(self.slip_minus)
    }

    /// The sign of the slip in a channel, 0 where it sticks or there is none.
    #[must_use]
    pub fn sign(&self, channel: usize) -> f64 {
        if self.slip_plus.has(channel) {
            1.0
        } else if self.slip_minus.has(channel) {
            -1.0
        } else {
            0.0
        }
    }

    /// What a channel does, as a number: 1 and -1 slip, 0 sticks, 2 belongs to an open gap.
    #[must_use]
    pub fn number(&self, channel: usize) -> i8 {
        match (self.slip_plus.has(channel), self.slip_minus.has(channel)) {
            (true, _) => 1,
            (_, true) => -1,
            _ => 2 * i8::from(!self.stick.has(channel)),
        }
    }

    /// The same with a channel that slips with the sign, or sticks if that is zero.
    #[must_use]
    pub fn with_channel(mut self, channel: usize, sign: f64) -> Self {
        self = self.without_channel(channel);
        let set = match sign {
            sign if sign > 0.0 => &mut self.slip_plus,
            sign if sign < 0.0 => &mut self.slip_minus,
            _ => &mut self.stick,
        };
        *set = set.with(GapSet::of(channel));
        self
    }

    /// The same with a channel of an open gap.
    #[must_use]
    pub fn without_channel(self, channel: usize) -> Self {
        let one = GapSet::of(channel);
        Self {
            closed: self.closed,
            slip_plus: self.slip_plus.without(one),
            slip_minus: self.slip_minus.without(one),
            stick: self.stick.without(one),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_channel_does_one_thing() {
        let mut mode = ContactMode::from(GapSet::of(3));
        assert!(mode.is_frictionless() && mode.number(1) == 2);
        for (sign, number) in [(2.0, 1), (-0.5, -1), (0.0, 0)] {
            mode = mode.with_channel(1, sign);
            assert_eq!((mode.number(1), mode.number(0), mode.closed), (number, 2, GapSet::of(3)));
            assert_eq!(mode.sign(1), f64::from(number));
            assert!(!mode.is_frictionless());
        }
        assert_eq!(mode.without_channel(1), ContactMode::from(GapSet::of(3)));
    }
}
