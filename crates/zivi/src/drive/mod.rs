//! Runs of many kinds: a sampled controller with its plant, many runs on all cores.

pub mod batch;
pub mod closed_loop;
pub mod mechanical;
mod updates;

pub use updates::{Updates, LATCH_LOST, REFUSED, SATURATED, UNSOLVED};
