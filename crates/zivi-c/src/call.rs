//! Common parts of the functions of the header: pointers, the control that is held, periods of
//! another length.

use zivi_core::{Physical, Real};

use crate::code::Sealed;
use crate::code::{Code, ZIVI_E_DT, ZIVI_E_NULL, ZIVI_E_STATE};
use crate::{GivenReference, Regulator, Tracker};

/// The object, unless the pointer is NULL or not aligned.
pub(crate) unsafe fn object<'a, T>(pointer: *mut T) -> Option<&'a mut T> {
    // SAFETY: by contract it points to an object
    if pointer.is_aligned() {
        unsafe { pointer.as_mut() }
    } else {
        None
    }
}

/// Runs one control update and returns the control that is held afterwards.
#[inline(always)]
pub(crate) unsafe fn ticked<T: Control>(
    it: *mut T,
    u: *mut Real,
    tick: impl FnOnce(&mut T) -> i32,
) -> i32 {
    if u.is_null() || !u.is_aligned() {
        return ZIVI_E_NULL;
    }
    // SAFETY: see `exports`
    let Some(it) = (unsafe { object(it) }) else { return ZIVI_E_NULL };
    let code = tick(it);
    let control = it.control();
    if code != ZIVI_E_STATE {
        // SAFETY: see `exports`; `it` is not used any longer, `u` may point into it
        unsafe { u.write(control) };
    }
    code
}

/// Object that holds a control.
pub(crate) trait Control {
    fn control(&self) -> Real;
}

impl Control for Regulator {
    fn control(&self) -> Real {
        self.u
    }
}

impl Control for Tracker {
    fn control(&self) -> Real {
        self.u
    }
}

/// A control update of a tracker, shared by all calls.
#[inline(never)]
pub(crate) unsafe fn tracked(
    tracker: *mut Tracker,
    (x, xdot): (Real, Real),
    force: Real,
    drive: Real,
    given: Option<(&GivenReference, &GivenReference)>,
    u: *mut Real,
) -> i32 {
    // SAFETY: see `exports`
    unsafe { ticked(tracker, u, |it| it.tick(Physical { x, xdot }, force, drive, given)) }
}

/// Object with a sampling period.
pub(crate) trait Sampled: Sealed {
    fn sampling(&mut self) -> (&mut Real, &mut u64);
}

impl Sampled for Tracker {
    fn sampling(&mut self) -> (&mut Real, &mut u64) {
        (&mut self.h, &mut self.seal)
    }
}

impl Sampled for Regulator {
    fn sampling(&mut self) -> (&mut Real, &mut u64) {
        (&mut self.h, &mut self.seal)
    }
}

/// A control update with the period `dt` in place of `h`, by the code of all other updates.
pub(crate) fn lasting<T: Sampled>(it: &mut T, dt: Real, tick: impl FnOnce(&mut T) -> Code) -> Code {
    if let Err(code) = it.intact() {
        return code;
    }
    if !(dt > 0.0 && dt <= Real::MAX) {
        return ZIVI_E_DT;
    }
    let (h, seal) = it.sampling();
    let before = (*h, *seal);
    *h = dt;
    let other = it.seal_of_settings();
    *it.sampling().1 = other;
    let code = tick(it);
    let (h, seal) = it.sampling();
    (*h, *seal) = before;
    code
}
