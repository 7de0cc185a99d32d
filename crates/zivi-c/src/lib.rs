//! zivi for C: the implicit step of a mass, the twisting regulator and the twisting tracker.
//!
//! Every object is a structure of plain numbers that the caller owns. It can be copied, logged,
//! stored and restored at any time; the library neither allocates memory nor keeps pointers.
//! `zivi_*_init` checks the settings once and seals them with a checksum. A step returns a code: 0,
//! bits that report a clamped sample or a saturated control, or a negative number for an invalid
//! setting or sample, in which case nothing has changed. The mathematics is that of `zivi-core`, bit
//! by bit.
//!
//! The C header, `include/zivi.h`, is made from this crate by cbindgen; the static library by
//! `tools/native.py`.

#![no_std]
#![deny(
    clippy::indexing_slicing,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::unreachable
)]

#[cfg(feature = "exports")]
mod call;
pub mod code;
mod config;
#[cfg(feature = "exports")]
pub mod exports;
mod mass;
mod observer;
mod predictor;
mod regulator;
mod tracker;

pub use code::message;
pub use code::Code;
pub use config::{
    ZIVI_GIVEN_AHEAD, ZIVI_GIVEN_DEPTH, ZIVI_GIVEN_DMAX, ZIVI_GIVEN_E, ZIVI_GIVEN_E_REF,
    ZIVI_GIVEN_HORIZON, ZIVI_GIVEN_KAPPA, ZIVI_GIVEN_KAPPA_REF, ZIVI_GIVEN_NOISE_X,
    ZIVI_GIVEN_NOISE_XDOT, ZIVI_GIVEN_PRESS, ZIVI_GIVEN_Q_D, ZIVI_GIVEN_U_LIMITS,
    ZIVI_TICK_LANDING, ZIVI_TICK_PAPER,
};
pub use mass::{Mass, MassConfig};
pub use observer::{Observer, ObserverConfig};
pub use predictor::{Predictor, PredictorConfig};
pub use regulator::{Regulator, RegulatorConfig};
pub use tracker::{
    GivenReference, Tracker, TrackerConfig, ZIVI_BRANCH_NEAREST, ZIVI_BRANCH_POSITIVE,
};

/// Version of this interface. It changes if a structure or the meaning of a function changes.
pub const ZIVI_ABI_VERSION: u32 = 3;

#[cfg(feature = "target")]
mod panic_free {
    extern "C" {
        fn zivi_panic_is_reachable() -> !;
    }

    /// Calls a function that is not defined: optimised code with a path to a panic
    /// refers to it and does not link.
    #[panic_handler]
    fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
        // SAFETY: it is never called; a library in which it could be does not link
        unsafe { zivi_panic_is_reachable() }
    }
}
