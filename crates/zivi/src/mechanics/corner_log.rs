//! The last impacts of several gaps, and the corner that they approach.

use std::ops::Deref;

use super::equation::State;
use crate::numeric::richardson::Powers;
use crate::record::gap_set::GapSet;
use crate::zeno::table::{Landing, Table};

/// Columns of the tables of Zeno points after the first: with 4 in 120 random runs 3 % more impacts
/// are needed before the jumps.
pub(super) const COLUMNS: usize = 5;
/// Longest pattern, in events.
const LONGEST: usize = 6;
/// Periods over which it must repeat.
const REPEATS: usize = 3;
/// Events of one phase in a table: fewest and most.
const PHASE: (usize, usize) = (4, 7);
/// Largest ratio, and how far the last two may differ, relative to `1 - r`.
const RATIO: (f64, f64) = (0.98, 0.1);

/// An event of an accumulation.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Mark {
    pub(super) hit: GapSet,
    /// The gaps that were closed, or those that were opened.
    pub(super) with: GapSet,
    pub(super) t: f64,
    pub(super) z: Vec<f64>,
}

impl Mark {
    /// A row of the table (1): the time since `start`, then the state.
    fn row_since(&self, start: f64) -> Vec<f64> {
        std::iter::once(self.t - start).chain(self.z.iter().copied()).collect()
    }
}

/// The last events: older ones are given up together.
#[derive(Clone, Debug, Default)]
pub(super) struct Marks {
    all: Vec<Mark>,
    /// The first that counts.
    first: usize,
    /// The gaps that they hit.
    hit: GapSet,
    /// Memory of others that were given up.
    spare: Vec<Vec<f64>>,
}

impl Deref for Marks {
    type Target = [Mark];

    fn deref(&self) -> &[Mark] {
        &self.all[self.first..]
    }
}

impl Marks {
    const MOST: usize = LONGEST * PHASE.1;

    fn clear(&mut self) {
        if self.all.is_empty() {
            return;
        }
        self.spare.extend(self.all.drain(..).skip(self.first).map(|mark| mark.z));
        (self.first, self.hit) = (0, GapSet::EMPTY);
    }

    fn push(&mut self, hit: GapSet, with: GapSet, now: &State) {
        let (mut z, lost) = if self.len() < Self::MOST {
            (self.spare.pop().unwrap_or_default(), hit)
        } else {
            let oldest = &mut self.all[self.first];
            let taken = (std::mem::take(&mut oldest.z), oldest.hit);
            self.first += 1;
            if self.first == Self::MOST {
                self.all.drain(..self.first);
                self.first = 0;
            }
            taken
        };
        z.clear();
        z.reserve_exact(now.x.len() + now.xdot.len());
        z.extend_from_slice(&now.x);
        z.extend_from_slice(&now.xdot);
        self.all.push(Mark { hit, with, t: now.t, z });
        self.hit = match lost == hit {
            true => self.hit.with(hit),
            false => gaps_of(self),
        };
    }
}

/// The gaps that events hit.
fn gaps_of(marks: &[Mark]) -> GapSet {
    marks.iter().fold(GapSet::EMPTY, |gaps, mark| gaps.with(mark.hit))
}

#[cfg(test)]
impl From<Vec<Mark>> for Marks {
    fn from(all: Vec<Mark>) -> Self {
        Self { hit: gaps_of(&all), all, ..Self::default() }
    }
}

/// The last impacts, and the last of them that opened contacts.
#[derive(Clone, Debug, Default)]
pub(super) struct CornerLog {
    pub(super) impacts: Marks,
    pub(super) openings: Marks,
    /// All gaps that were hit, also by impacts that are no more among the last.
    hit: GapSet,
    /// Impacts between which friction in a joint, or at a contact that stays closed, changes: in a fixed
    /// part of each flight, so that even those of one gap have a ratio of their own.
    kicks: usize,
}

impl CornerLog {
    pub(super) fn clear(&mut self) {
        self.impacts.clear();
        self.openings.clear();
        self.hit = GapSet::EMPTY;
        self.kicks = 0;
    }

    /// The impact that follows is one of those between which friction changes, or is not.
    pub(super) fn note_kick(&mut self, changes: bool) {
        self.kicks = if changes { self.kicks + 1 } else { 0 };
    }

    /// How many gaps take part in an accumulation with a ratio of its own, at least.
    pub(super) fn fewest(&self) -> usize {
        if self.kicks >= PHASE.0 {
            1
        } else {
            2
        }
    }

    /// Appends an impact.
    pub(super) fn note(&mut self, hit: GapSet, closed: GapSet, opened: GapSet, now: &State) {
        self.hit = self.hit.with(hit);
        self.impacts.push(hit, closed, now);
        if !opened.is_empty() {
            self.openings.push(hit, opened, now);
        }
    }

    /// The gaps of the last impacts.
    pub(super) fn recent(&self) -> GapSet {
        self.impacts.hit
    }

    /// The gaps of all impacts.
    pub(super) fn hit(&self) -> GapSet {
        self.hit
    }
}

/// The shortest pattern in which at least so many gaps take part: its length and gaps.
pub(super) fn pattern(marks: &[Mark], fewest: usize) -> Option<(usize, GapSet)> {
    let n = marks.len();
    let same = |a: &Mark, b: &Mark| a.hit == b.hit && a.with == b.with;
    let repeats = |&p: &usize| {
        n > REPEATS * p && (n - (REPEATS - 1) * p - 1..n).all(|k| same(&marks[k], &marks[k - p]))
    };
    let p = (1..=LONGEST).find(repeats)?;
    let gaps = marks[n - p..].iter().fold(GapSet::EMPTY, |set, it| set.with(it.hit));
    (gaps.len() >= fewest).then_some((p, gaps))
}

/// The events of the phase of the last one, that first, and the ratio of their times.
fn of_last_phase(marks: &[Mark], p: usize) -> Option<(Vec<&Mark>, f64)> {
    let phase: Vec<&Mark> = marks.iter().rev().step_by(p).take(PHASE.1).collect();
    if phase.len() < PHASE.0 {
        return None;
    }
    let gap = |k: usize| phase[k].t - phase[k + 1].t;
    let (r, previous) = (gap(0) / gap(1), gap(1) / gap(2));
    let steady = (r - previous).abs() < RATIO.1 * (1.0 - r);
    (r > 0.0 && r < RATIO.0 && steady).then_some((phase, r))
}

/// The sum of the geometric series of the times: where the corner is, without the state.
pub(super) fn time_of_corner(marks: &[Mark], fewest: usize) -> Option<f64> {
    let (p, _) = pattern(marks, fewest)?;
    let (phase, r) = of_last_phase(marks, p)?;
    Some(phase[0].t + (phase[0].t - phase[1].t) * r / (1.0 - r))
}

/// Equation (1) for the phase of the last event.
pub(super) fn landing(marks: &[Mark], p: usize, scales: &[f64]) -> Option<Landing<Vec<f64>>> {
    let (phase, r) = of_last_phase(marks, p)?;
    let first = phase[phase.len() - 1].t;
    let mut table = Table::new(scales.len(), COLUMNS);
    for mark in &phase {
        table.push(&mark.row_since(first));
    }
    let found = table.landing(first, phase[0].t, Powers { ratio: r, first: r }, scales);
    found.filter(|found| found.size <= 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_corner_is_extrapolated_with_the_ratio_of_its_times() {
        // t = 2 - q - 0.2 q^2, z = 1 + q - 0.5 q^2, q = 0.3^k; gaps 0 and 1 in turn
        let mark = |k: i32| {
            let q = 0.3f64.powi(k / 2) * if k % 2 == 0 { 1.0 } else { 0.6 };
            let (hit, with) = (GapSet::of((k % 2) as usize), GapSet::EMPTY);
            Mark { hit, with, t: 2.0 - q - 0.2 * q * q, z: vec![1.0 + q - 0.5 * q * q] }
        };
        let marks: Vec<Mark> = (0..14).map(mark).collect();
        assert_eq!(pattern(&marks, 2), Some((2, GapSet::of_bits(3))));
        assert_eq!(pattern(&marks[..6], 2), None);
        let found = landing(&marks, 2, &[1e-5, 1e-5]).unwrap();
        let errors = [(found.t - 2.0).abs(), (found.state()[0] - 1.0).abs()];
        assert!(errors[0] < 1e-6 && errors[1] < 1e-6, "{found:?}");
        assert!(errors[0] <= found.size * 1e-5 && errors[1] <= found.errors()[0], "{found:?}");
        assert_eq!(landing(&marks, 2, &[1e-14, 1e-14]), None);
        // one gap that bounces is a chain, and times without a ratio are no corner
        let alone = |mark: &Mark| Mark { hit: GapSet::of(0), ..mark.clone() };
        assert_eq!(pattern(&marks.iter().map(alone).collect::<Vec<_>>(), 2), None);
        let mut uneven = marks.clone();
        uneven[11].t += 0.5 * (marks[13].t - marks[11].t);
        assert_eq!(landing(&uneven, 2, &[1e9, 1e9]), None);
        // without the table: one geometric series
        let sum = time_of_corner(&marks, 2).unwrap();
        assert!((sum - 2.0).abs() < 1e-5 && marks[13].t < 2.0 - 1e-4, "{sum}");
    }
}
