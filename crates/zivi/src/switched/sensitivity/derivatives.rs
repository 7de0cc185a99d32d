//! What is requested of a run with derivatives, and what is found.

use super::columns::Wrt;
use super::validity::Nearest;

/// What is to be differentiated by what.
#[derive(Clone, Debug)]
pub struct Question<'a, W = Wrt> {
    /// What the columns are derivatives by.
    pub wrt: &'a [W],
    /// Magnitudes of these, positive: the absolute tolerance of a column is that of the state
    /// divided by its magnitude.
    pub sizes: &'a [f64],
    /// Whether the steps are adapted to the errors of the columns too.
    pub controlled: bool,
    /// Times at which the columns are wanted, within the span (s), increasing.
    pub times: &'a [f64],
}

/// The derivatives of the events of a run, for each of them a row of one number a column.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EventRates {
    /// Of the times of the impacts that were computed.
    pub impact_dt: Vec<f64>,
    /// Of the speeds after them.
    pub impact_du: Vec<f64>,
    /// Of the times at which gaps close.
    pub zeno_times: Vec<f64>,
    /// Of the times of the lift-offs.
    pub liftoff_times: Vec<f64>,
}

/// The derivatives of a run of `n` coordinates; a mass above a wall has one, its distance.
#[derive(Clone, Debug, PartialEq)]
pub struct Derivatives {
    /// Of the coordinates at the end of the run, at a fixed time: `n` numbers for each column.
    pub q: Vec<f64>,
    /// Of the velocities at the end.
    pub qdot: Vec<f64>,
    /// Of the events.
    pub events: EventRates,
    /// To first order, how far each may be moved before an event appears or disappears.
    pub radius: Vec<f64>,
    /// The event that limits each.
    pub nearest: Vec<Option<Nearest>>,
    /// Whether an impact, the want of one, or the order of two is decided by the tolerances.
    pub grazing: bool,
    /// Since when there are none: a corner, impacts or lift-offs of coupled gaps at once. Columns
    /// are NaN from there, until the contacts determine the state.
    pub lost_at: Option<f64>,
    /// At each of the times asked for `n` numbers of `dq` for each column, then those of `dq'`; NaN
    /// where the impacts accumulate.
    pub samples: Vec<f64>,
    /// Evaluations of the partial derivatives.
    pub n_slopes: u64,
}
