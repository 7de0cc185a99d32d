//! Mechanical systems with `n` coordinates and `m` gaps: the switched Runge-Kutta method.
//!
//! ```text
//! motion    M q'' = F + N_C^T lambda_C, g_C = 0          an embedded Runge-Kutta pair
//! impact    g+ = g- + D P,  0 <= P perp g+ + e g- >= 0   a linear complementarity problem
//! Zeno      t_n, z_n in powers of e^n                    extrapolation of times and states
//! lift-off  lambda_i = 0                                 0 <= lambda perp b + D lambda >= 0
//! ```
//!
//! The mode is the set `C` of closed gaps. The gaps and their speeds are integrated along with the
//! coordinates, so that impacts keep their precision however small the bounces become.

mod fixed_steps;
mod integrator;
mod periodic_impulses;
mod recording;
pub mod sensitivity;

pub use crate::kinetics::contact_forces;
pub(crate) use crate::kinetics::shares::shortest;
pub use crate::motion::path::MechanicalPath;
pub use crate::record::events::{FlagKind, Occurrence};
pub use crate::record::gap_set::{ContactMode, GapSet};
pub use crate::record::recorder::MotionPoint;
pub use fixed_steps::{simulate_mechanical_moreau_jean, simulate_mechanical_theta_gamma};
pub use periodic_impulses::{ImpulseEquations, Modes};
pub use recording::{
    simulate_mechanical, simulate_mechanical_loop, MechanicalOutput, MechanicalRun,
    MechanicalSamples, Sampling, Speeds, Ticks, Totals,
};
