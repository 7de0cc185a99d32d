//! The functions of FMI 2.0.

#![allow(non_snake_case, reason = "the names are those of the standard")]

use core::ffi::{c_char, c_int, c_void};

use crate::common::{
    absent, free_state, freed, get, get_state, instance, instantiated, restore, set, set_state,
    store, stored_size,
};
use crate::instance::{Instance, Log, Logger2, Status, DISCARD, ERROR, OK};
use crate::state::{mode, State};
use crate::table::Kind;

/// What an importer gives for an instance; the memory is our own business.
#[repr(C)]
pub(crate) struct Callbacks {
    logger: Option<Logger2>,
    allocate_memory: *const c_void,
    free_memory: *const c_void,
    step_finished: *const c_void,
    environment: *mut c_void,
}

/// `fmi2CoSimulation`.
const CO_SIMULATION: c_int = 1;

#[no_mangle]
extern "C" fn fmi2GetTypesPlatform() -> *const c_char {
    c"default".as_ptr()
}

#[no_mangle]
extern "C" fn fmi2GetVersion() -> *const c_char {
    c"2.0".as_ptr()
}

#[no_mangle]
unsafe extern "C" fn fmi2Instantiate(
    name: *const c_char,
    kind: c_int,
    token: *const c_char,
    _resources: *const c_char,
    callbacks: *const Callbacks,
    _visible: c_int,
    _logging: c_int,
) -> *mut Instance {
    // SAFETY: NULL or the importer's
    let Some(callbacks) = (unsafe { callbacks.as_ref() }) else { return core::ptr::null_mut() };
    if kind != CO_SIMULATION {
        return core::ptr::null_mut();
    }
    let log = callbacks.logger.map_or(Log::Nobody, Log::Two);
    // SAFETY: strings of the importer
    unsafe { instantiated(name, token, log, callbacks.environment) }
}

#[no_mangle]
unsafe extern "C" fn fmi2FreeInstance(it: *mut Instance) {
    // SAFETY: NULL or ours
    unsafe { freed(it) }
}

#[no_mangle]
unsafe extern "C" fn fmi2SetDebugLogging(it: *mut Instance) -> Status {
    // SAFETY: NULL or ours; what is wrong is always told
    if unsafe { instance(it) }.is_some() {
        OK
    } else {
        ERROR
    }
}

#[no_mangle]
unsafe extern "C" fn fmi2SetupExperiment(
    it: *mut Instance,
    _tolerance_defined: c_int,
    _tolerance: f64,
    start: f64,
) -> Status {
    // SAFETY: NULL or ours
    let Some(it) = (unsafe { instance(it) }) else { return ERROR };
    it.state.put(0, start);
    it.go(mode::INSTANTIATED, mode::INSTANTIATED)
}

#[no_mangle]
unsafe extern "C" fn fmi2EnterInitializationMode(it: *mut Instance) -> Status {
    // SAFETY: NULL or ours
    unsafe { instance(it) }.map_or(ERROR, |it| it.go(mode::INSTANTIATED, mode::INITIALISATION))
}

#[no_mangle]
unsafe extern "C" fn fmi2ExitInitializationMode(it: *mut Instance) -> Status {
    // SAFETY: NULL or ours
    unsafe { instance(it) }.map_or(ERROR, Instance::exit_initialisation)
}

#[no_mangle]
unsafe extern "C" fn fmi2Terminate(it: *mut Instance) -> Status {
    // SAFETY: NULL or ours
    unsafe { instance(it) }.map_or(ERROR, |it| it.go(mode::STEP, mode::TERMINATED))
}

#[no_mangle]
unsafe extern "C" fn fmi2Reset(it: *mut Instance) -> Status {
    // SAFETY: NULL or ours
    unsafe { instance(it) }.map_or(ERROR, Instance::reset)
}

#[no_mangle]
unsafe extern "C" fn fmi2DoStep(it: *mut Instance, from: f64, length: f64) -> Status {
    // SAFETY: NULL or ours
    unsafe { instance(it) }.map_or(ERROR, |it| it.step(from, length))
}

#[no_mangle]
unsafe extern "C" fn fmi2GetReal(
    it: *mut Instance,
    references: *const u32,
    count: usize,
    values: *mut f64,
) -> Status {
    // SAFETY: the arrays have so many elements
    unsafe { get(it, references, count, Kind::Real, |k, value| values.add(k).write(value)) }
}

#[no_mangle]
unsafe extern "C" fn fmi2SetReal(
    it: *mut Instance,
    references: *const u32,
    count: usize,
    values: *const f64,
) -> Status {
    // SAFETY: the arrays have so many elements
    unsafe { set(it, references, count, Kind::Real, |k| *values.add(k)) }
}

#[no_mangle]
unsafe extern "C" fn fmi2GetInteger(
    it: *mut Instance,
    references: *const u32,
    count: usize,
    values: *mut c_int,
) -> Status {
    // SAFETY: the arrays have so many elements
    unsafe {
        get(it, references, count, Kind::Integer, |k, value| values.add(k).write(value as c_int))
    }
}

#[no_mangle]
unsafe extern "C" fn fmi2SetInteger(
    it: *mut Instance,
    references: *const u32,
    count: usize,
    values: *const c_int,
) -> Status {
    // SAFETY: the arrays have so many elements
    unsafe { set(it, references, count, Kind::Integer, |k| f64::from(*values.add(k))) }
}

#[no_mangle]
unsafe extern "C" fn fmi2GetBoolean(
    it: *mut Instance,
    references: *const u32,
    count: usize,
    values: *mut c_int,
) -> Status {
    // SAFETY: the arrays have so many elements
    unsafe {
        get(it, references, count, Kind::Boolean, |k, value| {
            values.add(k).write(c_int::from(value != 0.0))
        })
    }
}

#[no_mangle]
unsafe extern "C" fn fmi2SetBoolean(
    it: *mut Instance,
    references: *const u32,
    count: usize,
    values: *const c_int,
) -> Status {
    // SAFETY: the arrays have so many elements
    unsafe {
        set(it, references, count, Kind::Boolean, |k| f64::from(u8::from(*values.add(k) != 0)))
    }
}

#[no_mangle]
unsafe extern "C" fn fmi2GetFMUstate(it: *mut Instance, to: *mut *mut State) -> Status {
    // SAFETY: see there
    unsafe { get_state(it, to) }
}

#[no_mangle]
unsafe extern "C" fn fmi2SetFMUstate(it: *mut Instance, from: *mut State) -> Status {
    // SAFETY: see there
    unsafe { set_state(it, from) }
}

#[no_mangle]
unsafe extern "C" fn fmi2FreeFMUstate(_it: *mut Instance, state: *mut *mut State) -> Status {
    // SAFETY: see there
    unsafe { free_state(state) }
}

#[no_mangle]
unsafe extern "C" fn fmi2SerializedFMUstateSize(
    _it: *mut Instance,
    _state: *mut State,
    size: *mut usize,
) -> Status {
    // SAFETY: see there
    unsafe { stored_size(size) }
}

#[no_mangle]
unsafe extern "C" fn fmi2SerializeFMUstate(
    it: *mut Instance,
    from: *mut State,
    to: *mut u8,
    size: usize,
) -> Status {
    // SAFETY: see there
    unsafe { store(it, from, to, size) }
}

#[no_mangle]
unsafe extern "C" fn fmi2DeSerializeFMUstate(
    it: *mut Instance,
    from: *const u8,
    size: usize,
    to: *mut *mut State,
) -> Status {
    // SAFETY: see there
    unsafe { restore(it, from, size, to) }
}

/// No step is ever pending: there is nothing to ask after.
macro_rules! statuses {
    ($($name:ident)*) => {$(
        #[no_mangle]
        extern "C" fn $name() -> Status {
            DISCARD
        }
    )*};
}

statuses! { fmi2GetStatus fmi2GetRealStatus fmi2GetIntegerStatus fmi2GetBooleanStatus fmi2GetStringStatus }

/// Functions that are not provided. Of their arguments only the instance is looked at, which the
/// calling conventions of C allow.
macro_rules! absent {
    ($($name:ident)*) => {$(
        #[no_mangle]
        unsafe extern "C" fn $name(it: *mut Instance) -> Status {
            // SAFETY: NULL or ours
            unsafe { absent(it) }
        }
    )*};
}

absent! {
    fmi2GetString fmi2SetString fmi2GetDirectionalDerivative fmi2SetRealInputDerivatives
    fmi2GetRealOutputDerivatives fmi2CancelStep fmi2EnterEventMode fmi2NewDiscreteStates
    fmi2EnterContinuousTimeMode fmi2CompletedIntegratorStep fmi2SetTime fmi2SetContinuousStates
    fmi2GetDerivatives fmi2GetEventIndicators fmi2GetContinuousStates
    fmi2GetNominalsOfContinuousStates
}
