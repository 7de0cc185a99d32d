//! The host library of zivi: it owns memory and time, `zivi_core` the mathematics of one step.
//!
//! ```
//! use zivi::{simulate_theta_gamma, ConstantForce, Grid, Physical, Restitution, Silent, ThetaGamma};
//!
//! let restitution = Restitution::from_kappa(0.41)?;
//! let ball = Physical { x: 1.0, xdot: 6.0 };
//! let grid = Grid::new(0.0, 3.0, 1e-3)?;
//! let run = simulate_theta_gamma(
//!     ThetaGamma::implicit_euler(), restitution, &mut ConstantForce(-9.81), grid, ball,
//!     &mut Silent,
//! )?;
//! assert!((run.trajectory.events.rest_time.unwrap() - 2.444).abs() < 1e-9);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! The rooms, each of which knows only those above it:
//!
//! * [`numeric`] knows no mechanics: Runge-Kutta pairs and their steps, Bernstein polynomials, roots,
//!   grids.
//! * [`record`]: the results of a run: a [`Trajectory`], a [`Status`], and the events at the gaps:
//!   [`Occurrence`]s, which [`Events`] reads.
//! * [`system`]: what moves: a [`Force`], a [`HarmonicWall`](system::force), an [`ImpactLaw`].
//! * [`zeno`]: where impacts accumulate: extrapolation of times and states, the flights that are skipped.
//! * `piecewise`: the run loop of methods that advance up to one event after the other.
//! * [`stepping`]: fixed steps, each scheme a [`stepping::fixed_step::Scheme`].
//!   [`stepping::theta_gamma`] and [`stepping::explicit`] implement
//!   [`stepping::fixed_step::FixedStep`], which is driven over a [`Grid`];
//!   [`stepping::moreau_jean`] has a walk of its own.
//! * [`switched`]: error control, high order through impacts and Zeno points.
//! * `kinetics`: systems of several coordinates and gaps at one state: accelerations, mobilities, forces.
//! * `friction`: dry friction in contacts and joints of these.
//! * `motion`: their state, and their motion up to an impact or a lift-off.
//! * `impact`: their impacts, and those that accumulate.
//! * [`mechanics`]: their runs: error control, high order through impacts and Zeno points.
//! * [`method`]: one entry to all of them, from a system, a span and a state to a run.
//! * [`drive`]: a sampled controller of `zivi_core::control` and a plant between its samples
//!   ([`drive::closed_loop`]); many runs on all cores ([`drive::batch`]).

#![forbid(unsafe_code)]

pub mod drive;
mod friction;
mod impact;
mod kinetics;
pub mod mechanics;
pub mod method;
mod motion;
pub mod numeric;
mod piecewise;
pub mod record;
pub mod stepping;
pub mod switched;
pub mod system;
pub mod zeno;

pub use drive::closed_loop::{simulate_closed_loop, LoopRun};
pub use method::{AnyMethod, Mechanism, Method, PointMass, PointRun};
pub use numeric::grid::{Grid, GridError};
pub use piecewise::running::Kick;
pub use record::columns::{Columns, Quantity, QUANTITIES};
pub use record::events::{Events, Impact, Occurrence};
pub use record::recorder::{
    DenseStep, Interpolation, Keep, MotionPoint, PathPoint, StepEnd, Summary,
};
pub use record::status::{Failure, Monitor, Silent, Status};
pub use record::stored::MotionError;
pub use record::trajectory::{Run, SetupError, Trajectory};
pub use record::user_events::{Direction, EventFunction, Level, LocatedEvent, UserEvent};
pub use stepping::explicit::{simulate_explicit_euler, ExplicitEuler};
pub use stepping::fixed_step::{FixedSteps, Scheme};
pub use stepping::moreau_jean::{simulate_moreau_jean, MoreauJean};
pub use stepping::step_events::StepEvents;
pub use stepping::theta_gamma::{simulate_theta_gamma, Solver, ThetaGamma};
pub use switched::{
    simulate_switched_rk, Counts, DensePath, Flights, ImpactMap, MapParameter, Motion, Order,
    Output, PathReader, PlotSamples, Return, Samples, SwitchedIntegrator, SwitchedRk, SwitchedRun,
};
pub use system::force::{
    ConstantForce, Dependence, Force, FunctionForce, LinearForce, LinearLaw, LinearRate, Wave,
};
pub use system::force::{HarmonicWall, OnMovingWall, WallMotion};
pub use system::impact_law::{
    AnyImpactLaw, FunctionImpact, ImpactLaw, ParametricLaw, SpeedDependentImpact, TabulatedImpact,
};
pub use system::time_table::{TableForce, TimeTable};
pub use zeno::Tail;
pub use zivi_core::{Branch, Lifted, Physical, Restitution};
