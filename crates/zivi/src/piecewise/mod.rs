//! Methods that advance segment by segment, each up to an event at most: one run loop for them, and one
//! loop over the steps of a flight.

pub(crate) mod flight;
pub(crate) mod running;
pub(crate) mod steps;
