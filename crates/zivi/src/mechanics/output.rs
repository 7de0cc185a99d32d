//! What is requested of a run of a mechanical system, and what it leaves.

use crate::system::dynamics::Layout;
use std::collections::TryReserveError;

use super::path::MechanicalPath;
use crate::record::contact_mode::ContactMode;
use crate::record::occurrence::Occurrence;
use crate::record::point::MotionPoint;
use crate::record::reserve::Reserve;
use crate::{Counts, LocatedEvent, Status, UserEvent};

/// What a run shall give, besides what happens at the gaps.
pub struct MechanicalOutput<'a, E> {
    /// Times of the samples, increasing and within the span. `None`: a sample at the start, at the
    /// end of each step, after each event at a gap, and at the end.
    pub t_eval: Option<&'a [f64]>,
    /// Times at which the forces are not smooth (s), increasing.
    pub tstops: &'a [f64],
    /// Without times of samples: only the first of them and that at the end, and how fast the system
    /// was at the others ([`MechanicalRun::speeds`]). Forces of linear systems are not evaluated there.
    pub ends: bool,
    /// Whether to keep the motion as a function of time.
    pub dense: bool,
    /// Whether to keep of the motion at least the arcs that jumps skip, with the impacts on them.
    pub arcs: bool,
    /// The user's events.
    pub events: Vec<UserEvent<'a, E, MotionPoint>>,
}

impl<E> Default for MechanicalOutput<'_, E> {
    fn default() -> Self {
        let (ends, dense, arcs) = (false, false, false);
        Self { t_eval: None, tstops: &[], ends, dense, arcs, events: Vec::new() }
    }
}

/// Samples of a mechanical system.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MechanicalSamples {
    /// Times (s).
    pub t: Vec<f64>,
    /// `q`, `g`, and what friction adds, `layout.size()` numbers a sample.
    pub x: Vec<f64>,
    /// Their rates, as many.
    pub v: Vec<f64>,
    /// Contact forces and those of friction, `m + p` numbers a sample.
    pub lambda: Vec<f64>,
    /// The closed gaps, and what friction does.
    pub modes: Vec<ContactMode>,
}

impl MechanicalSamples {
    /// Makes room for so many more, of so many coordinates and gaps.
    pub(super) fn make_room(
        &mut self,
        reserve: &mut Reserve,
        count: usize,
        layout: Layout,
    ) -> Result<(), TryReserveError> {
        const ASIDE: usize = size_of::<f64>();
        reserve.room(&mut self.t, count, ASIDE)?;
        reserve.room(&mut self.x, count * layout.size(), ASIDE)?;
        reserve.room(&mut self.v, count * layout.size(), ASIDE)?;
        reserve.room(&mut self.lambda, count * layout.rows(), ASIDE)?;
        reserve.room(&mut self.modes, count, layout.rows())
    }

    pub(super) fn push(
        &mut self,
        t: f64,
        (x, v): (&[f64], &[f64]),
        lambda: &[f64],
        mode: ContactMode,
    ) {
        self.t.push(t);
        self.x.extend_from_slice(x);
        self.v.extend_from_slice(v);
        self.lambda.extend_from_slice(lambda);
        self.modes.push(mode);
    }
}

/// The largest `|q'_i|` at the ends of steps, of a run that keeps no samples there.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Speeds {
    /// When something last happened at the gaps or to friction, or the start (s).
    pub since: f64,
    /// From the start on.
    pub fastest: f64,
    /// From then on.
    pub fastest_since: f64,
}

/// The speeds of a run under way.
#[derive(Clone, Copy, Debug)]
pub(super) struct SpeedLog {
    pub(super) speeds: Speeds,
    /// The last time that was looked at, and the speed there.
    last: (f64, f64),
    /// How many occurrences are known.
    known: usize,
}

impl SpeedLog {
    pub(super) fn from(t0: f64) -> Self {
        let speeds = Speeds { since: t0, ..Speeds::default() };
        Self { speeds, last: (t0, 0.0), known: 0 }
    }

    /// A time, the velocities there and what happened up to it.
    pub(super) fn note(&mut self, t: f64, velocities: &[f64], occurrences: &[Occurrence]) {
        let speed = velocities.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
        let Self { speeds, last, known } = self;
        for it in occurrences.iter().skip(*known) {
            let is_aside = matches!(it, Occurrence::Contact { .. } | Occurrence::Flag { .. });
            if !is_aside && it.t() > speeds.since {
                speeds.since = it.t();
                speeds.fastest_since = if last.0 >= it.t() { last.1 } else { 0.0 };
            }
        }
        *known = occurrences.len();
        *last = (t, if last.0 == t { speed.max(last.1) } else { speed });
        speeds.fastest = speeds.fastest.max(speed);
        speeds.fastest_since = speeds.fastest_since.max(speed);
    }
}

/// A run of a mechanical system.
#[derive(Clone, Debug, PartialEq)]
pub struct MechanicalRun<E> {
    /// How many coordinates and gaps there are.
    pub layout: Layout,
    /// Samples.
    pub samples: MechanicalSamples,
    /// How fast the system was, where only the ends were sampled.
    pub speeds: Option<Speeds>,
    /// What happened at the gaps, in order.
    pub occurrences: Vec<Occurrence>,
    /// The user's events, by function.
    pub hits: Vec<Vec<LocatedEvent<MotionPoint>>>,
    /// The motion as a function of time, if it was asked for.
    pub path: Option<MechanicalPath>,
    /// How the run ended.
    pub status: Status,
    /// The error that the system, an event or the monitor raised.
    pub raised: Option<E>,
    /// How much work was done.
    pub counts: Counts,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn speeds_count_from_the_last_occurrence_on_and_at_it() {
        let mut log = SpeedLog::from(0.5);
        let zeno = |t| Occurrence::LiftOff { t, gap: 0 };
        let flag = Occurrence::Contact { t: 9.0, gap: 0 };
        let mut occurrences = vec![];
        let mut told = |t, v: f64, new: &[Occurrence]| {
            occurrences.extend_from_slice(new);
            log.note(t, &[v, -0.1], &occurrences);
            let Speeds { since, fastest, fastest_since } = log.speeds;
            [since, fastest, fastest_since]
        };
        assert_eq!(told(0.5, -3.0, &[]), [0.5, 3.0, 3.0]);
        assert_eq!(told(1.0, 2.0, &[]), [0.5, 3.0, 3.0]);
        // that at the time of an occurrence counts, whichever was first
        assert_eq!(told(1.0, 1.0, &[zeno(1.0), flag]), [1.0, 3.0, 2.0]);
        assert_eq!(told(1.5, 4.0, &[]), [1.0, 4.0, 4.0]);
        assert_eq!(told(2.0, 0.5, &[zeno(1.7)]), [1.7, 4.0, 0.5]);
        assert_eq!(told(2.5, 0.0, &[zeno(1.6)]), [1.7, 4.0, 0.5]);
    }

    #[test]
    fn room_is_made_for_every_number_of_the_samples() {
        let (mut samples, mut reserve) = (MechanicalSamples::default(), Reserve::default());
        samples.make_room(&mut reserve, 100, Layout::smooth(4, 3)).unwrap();
        let MechanicalSamples { t, x, v, lambda, modes } = &samples;
        let rooms = [t.capacity(), x.capacity(), v.capacity(), lambda.capacity(), modes.capacity()];
        let needed = [100, 700, 700, 300, 100];
        assert!(rooms.iter().zip(needed).all(|(room, n)| *room >= n), "{rooms:?}");
    }
}
