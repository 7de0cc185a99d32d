//! The switched Runge-Kutta method against closed forms and stored references.

mod closed;
mod problems;
mod random;
mod references;
