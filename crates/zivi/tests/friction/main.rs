//! Mechanical systems with dry friction.

mod models;
mod references;
