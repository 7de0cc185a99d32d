//! What moves: the force on the mass, the motion of its wall, what an impact does.

pub mod driven;
pub mod dynamics;
pub(crate) mod evaluation;
pub mod force;
pub mod friction;
pub mod impact_law;
pub mod linear_dynamics;
pub mod linear_partials;
pub mod linear_system;
pub mod moving_wall;
pub mod partials;
pub mod slopes;
pub(crate) mod stops;
pub mod time_table;
pub mod tree;
