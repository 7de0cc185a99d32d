//! The seal of an object: a checksum of its settings, which are checked once, when it is
//! initialised. A call computes it again and rejects an object whose settings have changed since;
//! that costs a few instructions a setting, where checking them all would cost hundreds.

use crate::code::{Code, ZIVI_E_STATE};

/// A word of as many bytes as a number.
#[cfg(not(feature = "single"))]
pub(crate) type Word = u64;
/// A word of as many bytes as a number.
#[cfg(feature = "single")]
pub(crate) type Word = u32;

/// A structure of plain numbers that starts with its settings.
///
/// # Safety
/// The structure is `repr(C)` and aligned like a [`Word`], and its first `SETTINGS` words have no
/// padding.
pub(crate) unsafe trait Sealed: Sized {
    /// Words that the settings take.
    const SETTINGS: usize;
    /// What an object of this kind starts from: another one has another seal.
    const KIND: u64;

    /// The seal that was written when the object was initialised.
    fn seal(&self) -> u64;

    /// The seal that belongs to the settings. (Once for a kind, and as short for its callers as it can
    /// be: every call asks for it.)
    #[inline(never)]
    fn seal_of_settings(&self) -> u64 {
        // SAFETY: so many words of plain numbers, see the trait
        let words = unsafe {
            core::slice::from_raw_parts(core::ptr::from_ref(self).cast::<Word>(), Self::SETTINGS)
        };
        checksum(Self::KIND, words)
    }

    /// Rejects an object that was not initialised, or whose settings have changed since.
    #[inline]
    fn intact(&self) -> Result<(), Code> {
        if self.seal() == self.seal_of_settings() {
            Ok(())
        } else {
            Err(ZIVI_E_STATE)
        }
    }
}

/// Two words at a time. Every step is one-to-one in the sum and in each word (the factor is odd): a
/// change of one word always shows.
#[inline(always)]
fn checksum(start: u64, words: &[Word]) -> u64 {
    const FACTOR: u64 = 0x9e37_79b9_7f4a_7c15; // 2^64 over the golden ratio
    let mixed = |sum: u64, a: Word, b: Word| {
        #[allow(clippy::unnecessary_cast, reason = "a word may have 4 bytes")]
        let (a, b) = (a as u64, b as u64);
        (sum ^ a).rotate_left(29).wrapping_add(b).wrapping_mul(FACTOR).rotate_left(32)
    };
    let (fours, rest) = words.as_chunks::<4>();
    let (twos, rest) = rest.as_chunks::<2>();
    let sum = fours.iter().fold(start, |sum, [a, b, c, d]| mixed(mixed(sum, *a, *b), *c, *d));
    let sum = twos.iter().fold(sum, |sum, [a, b]| mixed(sum, *a, *b));
    rest.iter().fold(sum, |sum, a| mixed(sum, *a, 0))
}

#[cfg(test)]
mod tests {
    use crate::{
        code, Mass, MassConfig, Observer, ObserverConfig, Regulator, RegulatorConfig, Tracker,
        TrackerConfig,
    };

    /// Every bit of the settings and of the seal counts, and a rejected call changes nothing.
    macro_rules! every_bit {
        ($kind:ty, $config:expr, $settings:expr, $step:expr) => {
            let mut fresh = <$kind>::default();
            assert_eq!(fresh.init(&$config), code::ZIVI_OK);
            let seal = core::mem::offset_of!($kind, seal);
            for byte in (0..$settings).chain(seal..seal + 8) {
                for bit in 0..8 {
                    let mut damaged = fresh;
                    // SAFETY: a byte of a structure of plain numbers
                    unsafe {
                        let place = core::ptr::from_mut(&mut damaged).cast::<u8>().add(byte);
                        place.write(place.read() ^ (1 << bit));
                    }
                    let mut it = damaged;
                    assert_eq!($step(&mut it), code::ZIVI_E_STATE, "{byte} {bit}");
                    assert_eq!(bytes(&it), bytes(&damaged));
                    assert_eq!(reset(&mut it), code::ZIVI_E_STATE, "{byte} {bit}");
                }
            }
        };
    }

    fn bytes<T>(it: &T) -> &[u8] {
        // SAFETY: a structure of plain numbers without padding
        unsafe { core::slice::from_raw_parts(core::ptr::from_ref(it).cast::<u8>(), size_of::<T>()) }
    }

    trait Reset {
        fn again(&mut self) -> i32;
    }

    fn reset(it: &mut impl Reset) -> i32 {
        it.again()
    }

    impl Reset for Mass {
        fn again(&mut self) -> i32 {
            self.reset(1.0, 0.0)
        }
    }
    impl Reset for Regulator {
        fn again(&mut self) -> i32 {
            self.reset()
        }
    }
    impl Reset for Tracker {
        fn again(&mut self) -> i32 {
            self.reset(1.0, 0.0)
        }
    }
    impl Reset for Observer {
        fn again(&mut self) -> i32 {
            self.reset()
        }
    }

    #[test]
    fn an_object_with_any_bit_of_its_settings_changed_is_refused() {
        let mass = MassConfig { h: 1e-3, e: 0.5, ..MassConfig::defaults() };
        every_bit!(Mass, mass, 24, |it: &mut Mass| it.step(0.0));
        let regulator =
            RegulatorConfig { mu1: 3.0, mu2: 2.0, h: 1e-3, e: 0.5, ..RegulatorConfig::defaults() };
        every_bit!(Regulator, regulator, 72, |it: &mut Regulator| it.step(1.0, 0.0, 0.0));
        let tracker =
            TrackerConfig { mu1: 3.0, mu2: 2.0, h: 1e-3, e: 0.5, ..TrackerConfig::defaults() };
        every_bit!(Tracker, tracker, 112, |it: &mut Tracker| it.step(1.0, 0.0, 0.0, 0.0));
        let observer = ObserverConfig { h: 1e-3, e: 0.5, ..ObserverConfig::defaults() };
        every_bit!(Observer, observer, 88, |it: &mut Observer| it.step(1.0, 0.0, 0.0, 0.0));
    }
}
