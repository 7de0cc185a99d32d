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
mod decide;
mod impact;
mod limits;
mod restitution;

use crate::record::failure::Failure;
use crate::Status;

pub(super) use decide::decide;
pub(super) use impact::Collision;
pub(super) use limits::Limit;

/// Why the equations of contact have no unique solution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Undetermined {
    /// The force of a contact follows from the others.
    Contacts,
    /// More than one force of sticking contacts.
    Stick,
    /// The border of Painlevé's paradox.
    Painleve,
}

impl<E> From<Undetermined> for Failure<E> {
    fn from(why: Undetermined) -> Self {
        Failure::Status(match why {
            Undetermined::Contacts => Status::RedundantContacts,
            Undetermined::Stick => Status::RedundantStick,
            Undetermined::Painleve => Status::PainleveSingular,
        })
    }
}
