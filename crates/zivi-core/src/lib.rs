//! The mathematics of zivi: mechanical systems with one unilateral constraint and impacts.
//!
//! ```text
//! what moves        what removes      what makes it       what is        what acts
//!                   the impact        algebraic           solved
//! system      ->    transform    ->   step           ->   vi        ->   control
//! (force, e)        (s, v)            (theta-gamma)       (box VI)       (twisting)
//! ```
//!
//! A mass above a wall, `x'' = f(t, x, x')` for `x >= 0`, loses velocity at the wall:
//! `x'+ = -e x'-`. The Zhuravlev-Ivanov [`transform`] writes it as
//!
//! ```text
//! x = |s|,   x' = R v sgn s,   R = 1 - kappa sgn s sgn v,   kappa = (1 - e)/(1 + e)
//! s' = R v,  v' = sgn(s) f / R                                                        (2)
//! ```
//!
//! where an impact is `s` crossing zero and no state jumps. The [`step`] discretises the
//! set-valued signs implicitly; what it has to solve is a variational inequality on the box
//! `[-1, 1]^2`, in the general form that [`vi`] knows. [`control`] discretises the twisting
//! controllers in the same way: one update solves one such step with the control's signs in it.
//! [`observer`] estimates what a controller needs to know where not all of it is measured.
//!
//! The crate is `no_std`, allocates nothing, has no `unsafe`, and works on plain numbers ([`Real`]):
//! all of it runs on a microcontroller. They are `f64`, with the feature `single` `f32`; then
//! without [`vi`]. The notation, with the Rust and the Python name of every symbol,
//! is in `docs/notation.md`.

#![no_std]
#![forbid(unsafe_code)]
#![deny(
    clippy::indexing_slicing,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::unreachable
)]

pub mod control;
#[cfg(not(feature = "single"))]
pub mod cosine;
pub mod flight;
pub mod observer;
pub mod real;
pub mod restitution;
pub mod setting;
pub mod step;
pub mod transform;
#[cfg(not(feature = "single"))]
pub mod vi;

pub use real::Real;
pub use restitution::{Restitution, RestitutionError};
pub use setting::SettingError;
pub use step::{Case, StepFailure, StepSolution, ThetaGammaStep};
pub use transform::{Branch, Lifted, Physical};

/// The sign of `z`, with `sgn(0) = 0` (`f64::signum` gives `1` there).
///
/// ```
/// assert_eq!([zivi_core::sgn(-3.0), zivi_core::sgn(0.0), zivi_core::sgn(2.0)], [-1.0, 0.0, 1.0]);
/// ```
#[inline]
#[must_use]
pub fn sgn(z: Real) -> Real {
    // includes NaN
    if z.abs() > 0.0 {
        Real::copysign(1.0, z)
    } else {
        0.0
    }
}
