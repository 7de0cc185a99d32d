//! The functions of FMI 3.0.

#![allow(non_snake_case, reason = "the names are those of the standard")]

use core::ffi::{c_char, c_void};

use crate::common::{
    absent, free_state, freed, get, get_state, instance, instantiated, restore, set, set_state,
    store, stored_size,
};
use crate::instance::{Instance, Log, Logger3, Status, ERROR, OK};
use crate::state::{mode, State};
use crate::table::Kind;

#[no_mangle]
extern "C" fn fmi3GetVersion() -> *const c_char {
    c"3.0".as_ptr()
}

#[no_mangle]
unsafe extern "C" fn fmi3InstantiateCoSimulation(
    name: *const c_char,
    token: *const c_char,
    _resources: *const c_char,
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
    unsafe { instantiated(name, token, log.map_or(Log::Nobody, Log::Three), environment) }
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
unsafe extern "C" fn fmi3FreeInstance(it: *mut Instance) {
    // SAFETY: NULL or ours
    unsafe { freed(it) }
}

#[no_mangle]
unsafe extern "C" fn fmi3SetDebugLogging(it: *mut Instance) -> Status {
    // SAFETY: NULL or ours; what is wrong is always told
    if unsafe { instance(it) }.is_some() {
        OK
    } else {
        ERROR
    }
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
unsafe extern "C" fn fmi3ExitInitializationMode(it: *mut Instance) -> Status {
    // SAFETY: NULL or ours
    unsafe { instance(it) }.map_or(ERROR, Instance::exit_initialisation)
}

#[no_mangle]
unsafe extern "C" fn fmi3Terminate(it: *mut Instance) -> Status {
    // SAFETY: NULL or ours
    unsafe { instance(it) }.map_or(ERROR, |it| it.go(mode::STEP, mode::TERMINATED))
}

#[no_mangle]
unsafe extern "C" fn fmi3Reset(it: *mut Instance) -> Status {
    // SAFETY: NULL or ours
    unsafe { instance(it) }.map_or(ERROR, Instance::reset)
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
        if let Some(told) = unsafe { told.as_mut() } {
            *told = false;
        }
    }
    // SAFETY: as above
    if let Some(last_time) = unsafe { last_time.as_mut() } {
        *last_time = it.state.value(0);
    }
    status
}

#[no_mangle]
unsafe extern "C" fn fmi3GetFloat64(
    it: *mut Instance,
    references: *const u32,
    count: usize,
    values: *mut f64,
    room: usize,
) -> Status {
    // SAFETY: the arrays have so many elements
    unsafe {
        if room < count {
            return absent(it);
        }
        get(it, references, count, Kind::Real, |k, value| values.add(k).write(value))
    }
}

#[no_mangle]
unsafe extern "C" fn fmi3SetFloat64(
    it: *mut Instance,
    references: *const u32,
    count: usize,
    values: *const f64,
    given: usize,
) -> Status {
    // SAFETY: the arrays have so many elements
    unsafe {
        if given < count {
            return absent(it);
        }
        set(it, references, count, Kind::Real, |k| *values.add(k))
    }
}

#[no_mangle]
unsafe extern "C" fn fmi3GetInt32(
    it: *mut Instance,
    references: *const u32,
    count: usize,
    values: *mut i32,
    room: usize,
) -> Status {
    // SAFETY: the arrays have so many elements
    unsafe {
        if room < count {
            return absent(it);
        }
        get(it, references, count, Kind::Integer, |k, value| values.add(k).write(value as i32))
    }
}

#[no_mangle]
unsafe extern "C" fn fmi3SetInt32(
    it: *mut Instance,
    references: *const u32,
    count: usize,
    values: *const i32,
    given: usize,
) -> Status {
    // SAFETY: the arrays have so many elements
    unsafe {
        if given < count {
            return absent(it);
        }
        set(it, references, count, Kind::Integer, |k| f64::from(*values.add(k)))
    }
}

#[no_mangle]
unsafe extern "C" fn fmi3GetBoolean(
    it: *mut Instance,
    references: *const u32,
    count: usize,
    values: *mut bool,
    room: usize,
) -> Status {
    // SAFETY: the arrays have so many elements
    unsafe {
        if room < count {
            return absent(it);
        }
        get(it, references, count, Kind::Boolean, |k, value| values.add(k).write(value != 0.0))
    }
}

#[no_mangle]
unsafe extern "C" fn fmi3SetBoolean(
    it: *mut Instance,
    references: *const u32,
    count: usize,
    values: *const bool,
    given: usize,
) -> Status {
    // SAFETY: the arrays have so many elements
    unsafe {
        if given < count {
            return absent(it);
        }
        set(it, references, count, Kind::Boolean, |k| f64::from(u8::from(*values.add(k))))
    }
}

#[no_mangle]
unsafe extern "C" fn fmi3GetFMUState(it: *mut Instance, to: *mut *mut State) -> Status {
    // SAFETY: see there
    unsafe { get_state(it, to) }
}

#[no_mangle]
unsafe extern "C" fn fmi3SetFMUState(it: *mut Instance, from: *mut State) -> Status {
    // SAFETY: see there
    unsafe { set_state(it, from) }
}

#[no_mangle]
unsafe extern "C" fn fmi3FreeFMUState(_it: *mut Instance, state: *mut *mut State) -> Status {
    // SAFETY: see there
    unsafe { free_state(state) }
}

#[no_mangle]
unsafe extern "C" fn fmi3SerializedFMUStateSize(
    _it: *mut Instance,
    _state: *mut State,
    size: *mut usize,
) -> Status {
    // SAFETY: see there
    unsafe { stored_size(size) }
}

#[no_mangle]
unsafe extern "C" fn fmi3SerializeFMUState(
    it: *mut Instance,
    from: *mut State,
    to: *mut u8,
    size: usize,
) -> Status {
    // SAFETY: see there
    unsafe { store(it, from, to, size) }
}

#[no_mangle]
unsafe extern "C" fn fmi3DeserializeFMUState(
    it: *mut Instance,
    from: *const u8,
    size: usize,
    to: *mut *mut State,
) -> Status {
    // SAFETY: see there
    unsafe { restore(it, from, size, to) }
}

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
