//! The switched Runge-Kutta method: high order through impacts, Zeno points, rest and lift-off.
//!
//! ```text
//! flight    x'' = f(t, x, x')                              an embedded Runge-Kutta pair
//! impact    x = 0, x'- < 0:  x'+ = -e x'-                  first root of the dense polynomial
//! Zeno      t_n = t_inf - C_1 e^n - C_2 e^(2n) - ...       Richardson extrapolation
//! rest      x = x' = 0 while f(t, 0, 0) <= 0               first root of f(t, 0, 0)
//! ```
//!
//! Time stepping passes the accumulation of impacts at first order, and methods that detect events
//! stop there. This one has the order of its Runge-Kutta pair all the way: it steps onto each
//! impact, extrapolates the impact times with the ratios that the theory gives, and jumps to rest
//! when the extrapolated Zeno time is within the tolerance. It works in `(x, x')` and carries the
//! branch `sigma`; `s = sigma x` is reported.
//!
//! A step that ends in an impact is first tried past it, so the force is evaluated at `x` slightly
//! below zero and should be smooth there (an undefined value is replaced by the value at zero). The
//! sign of `f(t, 0, 0)` decides over rest. Events shorter than a step (a brief penetration with two roots
//! between which no stage lies, a pulse of the force) are seen as far as the polynomials show them;
//! `max_step` makes them look closer.
//!
//! * [`simulate_switched_rk`]: a whole run, with samples, events and dense output.
//! * [`SwitchedIntegrator`]: piece by piece, under a force that may change between calls.

pub(crate) mod accumulation;
pub(crate) mod flight;
mod impact_map;
mod integrator;
pub(crate) mod mode;
mod path;
mod plot_samples;
mod recording;
pub mod sensitivity;
mod settings;

pub use impact_map::{ImpactMap, MapParameter, Return};
pub use integrator::SwitchedIntegrator;
pub(crate) use integrator::Trace;
pub use mode::Counts;
pub use path::Motion;
pub use path::{DensePath, PathReader};
pub use plot_samples::PlotSamples;
pub(crate) use recording::check_span;
pub use recording::simulate_switched_rk;
pub use settings::Samples;
pub use settings::{Flights, Order, SwitchedRk};
pub use settings::{Output, SwitchedRun};
