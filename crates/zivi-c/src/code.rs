//! Codes of calls: 0, bits that report a change, or a negative number for an invalid argument.

use zivi_core::control::{GainError, TickStatus};
use zivi_core::{RestitutionError, SettingError};

/// Code that a call returns.
pub type Code = i32;

/// Success.
pub const ZIVI_OK: i32 = 0;
/// Bit: the measured position was slightly negative and was taken as 0.
pub const ZIVI_CLAMPED: i32 = 1;
/// Bit: the control was cut to the actuator's range.
pub const ZIVI_SATURATED: i32 = 2;

/// A pointer is NULL or not aligned.
pub const ZIVI_E_NULL: i32 = -1;
/// The member `size` of a configuration is not the size of any version of it.
pub const ZIVI_E_SIZE: i32 = -2;
/// The object was not initialised, or its settings were changed since, or it is damaged.
pub const ZIVI_E_STATE: i32 = -3;
/// The state or the force is too large to compute with.
pub const ZIVI_E_OVERFLOW: i32 = -4;
/// No solution of a step was found within rounding.
pub const ZIVI_E_NO_SOLUTION: i32 = -5;

/// `h` is not a finite period > 0.
pub const ZIVI_E_H: i32 = -10;
/// `e` is not in (0, 1].
pub const ZIVI_E_E: i32 = -11;
/// `kappa` is not in [0, 1), or `e` and `kappa` do not belong together.
pub const ZIVI_E_KAPPA: i32 = -12;
/// `e_ref` is not in (0, 1].
pub const ZIVI_E_E_REF: i32 = -13;
/// `kappa_ref` is not in [0, 1), or `e_ref` and `kappa_ref` do not belong together.
pub const ZIVI_E_KAPPA_REF: i32 = -14;
/// `mu1` is not a gain > 0, or too small for `bound`.
pub const ZIVI_E_MU1: i32 = -15;
/// `mu2` is not a gain with 0 < mu2 < mu1, or too small for `bound`.
pub const ZIVI_E_MU2: i32 = -16;
/// `bound` is not finite and >= 0.
pub const ZIVI_E_BOUND: i32 = -17;
/// `depth` is not finite and >= 0.
pub const ZIVI_E_DEPTH: i32 = -18;
/// `u_min` is not a number.
pub const ZIVI_E_U_MIN: i32 = -19;
/// `u_max` is not greater than `u_min`.
pub const ZIVI_E_U_MAX: i32 = -20;
/// `ahead` is too large (`ahead h` is not finite), or given for `ZIVI_TICK_PAPER`.
pub const ZIVI_E_AHEAD: i32 = -21;
/// `branch` is neither `ZIVI_BRANCH_POSITIVE` nor `ZIVI_BRANCH_NEAREST`.
pub const ZIVI_E_BRANCH: i32 = -22;
/// `tick` is neither `ZIVI_TICK_LANDING` nor `ZIVI_TICK_PAPER`.
pub const ZIVI_E_TICK: i32 = -23;
/// `press` is not finite and at least `bound`, or given for `ZIVI_TICK_PAPER`.
pub const ZIVI_E_PRESS: i32 = -24;
/// `horizon` is not a finite number of periods >= 1, or `horizon h` is not finite.
pub const ZIVI_E_HORIZON: i32 = -25;
/// `shift` is neither 0 nor 1.
pub const ZIVI_E_SHIFT: i32 = -26;
/// `noise_x` or `noise_xdot` is not a standard deviation that can be computed with.
pub const ZIVI_E_NOISE: i32 = -27;
/// `q_d` is not a finite variance >= 0.
pub const ZIVI_E_Q_D: i32 = -28;
/// `se` is not in [0, 1].
pub const ZIVI_E_SE: i32 = -29;

/// `x` is not finite, or less than `-depth`.
pub const ZIVI_E_X: i32 = -30;
/// `xdot` is not finite.
pub const ZIVI_E_XDOT: i32 = -31;
/// `force` is not finite.
pub const ZIVI_E_FORCE: i32 = -32;
/// `force_ref` is not finite, or too large for the reference to stay finite.
pub const ZIVI_E_FORCE_REF: i32 = -33;
/// The control is not finite: the sample is too large to compute with.
pub const ZIVI_E_U: i32 = -34;
/// `x_ref` is not finite and >= 0.
pub const ZIVI_E_X_REF: i32 = -35;
/// `xdot_ref` is not finite.
pub const ZIVI_E_XDOT_REF: i32 = -36;
/// `acceleration` of the reference is infinite.
pub const ZIVI_E_ACCELERATION: i32 = -37;
/// `side` of a given reference is neither +1 nor -1.
pub const ZIVI_E_SIDE: i32 = -38;
/// `dmax` is not a bound from 0 to 1e150.
pub const ZIVI_E_DMAX: i32 = -39;
/// `position_only` is neither 0 nor 1.
pub const ZIVI_E_POSITION_ONLY: i32 = -40;
/// `learn_e` is neither 0 nor 1.
pub const ZIVI_E_LEARN_E: i32 = -41;
/// `q_e` is not in [0, 1].
pub const ZIVI_E_Q_E: i32 = -42;
/// `dt` is not a finite time > 0.
pub const ZIVI_E_DT: i32 = -43;
/// `quiet` is not finite and >= 0, or given for `ZIVI_TICK_PAPER`.
pub const ZIVI_E_QUIET: i32 = -44;
/// `given` has a bit of a member that the configuration does not have.
pub const ZIVI_E_GIVEN: i32 = -45;
/// `delay` is more than 64 periods.
pub const ZIVI_E_DELAY: i32 = -46;

/// A setting without a code of its own.
pub const ZIVI_E_SETTING: i32 = -99;

/// Names of settings, filled up with zeros, and their codes. No pointers: those would be memory that
/// a program has to initialise.
const NAMES: [([u8; LONGEST], i8); 29] = [
    named("h", ZIVI_E_H),
    named("e", ZIVI_E_E),
    named("kappa", ZIVI_E_KAPPA),
    named("e_ref", ZIVI_E_E_REF),
    named("kappa_ref", ZIVI_E_KAPPA_REF),
    named("mu1", ZIVI_E_MU1),
    named("mu2", ZIVI_E_MU2),
    named("bound", ZIVI_E_BOUND),
    named("depth", ZIVI_E_DEPTH),
    named("u_min", ZIVI_E_U_MIN),
    named("u_max", ZIVI_E_U_MAX),
    named("ahead", ZIVI_E_AHEAD),
    named("press", ZIVI_E_PRESS),
    named("quiet", ZIVI_E_QUIET),
    named("horizon", ZIVI_E_HORIZON),
    named("x", ZIVI_E_X),
    named("xdot", ZIVI_E_XDOT),
    named("force", ZIVI_E_FORCE),
    named("force_ref", ZIVI_E_FORCE_REF),
    named("u", ZIVI_E_U),
    named("x_ref", ZIVI_E_X_REF),
    named("xdot_ref", ZIVI_E_XDOT_REF),
    named("acceleration", ZIVI_E_ACCELERATION),
    named("noise", ZIVI_E_NOISE),
    named("q_d", ZIVI_E_Q_D),
    named("se", ZIVI_E_SE),
    named("dmax", ZIVI_E_DMAX),
    named("q_e", ZIVI_E_Q_E),
    named("dt", ZIVI_E_DT),
];

/// Length of the longest name.
const LONGEST: usize = "acceleration".len();

#[allow(clippy::indexing_slicing, reason = "a constant")]
const fn named(name: &str, code: Code) -> ([u8; LONGEST], i8) {
    let mut filled = [0; LONGEST];
    let mut k = 0;
    while k < name.len() {
        filled[k] = name.as_bytes()[k];
        k += 1;
    }
    (filled, code as i8)
}

/// The code of the setting with this name.
#[cold]
#[inline(never)]
#[must_use]
pub fn of_setting(name: &str) -> Code {
    for (known, code) in &NAMES {
        let mut same = true;
        let mut rest = name.bytes();
        for byte in known {
            same &= rest.next().unwrap_or(0) == *byte;
        }
        if same {
            return Code::from(*code);
        }
    }
    ZIVI_E_SETTING
}

pub(crate) fn of(error: SettingError) -> Code {
    of_setting(error.name)
}

pub(crate) fn of_gain(error: GainError) -> Code {
    of_setting(error.name())
}

pub(crate) fn of_restitution(error: RestitutionError) -> Code {
    of_setting(error.name)
}

/// Code of an invalid setting or sample.
pub(crate) struct Refusal(pub(crate) Code);

impl From<SettingError> for Refusal {
    fn from(error: SettingError) -> Self {
        Refusal(of(error))
    }
}

/// The bits of a control update.
pub(crate) fn of_status(status: TickStatus) -> Code {
    Code::from(status.bits())
}

// Texts of codes.

/// The texts, each ended by a zero: one constant, which needs no relocation.
const WORDS: &str = "ok\0\
clamped: the measured position was slightly negative and was taken as 0\0\
saturated: the control was cut to the actuator's range\0\
clamped and saturated\0\
a pointer is NULL or not aligned\0\
size of the configuration: not one of this library\0\
the object was not initialised, or is damaged\0\
the state or the force is too large to compute with\0\
no solution of the step was found within rounding\0\
h must be a finite period > 0\0\
e must be in (0, 1]\0\
kappa must be in [0, 1), and belong to e if both are given\0\
e_ref must be in (0, 1]\0\
kappa_ref must be in [0, 1), and belong to e_ref if both are given\0\
mu1 must be a gain > 0, large enough for bound\0\
mu2 must be a gain with 0 < mu2 < mu1, large enough for bound\0\
bound must be finite and >= 0\0\
depth must be finite and >= 0\0\
u_min must be a number\0\
u_max must be greater than u_min\0\
ahead is too large, or given for ZIVI_TICK_PAPER\0\
branch must be ZIVI_BRANCH_POSITIVE or ZIVI_BRANCH_NEAREST\0\
tick must be ZIVI_TICK_LANDING or ZIVI_TICK_PAPER\0\
press must be finite and at least bound, and is not of ZIVI_TICK_PAPER\0\
horizon must be a finite number of periods >= 1\0\
shift must be 0 or 1\0\
noise_x and noise_xdot must be standard deviations > 0\0\
q_d must be a finite variance >= 0\0\
se must be in [0, 1]\0\
x must be finite and at most depth behind the wall\0\
xdot must be finite\0\
force must be finite\0\
force_ref must be finite, and the reference stay so\0\
the control is not finite: the sample is too large to compute with\0\
x_ref must be finite and >= 0\0\
xdot_ref must be finite\0\
acceleration must be finite, or NaN if it is not known\0\
side must be +1 or -1\0\
dmax must be a bound from 0 to 1e150, in single precision to 1e18\0\
position_only must be 0 or 1\0\
learn_e must be 0 or 1\0\
q_e must be in [0, 1]\0\
dt must be a finite time > 0\0\
quiet must be finite and >= 0, and is not of ZIVI_TICK_PAPER\0\
given must have bits of members of the configuration only\0\
delay must be at most 64 periods\0\
a setting is out of range\0\
not a code of this library\0";

/// Position of the text of a code.
fn place(code: Code) -> u32 {
    let distance = code.unsigned_abs();
    match code {
        0..=3 => distance,
        ZIVI_E_NO_SOLUTION..=ZIVI_E_NULL => 3 + distance,
        ZIVI_E_DELAY..=ZIVI_E_H => distance - 1,
        ZIVI_E_SETTING => 46,
        _ => 47,
    }
}

/// Meaning of a code: one line of English that ends with a zero.
#[must_use]
pub fn message(code: Code) -> &'static core::ffi::CStr {
    let mut rest = WORDS.as_bytes();
    let mut ahead = place(code);
    // one pass over the texts
    for _ in 0..WORDS.len() {
        if ahead == 0 {
            break;
        }
        let Some((first, more)) = rest.split_first() else { break };
        ahead -= u32::from(*first == 0);
        rest = more;
    }
    core::ffi::CStr::from_bytes_until_nul(rest).unwrap_or_default()
}

// The seal of an object: a checksum of its settings, which are checked once, when it is
// initialised. A call computes it again and rejects an object whose settings have changed since;
// that costs a few instructions a setting, where checking them all would cost hundreds.

/// An integer with the width of a number.
#[cfg(not(feature = "single"))]
pub(crate) type Word = u64;
/// An integer with the width of a number.
#[cfg(feature = "single")]
pub(crate) type Word = u32;

/// A structure of plain numbers that starts with its settings.
///
/// # Safety
/// The structure is `repr(C)` and aligned like a [`Word`], and its first `SETTINGS` words are free of
/// padding.
pub(crate) unsafe trait Sealed: Sized {
    /// Length of the settings in words.
    const SETTINGS: usize;
    /// Initial value of the checksum: it differs between kinds of objects.
    const KIND: u64;

    /// The seal that was written when the object was initialised.
    fn seal(&self) -> u64;

    /// The seal that belongs to the settings. (Not inlined and small for its callers:
    /// every call computes it.)
    #[inline(never)]
    fn seal_of_settings(&self) -> u64 {
        // SAFETY: `SETTINGS` words of plain numbers, see the trait
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

    /// Each bit of the settings and of the seal is checked; a rejected call leaves the object unchanged.
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
