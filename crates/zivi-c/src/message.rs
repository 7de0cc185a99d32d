//! Codes in words.

use crate::code::*;

/// The words, each ended by a zero: one constant, so that nothing has to be relocated.
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

/// Position of the words of a code.
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

/// What a code means, in one line of English that ends with a zero.
#[must_use]
pub fn message(code: Code) -> &'static core::ffi::CStr {
    let mut rest = WORDS.as_bytes();
    let mut ahead = place(code);
    // one pass over the words
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
