//! The functions of FMI 3.0.

#![allow(non_snake_case, reason = "the names are those of the standard")]

use core::ffi::{c_char, c_void};

use crate::common::{self, instance, instantiated, place};
use crate::instance::{Instance, Log, Logger3, Status, ERROR, OK};
use crate::shared::{absent, lifecycle, variables};
use crate::state::{mode, FmuState};
use crate::table::DataType;

#[no_mangle]
extern "C" fn fmi3GetVersion() -> *const c_char {
    c"3.0".as_ptr()
}

#[no_mangle]
unsafe extern "C" fn fmi3InstantiateCoSimulation(
    name: *const c_char,
    token: *const c_char,
    resources: *const c_char,
    _visible: bool,
    _logging: bool,
    _event_mode: bool,
    _early_return: bool,
    _intermediate: *const u32,
    _intermediates: usize,
    environment: *mut c_void,
    log: Option<Logger3>,
    _intermediate_update: *const c_void,
) -> *mut Instance {
    // SAFETY: strings of the importer
    unsafe {
        let log = log.map_or(Log::Nobody, Log::Three);
        instantiated(name, token, resources, log, environment)
    }
}

#[no_mangle]
extern "C" fn fmi3InstantiateModelExchange() -> *mut Instance {
    core::ptr::null_mut()
}

#[no_mangle]
extern "C" fn fmi3InstantiateScheduledExecution() -> *mut Instance {
    core::ptr::null_mut()
}

#[no_mangle]
unsafe extern "C" fn fmi3EnterInitializationMode(
    it: *mut Instance,
    _tolerance_defined: bool,
    _tolerance: f64,
    start: f64,
) -> Status {
    // SAFETY: NULL or ours
    let Some(it) = (unsafe { instance(it) }) else { return ERROR };
    let status = it.go(mode::INSTANTIATED, mode::INITIALISATION);
    if status == OK {
        it.state.put(0, start);
    }
    status
}

#[no_mangle]
unsafe extern "C" fn fmi3DoStep(
    it: *mut Instance,
    from: f64,
    length: f64,
    _no_state_before: bool,
    event_needed: *mut bool,
    terminate: *mut bool,
    early_return: *mut bool,
    last_time: *mut f64,
) -> Status {
    // SAFETY: NULL or ours
    let Some(it) = (unsafe { instance(it) }) else { return ERROR };
    let status = it.step(from, length);
    for told in [event_needed, terminate, early_return] {
        // SAFETY: NULL or a place of the importer
        if let Some(told) = unsafe { place(told) } {
            *told = false;
        }
    }
    // SAFETY: as above
    if let Some(last_time) = unsafe { place(last_time) } {
        *last_time = it.state.value(0);
    }
    status
}

lifecycle! {
    free: fmi3FreeInstance, log: fmi3SetDebugLogging, ready: fmi3ExitInitializationMode,
    end: fmi3Terminate, reset: fmi3Reset,
    get: fmi3GetFMUState, set: fmi3SetFMUState, forget: fmi3FreeFMUState,
    size: fmi3SerializedFMUStateSize, store: fmi3SerializeFMUState,
    restore: fmi3DeserializeFMUState,
}

variables! {
    fmi3GetFloat64 fmi3SetFloat64: Real as f64, |value| value, |value| value, room;
    fmi3GetInt32 fmi3SetInt32: Integer as i32, |value| value as i32, f64::from, room;
    // a byte: the importer's value may differ from 0 and 1
    fmi3GetBoolean fmi3SetBoolean: Boolean as u8, |value| u8::from(value != 0.0),
        |value| f64::from(u8::from(value != 0)), room;
}

absent! {
    fmi3ActivateModelPartition fmi3CompletedIntegratorStep fmi3EnterConfigurationMode
    fmi3EnterContinuousTimeMode fmi3EnterEventMode fmi3EnterStepMode fmi3EvaluateDiscreteStates
    fmi3ExitConfigurationMode fmi3GetAdjointDerivative fmi3GetBinary fmi3GetClock
    fmi3GetContinuousStateDerivatives fmi3GetContinuousStates fmi3GetDirectionalDerivative
    fmi3GetEventIndicators fmi3GetFloat32 fmi3GetInt16 fmi3GetInt64 fmi3GetInt8
    fmi3GetIntervalDecimal fmi3GetIntervalFraction fmi3GetNominalsOfContinuousStates
    fmi3GetNumberOfContinuousStates fmi3GetNumberOfEventIndicators
    fmi3GetNumberOfVariableDependencies fmi3GetOutputDerivatives fmi3GetShiftDecimal
    fmi3GetShiftFraction fmi3GetString fmi3GetUInt16 fmi3GetUInt32 fmi3GetUInt64 fmi3GetUInt8
    fmi3GetVariableDependencies fmi3SetBinary fmi3SetClock fmi3SetContinuousStates
    fmi3SetFloat32 fmi3SetInt16 fmi3SetInt64 fmi3SetInt8 fmi3SetIntervalDecimal
    fmi3SetIntervalFraction fmi3SetShiftDecimal fmi3SetShiftFraction fmi3SetString fmi3SetTime
    fmi3SetUInt16 fmi3SetUInt32 fmi3SetUInt64 fmi3SetUInt8 fmi3UpdateDiscreteStates
}
