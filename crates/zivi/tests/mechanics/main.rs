//! Mechanical systems with several coordinates and gaps.

mod laws;
mod lift_off;
mod limits;
mod models;
mod physics;
mod problems;
mod random;
mod references;
mod sensitivity;
mod time_stepping;
