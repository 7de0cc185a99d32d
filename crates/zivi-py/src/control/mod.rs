//! The controllers as Python classes: a tick is one call with plain numbers.

mod arguments;
mod explicit;
mod reference;
mod regulator;
mod tracker;

pub(crate) use explicit::Explicit;
pub(crate) use regulator::Regulator;
pub(crate) use tracker::Tracker;
