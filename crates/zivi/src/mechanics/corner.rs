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

use super::corner_log::{landing, pattern, time_of_corner, CornerLog};
use super::kinetics::Model;
use super::machine::Machine;
use super::mode::Ahead;
use crate::record::failure::Failure;
use crate::record::gap_set::GapSet;
use crate::system::dynamics::Dynamics;
use crate::zeno::table::Landing;

/// Speeds below which a corner is reached whatever the pattern: relative to `1 + |q'|`, and in
/// tolerances.
const FLOOR: (f64, f64) = (1e-12, 1e-2);

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
