//! Counts of the events of a run.

use crate::mechanics::recording::MechanicalRun;
use crate::record::events::Occurrence;
use crate::record::gap_set::GapSet;

/// Most impacts of one accumulation that count.
const MOST: usize = 1_000_000;

/// How often what happened at the gaps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Totals {
    /// Impacts, those of several gaps at one instant as one.
    pub impacts: usize,
    /// When the first of them was (s); NaN without one.
    pub first_impact: f64,
    /// When the last was.
    pub last_impact: f64,
    /// Gaps that came to rest.
    pub zeno: usize,
    /// Contacts that the forces opened.
    pub liftoffs: usize,
    /// Gaps that came to rest together.
    pub corners: usize,
    /// Flags.
    pub flags: usize,
}

impl<E> MechanicalRun<E> {
    /// How often what happened, with the impacts down to a part of the speed of the fastest, also those
    /// that jumps to Zeno points skipped.
    #[must_use]
    pub fn totals(&self, slowest: f64) -> Totals {
        let [first_impact, last_impact] = [f64::INFINITY, f64::NEG_INFINITY];
        let mut all = Totals { first_impact, last_impact, ..Totals::default() };
        let fastest = self.occurrences.iter().fold(0.0_f64, |most, it| match it {
            Occurrence::Impact { before, .. } => most.max(-before),
            _ => most,
        });
        let speed = slowest * fastest;
        let (mut last, mut bounced) = (None, GapSet::EMPTY);
        let mut skipped = self.path.iter().flat_map(|path| &path.skipped).peekable();
        for it in &self.occurrences {
            match *it {
                Occurrence::Impact { t, gap, before, after, group, .. } => {
                    if after > 0.0 {
                        bounced = bounced.with(GapSet::of(gap));
                    }
                    if -before >= speed && last != Some(group) {
                        last = Some(group);
                        all.count((t, t), 1);
                    }
                }
                Occurrence::Zeno { t, gap, .. } => {
                    all.zeno += 1;
                    while skipped.peek().is_some_and(|arcs| arcs.end < t) {
                        skipped.next();
                    }
                    let arcs = skipped.next_if(|arcs| arcs.end == t && speed > 0.0);
                    let tail = arcs.filter(|_| bounced.has(gap)).and_then(|it| it.arcs.as_ref());
                    if let Some(tail) = tail {
                        let (count, end) = tail.count_down_to(speed);
                        all.count((tail.time_of(1), end), count.min(MOST));
                    }
                }
                Occurrence::LiftOff { .. } => all.liftoffs += 1,
                Occurrence::Corner { .. } => all.corners += 1,
                Occurrence::Flag { .. } => all.flags += 1,
                _ => (),
            }
        }
        if all.impacts == 0 {
            (all.first_impact, all.last_impact) = (f64::NAN, f64::NAN);
        }
        all
    }
}

impl Totals {
    fn count(&mut self, (first, last): (f64, f64), count: usize) {
        if count > 0 {
            self.impacts += count;
            self.first_impact = self.first_impact.min(first);
            self.last_impact = self.last_impact.max(last);
        }
    }
}
