//! The steps of the schemes and the ticks of the controllers, against equations written a second time.

mod common;
mod control;
mod scheme;
