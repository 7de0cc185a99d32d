//! Derivatives of a run of the switched method by its initial state, the coefficient of
//! restitution and parameters of the force: through impacts, Zeno points, rest and lift-off.
//!
//! The columns `(dx/dq, dx'/dq)` are carried in the same Runge-Kutta steps; an impact multiplies
//! them by the saltation matrix, a Zeno point has the derivative of its extrapolation, they vanish
//! at rest and are reinitialised at lift-off.

mod columns;
mod correction;
mod flights;
mod impulses;
mod path;
mod run;
mod validity;
mod variational_run;

pub use columns::{Derivatives, EventRates, Question, Wrt};
pub use correction::{correct, Corrected, Hyperplane, Limits, NotCorrected};
pub use flights::{fly_apart, Flight, Flown, IndependentFlights};
pub use impulses::{sequence_equations, ImpactSequence, SequenceEquations};
pub use run::sensitivity;
pub(crate) use validity::Validity;
pub use validity::{Limit, Nearest};
