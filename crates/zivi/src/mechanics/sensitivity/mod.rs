//! Derivatives of a run of a mechanical system by its initial state, the coefficients of restitution
//! and parameters: through impacts, Zeno points, sliding contact and lift-off.
//!
//! ```text
//! flight, contact   columns (dq, dq') of the equations of motion, in the steps of the run
//! impact            dz+ = R_z dz- + (R_z F- + R_t - F+) dt        R the impact, dt its shift
//! Zeno point        the table of times and states, differentiated: dz = D z_inf - F dt_inf
//! lift-off          dt = -dlambda/lambda', no jump of the columns
//! ```

mod columns;
mod compliant;
mod exact;
mod friction;
mod impacts;
mod modes;
mod run;
mod variational_run;

pub use crate::switched::sensitivity::{Derivatives, EventRates, Question};
pub use columns::{FrictionNumber, MechanicalWrt};
pub use run::mechanical_sensitivity;
