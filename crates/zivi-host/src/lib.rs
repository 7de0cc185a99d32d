//! zivi for programs in C, C++, Julia and other languages, on a machine with an operating system.
//!
//! A request is a plain structure, a run is an opaque handle, and a function of the caller receives
//! the pointer that was passed with it. A panic does not cross the border: it becomes a code.
//! `zivi_last_error` returns the message of the last error of the calling thread.
//!
//! The header, `include/zivi_host.h`, is made from this crate by cbindgen. The shared library has
//! the functions of `include/zivi.h` too.

#![allow(clippy::missing_safety_doc, reason = "the comments are for C: pointers are the caller's")]

mod border;
mod mechanics;
mod simulation;
mod vi;

pub use border::{zivi_last_error, ZIVI_E_INVALID, ZIVI_E_MEMORY, ZIVI_E_PANIC};
pub use mechanics::{
    zivi_mechanical_column, zivi_mechanical_free, zivi_mechanical_samples, zivi_mechanical_status,
    zivi_simulate_mechanical, Evaluation, MechanicalHandle, Mechanics,
};
pub use simulation::{
    zivi_method_defaults, zivi_run_column, zivi_run_free, zivi_run_impacts, zivi_run_rest_time,
    zivi_run_samples, zivi_run_status, zivi_simulate, zivi_status_message, zivi_system_defaults,
    ForceFunction, Impact, Method, RunHandle, System,
};
pub use vi::{
    zivi_solve_avi, zivi_solve_vi, zivi_vi_defaults, zivi_vi_message, JacobianFunction,
    MapFunction, ViProblem, ViReport,
};

// the functions of zivi.h belong to the library
pub use zivi_c::exports;
