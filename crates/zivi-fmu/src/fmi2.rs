//! The functions of FMI 2.0.

#![allow(non_snake_case, reason = "the names are those of the standard")]

use core::ffi::{c_char, c_int, c_void};

use crate::common::{self, instance, instantiated, place};
use crate::instance::{Instance, Log, Logger2, Status, DISCARD, ERROR, OK};
use crate::shared::{absent, lifecycle, variables};
use crate::state::{mode, FmuState};
use crate::table::DataType;

/// Callbacks of an importer for an instance; memory is allocated by the library.
#[repr(C)]
pub(crate) struct Fmi2Callbacks {
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
    resources: *const c_char,
    callbacks: *mut Fmi2Callbacks,
    _visible: c_int,
    _logging: c_int,
) -> *mut Instance {
    // SAFETY: NULL or the importer's
    let Some(callbacks) = (unsafe { place(callbacks) }) else { return core::ptr::null_mut() };
    if kind != CO_SIMULATION {
        return core::ptr::null_mut();
    }
    let log = callbacks.logger.map_or(Log::Nobody, Log::Two);
    // SAFETY: strings of the importer
    unsafe { instantiated(name, token, resources, log, callbacks.environment) }
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
unsafe extern "C" fn fmi2DoStep(it: *mut Instance, from: f64, length: f64) -> Status {
    // SAFETY: NULL or ours
    unsafe { instance(it) }.map_or(ERROR, |it| it.step(from, length))
}

lifecycle! {
    free: fmi2FreeInstance, log: fmi2SetDebugLogging, ready: fmi2ExitInitializationMode,
    end: fmi2Terminate, reset: fmi2Reset,
    get: fmi2GetFMUstate, set: fmi2SetFMUstate, forget: fmi2FreeFMUstate,
    size: fmi2SerializedFMUstateSize, store: fmi2SerializeFMUstate,
    restore: fmi2DeSerializeFMUstate,
}

variables! {
    fmi2GetReal fmi2SetReal: Real as f64, |value| value, |value| value;
    fmi2GetInteger fmi2SetInteger: Integer as c_int, |value| value as c_int, f64::from;
    fmi2GetBoolean fmi2SetBoolean: Boolean as c_int, |value| c_int::from(value != 0.0),
        |value| f64::from(u8::from(value != 0));
}

/// A step is never pending, so there is no status to query.
macro_rules! statuses {
    ($($name:ident)*) => {$(
        #[no_mangle]
        extern "C" fn $name() -> Status {
            DISCARD
        }
    )*};
}

statuses! { fmi2GetStatus fmi2GetRealStatus fmi2GetIntegerStatus fmi2GetBooleanStatus fmi2GetStringStatus }

absent! {
    fmi2GetString fmi2SetString fmi2GetDirectionalDerivative fmi2SetRealInputDerivatives
    fmi2GetRealOutputDerivatives fmi2CancelStep fmi2EnterEventMode fmi2NewDiscreteStates
    fmi2EnterContinuousTimeMode fmi2CompletedIntegratorStep fmi2SetTime fmi2SetContinuousStates
    fmi2GetDerivatives fmi2GetEventIndicators fmi2GetContinuousStates
    fmi2GetNominalsOfContinuousStates
}
