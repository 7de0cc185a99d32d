//! What is saved of one run of a batch.

use crate::trajectory::{Columns, Quantity};
use crate::{Events, Grid, Impact, Status, Summary};

use super::Save;

/// Sampled positions and velocities of one run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Saved {
    /// Distances from the wall (m).
    pub x: Vec<f64>,
    /// Velocities (m/s).
    pub xdot: Vec<f64>,
}

impl Saved {
    pub(super) fn with_room(every: usize, grid: Grid) -> Self {
        let room = grid.n_steps().checked_div(every).map_or(0, |it| it + 1);
        Self { x: Vec::with_capacity(room), xdot: Vec::with_capacity(room) }
    }

    /// The first sample and every so many after it.
    pub(super) fn every(columns: &Columns, every: usize) -> Self {
        let of = |quantity| columns.of(quantity).iter().step_by(every).copied().collect();
        Self { x: of(Quantity::X), xdot: of(Quantity::Xdot) }
    }

    pub(super) fn push(&mut self, x: f64, xdot: f64) {
        self.x.push(x);
        self.xdot.push(xdot);
    }
}

/// The end of one run and what happened in it.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// The last state and the extremes (the extremes only with [`Save::Statistics`]).
    pub summary: Summary,
    /// How it ended.
    pub status: Status,
    /// Evaluations of the force.
    pub nfev: u64,
    /// Number of impacts that were resolved, of Zeno points and of lift-offs.
    pub counts: [u64; 3],
    /// Time of the first and of the last impact (s), NaN without one.
    pub first_impact: f64,
    /// Time of the last impact (s), NaN without one.
    pub last_impact: f64,
    /// Largest speed before an impact (m/s), 0 without one.
    pub hardest_impact: f64,
    /// Time from which the mass rests until the end (s), NaN if it does not.
    pub rest_time: f64,
    /// The events, with [`Save::Events`].
    pub events: Option<Events>,
    /// The samples, with [`Save::Every`].
    pub saved: Saved,
}

impl Outcome {
    pub(super) fn new(
        events: Events,
        saved: Saved,
        summary: Summary,
        (status, nfev): (Status, u64),
        save: Save,
    ) -> Self {
        let time = |impact: Option<&Impact>| impact.map_or(f64::NAN, |impact| impact.t);
        let hardest = |so_far: f64, impact: &Impact| so_far.max(-impact.xdot_before);
        let count = |it: usize| it as u64;
        Self {
            summary,
            status,
            nfev,
            counts: [
                count(events.impacts.len()),
                count(events.zeno_times.len()),
                count(events.liftoff_times.len()),
            ],
            first_impact: time(events.impacts.first()),
            last_impact: time(events.impacts.last()),
            hardest_impact: events.impacts.iter().fold(0.0, hardest),
            rest_time: events.rest_time.unwrap_or(f64::NAN),
            events: (save == Save::Events).then_some(events),
            saved,
        }
    }
}
