//! The switched Runge-Kutta method against closed forms and stored references.

mod closed;
mod failures;
mod fuzz;
mod landing;
mod orders;
mod pitfalls;
mod problems;
mod random;
mod references;
mod sampled;
mod units;
mod watching;
mod zeno;
