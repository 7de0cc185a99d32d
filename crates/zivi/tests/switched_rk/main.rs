//! The switched Runge-Kutta method against closed forms and stored references.

mod problems;
mod references;
