//! Mechanical systems with several coordinates and gaps.

mod laws;
mod limits;
mod models;
mod physics;
mod problems;
mod random;
mod references;
mod sensitivity;
mod time_stepping;
