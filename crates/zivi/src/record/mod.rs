//! What a run leaves: samples, events at the wall, how it ended.

pub mod columns;
pub mod contact_mode;
pub mod dense_step;
pub(crate) mod event_locator;
pub mod events;
pub mod failure;
pub mod gap_set;
pub mod impact;
pub mod monitor;
pub mod occurrence;
pub mod point;
pub(crate) mod recorder;
pub(crate) mod reserve;
pub mod status;
pub mod stored;
pub mod summary;
pub mod trajectory;
pub mod user_events;
pub mod values;
