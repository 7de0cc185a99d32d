//! What moves: the force on the mass, the motion of its wall.

pub mod dynamics;
pub(crate) mod evaluation;
pub mod force;
pub mod moving_wall;
pub mod partials;
pub mod slopes;
pub(crate) mod stops;
