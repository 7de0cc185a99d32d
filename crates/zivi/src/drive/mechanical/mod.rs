//! Sampled control of mechanical systems: one tracker a gap, the rest at right angles to impacts.
//!
//! ```text
//! M q'' = F + B u + N^T lambda      W = N M^-1 N^T      g'' = a + W lambda
//! q'  = M^-1 N^T W^-1 g' + T w      N T = 0             w: no impact changes it
//! ```
//!
//! `kinetics` computes gap coordinates of a state, `allocation` the controls for accelerations,
//! `in_box` controls within limits, `gap_tracker` is the law, `latch` its held contacts,
//! `believed_plant` its model of the plant, `tasks` the task functions, `tracking` the law in a
//! loop, `striker` the law that aims at impacts, `sampled` the operations at a sample.

mod allocation;
mod believed_plant;
mod gap_tracker;
mod kinetics;
mod law_error;
mod reference;
mod sampled;
mod striker;
mod tracking;

pub use allocation::{controls, decoupling_force, Allocation, Limits};
pub use believed_plant::{one_step_each, BelievedPlant, Moved, SentControls, Tasks};
pub use gap_tracker::{
    GapTracker, GapTrackerSettings, GapTrackerState, Latch, Noise, Offsets, EXACT,
};
pub use kinetics::GapKinetics;
pub use law_error::LawError;
pub use reference::{MechanicalReference, ReferenceSample};
pub use sampled::{MechanicalController, MechanicalSensor, Observing, SampledLoop, TickRecord};
pub use striker::{Striker, StrikerSettings, StrikerState, Striking};
pub use tracking::Tracking;
