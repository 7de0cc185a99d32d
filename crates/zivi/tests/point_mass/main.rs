//! One mass: ballistic flights, the fixed-step schemes, batches, closed loops, moving walls.

mod ballistic;
mod batch;
mod closed_loop;
mod fixed_steps;
mod implicit;
mod moreau_jean;
mod moving_wall;
mod new_scheme;
