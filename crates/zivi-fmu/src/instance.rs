//! An instance: a model, its state and its logger.

use core::ffi::{c_char, c_void, CStr};

use crate::model::{message, AnyModel};
use crate::state::StepRefusal;
use crate::state::{mode, FmuState};
use crate::table::DataType;

/// Status that a function of FMI returns, in both versions.
pub(crate) type Status = i32;
pub(crate) const OK: Status = 0;
pub(crate) const WARNING: Status = 1;
pub(crate) const DISCARD: Status = 2;
pub(crate) const ERROR: Status = 3;

/// The logger of FMI 2; arguments after the message are never passed.
pub(crate) type Logger2 =
    unsafe extern "C" fn(*mut c_void, *const c_char, Status, *const c_char, *const c_char, ...);
/// The logger of FMI 3.
pub(crate) type Logger3 = unsafe extern "C" fn(*mut c_void, Status, *const c_char, *const c_char);

/// The logger.
#[derive(Clone, Copy)]
pub(crate) enum Log {
    Nobody,
    Two(Logger2),
    Three(Logger3),
}

/// Bytes of a name that are kept for the logger.
const NAME: usize = 64;

/// The stored part of a name; it ends with 0.
pub(crate) fn kept(name: &[u8]) -> [u8; NAME] {
    let mut kept = [0; NAME];
    // the last byte stays 0
    for (to, from) in kept.iter_mut().take(NAME - 1).zip(name) {
        *to = *from;
    }
    kept
}

/// An instance of a model.
pub(crate) struct Instance {
    pub(crate) model: AnyModel,
    pub(crate) state: FmuState,
    pub(crate) log: Log,
    pub(crate) environment: *mut c_void,
    name: [u8; NAME],
}

impl Instance {
    pub(crate) fn new(model: AnyModel, name: &[u8], log: Log, environment: *mut c_void) -> Self {
        Self {
            model,
            state: FmuState::new(model.number(), model.table()),
            log,
            environment,
            name: kept(name),
        }
    }

    /// Logs an error and returns the status.
    pub(crate) fn tell(&self, status: Status, words: &CStr) -> Status {
        self.log.tell(self.environment, &self.name, status, words)
    }
}

impl Log {
    /// Logs an error of an instance with a name that ends with 0, and returns the status.
    pub(crate) fn tell(
        self,
        environment: *mut c_void,
        name: &[u8],
        status: Status,
        words: &CStr,
    ) -> Status {
        let category = if status == WARNING { c"logStatusWarning" } else { c"logStatusError" };
        // SAFETY: the importer gave the function with the environment, the strings end with 0
        unsafe {
            match self {
                Log::Nobody => {}
                Log::Two(log) => log(
                    environment,
                    name.as_ptr().cast(),
                    status,
                    category.as_ptr(),
                    words.as_ptr(),
                ),
                Log::Three(log) => log(environment, status, category.as_ptr(), words.as_ptr()),
            }
        }
        status
    }
}

impl Instance {
    /// Enters the next mode.
    pub(crate) fn go(&mut self, from: u32, to: u32) -> Status {
        if self.state.mode != from {
            return self.tell(ERROR, c"this function must not be called now");
        }
        self.state.mode = to;
        OK
    }

    /// Makes the model from its parameters.
    pub(crate) fn exit_initialisation(&mut self) -> Status {
        if self.state.mode != mode::INITIALISATION {
            return self.tell(ERROR, c"this function must not be called now");
        }
        let code = self.model.configure(&mut self.state);
        if code < 0 {
            return self.tell(ERROR, message(code));
        }
        (self.state.mode, self.state.asked) = (mode::STEP, 1);
        OK
    }

    pub(crate) fn reset(&mut self) -> Status {
        self.state = FmuState::new(self.model.number(), self.model.table());
        OK
    }

    /// The state with its outputs as they are now.
    pub(crate) fn seen(&self) -> FmuState {
        let mut seen = self.state;
        let ready = match seen.mode {
            mode::INSTANTIATED => false,
            mode::INITIALISATION => self.model.configure(&mut seen) >= 0,
            _ => true,
        };
        if ready {
            self.model.outputs(&mut seen);
        }
        seen
    }

    /// One communication step.
    pub(crate) fn step(&mut self, from: f64, length: f64) -> Status {
        if self.state.mode != mode::STEP {
            return self.tell(ERROR, c"a step must not be made now");
        }
        let now = self.state.value(TIME);
        // an importer that adds up steps rounds differently
        let (off, rounding) = ((from - now).abs(), 1e-6 * length.abs() + 1e-12 * now.abs());
        if !off.is_finite() || off > rounding {
            return self.tell(ERROR, c"the communication point must be the time that was reached");
        }
        let before = self.state;
        if let Err(refusal) = self.model.step(&mut self.state, length) {
            self.state = before;
            let words = match refusal {
                StepRefusal::Length => c"the communication step must be > 0 and at most 1e9 h",
                StepRefusal::Multiple => c"the communication step must be a multiple of h",
                StepRefusal::Code(code) => message(code),
            };
            return self.tell(ERROR, words);
        }
        self.state.put(TIME, from + length);
        match self.state.code {
            code if code < 0 => self.tell(WARNING, message(code)),
            _ => OK,
        }
    }

    /// Sets one variable.
    pub(crate) fn set(&mut self, reference: u32, kind: DataType, value: f64) -> Status {
        if self.state.set(self.model.table(), reference, kind, value) {
            OK
        } else {
            self.tell(ERROR, c"no variable of this type that may be set now has this reference")
        }
    }
}

/// The value reference of time in every model.
const TIME: usize = 0;
