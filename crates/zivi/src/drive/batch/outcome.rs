//! Saved data of one run of a batch.

use zivi_core::Physical;

use crate::record::columns::{Columns, Quantity};
use crate::{Events, Grid, Impact, SetupError, Status, Summary, Tail};

/// Choice of the saved data of each run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Save<'a> {
    /// The last state, counts of events, rest time.
    #[default]
    Final,
    /// The same, and the largest position and speed of all samples.
    Statistics,
    /// The same as [`Save::Final`], and every event.
    Events,
    /// The same as [`Save::Final`], and whether the run passed a grazing that its tolerances
    /// decided (the switched method only).
    Grazing,
    /// The data of [`Save::Final`], the first sample and every n-th after it (n >= 1).
    Every(usize),
    /// The same as [`Save::Final`], and the states at these times, increasing and within the span
    /// (the switched method only).
    At(&'a [f64]),
    /// The same as [`Save::Final`], and the samples of these steps, increasing numbers, with `s`
    /// and `v` (methods of fixed steps only).
    Steps(&'a [usize]),
}

impl Save<'_> {
    /// Samples from one that is saved to the next, 0 if none is.
    pub(super) fn every(self) -> usize {
        match self {
            Save::Every(every) => every,
            _ => 0,
        }
    }
}

/// Sampled positions and velocities of one run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Saved {
    /// Distances from the wall (m).
    pub x: Vec<f64>,
    /// Velocities (m/s).
    pub xdot: Vec<f64>,
    /// Transformed positions (m), with [`Save::Steps`].
    pub s: Vec<f64>,
    /// Transformed velocities (m/s), with [`Save::Steps`].
    pub v: Vec<f64>,
}

impl Saved {
    pub(super) fn with_room(every: usize, grid: Grid) -> Result<Self, SetupError> {
        let room = samples(every, grid);
        Ok(Self { x: with_room(room)?, xdot: with_room(room)?, ..Self::default() })
    }

    /// The first sample and every n-th after it.
    pub(super) fn every(columns: &Columns, every: usize) -> Result<Self, SetupError> {
        let of = |quantity| thinned(columns.of(quantity), every);
        Ok(Self { x: of(Quantity::X)?, xdot: of(Quantity::Xdot)?, ..Self::default() })
    }

    /// The samples of these steps, as far as the run went.
    pub(super) fn steps(columns: &Columns, steps: &[usize]) -> Result<Self, SetupError> {
        let of = |quantity| -> Result<Vec<f64>, SetupError> {
            let values = columns.of(quantity);
            let mut list = with_room(steps.len())?;
            list.extend(steps.iter().map_while(|&step| values.get(step)));
            Ok(list)
        };
        Ok(Self {
            x: of(Quantity::X)?,
            xdot: of(Quantity::Xdot)?,
            s: of(Quantity::S)?,
            v: of(Quantity::V)?,
        })
    }

    pub(super) fn push(&mut self, x: f64, xdot: f64) {
        self.x.push(x);
        self.xdot.push(xdot);
    }
}

/// Number of samples kept, every n-th, none for `0`.
pub(super) fn samples(every: usize, grid: Grid) -> usize {
    grid.n_steps().checked_div(every).map_or(0, |it| it + 1)
}

fn with_room(room: usize) -> Result<Vec<f64>, SetupError> {
    let mut list = Vec::new();
    list.try_reserve_exact(room).map_err(|_| SetupError::Memory(room))?;
    Ok(list)
}

/// The first value and every n-th after it, none for `0`.
pub(super) fn thinned(values: &[f64], every: usize) -> Result<Vec<f64>, SetupError> {
    if every == 0 {
        return Ok(Vec::new());
    }
    let mut list = with_room(values.len().div_ceil(every))?;
    list.extend(values.iter().step_by(every));
    Ok(list)
}

/// Result of one run.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// The last state and the extremes (the extremes only with [`Save::Statistics`]).
    pub summary: Summary,
    /// How it ended.
    pub status: Status,
    /// Evaluations of the force.
    pub nfev: u64,
    /// Number of impacts, of Zeno points, of lift-offs, and of impacts that were resolved.
    pub counts: [u64; 4],
    /// Time of the first impact (s), NaN without one.
    pub first_impact: f64,
    /// Time of the last impact (s), NaN without one.
    pub last_impact: f64,
    /// Time of the last impact that was resolved (s), NaN without one.
    pub last_resolved: f64,
    /// Largest speed before an impact (m/s), 0 without one.
    pub hardest_impact: f64,
    /// Time from which the mass rests until the end (s), NaN if it does not.
    pub rest_time: f64,
    /// Whether it passed a grazing that its tolerances decided, with [`Save::Grazing`].
    pub grazing: bool,
    /// The events, with [`Save::Events`]; impacts are those that were resolved.
    pub events: Option<Events>,
    /// The impacts, with [`Save::Events`].
    pub impacts: Vec<Impact>,
    /// The samples, with [`Save::Every`].
    pub saved: Saved,
}

impl Outcome {
    /// Of a run from `initial` at `t` of which nothing is left.
    pub(super) fn lost(
        t: f64,
        Physical { x, xdot }: Physical,
        status: Status,
        save: Save<'_>,
    ) -> Self {
        let summary = Summary { t, x, xdot, ..Summary::default() };
        let none = (Events::default(), [].as_slice());
        Self::new(none, Saved::default(), summary, (status, 0), (save, 0.0))
    }

    /// `slowest` is the part of the fastest impact down to which impacts are counted.
    pub(super) fn new(
        (mut events, tails): (Events, &[Tail]),
        saved: Saved,
        summary: Summary,
        (status, nfev): (Status, u64),
        (save, slowest): (Save<'_>, f64),
    ) -> Self {
        // what is kept of many runs takes no more room than it needs
        events.impacts.shrink_to_fit();
        events.zeno_times.shrink_to_fit();
        events.liftoff_times.shrink_to_fit();
        let time = |impact: Option<&Impact>| impact.map_or(f64::NAN, |impact| impact.t);
        let hardest = |so_far: f64, impact: &Impact| so_far.max(-impact.xdot_before);
        let count = |it: usize| it as u64;
        let hardest_impact = events.impacts.iter().fold(0.0, hardest);
        let listed =
            ListedImpacts { speed: slowest * hardest_impact, resolved: &events.impacts, tails };
        let (n_impacts, last_impact) = listed.count();
        Self {
            summary,
            status,
            nfev,
            counts: [
                count(n_impacts),
                count(events.zeno_times.len()),
                count(events.liftoff_times.len()),
                count(events.impacts.len()),
            ],
            first_impact: listed.first(),
            last_impact,
            last_resolved: time(events.impacts.last()),
            hardest_impact,
            rest_time: events.rest_time.unwrap_or(f64::NAN),
            grazing: false,
            impacts: if save == Save::Events { listed.impacts() } else { Vec::new() },
            events: (save == Save::Events).then_some(events),
            saved,
        }
    }
}

/// The impacts with at least a speed before them (m/s), resolved or skipped by a jump to rest.
struct ListedImpacts<'a> {
    speed: f64,
    resolved: &'a [Impact],
    tails: &'a [Tail],
}

impl ListedImpacts<'_> {
    fn fast(&self) -> impl DoubleEndedIterator<Item = &Impact> {
        self.resolved.iter().filter(|it| -it.xdot_before >= self.speed)
    }

    /// The time of the first (s), which is a resolved one; NaN without one.
    fn first(&self) -> f64 {
        self.fast().next().map_or(f64::NAN, |it| it.t)
    }

    /// Their number, and the time of the last (s), NaN without one.
    fn count(&self) -> (usize, f64) {
        let last = self.fast().next_back().map_or(f64::NAN, |it| it.t);
        let skipped = self.tails.iter().map(|tail| tail.count_down_to(self.speed));
        skipped
            .filter(|(count, _)| *count > 0)
            .fold((self.fast().count(), last), |(sum, last), (count, t)| (sum + count, last.max(t)))
    }

    fn impacts(&self) -> Vec<Impact> {
        let skipped = self.tails.iter().flat_map(|tail| {
            let count = tail.count_down_to(self.speed).0;
            tail.impacts_down_to(0.0, count)
        });
        let mut all: Vec<Impact> = self.fast().copied().chain(skipped).collect();
        all.sort_by(|one, two| one.t.total_cmp(&two.t));
        all
    }
}

/// Why a batch gave nothing.
#[derive(Clone, Debug, PartialEq)]
pub enum BatchError<E> {
    /// The member of this number, or a common setting, is out of range.
    Setup(Option<usize>, SetupError),
    /// The monitor wants to stop.
    Raised(E),
}
