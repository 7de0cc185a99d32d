//! Results of a run: samples, events at the wall, status.

pub mod columns;
pub mod events;
pub mod gap_set;
pub mod recorder;
pub mod status;
pub mod stored;
pub mod trajectory;
pub mod user_events;
