//! The functions of `include/zivi.h`. Their comments are those of the header.
//!
//! No function keeps a pointer, so an object may lie and move anywhere between two calls; two
//! objects never influence each other. A pointer that is not NULL must point to an object of its
//! type.

#![allow(clippy::missing_safety_doc, reason = "the comments are for C, see above")]
#![cfg_attr(
    feature = "single",
    allow(unused_attributes, reason = "`export_name` counts, not `no_mangle`")
)]

use core::ffi::{c_char, CStr};
use zivi_core::Real;

use zivi_core::observer::Measurement;

use crate::call::{lasting, object, ticked, tracked};
use crate::code::Sealed;
use crate::code::{ZIVI_E_NULL, ZIVI_OK};
use crate::{
    GivenReference, Mass, MassConfig, Observer, ObserverConfig, Predictor, PredictorConfig,
    Regulator, RegulatorConfig, Tracker, TrackerConfig, ZIVI_ABI_VERSION,
};

const VERSION: &CStr =
    match CStr::from_bytes_with_nul(concat!(env!("CARGO_PKG_VERSION"), "\0").as_bytes()) {
        Ok(version) => version,
        Err(_) => c"",
    };

unsafe fn constant<'a, T>(pointer: *const T) -> Option<&'a T> {
    // SAFETY: as above
    if pointer.is_aligned() {
        unsafe { pointer.as_ref() }
    } else {
        None
    }
}

/// `ZIVI_ABI_VERSION` of the library: compare it with that of the header.
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_abi_version")]
pub extern "C" fn zivi_abi_version() -> u32 {
    ZIVI_ABI_VERSION
}

/// The version of zivi, for instance "0.2.0".
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_version")]
pub extern "C" fn zivi_version() -> *const c_char {
    VERSION.as_ptr()
}

/// Meaning of a code, one line of English.
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_message")]
pub extern "C" fn zivi_message(code: i32) -> *const c_char {
    crate::message(code).as_ptr()
}

/// `sizeof(zivi_mass)` in the library.
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_mass_size")]
pub extern "C" fn zivi_mass_size() -> u32 {
    size_of::<Mass>() as u32
}

/// Sets `size`, and all other members to their default, 0. You set the members without a default:
/// gains, period, wall.
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_mass_defaults")]
pub unsafe extern "C" fn zivi_mass_defaults(config: *mut MassConfig) -> i32 {
    // SAFETY: see the module
    let Some(config) = (unsafe { object(config) }) else { return ZIVI_E_NULL };
    *config = MassConfig::defaults();
    ZIVI_OK
}

/// Checks the settings and starts at rest on the wall. If the returned code is < 0, nothing is
/// written.
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_mass_init")]
pub unsafe extern "C" fn zivi_mass_init(mass: *mut Mass, config: *const MassConfig) -> i32 {
    // SAFETY: see the module
    match unsafe { (object(mass), constant(config)) } {
        (Some(it), Some(config)) => it.init(config),
        _ => ZIVI_E_NULL,
    }
}

/// Puts the mass at `x` >= 0 (m) with velocity `xdot` (m/s).
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_mass_reset")]
pub unsafe extern "C" fn zivi_mass_reset(mass: *mut Mass, x: Real, xdot: Real) -> i32 {
    // SAFETY: see the module
    unsafe { object(mass) }.map_or(ZIVI_E_NULL, |it| it.reset(x, xdot))
}

/// Moves the mass by one step `h` under `force` per unit mass (m/s^2). The new state is
/// `mass->x` (m) and `mass->xdot` (m/s), exactly 0 at rest.
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_mass_step")]
pub unsafe extern "C" fn zivi_mass_step(mass: *mut Mass, force: Real) -> i32 {
    // SAFETY: see the module
    unsafe { object(mass) }.map_or(ZIVI_E_NULL, |it| it.step(force))
}

/// `sizeof(zivi_regulator)` in the library.
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_regulator_size")]
pub extern "C" fn zivi_regulator_size() -> u32 {
    size_of::<Regulator>() as u32
}

/// Sets `size`, and all other members to their default, 0. You set the members without a default:
/// gains, period, wall.
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_regulator_defaults")]
pub unsafe extern "C" fn zivi_regulator_defaults(config: *mut RegulatorConfig) -> i32 {
    // SAFETY: see the module
    let Some(config) = (unsafe { object(config) }) else { return ZIVI_E_NULL };
    *config = RegulatorConfig::defaults();
    ZIVI_OK
}

/// Checks the settings. If the returned code is < 0, nothing is written.
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_regulator_init")]
pub unsafe extern "C" fn zivi_regulator_init(
    regulator: *mut Regulator,
    config: *const RegulatorConfig,
) -> i32 {
    // SAFETY: see the module
    match unsafe { (object(regulator), constant(config)) } {
        (Some(it), Some(config)) => it.init(config),
        _ => ZIVI_E_NULL,
    }
}

/// Forgets the last update.
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_regulator_reset")]
pub unsafe extern "C" fn zivi_regulator_reset(regulator: *mut Regulator) -> i32 {
    // SAFETY: see the module
    unsafe { object(regulator) }.map_or(ZIVI_E_NULL, Regulator::reset)
}

/// The control for the period that starts with the measurement `x` (m), `xdot` (m/s): `*u`
/// (m/s^2), to be held for one period. `force` acts on the mass without control (m/s^2).
///
/// If a sample is invalid, the returned code is < 0, `*u` is the last control, and nothing else
/// is written.
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_regulator_step")]
pub unsafe extern "C" fn zivi_regulator_step(
    regulator: *mut Regulator,
    x: Real,
    xdot: Real,
    force: Real,
    u: *mut Real,
) -> i32 {
    // SAFETY: see the module
    unsafe { ticked(regulator, u, |it| it.step(x, xdot, force)) }
}

/// `zivi_regulator_step` for a period of the length `dt` > 0 (s) instead of `h`. For a missing sample
/// pass NaN as `x`: `*u` is then the last control, `xdot` and `force` are ignored.
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_regulator_step_over")]
pub unsafe extern "C" fn zivi_regulator_step_over(
    regulator: *mut Regulator,
    dt: Real,
    x: Real,
    xdot: Real,
    force: Real,
    u: *mut Real,
) -> i32 {
    // SAFETY: see the module
    unsafe {
        ticked(regulator, u, |it| {
            lasting(it, dt, |it| if x.is_nan() { it.miss() } else { it.step(x, xdot, force) })
        })
    }
}

/// `sizeof(zivi_tracker)` in the library.
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_tracker_size")]
pub extern "C" fn zivi_tracker_size() -> u32 {
    size_of::<Tracker>() as u32
}

/// Sets `size`, `horizon` to 1, and all other members to their default, 0. You set the members without
/// a default: gains, period, wall.
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_tracker_defaults")]
pub unsafe extern "C" fn zivi_tracker_defaults(config: *mut TrackerConfig) -> i32 {
    // SAFETY: see the module
    let Some(config) = (unsafe { object(config) }) else { return ZIVI_E_NULL };
    *config = TrackerConfig::defaults();
    ZIVI_OK
}

/// Checks the settings; the reference starts at rest. If the returned code is < 0, nothing is
/// written.
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_tracker_init")]
pub unsafe extern "C" fn zivi_tracker_init(
    tracker: *mut Tracker,
    config: *const TrackerConfig,
) -> i32 {
    // SAFETY: see the module
    match unsafe { (object(tracker), constant(config)) } {
        (Some(it), Some(config)) => it.init(config),
        _ => ZIVI_E_NULL,
    }
}

/// Puts the reference at `x_ref` >= 0 (m) with velocity `xdot_ref` (m/s) and forgets the last update.
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_tracker_reset")]
pub unsafe extern "C" fn zivi_tracker_reset(
    tracker: *mut Tracker,
    x_ref: Real,
    xdot_ref: Real,
) -> i32 {
    // SAFETY: see the module
    unsafe { object(tracker) }.map_or(ZIVI_E_NULL, |it| it.reset(x_ref, xdot_ref))
}

/// The control for the period that starts with the measurement `x` (m), `xdot` (m/s): `*u`
/// (m/s^2), to be held for one period. `force` acts on the mass without control, `force_ref` on
/// the reference (m/s^2), which advances by one period: `tracker->x_ref` is that at the next sample.
///
/// If a sample is invalid, the returned code is < 0, `*u` is the last control, and nothing else
/// is written: the reference has not advanced.
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_tracker_step")]
pub unsafe extern "C" fn zivi_tracker_step(
    tracker: *mut Tracker,
    x: Real,
    xdot: Real,
    force: Real,
    force_ref: Real,
    u: *mut Real,
) -> i32 {
    // SAFETY: see the module
    unsafe { tracked(tracker, (x, xdot), force, force_ref, None, u) }
}

/// `zivi_tracker_step` for a given reference, at this sample (`now`) and at the next one (`next`).
/// `acceleration` is that of the reference over the period (m/s^2). If it is NaN, the difference quotient
/// of the velocities replaces it, or `force` if the reference has an impact in the period.
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_tracker_step_to")]
pub unsafe extern "C" fn zivi_tracker_step_to(
    tracker: *mut Tracker,
    x: Real,
    xdot: Real,
    force: Real,
    now: *const GivenReference,
    next: *const GivenReference,
    acceleration: Real,
    u: *mut Real,
) -> i32 {
    // SAFETY: see the module
    let (Some(now), Some(next)) = (unsafe { (constant(now), constant(next)) }) else {
        // SAFETY: see the module
        return unsafe { ticked(tracker, u, |it| it.intact().err().unwrap_or(ZIVI_E_NULL)) };
    };
    // SAFETY: see the module
    unsafe { tracked(tracker, (x, xdot), force, acceleration, Some((now, next)), u) }
}

/// `zivi_tracker_step` for a period of the length `dt` > 0 (s) instead of `h`: the reference advances by
/// `dt`; `horizon` and `ahead` count periods of this length. For a missing sample pass NaN as `x`: `*u` is
/// then the last control, the reference advances, `xdot` and `force` are
/// ignored.
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_tracker_step_over")]
pub unsafe extern "C" fn zivi_tracker_step_over(
    tracker: *mut Tracker,
    dt: Real,
    x: Real,
    xdot: Real,
    force: Real,
    force_ref: Real,
    u: *mut Real,
) -> i32 {
    let mut held = 0.0; // `u` may point into the tracker
                        // SAFETY: see the module
    unsafe {
        ticked(tracker, u, |it| {
            lasting(it, dt, |it| match x.is_nan() {
                true => it.miss(force_ref, None),
                false => tracked(it, (x, xdot), force, force_ref, None, &mut held),
            })
        })
    }
}

/// `zivi_tracker_step_to` for a period of `dt` > 0 (s), or without a sample, in the same way.
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_tracker_step_to_over")]
pub unsafe extern "C" fn zivi_tracker_step_to_over(
    tracker: *mut Tracker,
    dt: Real,
    x: Real,
    xdot: Real,
    force: Real,
    now: *const GivenReference,
    next: *const GivenReference,
    acceleration: Real,
    u: *mut Real,
) -> i32 {
    // SAFETY: see the module
    let (Some(now), Some(next)) = (unsafe { (constant(now), constant(next)) }) else {
        // SAFETY: see the module
        return unsafe { ticked(tracker, u, |it| it.intact().err().unwrap_or(ZIVI_E_NULL)) };
    };
    let mut held = 0.0;
    // SAFETY: see the module
    unsafe {
        ticked(tracker, u, |it| {
            lasting(it, dt, |it| match x.is_nan() {
                true => it.miss(0.0, Some(next)),
                false => tracked(it, (x, xdot), force, acceleration, Some((now, next)), &mut held),
            })
        })
    }
}

/// `sizeof(zivi_observer)` in the library.
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_observer_size")]
pub extern "C" fn zivi_observer_size() -> u32 {
    size_of::<Observer>() as u32
}

/// Sets `size`, and all other members to their default, 0. You set the members without a default:
/// period, wall.
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_observer_defaults")]
pub unsafe extern "C" fn zivi_observer_defaults(config: *mut ObserverConfig) -> i32 {
    // SAFETY: see the module
    let Some(config) = (unsafe { object(config) }) else { return ZIVI_E_NULL };
    *config = ObserverConfig::defaults();
    ZIVI_OK
}

/// Checks the settings and forgets all measurements. If the returned code is < 0, nothing is written.
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_observer_init")]
pub unsafe extern "C" fn zivi_observer_init(
    observer: *mut Observer,
    config: *const ObserverConfig,
) -> i32 {
    // SAFETY: see the module
    match unsafe { (object(observer), constant(config)) } {
        (Some(it), Some(config)) => it.init(config),
        _ => ZIVI_E_NULL,
    }
}

/// Forgets all measurements.
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_observer_reset")]
pub unsafe extern "C" fn zivi_observer_reset(observer: *mut Observer) -> i32 {
    // SAFETY: see the module
    unsafe { object(observer) }.map_or(ZIVI_E_NULL, Observer::reset)
}

/// Updates the estimates with the measurement `x` (m), `xdot` (m/s, NaN if not measured). `force` is the
/// known force, `u` the control that acted over the period that ends now (m/s^2). The estimates are
/// `observer->x` (m), `->xdot` (m/s) and `->d`, the unknown force (m/s^2); they are valid from
/// `observer->started` on. For a missing measurement pass NaN as `x`: the estimates are predicted and
/// not corrected, `xdot` is ignored.
///
/// If the returned code is < 0, the measurement is invalid and nothing has changed.
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_observer_step")]
pub unsafe extern "C" fn zivi_observer_step(
    observer: *mut Observer,
    x: Real,
    xdot: Real,
    force: Real,
    u: Real,
) -> i32 {
    // SAFETY: see the module
    unsafe { object(observer) }.map_or(ZIVI_E_NULL, |it| it.step(x, xdot, force, u))
}

/// `zivi_observer_step` if `dt` (s) passed since the last call, instead of `h`.
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_observer_step_after")]
pub unsafe extern "C" fn zivi_observer_step_after(
    observer: *mut Observer,
    dt: Real,
    x: Real,
    xdot: Real,
    force: Real,
    u: Real,
) -> i32 {
    let measured = Measurement { x, xdot: Some(xdot) };
    // SAFETY: see the module
    unsafe { object(observer) }.map_or(ZIVI_E_NULL, |it| it.step_after(dt, measured, force, u))
}

/// `sizeof(zivi_predictor)` in the library.
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_predictor_size")]
pub extern "C" fn zivi_predictor_size() -> u32 {
    size_of::<Predictor>() as u32
}

/// Sets `size`, and all other members to their default, 0. You set the members without a default:
/// delay, period, wall.
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_predictor_defaults")]
pub unsafe extern "C" fn zivi_predictor_defaults(config: *mut PredictorConfig) -> i32 {
    // SAFETY: see the module
    let Some(config) = (unsafe { object(config) }) else { return ZIVI_E_NULL };
    *config = PredictorConfig::defaults();
    ZIVI_OK
}

/// Checks the settings; no control is pending. If the returned code is < 0, nothing is written.
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_predictor_init")]
pub unsafe extern "C" fn zivi_predictor_init(
    predictor: *mut Predictor,
    config: *const PredictorConfig,
) -> i32 {
    // SAFETY: see the module
    match unsafe { (object(predictor), constant(config)) } {
        (Some(it), Some(config)) => it.init(config),
        _ => ZIVI_E_NULL,
    }
}

/// Forgets pending controls: a control of 0 acts until the first one that is sent does.
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_predictor_reset")]
pub unsafe extern "C" fn zivi_predictor_reset(predictor: *mut Predictor) -> i32 {
    // SAFETY: see the module
    unsafe { object(predictor) }.map_or(ZIVI_E_NULL, Predictor::reset)
}

/// Predicts from the measurement `x` (m), `xdot` (m/s) and the known `force` (m/s^2) the state at which the
/// control of this sample acts, through impacts and into rest: `predictor->x` and `->xdot`. Pass them
/// to a controller (`ahead` 1) in place of the measurement. Its reference is `delay` periods ahead: call
/// `zivi_tracker_step_over` `delay` times without a sample after a reset. Then `zivi_predictor_send`.
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_predictor_step")]
pub unsafe extern "C" fn zivi_predictor_step(
    predictor: *mut Predictor,
    x: Real,
    xdot: Real,
    force: Real,
) -> i32 {
    // SAFETY: see the module
    unsafe { object(predictor) }.map_or(ZIVI_E_NULL, |it| it.step(x, xdot, force))
}

/// Stores the control that is sent (m/s^2), after limits. Call it once a period, and with the last control
/// if that is held.
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_predictor_send")]
pub unsafe extern "C" fn zivi_predictor_send(predictor: *mut Predictor, u: Real) -> i32 {
    // SAFETY: see the module
    unsafe { object(predictor) }.map_or(ZIVI_E_NULL, |it| it.send(u))
}

/// Contains a path to a panic.
#[cfg(feature = "canary")]
#[no_mangle]
#[cfg_attr(feature = "single", export_name = "zivi_f32_canary")]
pub extern "C" fn zivi_canary(values: &[Real; 4], index: usize) -> Real {
    values[index]
}
