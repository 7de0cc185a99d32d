//! The impacts of gaps that are hit again and again while the same others stay closed, and the jump
//! through the Zeno point onto the manifold on which they rest.

use crate::impact::corner_descent::COLUMNS;
use crate::kinetics::mode::Key;
use crate::kinetics::{Kinetics, Model};
use crate::motion::one_coordinate::Pull;
use crate::motion::propagation::PullAlongArcs;
use crate::motion::state::MechanicalState;
use crate::motion::tail::{
    scales, through, Correction, EndOfArcs, InPowers, Mechanism, PartOfArc, SkippedArcs,
    StoppedSlip, ORDERS, POINTS,
};
use crate::record::gap_set::{ContactMode, GapSet};
use crate::record::status::Failure;
use crate::switched::accumulation::{Deviation, Lookahead};
use crate::switched::flight::series::Linear;
use crate::switched::mode::Counted;
use crate::switched::{accumulation, SwitchedRk};
use crate::system::dynamics::{Dynamics, Layout};
use crate::zeno::arc::Bounce;
use crate::zeno::chain::Chain;
use crate::zeno::table::ExtrapolatedEnd;
use crate::zeno::tail::ROUNDINGS;
use crate::{Dependence, Force};

/// The forces of a linear system without tables change like a line in this part of the time of the fastest
/// mode or load.
const SHORT: f64 = 1.0 / 64.0;
/// Largest number of corrections of extrapolated flights, until this part of the tolerances
/// is left.
const PASSES: usize = 8;
const LEFT: f64 = 0.05;
/// Weights of the integral over a flight at [`POINTS`].
const WEIGHTS: [f64; 4] = [1.0 / 12.0, 5.0 / 12.0, 5.0 / 12.0, 1.0 / 12.0];

/// The last impacts of one kind.
#[derive(Clone, Debug)]
pub(crate) struct ImpactChain {
    chain: Chain<Vec<f64>, Key>,
    /// Where the forces last kept the system from jumping to the end of it.
    obstacle: Option<Deviation>,
    /// The shortest period of the forces, if that is known (s).
    period: Option<f64>,
    /// The force on the bouncing gap, for one gap of one coordinate.
    alone: Option<Linear>,
    /// The state after an impact without the speeds of the bouncing gaps, and its rates in contact.
    z: Vec<f64>,
    rates: Vec<f64>,
}

impl ImpactChain {
    /// For these numbers of coordinates and gaps.
    pub(crate) fn new(size: usize) -> Self {
        let chain = Chain::new(Key::default(), 0.5, 2 * size, COLUMNS);
        Self { chain, obstacle: None, period: None, alone: None, z: vec![], rates: vec![] }
    }

    /// The impacts.
    pub(crate) fn impacts(&self) -> &Chain<Vec<f64>, Key> {
        &self.chain
    }

    /// Where the forces last kept the system from jumping.
    pub(crate) fn obstacle(&self) -> Option<Deviation> {
        self.obstacle
    }

    /// The forces have no shorter period (s).
    pub(crate) fn set_period(&mut self, period: f64) {
        self.period = Some(period);
    }

    /// Starts a new impact sequence.
    pub(crate) fn clear(&mut self) {
        self.chain.clear();
    }

    /// The same, under other forces or after a jump.
    pub(crate) fn restart(&mut self) {
        self.chain.clear();
        self.obstacle = None;
    }

    /// The mode in which the impact sequence ends.
    fn landed(&self) -> ContactMode {
        self.chain.key().landed
    }

    /// The tolerances of the Zeno time and of the state there.
    pub(crate) fn scales(
        &self,
        settings: &SwitchedRk,
        state: &MechanicalState,
        last: Bounce,
    ) -> Vec<f64> {
        scales(settings, state, settings.zeno_tolerance(&self.chain, last.g))
    }

    /// Whether the impact sequence was followed down to rounding, and friction has a part in where it ends.
    pub(crate) fn is_forced(&self) -> bool {
        self.chain.is_over() && !self.landed().is_frictionless()
    }

    /// Appends an impact, with the acceleration of a single gap towards its wall, if known; returns
    /// the end of the impact sequence, if determined to the tolerance.
    pub(crate) fn note<E, D: Dynamics<E>>(
        &mut self,
        (key, alone): (Key, Option<Pull>),
        at: &mut Mechanism<'_, '_, D>,
    ) -> Result<Option<ExtrapolatedEnd<Vec<f64>>>, Failure<E>> {
        let n = at.aside.coordinates();
        let Some(first) = key.hit.iter().next() else { return Ok(None) };
        let (e, u) = (at.e[first], at.state.gap(first).1);
        let alike = key.hit.iter().all(|i| at.e[i] == e);
        if !(alike && e > 0.0 && e < 1.0 && u > 0.0) {
            self.chain.clear();
            return Ok(None);
        }
        let t = at.state.now().t;
        at.state.without_speeds_to(key.landed, &mut self.z)?;
        let (x, v) = self.z.split_at(self.z.len() / 2);
        let aside = &mut *at.aside;
        aside.evaluate(at.model, t, &x[..n], &v[..n])?;
        aside.turn(&at.state.now().xdot[n..]);
        let g = if key.flight == ContactMode::default() && key.hit.only().is_some() {
            -aside.b(first)
        } else {
            aside.contact(key.flight)?;
            let pull = |i: usize| -aside.acceleration[n + i];
            let least = key.hit.iter().map(pull).fold(f64::INFINITY, f64::min);
            if least > 0.0 {
                pull(first)
            } else {
                least
            }
        };
        if alone.is_some() {
            // those of a mass
            self.chain.set_columns(accumulation::COLUMNS);
        }
        let g = alone.map_or(g, |pull| pull.g);
        self.alone = alone.map(|pull| pull.force);
        aside.contact(key.landed)?;
        self.rates.clear();
        self.rates.extend_from_slice(v);
        aside.append_accelerations(&mut self.rates);
        if let Some(power) = self.rates.get_mut(v.len() + n + aside.layout.rows()) {
            *power = aside.friction_power(key.landed, &v[n..]);
        }
        let bounce = Bounce { t, u, g };
        self.chain.turn_to(key, e);
        self.chain.note(bounce, &self.z, &self.rates)?;
        let is_constant = |force| Force::<E>::dependence(&force) == Dependence::Constant;
        if self.alone.is_some_and(is_constant) && self.chain.end_under_constant_pull().is_some() {
            return Ok(self.chain.leading());
        }
        if g > 0.0 {
            self.end(bounce, at)
        } else {
            Ok(None)
        }
    }

    /// The end of slow impacts outside of a geometric impact sequence, from the sum of the speeds after them, if that is
    /// known to the tolerance: an impact sequence of that duration replaces them.
    ///
    /// A flight lasts `2 u/g`: with the acceleration `g` along the motion in contact they end where `int g/2 dt` is
    /// the sum.
    pub(crate) fn settle<E, D: Dynamics<E>>(
        &mut self,
        (key, sum): (Key, f64),
        at: &mut Mechanism<'_, '_, D>,
    ) -> Result<Option<ExtrapolatedEnd<Vec<f64>>>, Failure<E>> {
        let Some(gap) = key.hit.only() else { return Ok(None) };
        let (t, u) = (at.state.now().t, at.state.gap(gap).1);
        at.state.without_speeds_to(key.landed, &mut self.z)?;
        let start = std::mem::take(&mut self.z);
        let settled = match settled((t, &start), (gap, key, sum), at) {
            Err(Failure::Status(_)) => None,
            settled => settled?,
        };
        self.z = start;
        let Some(Settled { landing, rates, pull, time_error }) = settled else { return Ok(None) };
        self.alone = None;
        let left = landing.t - t;
        let lost = 2.0 * u / (pull * left);
        if !(pull > 0.0 && left > 0.0 && lost < 1.0) {
            return Ok(None);
        }
        self.chain.turn_to(key, 1.0 - lost);
        self.chain.note(Bounce { t, u, g: pull }, &self.z, &rates)?;
        let tolerance = at.settings.zeno_tolerance(&self.chain, pull) + at.settings.rtol * left;
        let scales = scales(at.settings, at.state, tolerance);
        let errors = std::iter::once(&time_error).chain(landing.errors());
        let known = errors.zip(&scales).all(|(error, scale)| error <= scale);
        let sound = known
            && at.is_clear(&landing, key.landed)
            && at.stays_closed(&landing, key.landed, key.flight)?;
        Ok(sound.then_some(landing))
    }

    /// Where the impact sequence ends, if that is known to the tolerance.
    fn end<E, D: Dynamics<E>>(
        &mut self,
        last: Bounce,
        at: &mut Mechanism<'_, '_, D>,
    ) -> Result<Option<ExtrapolatedEnd<Vec<f64>>>, Failure<E>> {
        if self.chain.is_over() {
            return Ok(self.chain.leading());
        }
        let left = self.chain.remaining(last);
        if !self.chain.may_land(at.settings.zeno_tolerance(&self.chain, last.g)) {
            return Ok(None);
        }
        let scales = self.scales(at.settings, at.state, last);
        let Some(landing) = self.chain.landing(&scales) else { return Ok(None) };
        let ahead = landing.t - last.t;
        let key = self.chain.key();
        let known = landing.size <= 1.0 && ahead > 0.0 && ahead < 3.0 * left;
        let sound = known
            && at.is_clear(&landing, key.landed)
            && at.stays_closed(&landing, key.landed, key.flight)?
            && (self.is_short(ahead, at) || self.look_ahead(&landing, scales[0], at)?);
        Ok(sound.then_some(landing))
    }

    /// Whether what is left of the impact sequence is too short for loads and modes to do anything else in it than
    /// over the last impacts.
    fn is_short<E, D: Dynamics<E>>(&self, ahead: f64, at: &Mechanism<'_, '_, D>) -> bool {
        let is_smooth = at.model.dynamics.linear().is_some_and(|system| system.is_smooth());
        let period = self.period.filter(|_| is_smooth && self.alone.is_none());
        self.obstacle.is_none() && period.is_some_and(|period| ahead <= SHORT * period)
    }

    /// Whether the forces make the flights that a jump would skip: they are put back into the
    /// equation of the bouncing gap.
    fn look_ahead<E, D: Dynamics<E>>(
        &mut self,
        landing: &ExtrapolatedEnd<Vec<f64>>,
        tolerance: f64,
        at: &mut Mechanism<'_, '_, D>,
    ) -> Result<bool, Failure<E>> {
        let (key, set) = (self.chain.key(), self.landed());
        let Some(gap) = key.hit.iter().next() else { return Ok(false) };
        let (t, z) = (at.state.now().t, at.state.without_speeds(set)?);
        let speeds = at.state.now().xdot.clone();
        let mut first = at.end_of_arcs(t, &z, set)?;
        first.way = self.way(set, &speeds, at.aside)?;
        let mut last = at.end_of_arcs(landing.t, landing.state(), set)?;
        last.way = self.way(set, &speeds, at.aside)?;
        let arcs = SkippedArcs::of_chain(&self.chain, landing.t, [first, last]);
        let Some(tail) = &arcs.arcs else { return Ok(false) };
        let (e, max_step) = (self.chain.e(), at.settings.max_step);
        let ahead = Lookahead { tail, e, tolerance, max_step, period: self.period };
        let (suspect, smooth) = (self.obstacle, at.model.smooth);
        self.obstacle = if let Some(linear) = self.alone {
            ahead.obstacle(suspect, &mut Counted::known(&mut { linear }, Some(&linear)))?
        } else if let Some(system) = at.model.dynamics.linear().cloned() {
            let of = (key.flight.closed, gap);
            let mut pull = PullAlongArcs::new(system, smooth, &arcs, of, at.aside)?;
            ahead.obstacle(suspect, &mut Counted::new(&mut pull))?
        } else {
            let mut pull = AlongArcs::new(&arcs, (key.flight, gap), at.aside, at.model);
            ahead.obstacle(suspect, &mut Counted::new(&mut pull))?
        };
        Ok(self.obstacle.is_none())
    }

    /// Through the rest of the impact sequence: the flights that this skips, if they end after the first time, with the
    /// motion of the system along them if they end after the second, and the gaps that are closed then.
    pub(crate) fn jump<E, D: Dynamics<E>>(
        &self,
        landing: &ExtrapolatedEnd<Vec<f64>>,
        (dense_from, drawn_from): (f64, f64),
        at: &mut Mechanism<'_, '_, D>,
    ) -> Result<(SkippedArcs, GapSet), Failure<E>> {
        let mut mode = self.landed();
        let zeno = landing.t.max(at.state.now().t);
        if zeno <= dense_from {
            let skipped = SkippedArcs::of_rows(zeno, zeno, vec![]);
            return Ok((skipped, at.move_to(landing, mode)?));
        }
        if zeno <= drawn_from {
            let set = at.move_to(landing, mode)?;
            let now = at.state.now();
            return Ok((SkippedArcs::undrawn(&self.chain, now.t, now.x.len()), set));
        }
        let (start, z) = (at.state.now().t, at.state.without_speeds(mode)?);
        let speeds = at.state.now().xdot.clone();
        let stopped = self.stopped();
        let mut first = at.end_of_arcs(start, &z, mode)?;
        first.way = self.way(mode, &speeds, at.aside)?;
        let from = slip_ways(stopped, mode, at.aside)?;
        let set = at.move_to(landing, mode)?;
        mode.closed = set;
        let mut last = at.end_here(mode)?;
        last.way = self.way(mode, &speeds, at.aside)?;
        let to = slip_ways(stopped, mode, at.aside)?;
        let zeno = at.state.now().t;
        let work = (at.aside.layout.p > 0).then(|| speeds.len() - 1);
        if let Some(c) = work.filter(|_| zeno > start) {
            // a line, which impacts and forces correct
            let (h, before, after) = (zeno - start, speeds[c], last.v[c]);
            let power = (after - before) / h;
            (first.v[c], first.x[c]) = (before, last.x[c] - 0.5 * h * (before + after));
            (first.acceleration[c], last.acceleration[c]) = (power, power);
        }
        let mut arcs = SkippedArcs::of_chain(&self.chain, zeno, [first.clone(), last.clone()]);
        if !stopped.is_empty() {
            let slip = |ways| StoppedSlip { ways, accelerations: Default::default() };
            arcs.slips = from.into_iter().zip(to).map(|(from, to)| slip([from, to])).collect();
            // the slips move the system along the flights, and that the forces on it
            for _ in 0..2 {
                self.slip(&mut arcs, at)?;
                arcs.end_at(&first, &last, work);
            }
        }
        self.bend(&mut arcs, at)?;
        // a coordinate alone goes where its gap does
        if self.alone.is_none() {
            self.correct(&mut arcs, &speeds, at)?;
            arcs.end_at(&first, &last, work);
        }
        Ok((arcs, set))
    }

    /// The channels that slip in flight, and that every impact stops.
    fn stopped(&self) -> GapSet {
        let Key { flight, landed, .. } = self.chain.key();
        landed.stick.without(flight.stick).without(flight.slipping())
    }

    /// Gives the flights of a jump the slips of the channels that impacts stop.
    fn slip<E, D: Dynamics<E>>(
        &self,
        arcs: &mut SkippedArcs,
        at: &mut Mechanism<'_, '_, D>,
    ) -> Result<(), Failure<E>> {
        let (flight, stopped) = (self.chain.key().flight, self.stopped());
        let first_slip = at.aside.coordinates() + at.aside.layout.m;
        let mut accelerations = vec![[vec![], vec![]]; stopped.len()];
        let (numbers, q) = probed(arcs);
        for number in numbers {
            for (end, theta) in [0.0, 1.0].into_iter().enumerate() {
                probe(arcs, (number, theta), flight, at)?;
                for (to, channel) in accelerations.iter_mut().zip(stopped.iter()) {
                    to[end].push(at.aside.acceleration[first_slip + channel]);
                }
            }
        }
        for (slip, values) in arcs.slips.iter_mut().zip(&accelerations) {
            slip.accelerations = [0, 1].map(|end| through(&q, &values[end]));
        }
        Ok(())
    }

    /// Gives the flights of a jump, after an impact at the given rates of the state, what the forces and impacts do
    /// along them, to the tolerance.
    fn correct<E, D: Dynamics<E>>(
        &self,
        arcs: &mut SkippedArcs,
        rates: &[f64],
        at: &mut Mechanism<'_, '_, D>,
    ) -> Result<(), Failure<E>> {
        let scales = scales(at.settings, at.state, 0.0);
        let (has_friction, mut before) = (at.aside.layout.p > 0, f64::INFINITY);
        for pass in 0..PASSES {
            let at_least = if pass == 0 && !has_friction { LEFT } else { 0.0 };
            let Some(next) = self.corrections(arcs, rates, (at_least, &scales[1..]), at)? else {
                break;
            };
            let change = arcs.distance(&next, &scales[1..], &probed(arcs).0);
            if change >= before || change.is_nan() {
                break;
            }
            arcs.corrections = next;
            // they fall by what they did at least
            if change <= LEFT || (before.is_finite() && change * change <= LEFT * before) {
                break;
            }
            before = change;
            self.bend(arcs, at)?;
        }
        Ok(())
    }

    /// Effects of forces and impacts along the extrapolated flights that (1) neglects, if
    /// significant relative to the tolerances.
    fn corrections<E, D: Dynamics<E>>(
        &self,
        arcs: &SkippedArcs,
        rates: &[f64],
        (at_least, scales): (f64, &[f64]),
        at: &mut Mechanism<'_, '_, D>,
    ) -> Result<Option<Vec<Correction>>, Failure<E>> {
        let (Key { hit, flight, landed }, stopped) = (self.chain.key(), self.stopped());
        let (Some(tail), Some(last)) = (&arcs.arcs, self.chain.bounces().last()) else {
            return Ok(None);
        };
        let Layout { n, m, p, .. } = at.aside.layout;
        let (size, slips, whole) = (arcs.rows.len(), n + m, arcs.end - arcs.start);
        let (numbers, q) = probed(arcs);
        let mut values = vec![<[Vec<f64>; POINTS.len()]>::default(); size];
        let mut jumps = vec![vec![]; size];
        for number in numbers {
            let Some(arc) = tail.arc(number) else { break };
            let mut left = vec![[0.0; POINTS.len()]; size];
            let mut end = Probe::default();
            // what rounding of its times makes of the accelerations of a flight
            let times = arc.start.abs().max(arc.end.abs()) / (arc.end - arc.start);
            let rounding = ROUNDINGS * f64::EPSILON * (1.0 + times);
            for (point, theta) in POINTS.into_iter().enumerate() {
                end = probe(arcs, (number, theta), flight, at)?;
                let known = at.aside.acceleration.iter().zip(&end.a);
                for (left, (a, known)) in left.iter_mut().zip(known).take(slips + p) {
                    let most = rounding * a.abs().max(known.abs());
                    left[point] = if (a - known).abs() <= most { 0.0 } else { a - known };
                }
                if p > 0 {
                    let power = at.aside.friction_power(flight, &end.v[n..]);
                    left[size - 1][point] = power - end.a[size - 1];
                }
            }
            // the impact at the end of the flight, and what (1) and the slips make of it
            let bounce = tail.speed_of(number + 1) - arc.incoming;
            let way = self.way(landed, rates, at.aside)?;
            let stops = slip_ways(stopped, landed, at.aside)?;
            let turn = |c: usize| {
                let (now, known) = (way[c], arcs.way(c, end.t));
                let rounding = ROUNDINGS * f64::EPSILON * now.abs().max(known.abs());
                if (now - known).abs() <= rounding {
                    0.0
                } else {
                    now - known
                }
            };
            let mut jump: Vec<f64> = (0..size).map(|c| turn(c) * bounce).collect();
            for ((stop, channel), slip) in stops.iter().zip(stopped.iter()).zip(&arcs.slips) {
                let known = slip.speed(end.part);
                let more: f64 =
                    (0..POINTS.len()).map(|i| WEIGHTS[i] * left[slips + channel][i]).sum();
                let speed = known + more * arc.length;
                for c in 0..size {
                    jump[c] += arcs.part_of_way(&slip.ways, c, end.t) * known - stop[c] * speed;
                }
            }
            if p > 0 {
                let rows = &end.v[slips..];
                let change = |row: usize| match row.checked_sub(m) {
                    None if hit.has(row) => bounce * rates[n + row] / last.u,
                    Some(channel) if stopped.has(channel) => -rows[channel],
                    _ => 0.0,
                };
                let pulls = at.aside.friction_impulses(landed, change)?;
                let after = |channel: usize| {
                    let stop: f64 = stopped
                        .iter()
                        .zip(&stops)
                        .map(|(of, stop)| stop[slips + channel] * rows[of])
                        .sum();
                    rows[channel] + way[slips + channel] * bounce - stop
                };
                let mean = |channel: usize| 0.5 * (rows[channel] + after(channel));
                jump[size - 1] = (0..p).map(|channel| -pulls[channel] * mean(channel)).sum();
            }
            let seen = |c: usize| {
                let rate = left[c].iter().fold(0.0_f64, |most, a| most.max(a.abs())) * whole;
                let rate = rate + jump[c].abs() / (1.0 - self.chain.e());
                rate > at_least * scales[size + c] || rate * whole > at_least * scales[c]
            };
            if at_least > 0.0 && !(0..n).any(seen) {
                return Ok(None);
            }
            for (c, (to, jumps)) in values.iter_mut().zip(&mut jumps).enumerate() {
                to.iter_mut().zip(left[c]).for_each(|(to, left)| to.push(left));
                jumps.push(jump[c]);
            }
        }
        let still = landed.closed.iter().map(|i| n + i);
        let still = still.chain(landed.stick.without(stopped).iter().map(|c| slips + c));
        let still: Vec<usize> = still.collect();
        let of = |c: usize| {
            let series = |values: &[f64], vanishes: bool| -> InPowers {
                if !vanishes {
                    return through(&q, values);
                }
                let parts: Vec<f64> = values.iter().zip(&q).map(|(value, q)| value / q).collect();
                let of: [f64; ORDERS] = through(&q, &parts);
                std::array::from_fn(|k| if k > 0 { of[k - 1] } else { 0.0 })
            };
            // friction works in contact with the whole pull, and along the flights without that
            let vanishes = c < slips + p;
            let points = values[c].each_ref().map(|values| series(values, vanishes));
            let mut accelerations = [[0.0; ORDERS + 1]; POINTS.len()];
            for k in 0..=ORDERS {
                let of_theta: [f64; 4] = through(&POINTS, &points.map(|of| of[k]));
                accelerations.iter_mut().zip(of_theta).for_each(|(a, of)| a[k] = of);
            }
            Correction::new(c, (accelerations, series(&jumps[c], true)), tail)
        };
        Ok(Some((0..size).filter(|c| !still.contains(c)).map(of).collect()))
    }

    /// Gives the flights of a jump the accelerations of the bouncing gap at their ends.
    fn bend<E, D: Dynamics<E>>(
        &self,
        arcs: &mut SkippedArcs,
        at: &mut Mechanism<'_, '_, D>,
    ) -> Result<(), Failure<E>> {
        let key = self.chain.key();
        let (Some(gap), Some(mut tail)) = (key.hit.iter().next(), arcs.arcs.clone()) else {
            return Ok(());
        };
        let row = at.aside.coordinates() + gap;
        let mut pull = |number: usize, theta: f64| {
            probe(arcs, (number, theta), key.flight, at)?;
            Ok::<f64, Failure<E>>(at.aside.acceleration[row])
        };
        match tail.bend_arcs(|number, _| Ok([pull(number, 0.0)?, pull(number, 1.0)?])) {
            Err(Failure::Status(_)) => return Ok(()),
            bent => bent?,
        }
        arcs.arcs = Some(tail);
        Ok(())
    }

    /// The direction in which the bouncing gaps, at the given rates of the state, move coordinates
    /// and gaps from where the system was last evaluated aside.
    fn way<E>(
        &self,
        mode: ContactMode,
        rates: &[f64],
        aside: &mut Kinetics,
    ) -> Result<Vec<f64>, Failure<E>> {
        let (n, bouncing) = (aside.coordinates(), self.chain.key().hit);
        let Some(last) = self.chain.bounces().last() else { return Ok(vec![0.0; rates.len()]) };
        let part = |row: usize| if bouncing.has(row) { rates[n + row] / last.u } else { 0.0 };
        Ok(aside.displacement(mode, part)?)
    }
}

/// The end of impacts that are slower than the tolerance, the rates and the acceleration of the gap at their start, and
/// the error of their time.
struct Settled {
    landing: ExtrapolatedEnd<Vec<f64>>,
    rates: Vec<f64>,
    pull: f64,
    time_error: f64,
}

/// The motion in contact when half the acceleration of a gap has added up to a sum of speeds.
fn settled<E, D: Dynamics<E>>(
    (t, start): (f64, &[f64]),
    (gap, key, sum): (usize, Key, f64),
    at: &mut Mechanism<'_, '_, D>,
) -> Result<Option<Settled>, Failure<E>> {
    /// How well the sum is known.
    const SUM: f64 = 1e-7;
    const ROUNDS: usize = 4;
    let (rates, pull) = pulled((t, start), (gap, key), at)?;
    let mut left = 2.0 * sum / pull;
    for _ in 0..ROUNDS {
        if !(pull > 0.0 && left > 0.0) {
            return Ok(None);
        }
        let (middle, first) = in_contact((t, start), 0.5 * left, (gap, key), at)?;
        let (end, second) = in_contact((t + 0.5 * left, &middle), 0.5 * left, (gap, key), at)?;
        let there = pulled((t + left, &end), (gap, key), at)?.1;
        let change = 2.0 * (sum - first - second) / there;
        if change.abs() > SUM * left {
            left += change;
            continue;
        }
        let (whole, once) = in_contact((t, start), left, (gap, key), at)?;
        let missing = (first + second - once).abs() / (0.5 * there);
        let time_error = missing + SUM * left;
        let row: Vec<f64> = std::iter::once(left).chain(end.iter().copied()).collect();
        let errors = end.iter().zip(&whole).map(|(end, whole)| (end - whole).abs());
        let landing = ExtrapolatedEnd::new(t, &row, 0.0).with_errors(errors);
        return Ok(Some(Settled { landing, rates, pull, time_error }));
    }
    Ok(None)
}

/// The rates of the motion in contact, and the acceleration of the bouncing gap towards its wall.
fn pulled<E, D: Dynamics<E>>(
    (t, z): (f64, &[f64]),
    (gap, key): (usize, Key),
    at: &mut Mechanism<'_, '_, D>,
) -> Result<(Vec<f64>, f64), Failure<E>> {
    let EndOfArcs { v, acceleration, .. } = at.end_of_arcs(t, z, key.landed)?;
    at.aside.contact(key.flight)?;
    let pull = -at.aside.acceleration[at.aside.coordinates() + gap];
    Ok(([v, acceleration].concat(), pull))
}

/// The motion in contact after a time, and half of the acceleration of the gap integrated over it: one step of
/// Runge and Kutta.
fn in_contact<E, D: Dynamics<E>>(
    (t, start): (f64, &[f64]),
    h: f64,
    of: (usize, Key),
    at: &mut Mechanism<'_, '_, D>,
) -> Result<(Vec<f64>, f64), Failure<E>> {
    const STAGES: [(f64, f64); 4] = [(0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)];
    let (mut end, mut half) = (start.to_vec(), 0.0);
    let mut rates = vec![0.0; start.len()];
    for (part, weight) in STAGES {
        let z: Vec<f64> = start.iter().zip(&rates).map(|(z, f)| z + part * h * f).collect();
        let stage = pulled((t + part * h, &z), of, at)?;
        end.iter_mut().zip(&stage.0).for_each(|(end, f)| *end += weight * h / 6.0 * f);
        half += 0.5 * weight * h / 6.0 * stage.1;
        rates = stage.0;
    }
    Ok((end, half))
}

/// The flights of a jump at which the forces are evaluated, and their `e^m`.
fn probed(arcs: &SkippedArcs) -> (Vec<usize>, Vec<f64>) {
    let Some(tail) = &arcs.arcs else { return Default::default() };
    let stride = tail.stride();
    let known = |&i: &usize| tail.arc(i).is_some();
    let numbers: Vec<usize> = (0..ORDERS).map(|i| i * stride).take_while(known).collect();
    let q = numbers.iter().map(|&number| tail.power(number)).collect();
    (numbers, q)
}

/// The state after a part of a flight, and the accelerations of (1) there.
#[derive(Default)]
struct Probe {
    t: f64,
    part: PartOfArc,
    v: Vec<f64>,
    a: Vec<f64>,
}

/// Evaluates the system aside after a part of a flight, with its accelerations in a mode.
fn probe<E, D: Dynamics<E>>(
    arcs: &SkippedArcs,
    (number, theta): (usize, f64),
    mode: ContactMode,
    at: &mut Mechanism<'_, '_, D>,
) -> Result<Probe, Failure<E>> {
    let [mut x, mut v, mut a] = [(); 3].map(|()| vec![0.0; arcs.rows.len()]);
    let Some(part) = arcs.part_of(number, theta) else { return Ok(Probe::default()) };
    let t = arcs.after(part, [&mut x, &mut v, &mut a]).unwrap_or(arcs.end);
    let n = at.aside.coordinates();
    at.aside.evaluate(at.model, t, &x[..n], &v[..n])?;
    at.aside.turn(&v[n..]);
    at.aside.contact(mode)?;
    Ok(Probe { t, part, v, a })
}

/// How a unit of slip in each channel of a set moves coordinates and rows by the impulses of a mode.
fn slip_ways<E>(
    channels: GapSet,
    mode: ContactMode,
    aside: &mut Kinetics,
) -> Result<Vec<Vec<f64>>, Failure<E>> {
    let unit = |row: usize| move |it: usize| f64::from(u8::from(it == row));
    let way = |channel| aside.displacement(mode, unit(aside.row(channel)));
    Ok(channels.iter().map(way).collect::<Result<_, _>>()?)
}

/// The acceleration of the bouncing gap along the flights of a jump, as the force of a scalar motion.
struct AlongArcs<'r, 'm, D> {
    arcs: &'r SkippedArcs,
    kinetics: &'r mut Kinetics,
    model: &'r mut Model<'m, D>,
    mode: ContactMode,
    component: usize,
    n: usize,
    x: Vec<f64>,
    v: Vec<f64>,
}

impl<'r, 'm, D> AlongArcs<'r, 'm, D> {
    /// Of a gap while others stay closed.
    fn new(
        arcs: &'r SkippedArcs,
        (mode, gap): (ContactMode, usize),
        kinetics: &'r mut Kinetics,
        model: &'r mut Model<'m, D>,
    ) -> Self {
        let (Layout { n, .. }, size) = (kinetics.layout, kinetics.layout.size());
        let [x, v] = [(); 2].map(|()| vec![0.0; size]);
        Self { arcs, kinetics, model, mode, component: n + gap, n, x, v }
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
        self.kinetics.turn(&self.v[self.n..]);
        Ok(match self.kinetics.contact(self.mode) {
            Ok(()) => self.kinetics.acceleration[self.component],
            Err(_) => f64::NAN,
        })
    }
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use super::*;
    use crate::mechanics::{simulate_mechanical, MechanicalOutput};
    use crate::record::events::Occurrence;
    use crate::system::dynamics::FunctionDynamics;
    use crate::system::force::{Channel, Friction};
    use crate::system::impact_law::newton_impacts;
    use crate::Silent;

    const E: f64 = 0.6;

    /// A particle that slides in the parabola `y = x^2/2`, with drag along `x` and a spring.
    struct Bowl {
        friction: Friction,
        mu: f64,
    }

    impl Bowl {
        fn new(mu: f64) -> Self {
            let channels = vec![Channel { gap: Some(0), e_t: 0.0 }];
            Self { friction: Friction { channels, ..Friction::default() }, mu }
        }
    }

    impl Dynamics<Infallible> for Bowl {
        fn layout(&self) -> Layout {
            Layout { n: 2, m: 1, p: 1, k: 0 }
        }

        fn friction(&self) -> &Friction {
            &self.friction
        }

        fn evaluate(
            &mut self,
            _: f64,
            q: &[f64],
            w: &[f64],
            out: &mut [f64],
        ) -> Result<(), Infallible> {
            let (x, mu) = (q[0], self.mu);
            let force = [-0.4 * w[0] - 2.0 * x, -9.81 - 0.3 * w[1]];
            out.copy_from_slice(&[
                1.0,
                0.0,
                0.0,
                1.5, // M
                force[0],
                force[1],
                q[1] - x * x / 2.0,
                -x,
                1.0,
                1.0,
                x, // normal, tangent
                -w[0] * w[0],
                w[0] * w[1],
                0.0,
                0.0,
                mu,
                mu,
            ]);
            Ok(())
        }
    }

    /// The errors of time, coordinates and velocities in the first column, from an impact that leaves
    /// the speed `u`, against the end of the accumulation that follows.
    fn first_column(mu: f64, slip: f64, u: f64) -> [f64; 3] {
        let mut bowl = Bowl::new(mu);
        let (x, slope) = (0.5, 0.5);
        // g' = u and w = slip
        let (a, b) = (slip / (1.0 + slope * slope), u / (1.0 + slope * slope));
        let (q, w) = ([x, x * x / 2.0], [a - slope * b, slope * a + b]);
        let settings = SwitchedRk { rtol: 1e-13, atol: [1e-13; 2], ..SwitchedRk::default() };
        let output = MechanicalOutput { dense: true, ..MechanicalOutput::default() };
        let (span, start) = ((0.0, 2.0 * u), (&q[..], &w[..]));
        let run = simulate_mechanical(
            settings,
            &mut bowl,
            &newton_impacts(&[E]).unwrap(),
            span,
            start,
            output,
            &mut Silent,
        )
        .unwrap();
        let zeno = |it: &Occurrence| match *it {
            Occurrence::Zeno { t, .. } => Some(t),
            _ => None,
        };
        let end = run.occurrences.iter().find_map(zeno).unwrap();
        let there = run.path.as_ref().unwrap().at(end).unwrap();

        let (layout, friction) = (bowl.layout(), bowl.friction.clone());
        let mut state = MechanicalState::new(layout, &friction);
        let mut aside = Kinetics::new(layout, &friction);
        let mut model = Model::new(&mut bowl);
        state.start(0.0, start, [0.0; 2], &mut model).unwrap();
        let (gap, channel) = (GapSet::of(0), GapSet::of(0));
        let landed = match slip {
            0.0 => ContactMode { closed: gap, stick: channel, ..ContactMode::default() },
            _ => ContactMode { closed: gap, slip_plus: channel, ..ContactMode::default() },
        };
        let key = Key { hit: gap, flight: ContactMode::default(), landed };
        let (state, aside, model) = (&mut state, &mut aside, &mut model);
        let mut at = Mechanism { settings: &settings, e: &[E], state, aside, model };
        let mut chain = ImpactChain::new(layout.size());
        chain.note((key, None), &mut at).unwrap();
        let row = chain.impacts().row(0);
        let size = layout.size();
        let far = |from: usize, exact: &[f64]| {
            let pairs = row[1 + from..].iter().zip(exact);
            pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
        };
        [(row[0] - end).abs(), far(0, &there.x[..2]), far(size, &there.v[..2])]
    }

    #[test]
    fn the_first_column_is_of_the_second_order_where_contacts_slip_and_stick() {
        // impulses along the normal, and not along the edge of the cone, would make it one of the first
        for (mu, slip) in [(0.3, 1.5), (0.6, 1.0), (0.0, 1.5), (0.9, 0.0)] {
            let errors = [0.01, 0.005].map(|u| first_column(mu, slip, u));
            for of in 0..3 {
                // what sticks has no velocity
                if slip == 0.0 && of == 2 {
                    assert_eq!([errors[0][of], errors[1][of]], [0.0; 2]);
                    continue;
                }
                let order = (errors[0][of] / errors[1][of]).log2();
                assert!((order - 2.0).abs() < 0.05, "{mu} {slip} {of}: {order} {errors:?}");
            }
        }
    }

    /// A particle that slides in the paraboloid `z = (x^2 + y^2)/2`, with drag along `x`.
    struct Dish(Friction);

    impl Dynamics<Infallible> for Dish {
        fn layout(&self) -> Layout {
            Layout { n: 3, m: 1, p: 2, k: 0 }
        }

        fn friction(&self) -> &Friction {
            &self.0
        }

        fn evaluate(
            &mut self,
            _: f64,
            q: &[f64],
            w: &[f64],
            out: &mut [f64],
        ) -> Result<(), Infallible> {
            let ([x, y, z], [u, v, r]) = ([q[0], q[1], q[2]], [w[0], w[1], w[2]]);
            out.fill(0.0);
            (out[0], out[4], out[8]) = (1.0, 1.2, 1.5);
            out[9..12].copy_from_slice(&[-0.4 * u - 2.0 * x, 1.0 - y, -9.81 - 0.3 * r]);
            out[12] = z - 0.5 * (x * x + y * y);
            out[13..22].copy_from_slice(&[-x, -y, 1.0, 1.0, 0.0, x, 0.0, 1.0, y]);
            out[22..25].copy_from_slice(&[-u * u - v * v, u * r, v * r]);
            out[28..32].fill(0.3);
            Ok(())
        }
    }

    #[test]
    fn the_first_column_is_of_the_second_order_where_the_slip_turns() {
        let channels = vec![Channel { gap: Some(0), e_t: 0.0 }; 2];
        let friction = Friction { channels, ..Friction::default() };
        let mut dish = Dish(friction.clone());
        let (q, tight) = ([0.5, 0.3, 0.17], 1e-13);
        let settings = SwitchedRk { rtol: tight, atol: [tight; 2], ..SwitchedRk::default() };
        let mut column = |u: f64| {
            // g' = u
            let w = [0.7, -1.1, u + 0.5 * 0.7 - 0.3 * 1.1];
            let output = MechanicalOutput { dense: true, ..MechanicalOutput::default() };
            let laws = newton_impacts(&[E]).unwrap();
            let (span, start) = ((0.0, 2.0 * u), (&q[..], &w[..]));
            let run =
                simulate_mechanical(settings, &mut dish, &laws, span, start, output, &mut Silent)
                    .unwrap();
            let zeno = |it: &Occurrence| match *it {
                Occurrence::Zeno { t, .. } => Some(t),
                _ => None,
            };
            let end = run.occurrences.iter().find_map(zeno).unwrap();
            let there = run.path.as_ref().unwrap().at(end).unwrap();
            let layout = dish.layout();
            let mut state = MechanicalState::new(layout, &friction);
            let mut aside = Kinetics::new(layout, &friction);
            let mut model = Model::new(&mut dish);
            state.start(0.0, start, [0.0; 2], &mut model).unwrap();
            let (gap, both) = (GapSet::of(0), GapSet::of(0).with(GapSet::of(1)));
            let landed = ContactMode { closed: gap, slip_plus: both, ..ContactMode::default() };
            let key = Key { hit: gap, flight: ContactMode::default(), landed };
            let (state, aside, model) = (&mut state, &mut aside, &mut model);
            let mut at = Mechanism { settings: &settings, e: &[E], state, aside, model };
            let mut chain = ImpactChain::new(layout.size());
            chain.note((key, None), &mut at).unwrap();
            let row = chain.impacts().row(0);
            let far = |from: usize, exact: &[f64]| {
                let pairs = row[1 + from..].iter().zip(exact);
                pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
            };
            [(row[0] - end).abs(), far(0, &there.x[..3]), far(layout.size(), &there.v[..3])]
        };
        let errors = [0.01, 0.005].map(&mut column);
        for of in 0..3 {
            let order = (errors[0][of] / errors[1][of]).log2();
            assert!((order - 2.0).abs() < 0.05, "{of}: {order} {errors:?}");
        }
    }

    #[test]
    fn only_impacts_of_one_restitution_below_one_are_a_chain() {
        let layout = Layout::smooth(2, 2);
        let unit = [1.0, 0.0, 0.0, 1.0];
        // two masses on floors of their own, which they leave together
        let noted = |e: [f64; 2], u: [f64; 2]| {
            let function = |_: f64, q: &[f64], _: &[f64], out: &mut [f64]| {
                out[layout.mass()].copy_from_slice(&unit);
                out[layout.force()].copy_from_slice(&[-2.0, -2.0]);
                out[layout.gap()].copy_from_slice(q);
                out[layout.gradient()].copy_from_slice(&unit);
                out[layout.curvature()].fill(0.0);
                out[layout.rate()].fill(0.0);
                Ok::<(), Infallible>(())
            };
            let mut masses = FunctionDynamics { layout, function };
            let friction = Friction::none();
            let mut state = MechanicalState::new(layout, friction);
            let mut aside = Kinetics::new(layout, friction);
            let mut model = Model::new(&mut masses);
            state.start(0.0, (&[0.0, 0.0], &u), [0.0; 2], &mut model).unwrap();
            let both = GapSet::of(0).with(GapSet::of(1));
            let landed = ContactMode { closed: both, ..ContactMode::default() };
            let key = Key { hit: both, flight: ContactMode::default(), landed };
            let (state, aside, model) = (&mut state, &mut aside, &mut model);
            let settings = SwitchedRk::default();
            let mut at = Mechanism { settings: &settings, e: &e, state, aside, model };
            let mut chain = ImpactChain::new(layout.size());
            chain.note((key, None), &mut at).unwrap();
            chain.impacts().bounces().len()
        };
        assert_eq!(noted([0.5, 0.5], [1.0, 1.0]), 1);
        for (e, u) in [
            ([0.5, 0.8], [1.0, 1.0]),
            ([1.0, 1.0], [1.0, 1.0]),
            ([0.0, 0.0], [1.0, 1.0]),
            ([0.5, 0.5], [0.0, 1.0]),
        ] {
            assert_eq!(noted(e, u), 0, "{e:?} {u:?}");
        }
    }
}
