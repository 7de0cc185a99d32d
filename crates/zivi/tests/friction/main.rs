//! Mechanical systems with dry friction.

mod closed_forms;
mod models;
mod references;
