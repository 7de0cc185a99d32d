//! Codes of calls: 0, bits that report a change, or a negative number for an invalid argument.

use zivi_core::control::{GainError, TickStatus};
use zivi_core::{RestitutionError, SettingError};

/// Code that a call returns.
pub type Code = i32;

/// Done; nothing to report.
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

/// The bits of a tick.
pub(crate) fn of_status(status: TickStatus) -> Code {
    Code::from(status.bits())
}
