//! Dry friction of a mechanical system.
//!
//! ```text
//! rows R = [N_C; B_S]    columns C = M^-1 [N_i - sum_slip mu sigma B; B_S]^T    S sticks       (1)
//! K = R C      K (lambda, f_S) = -(R A + (h, k))      q'' = A + C (lambda, f_S)
//! ```
//!
//! with `A = M^-1 (F - sum_joints L sigma B^T)`. `K` is not symmetric: its columns are edges of the
//! cone of friction. Where a contact slips and `det K <= 0` no motion obeys the law, or several do
//! (Painlevé's paradox).

mod contact;
mod coulomb;
mod decide;
mod impact;
mod local;
mod restitution;

pub(crate) use contact::{Edges, LimitLevel};
pub(crate) use decide::decide;
pub(crate) use impact::Collision;
pub(crate) use local::{LocalContact, LocalSlip};
