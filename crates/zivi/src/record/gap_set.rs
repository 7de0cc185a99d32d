//! Sets of gaps, and contact modes.
//!
//! Sets of gaps.

/// Words of 64 gaps.
const WORDS: usize = 4;

/// Some of the gaps of a system, at most [`GapSet::MOST`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GapSet([u64; WORDS]);

impl GapSet {
    /// No gap.
    pub const EMPTY: Self = Self([0; WORDS]);

    /// Most gaps.
    pub const MOST: usize = 64 * WORDS;

    /// One gap.
    #[must_use]
    pub fn of(gap: usize) -> Self {
        let mut words = [0; WORDS];
        words[gap / 64] = 1 << (gap % 64);
        Self(words)
    }

    /// Those of the first 64 gaps whose bits are set.
    #[must_use]
    pub fn of_bits(bits: u64) -> Self {
        let mut words = [0; WORDS];
        words[0] = bits;
        Self(words)
    }

    /// Whether the gap is one of them.
    #[must_use]
    pub fn has(self, gap: usize) -> bool {
        self.0[gap / 64] >> (gap % 64) & 1 == 1
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(self) -> bool {
        self.0.iter().fold(0, |all, word| all | word) == 0
    }

    /// The gap, if the set has exactly one.
    #[must_use]
    pub fn only(self) -> Option<usize> {
        if self.0[1..].iter().fold(0, |all, word| all | word) != 0 {
            return self.iter().next().filter(|_| self.len() == 1);
        }
        self.0[0].is_power_of_two().then(|| self.0[0].trailing_zeros() as usize)
    }

    /// How many there are.
    #[must_use]
    pub fn len(self) -> usize {
        self.0.iter().map(|word| word.count_ones() as usize).sum()
    }

    /// With those of the other set.
    #[must_use]
    pub fn with(self, other: Self) -> Self {
        Self(std::array::from_fn(|k| self.0[k] | other.0[k]))
    }

    /// Without those of the other set.
    #[must_use]
    pub fn without(self, other: Self) -> Self {
        Self(std::array::from_fn(|k| self.0[k] & !other.0[k]))
    }

    /// The gaps, ascending.
    pub fn iter(self) -> impl Iterator<Item = usize> + Clone {
        let more = self.0[1..].iter().fold(0, |all, word| all | word) != 0;
        let (mut word, mut left) = (0, self.0[0]);
        std::iter::from_fn(move || {
            while left == 0 {
                if !more {
                    return None;
                }
                word += 1;
                left = *self.0.get(word)?;
            }
            let gap = 64 * word + left.trailing_zeros() as usize;
            left &= left - 1;
            Some(gap)
        })
    }

    /// Numbers that hold 32 gaps each exactly: those of the first `count` gaps.
    pub(crate) fn halves(self, count: usize) -> impl Iterator<Item = f64> {
        let half = move |k: usize| self.0[k / 2] >> (32 * (k % 2)) & 0xffff_ffff;
        (0..Self::n_halves(count)).map(move |k| half(k) as f64)
    }

    /// How many these are: two at least.
    pub(crate) fn n_halves(count: usize) -> usize {
        count.div_ceil(32).max(2)
    }

    /// The set of some halves, each below 2^32.
    pub(crate) fn of_halves(halves: &[u32]) -> Self {
        let mut words = [0; WORDS];
        for (k, &half) in halves.iter().enumerate() {
            words[k / 2] |= u64::from(half) << (32 * (k % 2));
        }
        Self(words)
    }
}

impl FromIterator<usize> for GapSet {
    fn from_iter<I: IntoIterator<Item = usize>>(gaps: I) -> Self {
        gaps.into_iter().fold(Self::EMPTY, |mut set, gap| {
            set.0[gap / 64] |= 1 << (gap % 64);
            set
        })
    }
}

// Closed contacts, and the mode of each friction channel.

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
    /// The compliant gaps that are in contact: a law gives their forces. They are in no other set.
    pub pressed: GapSet,
    /// The compliant gaps below zero whose law would be tensile: their force is zero.
    pub unloaded: GapSet,
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

    /// Whether there is friction in no channel, and a force or depth at no compliant gap.
    pub(crate) fn is_plain(&self) -> bool {
        self.is_frictionless() && self.pressed.with(self.unloaded).is_empty()
    }

    /// Whether a compliant gap is below zero.
    pub(crate) fn is_deep(&self, gap: usize) -> bool {
        self.pressed.has(gap) || self.unloaded.has(gap)
    }

    /// The gaps in contact: rigid ones that are closed, and compliant ones that are pressed.
    #[must_use]
    pub fn in_contact(&self) -> GapSet {
        self.closed.with(self.pressed)
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

    /// Mode of a channel as a number: 1 and -1 slip, 0 stick, 2 open gap.
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
            slip_plus: self.slip_plus.without(one),
            slip_minus: self.slip_minus.without(one),
            stick: self.stick.without(one),
            ..self
        }
    }
}

#[cfg(test)]
mod gap_set_tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn it_is_a_set() {
        let mut seed = 1_u64;
        let mut draw = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (seed >> 33) as usize % GapSet::MOST
        };
        for size in [0, 1, 3, 60, 200] {
            let (a, b): (BTreeSet<_>, BTreeSet<_>) = (0..size).map(|_| (draw(), draw())).unzip();
            let set = |of: &BTreeSet<usize>| of.iter().copied().collect::<GapSet>();
            let back = |of: GapSet| of.iter().collect::<BTreeSet<_>>();
            let (x, y) = (set(&a), set(&b));
            assert_eq!(back(x), a);
            assert!(x.iter().is_sorted());
            assert_eq!((x.len(), x.is_empty()), (a.len(), a.is_empty()));
            assert_eq!(x.only(), a.first().copied().filter(|_| a.len() == 1));
            assert_eq!(back(x.with(y)), &a | &b);
            assert_eq!(back(x.without(y)), &a - &b);
            assert!((0..GapSet::MOST).all(|gap| x.has(gap) == a.contains(&gap)));
            assert!(a.iter().all(|&gap| back(GapSet::of(gap)).iter().eq([&gap])));
            let halves: Vec<u32> = x.halves(GapSet::MOST).map(|half| half as u32).collect();
            assert_eq!(GapSet::of_halves(&halves), x);
        }
        assert!(GapSet::of_bits(5).iter().eq([0, 2]));
    }
}

#[cfg(test)]
mod contact_mode_tests {
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
