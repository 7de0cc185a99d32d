//! Accumulations of several gaps at once.
//!
//! They are self-similar: impacts, or impacts that open contacts, repeat in a pattern, and times
//! and states of one phase of it approach the corner in powers of a ratio `r` that is in general
//! none of the `e`. So it is measured,
//!
//! ```text
//! r = (t_3 - t_2)/(t_2 - t_1)      S^(j) = (S_k^(j-1) - r^j S_(k-1)^(j-1))/(1 - r^j)     (1)
//! ```
//!
//! An inexact `r` costs no order: its error is of the order of the speeds. Where no pattern shows,
//! `L = 1/2 g' . D^-1 g' + lambda . g`, constant in flight and falling at impacts, tells when what
//! is left of the motion is below the tolerance.

use super::equation::State;
use super::kinetics::Model;
use super::landing::Ahead;
use super::machine::{Machine, COLUMNS};
use crate::numeric::richardson::Powers;
use crate::record::failure::Failure;
use crate::record::gap_set::GapSet;
use crate::system::dynamics::Dynamics;
use crate::zeno::table::{Landing, Table};

/// Longest pattern, in events.
const LONGEST: usize = 6;
/// Periods over which it must repeat.
const REPEATS: usize = 3;
/// Events of one phase in a table: fewest and most.
const PHASE: (usize, usize) = (4, 7);
/// Largest ratio, and how far the last two may differ, relative to `1 - r`.
const RATIO: (f64, f64) = (0.98, 0.1);
/// Speeds below which a corner is reached whatever the pattern: relative to `1 + |q'|`, and in
/// tolerances.
const FLOOR: (f64, f64) = (1e-12, 1e-2);

/// An event of an accumulation.
#[derive(Clone, Debug, PartialEq)]
struct Mark {
    hit: GapSet,
    /// The gaps that were closed, or those that were opened.
    with: GapSet,
    t: f64,
    z: Vec<f64>,
}

impl Mark {
    /// A row of the table (1): the time since `start`, then the state.
    fn row_since(&self, start: f64) -> Vec<f64> {
        std::iter::once(self.t - start).chain(self.z.iter().copied()).collect()
    }
}

/// The last impacts, and the last of them that opened contacts.
#[derive(Clone, Debug, Default)]
pub(super) struct CornerLog {
    impacts: Vec<Mark>,
    openings: Vec<Mark>,
}

impl CornerLog {
    pub(super) fn clear(&mut self) {
        self.impacts.clear();
        self.openings.clear();
    }

    /// Appends an impact.
    pub(super) fn note(&mut self, hit: GapSet, closed: GapSet, opened: GapSet, now: &State) {
        let z = || now.x.iter().chain(&now.xdot).copied().collect();
        append(&mut self.impacts, Mark { hit, with: closed, t: now.t, z: z() });
        if !opened.is_empty() {
            append(&mut self.openings, Mark { hit, with: opened, t: now.t, z: z() });
        }
    }

    /// The gaps of the last impacts.
    fn recent(&self) -> GapSet {
        self.impacts.iter().fold(GapSet::EMPTY, |gaps, mark| gaps.with(mark.hit))
    }
}

fn append(marks: &mut Vec<Mark>, mark: Mark) {
    if marks.len() == LONGEST * PHASE.1 {
        marks.remove(0);
    }
    marks.push(mark);
}

/// The shortest pattern in which several gaps take part: its length and gaps.
fn pattern(marks: &[Mark]) -> Option<(usize, GapSet)> {
    let n = marks.len();
    let same = |a: &Mark, b: &Mark| a.hit == b.hit && a.with == b.with;
    let repeats = |&p: &usize| {
        n > REPEATS * p && (n - (REPEATS - 1) * p - 1..n).all(|k| same(&marks[k], &marks[k - p]))
    };
    let p = (1..=LONGEST).find(repeats)?;
    let gaps = marks[n - p..].iter().fold(GapSet::EMPTY, |set, it| set.with(it.hit));
    (gaps.len() >= 2).then_some((p, gaps))
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
fn time_of_corner(marks: &[Mark]) -> Option<f64> {
    let (p, _) = pattern(marks)?;
    let (phase, r) = of_last_phase(marks, p)?;
    Some(phase[0].t + (phase[0].t - phase[1].t) * r / (1.0 - r))
}

/// Equation (1) for the phase of the last event.
fn landing(marks: &[Mark], p: usize, scales: &[f64]) -> Option<Landing<Vec<f64>>> {
    let (phase, r) = of_last_phase(marks, p)?;
    let first = phase[phase.len() - 1].t;
    let mut table = Table::new(scales.len(), COLUMNS);
    for mark in &phase {
        table.push(&mark.row_since(first));
    }
    let found = table.landing(first, phase[0].t, Powers { ratio: r, first: r }, scales);
    found.filter(|found| found.size <= 1.0)
}

impl Machine {
    /// The corner that the last events approach, if it is known to the tolerance.
    pub(super) fn corner_ahead<E, D: Dynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
    ) -> Result<Option<Ahead>, Failure<E>> {
        let recent = self.gathered.corners.recent();
        if recent.len() < 2 || !self.lose_energy(recent) {
            return Ok(None);
        }
        for of_openings in [false, true] {
            let marks = if of_openings {
                &self.gathered.corners.openings
            } else {
                &self.gathered.corners.impacts
            };
            if marks.last().is_none_or(|last| last.t < self.now.t) {
                continue;
            }
            let Some((p, gaps)) = pattern(marks).filter(|&(_, gaps)| self.lose_energy(gaps)) else {
                continue;
            };
            let rtol = self.settings.rtol;
            let since = self.now.t - marks[0].t;
            let scales = self.scales_with(rtol * since);
            let Some(landing) = landing(marks, p, &scales) else { continue };
            let set = self.contacts.closed.with(gaps);
            if landing.t > self.now.t
                && self.is_clear(&landing, set)
                && self.stays_closed(&landing, set, GapSet::EMPTY, model)?
            {
                return Ok(Some(Ahead { landing, corner: Some(set) }));
            }
        }
        self.floor(recent)
    }

    /// Whether impacts on a set of gaps can accumulate: those on elastic ones keep the energy.
    fn lose_energy(&self, gaps: GapSet) -> bool {
        gaps.iter().any(|i| self.e[i] < 1.0)
    }

    /// A speed below all tolerances.
    pub(super) fn slow(&self) -> f64 {
        let w = &self.now.xdot[..self.layout.n];
        let speed = w.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        FLOOR.0.max(FLOOR.1 * self.settings.rtol) * (1.0 + speed)
    }

    /// The corner where the system is, if the speeds in it are below all tolerances.
    fn floor<E>(&mut self, recent: GapSet) -> Result<Option<Ahead>, Failure<E>> {
        let (n, m) = (self.layout.n, self.layout.m);
        let slow = self.slow();
        let (x, v) = (&self.now.x[n..], &self.now.xdot[n..]);
        let near = |&i: &usize| {
            let low = 2.0 * x[i] * self.kinetics.b(i).abs() <= slow * slow;
            self.contacts.closed.has(i) || (recent.has(i) && v[i].abs() <= slow && low)
        };
        let set: GapSet = (0..m).filter(near).collect();
        if set.without(self.contacts.closed).is_empty()
            || set.iter().filter(|&i| recent.has(i)).count() < 2
        {
            return Ok(None);
        }
        if self.kinetics.solve(set, |at, i| -at.b(i)).is_err() {
            return Ok(None);
        }
        let mut pressed = self.kinetics.solved()[..set.len()].to_vec();
        if pressed.iter().any(|&force| force <= 0.0) {
            // impacts without end at one instant: they go on until there are no speeds, and then the
            // forces open what they pull
            if !self.touch(set) {
                return Ok(None);
            }
            pressed.fill(0.0);
        }
        let speeds = &self.now.xdot[n..];
        self.kinetics.solve(set, |_, i| speeds[i])?;
        let momenta = self.kinetics.solved()[..set.len()].to_vec();
        let (mut depth, mut widest) = (0.0, 0.0_f64);
        for (row, i) in set.iter().enumerate() {
            depth += 0.5 * speeds[i] * momenta[row] + pressed[row] * self.now.x[n + i];
            widest = widest.max(self.kinetics.d(i, i));
        }
        if (2.0 * depth * widest).sqrt() > slow {
            return Ok(None);
        }
        let z = self.without_speeds(set)?;
        let CornerLog { impacts, openings } = &self.gathered.corners;
        let end = time_of_corner(openings).or_else(|| time_of_corner(impacts));
        let t = end.map_or(self.now.t, |end| end.max(self.now.t));
        let landing = Landing::new(t, &[&[0.0], &z[..]].concat(), 0.0);
        Ok(Some(Ahead { landing, corner: Some(set) }))
    }
}

impl Machine {
    /// Whether all gaps of a set are zero but for rounding.
    fn touch(&self, set: GapSet) -> bool {
        let n = self.layout.n;
        let (q, w) = (&self.now.x[..n], &self.now.xdot[..n]);
        set.iter().all(|i| self.now.x[n + i] <= 8.0 * self.kinetics.rounding(i, q, w).0)
    }
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
        assert_eq!(pattern(&marks), Some((2, GapSet(3))));
        assert_eq!(pattern(&marks[..6]), None);
        let found = landing(&marks, 2, &[1e-5, 1e-5]).unwrap();
        let errors = [(found.t - 2.0).abs(), (found.state()[0] - 1.0).abs()];
        assert!(errors[0] < 1e-6 && errors[1] < 1e-6, "{found:?}");
        assert!(errors[0] <= found.size * 1e-5 && errors[1] <= found.errors()[0], "{found:?}");
        assert_eq!(landing(&marks, 2, &[1e-14, 1e-14]), None);
        // one gap that bounces is a chain, and times without a ratio are no corner
        let alone = |mark: &Mark| Mark { hit: GapSet::of(0), ..mark.clone() };
        assert_eq!(pattern(&marks.iter().map(alone).collect::<Vec<_>>()), None);
        let mut uneven = marks.clone();
        uneven[11].t += 0.5 * (marks[13].t - marks[11].t);
        assert_eq!(landing(&uneven, 2, &[1e9, 1e9]), None);
        // without the table: one geometric series
        let sum = time_of_corner(&marks).unwrap();
        assert!((sum - 2.0).abs() < 1e-5 && marks[13].t < 2.0 - 1e-4, "{sum}");
    }
}
