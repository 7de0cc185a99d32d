//! Impacts, and what follows from them.
//!
//! On the set `C` of the gaps that are zero, closed ones and those that are hit, with the speeds `g-` before,
//!
//! ```text
//! g+ = g- + D P      0 <= P  perp  g+ + e g- >= 0      q'+ = q'- + M^-1 N_C^T P          (1)
//! ```
//!
//! Energy never rises, whatever the `e_i`: `E+ - E- = 1/2 sum_(P_i > 0) (1 - e_i) P_i g-_i <= 0`.

use super::contact_problem::problem;
use super::kinetics::{without_rounding, Model};
use super::lcp;
use super::machine::Machine;
use super::mode::Key;
use super::mode::Next;
use super::piece::Piece;
use crate::record::failure::Failure;
use crate::record::gap_set::GapSet;
use crate::record::occurrence::{FlagKind, Occurrence};
use crate::system::dynamics::{Dynamics, Layout};
use crate::zeno::bounce::{restored, Bounce};
use crate::Status;

/// Gaps with a kinetic cosine above this are coupled.
const COUPLED: f64 = 1e-9;
/// A coupled gap that would be hit within so many tolerances of the time has no certain order.
const UNCERTAIN: f64 = 100.0;
/// The last flight must have been so many times longer.
const LONGER: f64 = 1e3;

/// A speed below this part of that of the impact is none.
const STILL: f64 = 1e-12;

impl Machine {
    /// The impact on the gaps `hit` at the present state, and what follows from it: which gaps
    /// are closed, whether the impacts accumulate.
    pub(super) fn strike<E, D: Dynamics<E>>(
        &mut self,
        hit: GapSet,
        model: &mut Model<'_, D>,
    ) -> Result<Piece, Failure<E>> {
        let (n, before) = (self.layout.n, self.contacts.closed);
        self.kinetics.evaluate(model, self.now.t, &self.now.x[..n], &self.now.xdot[..n])?;
        let touched = self.touched(hit);
        let set = before.with(hit).with(touched);
        self.kinetics.solve(set, |_, _| 0.0)?;
        self.note_flags(hit);
        let positive = self.exchange(set, hit)?;
        self.project(set, model)?;
        let touching: GapSet = set.iter().filter(|&i| self.now.xdot[n + i] == 0.0).collect();
        self.contacts = self.settle(touching)?;
        let closed = self.contacts.closed;
        self.refresh()?;
        self.note_changes(before, hit, touching);
        self.last_impact = self.now.t;
        self.gathered.impacts += 1;
        let key = Key { hit, closed: before };
        let all_hit = hit.iter().all(|i| positive.has(i));
        if closed == before && all_hit && touched.is_empty() {
            self.weigh(key, model)?;
        } else {
            self.gathered.chain.clear();
        }
        let opened = before.without(closed).without(hit);
        self.gathered.corners.note(hit, before, opened, &self.now);
        if let Next::Step(_) = self.next {
            self.next = Next::jump(self.corner_ahead(model)?);
        }
        Ok(Piece::Instant)
    }

    /// The open gaps that are zero without a speed, but for rounding, where others are hit: they have
    /// just been left. Without them the impact would be passed on to them and back, again and again.
    fn touched(&self, hit: GapSet) -> GapSet {
        let Layout { n, m } = self.layout;
        let (q, w) = (&self.now.x[..n], &self.now.xdot[..n]);
        let fastest = hit.iter().fold(0.0_f64, |v, i| v.max(-self.now.xdot[n + i]));
        let touches = |&i: &usize| {
            let (gap, rate) = (self.now.x[n + i], self.now.xdot[n + i]);
            gap <= 8.0 * self.kinetics.rounding(i, q, w).0 && rate.abs() <= STILL * fastest
        };
        let open = (0..m).filter(|&i| !hit.with(self.contacts.closed).has(i));
        open.filter(touches).collect()
    }

    /// Speeds after the impact, equation (1); the gaps with an impulse.
    fn exchange<E>(&mut self, set: GapSet, hit: GapSet) -> Result<GapSet, Failure<E>> {
        let n = self.layout.n;
        for i in set.iter() {
            let v = &mut self.now.xdot[n + i];
            *v = if hit.has(i) { v.min(0.0) } else { 0.0 };
        }
        let (speeds, e) = (&self.now.xdot[n..], &self.e);
        let (matrix, right) = problem(&mut self.kinetics, set, |_, i| (1.0 + e[i]) * speeds[i]);
        let solution = lcp::solve(&matrix, &right);
        let solution = solution.ok_or(Failure::Status(Status::ImpactNotSolved))?;
        self.group += 1;
        self.counts.impacts += 1;
        let before: Vec<f64> = self.now.xdot[n..].to_vec();
        let mut positive = GapSet::EMPTY;
        for k in 0..self.layout.m {
            let change: f64 = set
                .iter()
                .zip(&solution.z)
                .map(|(i, p)| if *p == 0.0 { 0.0 } else { self.kinetics.coupling(k, i) * p })
                .sum();
            let row = set.iter().position(|i| i == k);
            let after = match row {
                Some(row) if solution.positive.has(row) => {
                    positive = positive.with(GapSet::of(k));
                    restored(self.e[k], before[k])
                }
                Some(_) => (before[k] + change).max(restored(self.e[k], before[k])),
                None => before[k] + change,
            };
            self.now.xdot[n + k] = after;
            if let Some(row) = row.filter(|_| hit.has(k) || positive.has(k)) {
                let (t, group, impulse) = (self.now.t, self.group, solution.z[row]);
                let (gap, before) = (k, before[k]);
                self.occurrences.push(Occurrence::Impact { t, gap, before, after, impulse, group });
            }
        }
        Ok(positive)
    }

    /// Coupled gaps that are hit together, or might be hit in another order.
    fn note_flags(&mut self, hit: GapSet) {
        let (n, t) = (self.layout.n, self.now.t);
        let mut strongest = 0.0_f64;
        for i in hit.iter() {
            for j in hit.iter().filter(|&j| j < i) {
                strongest = strongest.max(self.kinetics.cosine(i, j).abs());
            }
        }
        if strongest > COUPLED {
            let kind = FlagKind::Simultaneous;
            self.occurrences.push(Occurrence::Flag { kind, t, gaps: hit, size: strongest });
        }
        let flight = t - self.last_impact;
        let near = (UNCERTAIN * self.settings.rtol).min(1.0 / LONGER) * flight;
        for j in (0..self.layout.m).filter(|&j| !hit.with(self.contacts.closed).has(j)) {
            let (x, v) = (self.now.x[n + j], self.now.xdot[n + j]);
            let later = -x / v;
            let coupled = hit.iter().any(|i| self.kinetics.cosine(i, j).abs() > COUPLED);
            if v < 0.0 && later <= near && coupled {
                let (kind, gaps) = (FlagKind::OrderUncertain, hit.with(GapSet::of(j)));
                self.occurrences.push(Occurrence::Flag { kind, t, gaps, size: later });
            }
        }
    }

    /// Notes the gaps that closed and opened by an impact.
    fn note_changes(&mut self, before: GapSet, hit: GapSet, touching: GapSet) {
        let (t, closed) = (self.now.t, self.contacts.closed);
        for gap in closed.without(before).iter() {
            self.occurrences.push(Occurrence::Zeno { t, gap, closed });
        }
        for gap in before.without(closed).without(hit).iter() {
            self.occurrences.push(if touching.has(gap) {
                Occurrence::LiftOff { t, gap }
            } else {
                Occurrence::Opened { t, gap }
            });
        }
        if closed != before {
            self.gathered.impacts = 0;
        }
    }

    /// Appends an impact to its chain, and looks for the end of that.
    fn weigh<E, D: Dynamics<E>>(
        &mut self,
        key: Key,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let n = self.layout.n;
        let Some(first) = key.hit.iter().next() else { return Ok(()) };
        let e = self.e[first];
        let alike = key.hit.iter().all(|i| self.e[i] == e);
        if !(alike && e > 0.0 && e < 1.0 && self.now.xdot[n + first] > 0.0) {
            self.gathered.chain.clear();
            return Ok(());
        }
        let z = self.without_bounce(key)?;
        let (x, v) = z.split_at(n + self.layout.m);
        self.aside.evaluate(model, self.now.t, &x[..n], &v[..n])?;
        self.aside.contact(key.closed)?;
        let least =
            key.hit.iter().map(|i| -self.aside.acceleration[n + i]).fold(f64::INFINITY, f64::min);
        let g = if least > 0.0 { -self.aside.acceleration[n + first] } else { least };
        self.aside.contact(key.closed.with(key.hit))?;
        let mut rates = v.to_vec();
        rates.append(&mut self.aside.accelerations());
        let bounce = Bounce { t: self.now.t, u: self.now.xdot[n + first], g };
        self.gathered.chain.turn_to(key, e);
        self.gathered.chain.note(bounce, &z, &rates)?;
        if g > 0.0 {
            self.next = Next::jump(self.end_of_chain(bounce, model)?);
        }
        Ok(())
    }

    /// The state with the speeds of the bouncing gaps taken out, along the impulses: that from
    /// which they would stay closed.
    pub(super) fn without_bounce<E>(&mut self, key: Key) -> Result<Vec<f64>, Failure<E>> {
        self.without_speeds(key.closed.with(key.hit))
    }

    /// The same for any set of gaps.
    pub(super) fn without_speeds<E>(&mut self, set: GapSet) -> Result<Vec<f64>, Failure<E>> {
        let n = self.layout.n;
        let (mut x, mut v) = (self.now.x.clone(), self.now.xdot.clone());
        // twice: the first leaves rounding of the speeds
        for _ in 0..2 {
            let w = &v[..n];
            self.kinetics.solve(set, |at, i| -at.rate(i, w))?;
            self.kinetics.apply(set, &mut v[..n]);
        }
        without_rounding(&mut v[..n], &self.now.xdot);
        let speeds = &self.now.xdot[n..];
        self.kinetics.solve(set, |_, i| -speeds[i])?;
        for k in 0..self.layout.m {
            v[n + k] = if set.has(k) { 0.0 } else { v[n + k] + self.kinetics.passed_on(k, set) };
        }
        for i in set.iter() {
            x[n + i] = 0.0;
        }
        x.append(&mut v);
        Ok(x)
    }
}
