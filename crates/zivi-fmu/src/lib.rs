//! The binary of zivi's FMUs (functional mock-up units), for FMI 2.0 and 3.0 co-simulation.
//!
//! One shared library serves all models and both versions; the token with which an importer
//! instantiates selects the model. A model is a table of variables (`table`) around the objects of
//! `zivi-c`; the data that change during a run are one plain structure (`state::FmuState`), so that getting,
//! setting and storing it is a copy. `python/zivi/fmu` writes the descriptions that belong to it.
//!
//! An output is computed when it is read: a control answers the inputs that were set since the last
//! step. An importer that sets, reads and steps therefore closes a loop without delay; one that
//! steps and reads gets the control of the last period, a delay of one period.

#![cfg_attr(not(feature = "loops"), no_std)]
#![deny(
    clippy::indexing_slicing,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::unreachable
)]
#![cfg_attr(not(feature = "target"), allow(dead_code, reason = "the functions of FMI use it"))]

#[cfg(feature = "target")]
mod common;
#[cfg(feature = "target")]
mod fmi2;
#[cfg(feature = "target")]
mod fmi3;
mod instance;
#[cfg_attr(feature = "loops", path = "loops/mod.rs")]
mod model;
#[cfg(feature = "target")]
mod shared;
mod state;
mod table;

#[cfg(all(feature = "target", not(feature = "loops")))]
mod panic_free {
    extern "C" {
        fn zivi_panic_is_reachable() -> !;
    }

    /// As in `zivi-c`: a library with a path to a panic does not load.
    #[panic_handler]
    fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
        // SAFETY: it is never called; a library in which it could be does not load
        unsafe { zivi_panic_is_reachable() }
    }
}
