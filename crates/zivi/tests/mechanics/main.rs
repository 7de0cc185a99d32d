//! Mechanical systems with several coordinates and gaps.

mod models;
mod references;
