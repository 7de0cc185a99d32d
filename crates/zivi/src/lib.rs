//! The host library of zivi: it owns memory and time, `zivi_core` the mathematics of one step.
//!
//! ```
//! use zivi::{simulate_theta_gamma, ConstantForce, Grid, Physical, Restitution, Silent, ThetaGamma};
//!
//! let wall = Restitution::from_kappa(0.41)?;
//! let ball = Physical { x: 1.0, xdot: 6.0 };
//! let grid = Grid::new(0.0, 3.0, 1e-3)?;
//! let run = simulate_theta_gamma(
//!     ThetaGamma::implicit_euler(), wall, &mut ConstantForce(-9.81), grid, ball, &mut Silent,
//! )?;
//! assert!((run.trajectory.events.rest_time.unwrap() - 2.444).abs() < 1e-9);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! The pipeline: a [`Force`] (perhaps above a [`moving_wall`]) and a wall are advanced by a method,
//! giving a [`Trajectory`] with its [`Events`].
//!
//! * Fixed steps: [`theta_gamma`] and [`explicit`] implement [`fixed_step::FixedStep`], which
//!   [`fixed_step`] drives over a [`Grid`]; [`moreau_jean`] has a walk of its own.
//! * Error control: [`switched_rk`], high order through impacts and Zeno points.
//! * [`closed_loop`]: a sampled controller of `zivi_core::control` and a plant between its samples.
//! * [`batch`]: many runs on all cores.

#![forbid(unsafe_code)]

pub mod ballistic;
pub mod batch;
pub mod closed_loop;
pub mod events;
pub mod explicit;
pub mod fixed_step;
pub mod force;
pub mod grid;
mod implicit;
pub mod monitor;
pub mod moreau_jean;
pub mod moving_wall;
mod recorder;
mod room;
pub mod sign_solver;
pub mod status;
pub mod step_events;
pub mod step_solver;
pub mod summary;
pub mod switched_rk;
pub mod theta_gamma;
pub mod trajectory;

pub use closed_loop::{simulate_closed_loop, LoopRun};
pub use events::{Events, Impact};
pub use explicit::simulate_explicit_euler;
pub use fixed_step::Failure;
pub use force::{ConstantForce, Dependence, Force, FunctionForce, LinearForce};
pub use grid::{Grid, GridError};
pub use monitor::{Monitor, Silent};
pub use moreau_jean::{simulate_moreau_jean, MoreauJean};
pub use moving_wall::{HarmonicWall, OnMovingWall, WallMotion};
pub use status::Status;
pub use step_events::{Following, Interpolation, Knot, Stretch};
pub use summary::{Keep, Summary};
pub use switched_rk::{
    simulate_switched_rk, Counts, DensePath, Direction, EventFunction, EventHit, Level, Motion,
    MotionError, Occurrence, Order, Output, PathPoint, SwitchedIntegrator, SwitchedRk, SwitchedRun,
    Tail, UserEvent,
};
pub use theta_gamma::{simulate_theta_gamma, Solver, ThetaGamma};
pub use trajectory::{Columns, Quantity, Run, SetupError, Trajectory, QUANTITIES};
pub use zivi_core::{Branch, Lifted, Physical, Restitution};
