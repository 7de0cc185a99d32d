//! The step of the theta-gamma scheme.

mod jacobian;
mod laws;
mod residual;
mod rest;
mod selection;
mod uniqueness;
