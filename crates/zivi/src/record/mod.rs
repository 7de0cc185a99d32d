//! What a run leaves: samples, events at the wall, how it ended.

pub mod events;
pub mod failure;
pub mod monitor;
pub(crate) mod recorder;
pub(crate) mod reserve;
pub mod status;
pub mod summary;
pub mod trajectory;
