//! The jump through a Zeno point onto the manifold of one more closed gap.

use super::chain::Landing;
use super::gap_set::GapSet;
use super::kinetics::Model;
use super::machine::Machine;
use super::occurrence::Occurrence;
use super::tail::{EndOfArcs, SkippedArcs};
use crate::record::failure::Failure;
use crate::switched::chain::Bounce;
use crate::system::dynamics::{Dynamics, Layout};

impl Machine {
    /// Where the chain ends, if that is known to the tolerance.
    pub(super) fn end_of_chain(&self, last: Bounce) -> Option<Landing> {
        let left = self.chain.times.remaining(last);
        // what is left of the chain is below rounding, of the time or of the speeds
        if left <= 4.0 * f64::EPSILON * last.t.abs() || self.chain.times.is_spent() {
            return Some(self.chain.leading());
        }
        let landing = self.chain.landing(&self.scales(last))?;
        let ahead = landing.t - last.t;
        (landing.size <= 1.0 && ahead > 0.0 && ahead < 3.0 * left).then_some(landing)
    }

    /// The tolerances of a Zeno time and of the state there.
    fn scales(&self, last: Bounce) -> Vec<f64> {
        let ([atol_x, atol_v], rtol) = (self.settings.atol, self.settings.rtol);
        let times = &self.chain.times;
        let of_time = rtol * times.duration() + (atol_x / times.fastest()).min(atol_v / last.g);
        let of_x = self.now.x.iter().map(|x| atol_x + rtol * x.abs());
        let of_v = self.now.v.iter().map(|v| atol_v + rtol * v.abs());
        std::iter::once(of_time).chain(of_x).chain(of_v).collect()
    }

    /// Through the rest of the chain, onto the manifold.
    pub(super) fn jump<E, D: Dynamics<E>>(
        &mut self,
        landing: Landing,
        model: &mut Model<'_, D>,
    ) -> Result<SkippedArcs, Failure<E>> {
        let (n, key) = (self.layout.n, self.chain.key);
        let set = key.closed.with(key.hit);
        let speeds: Vec<f64> = self.now.v[n..].to_vec();
        let bouncing = |i: usize| if key.hit.has(i) { speeds[i] } else { 0.0 };
        let state = self.without_bounce(key)?;
        let first = self.end_of_arcs(state, set, bouncing, model)?;
        (self.now.t, self.now.late) = (landing.t.max(self.now.t), 0.0);
        let (x, v) = landing.z.split_at(n + self.layout.m);
        self.now.x.copy_from_slice(x);
        self.now.v.copy_from_slice(v);
        for i in set.iter() {
            (self.now.x[n + i], self.now.v[n + i]) = (0.0, 0.0);
        }
        self.project(set, model)?;
        let state = [&self.now.x[..], &self.now.v[..]].concat();
        let last = self.end_of_arcs(state, set, bouncing, model)?;
        let arcs = SkippedArcs::new(&self.chain, self.now.t, [first, last]);
        let (closed, left) = self.settle(set)?;
        (self.closed, self.unarmed) = (closed, left);
        self.refresh()?;
        let t = self.now.t;
        for gap in key.hit.iter() {
            self.occurrences.push(Occurrence::Zeno { t, gap, closed: set });
        }
        self.note_lifted(left);
        self.chain.clear();
        self.struck = 0;
        Ok(arcs)
    }

    /// One end of the arcs that a jump skips: the motion in contact, and which way the bouncing
    /// gaps, with these speeds, move the system out of it.
    fn end_of_arcs<E, D: Dynamics<E>>(
        &mut self,
        state: Vec<f64>,
        set: GapSet,
        speeds: impl Fn(usize) -> f64 + Copy,
        model: &mut Model<'_, D>,
    ) -> Result<EndOfArcs, Failure<E>> {
        let Layout { n, m } = self.layout;
        let (x, v) = state.split_at(n + m);
        self.aside.evaluate(model, self.now.t, &x[..n], &v[..n])?;
        self.aside.contact(set)?;
        let acceleration = self.aside.acceleration.clone();
        let unit = self.chain.times.bounces().last().map_or(1.0, |last| last.u);
        self.aside.solve(set, |_, i| speeds(i) / unit)?;
        let mut way = vec![0.0; n + m];
        self.aside.apply(set, &mut way[..n]);
        for k in 0..m {
            way[n + k] = if set.has(k) { speeds(k) / unit } else { self.aside.passed_on(k, set) };
        }
        Ok(EndOfArcs { x: x.to_vec(), v: v.to_vec(), acceleration, way })
    }

    pub(super) fn note_lifted(&mut self, gaps: GapSet) {
        let t = self.now.t;
        self.occurrences.extend(gaps.iter().map(|gap| Occurrence::LiftOff { t, gap }));
    }
}
