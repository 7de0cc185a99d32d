//! Mechanical systems with dry friction.

mod closed_forms;
mod impacts;
mod models;
mod random;
mod references;
mod time_stepping;
