//! Mechanical systems: force on the mass, motion of its wall, impact law.

pub mod dynamics;
pub mod force;
pub mod impact_law;
pub mod linear_dynamics;
pub mod linear_system;
pub mod partials;
pub mod slopes;
pub mod time_table;
pub mod tree;
