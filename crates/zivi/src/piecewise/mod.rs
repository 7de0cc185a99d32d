//! Methods that advance piece by piece, each up to an event at most: one run loop for them.

pub(crate) mod method;
pub(crate) mod running;
pub(crate) mod wanted;
