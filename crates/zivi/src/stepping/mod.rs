//! Methods of fixed steps, and the loop that drives them.

pub mod ballistic;
pub mod explicit;
pub mod fixed_step;
pub(crate) mod implicit;
pub mod moreau_jean;
pub mod step_events;
pub mod step_solver;
pub mod theta_gamma;
