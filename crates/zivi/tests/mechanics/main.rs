//! Mechanical systems with several coordinates and gaps.

mod chains;
mod closed_forms;
mod laws;
mod lift_off;
mod limits;
mod line;
mod models;
mod physics;
mod problems;
mod random;
mod references;
mod sensitivity;
mod time_stepping;
