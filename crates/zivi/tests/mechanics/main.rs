//! Mechanical systems with several coordinates and gaps.

mod models;
mod problems;
mod random;
mod references;
