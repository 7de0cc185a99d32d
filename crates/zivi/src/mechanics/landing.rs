//! The jump through a Zeno point onto the manifold of more closed gaps.

use super::kinetics::{Kinetics, Model};
use super::machine::Machine;
use super::mode::Ahead;
use super::mode::Key;
use super::piece::Flight;
use super::piece::Piece;
use super::tail::{EndOfArcs, SkippedArcs};
use crate::numeric::bernstein::Bernstein;
use crate::record::failure::Failure;
use crate::record::gap_set::GapSet;
use crate::record::occurrence::Occurrence;
use crate::switched::lookahead::Lookahead;
use crate::switched::stages::Counted;
use crate::system::dynamics::{Dynamics, Layout};
use crate::zeno::bounce::Bounce;
use crate::zeno::table::Landing;
use crate::Force;

/// A jump passes no other gap that is nearer than so many of its estimated errors.
const CLEAR: f64 = 100.0;

impl Machine {
    /// Where the chain ends, if that is known to the tolerance.
    pub(super) fn end_of_chain<E, D: Dynamics<E>>(
        &mut self,
        last: Bounce,
        model: &mut Model<'_, D>,
    ) -> Result<Option<Ahead>, Failure<E>> {
        if self.gathered.chain.is_over() {
            return Ok(self
                .gathered
                .chain
                .leading()
                .map(|landing| Ahead { landing, corner: None }));
        }
        let left = self.gathered.chain.remaining(last);
        let scales = self.scales(last);
        let Some(landing) = self.gathered.chain.landing(&scales) else { return Ok(None) };
        let ahead = landing.t - last.t;
        let key = self.gathered.chain.key();
        let set = key.closed.with(key.hit);
        let known = landing.size <= 1.0 && ahead > 0.0 && ahead < 3.0 * left;
        let sound = known
            && self.is_clear(&landing, set)
            && self.stays_closed(&landing, set, key.closed, model)?
            && self.look_ahead(&landing, scales[0], model)?;
        Ok(sound.then_some(Ahead { landing, corner: None }))
    }

    /// The tolerances of a Zeno time and of the state there.
    pub(super) fn scales(&self, last: Bounce) -> Vec<f64> {
        self.scales_with(self.settings.zeno_tolerance(&self.gathered.chain, last.g))
    }

    /// The same with the tolerance of the time given.
    pub(super) fn scales_with(&self, of_time: f64) -> Vec<f64> {
        let ([atol_x, atol_v], rtol) = (self.settings.atol, self.settings.rtol);
        let of_x = self.now.x.iter().map(|x| atol_x + rtol * x.abs());
        let of_v = self.now.xdot.iter().map(|v| atol_v + rtol * v.abs());
        std::iter::once(of_time).chain(of_x).chain(of_v).collect()
    }

    /// Whether the gaps outside of a set stay open on the way to the landing: the cubic between
    /// both ends stays clear of zero.
    pub(super) fn is_clear(&self, landing: &Landing<Vec<f64>>, set: GapSet) -> bool {
        let (n, m) = (self.layout.n, self.layout.m);
        let (h, z, errors) = (landing.t - self.now.t, landing.state(), landing.errors());
        (0..m).filter(|&k| !set.has(k)).all(|k| {
            let (c, error) = (n + k, errors[n + k]);
            let (first, last) = (self.now.x[c], z[c]);
            let (slope, end) = (h * self.now.xdot[c], h * z[n + m + c]);
            let p = Bernstein::hermite((first, slope), (last, end));
            p.coefficients().iter().all(|&c| c > CLEAR * error)
        })
    }

    /// Whether the forces keep all gaps of a set closed along the way to the landing, and those
    /// that stay closed while another one bounces also without it, and under its impacts.
    pub(super) fn stays_closed<E, D: Dynamics<E>>(
        &mut self,
        landing: &Landing<Vec<f64>>,
        set: GapSet,
        meanwhile: GapSet,
        model: &mut Model<'_, D>,
    ) -> Result<bool, Failure<E>> {
        let (Layout { n, m }, z) = (self.layout, landing.state());
        for part in [0.25, 0.5, 0.75, 1.0] {
            let on_the_way = |from: &[f64], to: &[f64]| -> Vec<f64> {
                from.iter().zip(to).map(|(a, b)| a + part * (b - a)).collect()
            };
            let q = on_the_way(&self.now.x[..n], &z[..n]);
            let w = on_the_way(&self.now.xdot[..n], &z[n + m..][..n]);
            let t = self.now.t + part * (landing.t - self.now.t);
            match self.aside.evaluate(model, t, &q, &w) {
                Err(Failure::Status(_)) => return Ok(false),
                evaluated => evaluated?,
            }
            if self.aside.contact(set).is_err() {
                return Ok(false);
            }
            let at = &mut self.aside;
            let pushes = |at: &mut Kinetics, i: usize| {
                // bodies in free fall touch without a force
                let none =
                    if self.contacts.closed.has(i) { -at.noise(i) / at.d(i, i) } else { 0.0 };
                at.lambda[i] > none || (self.contacts.closed.has(i) && at.lambda[i] >= none)
            };
            if !set.iter().all(|i| pushes(at, i)) {
                return Ok(false);
            }
            if at.contact(meanwhile).is_err() || !meanwhile.iter().all(|i| pushes(at, i)) {
                return Ok(false);
            }
            if !meanwhile.is_empty() && !at.impacts_press(set.without(meanwhile), meanwhile)? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Whether the forces make the arcs that a jump would skip: they are put back into the
    /// equation of the bouncing gap.
    fn look_ahead<E, D: Dynamics<E>>(
        &mut self,
        landing: &Landing<Vec<f64>>,
        tolerance: f64,
        model: &mut Model<'_, D>,
    ) -> Result<bool, Failure<E>> {
        let key = self.gathered.chain.key();
        let set = key.closed.with(key.hit);
        let Some(gap) = key.hit.iter().next() else { return Ok(false) };
        let (t, state) = (self.now.t, self.without_bounce(key)?);
        let first = self.end_of_arcs(t, state, set, key.hit, model)?;
        let last = self.end_of_arcs(landing.t, landing.state().to_vec(), set, key.hit, model)?;
        let arcs = SkippedArcs::of_chain(&self.gathered.chain, landing.t, [first, last]);
        let Some(tail) = &arcs.arcs else { return Ok(false) };
        let (e, max_step) = (self.gathered.chain.e(), self.settings.max_step);
        let ahead = Lookahead { tail, e, tolerance, max_step, period: None };
        let mut pull = AlongArcs::new(&arcs, (key.closed, gap), &mut self.aside, model);
        let obstacle = &mut self.gathered.obstacle;
        *obstacle = ahead.obstacle(*obstacle, &mut Counted::new(&mut pull))?;
        Ok(obstacle.is_none())
    }

    /// Gives the arcs of a jump the accelerations of the bouncing gap at their ends.
    fn bend<E, D: Dynamics<E>>(
        &mut self,
        arcs: &mut SkippedArcs,
        key: Key,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let (Some(gap), Some(mut tail)) = (key.hit.iter().next(), arcs.arcs.take()) else {
            return Ok(());
        };
        let mut pull = AlongArcs::new(arcs, (key.closed, gap), &mut self.aside, model);
        Counted::new(&mut pull).bend(&mut tail)?;
        arcs.arcs = Some(tail);
        Ok(())
    }

    /// Through the rest of an accumulation, onto the manifold.
    pub(super) fn jump<E, D: Dynamics<E>>(
        &mut self,
        Ahead { landing, corner }: Ahead,
        model: &mut Model<'_, D>,
    ) -> Result<Piece, Failure<E>> {
        let key = self.gathered.chain.key();
        let mut set = corner.unwrap_or(key.closed.with(key.hit));
        let (start, before) = (self.now.t, self.contacts.closed);
        let piece = if corner.is_some() {
            let (closed, flights) = self.move_into_corner(&landing, set, model)?;
            set = closed;
            Piece::Descent(flights)
        } else {
            let state = self.without_bounce(key)?;
            let first = self.end_of_arcs(start, state, set, key.hit, model)?;
            let speeds = self.now.xdot.clone();
            set = self.move_to(&landing, set, model)?;
            let state = [&self.now.x[..], &self.now.xdot[..]].concat();
            let mut last = self.end_of_arcs(self.now.t, state, set, GapSet::EMPTY, model)?;
            last.way = self.way(set, key.hit, &speeds)?;
            let ends = [first, last];
            let mut arcs = SkippedArcs::of_chain(&self.gathered.chain, self.now.t, ends);
            if self.now.t > self.dense_from {
                self.bend(&mut arcs, key, model)?;
            }
            Piece::Skipped(arcs)
        };
        self.contacts = self.settle(set)?;
        self.refresh()?;
        let t = self.now.t;
        if corner.is_some() {
            self.occurrences.push(Occurrence::Corner { t, gaps: set });
            self.gathered.corners.clear();
        } else {
            let zeno = |gap| Occurrence::Zeno { t, gap, closed: set };
            self.occurrences.extend(set.without(before).iter().map(zeno));
        }
        self.note_lifted(self.contacts.left);
        self.gathered.chain.clear();
        (self.gathered.impacts, self.gathered.obstacle) = (0, None);
        Ok(piece)
    }

    /// The gaps that are closed to rounding with those of a set, where the system has just been
    /// evaluated. If the set determines them they never move, and no impact would tell.
    fn closed_along(&mut self, set: GapSet) -> GapSet {
        let Layout { n, m } = self.layout;
        let [of_x, of_v] = self.settings.atol.map(|atol| f64::EPSILON * atol);
        let (q, w) = (&self.now.x[..n], &self.now.xdot[..n]);
        let touches = |&i: &usize| {
            let (of_gap, of_rate) = self.kinetics.rounding(i, q, w);
            let (gap, rate) = (self.kinetics.gap(i), self.kinetics.rate(i, w));
            !set.has(i) && gap.abs() <= of_gap + of_x && rate.abs() <= of_rate + of_v
        };
        let more: GapSet = (0..m).filter(touches).collect();
        for i in more.iter() {
            (self.now.x[n + i], self.now.xdot[n + i]) = (0.0, 0.0);
        }
        more
    }

    /// To where the gaps of a set are closed, and maybe others with them: all of these. The system
    /// is evaluated there.
    fn move_to<E, D: Dynamics<E>>(
        &mut self,
        landing: &Landing<Vec<f64>>,
        set: GapSet,
        model: &mut Model<'_, D>,
    ) -> Result<GapSet, Failure<E>> {
        let (n, size) = (self.layout.n, self.layout.n + self.layout.m);
        (self.now.t, self.now.late) = (landing.t.max(self.now.t), 0.0);
        let (x, xdot) = landing.state().split_at(size);
        self.now.x.copy_from_slice(x);
        self.now.xdot.copy_from_slice(xdot);
        for i in set.iter() {
            (self.now.x[n + i], self.now.xdot[n + i]) = (0.0, 0.0);
        }
        self.project(set, model)?;
        Ok(set.with(self.closed_along(set)))
    }

    /// To the corner of a set: what is closed there, and the way, if it is asked for.
    fn move_into_corner<E, D: Dynamics<E>>(
        &mut self,
        landing: &Landing<Vec<f64>>,
        set: GapSet,
        model: &mut Model<'_, D>,
    ) -> Result<(GapSet, Vec<Flight>), Failure<E>> {
        let rim = match landing.t > self.dense_from {
            true => Some(self.rim(set)?),
            false => None,
        };
        let closed = self.move_to(landing, set, model)?;
        let flights = match rim {
            Some(rim) => self.descent(&rim, self.slow(), model)?,
            None => Vec::new(),
        };
        Ok((closed, flights))
    }

    /// One end of the arcs that a jump skips: the motion in contact, and which way the bouncing
    /// gaps move the system out of it.
    pub(super) fn end_of_arcs<E, D: Dynamics<E>>(
        &mut self,
        t: f64,
        state: Vec<f64>,
        set: GapSet,
        bouncing: GapSet,
        model: &mut Model<'_, D>,
    ) -> Result<EndOfArcs, Failure<E>> {
        let n = self.layout.n;
        let (x, v) = state.split_at(n + self.layout.m);
        self.aside.evaluate(model, t, &x[..n], &v[..n])?;
        self.aside.contact(set)?;
        let acceleration = self.aside.accelerations();
        let speeds = self.now.xdot.clone();
        let way = self.way(set, bouncing, &speeds)?;
        Ok(EndOfArcs { x: x.to_vec(), v: v.to_vec(), acceleration, way })
    }

    /// The direction in which the bouncing gaps, at the given speeds, move coordinates and gaps
    /// from where the system was last evaluated aside.
    fn way<E>(
        &mut self,
        set: GapSet,
        bouncing: GapSet,
        speeds: &[f64],
    ) -> Result<Vec<f64>, Failure<E>> {
        let Layout { n, m } = self.layout;
        let mut way = vec![0.0; n + m];
        let Some(last) = self.gathered.chain.bounces().last().filter(|_| !bouncing.is_empty())
        else {
            return Ok(way);
        };
        let part = |i: usize| if bouncing.has(i) { speeds[n + i] / last.u } else { 0.0 };
        self.aside.solve(set, |_, i| part(i))?;
        self.aside.apply(set, &mut way[..n]);
        for k in 0..m {
            way[n + k] = if set.has(k) { part(k) } else { self.aside.passed_on(k, set) };
        }
        Ok(way)
    }

    pub(super) fn note_lifted(&mut self, gaps: GapSet) {
        let t = self.now.t;
        self.occurrences.extend(gaps.iter().map(|gap| Occurrence::LiftOff { t, gap }));
    }
}

/// The acceleration of the bouncing gap along the arcs of a jump, as the force of a scalar motion.
struct AlongArcs<'r, 'm, D> {
    arcs: &'r SkippedArcs,
    kinetics: &'r mut Kinetics,
    model: &'r mut Model<'m, D>,
    closed: GapSet,
    component: usize,
    n: usize,
    x: Vec<f64>,
    v: Vec<f64>,
}

impl<'r, 'm, D> AlongArcs<'r, 'm, D> {
    /// Of a gap while those of a set stay closed.
    fn new(
        arcs: &'r SkippedArcs,
        (closed, gap): (GapSet, usize),
        kinetics: &'r mut Kinetics,
        model: &'r mut Model<'m, D>,
    ) -> Self {
        let Layout { n, m } = kinetics.layout;
        let [x, v] = [(); 2].map(|()| vec![0.0; n + m]);
        Self { arcs, kinetics, model, closed, component: n + gap, n, x, v }
    }
}

impl<E, D: Dynamics<E>> Force<E> for AlongArcs<'_, '_, D> {
    fn at(&mut self, t: f64, y: f64, u: f64) -> Result<f64, E> {
        self.arcs.combine(t, (y, u), &mut self.x, &mut self.v);
        match self.kinetics.evaluate(self.model, t, &self.x[..self.n], &self.v[..self.n]) {
            Err(Failure::Raised(error)) => return Err(error),
            Err(Failure::Status(_)) => return Ok(f64::NAN),
            Ok(()) => (),
        }
        Ok(match self.kinetics.contact(self.closed) {
            Ok(()) => self.kinetics.acceleration[self.component],
            Err(_) => f64::NAN,
        })
    }
}
