//! The steps of the schemes and the updates of the controllers, against equations written a second time.

mod common;
mod control;
mod scheme;
