//! The switched Runge-Kutta method against closed forms and stored references.

mod closed;
mod orders;
mod problems;
mod random;
mod references;
mod zeno;
